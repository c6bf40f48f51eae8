// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/test/random_stack.hpp>

namespace telefab {
namespace {

using Bytes = std::vector<std::byte>;

CodecOptions options_for(std::uint64_t seed) {
  return {.coding = seed % 2 ? Coding::Exact : Coding::Curve, .layers_per_chunk = 4};
}

/// Magic and records of a .tfc file, each with its checksum.
std::vector<Bytes> pieces_of(const Bytes& file) {
  std::vector<Bytes> pieces{{file.begin(), file.begin() + 8}};
  for (std::size_t at = 8; at < file.size();) {
    std::size_t length = 9;
    for (unsigned i = 0; i < 4; ++i) length += std::to_integer<std::size_t>(file[at + 1 + i]) << (8 * i);
    pieces.emplace_back(file.begin() + static_cast<std::ptrdiff_t>(at),
                        file.begin() + static_cast<std::ptrdiff_t>(at + length));
    at += length;
  }
  return pieces;
}

enum Damage { Flip, Swap, Drop, Repeat, Splice, Cut, kDamages };

/// Nothing where the damage changed nothing.
std::optional<Bytes> damaged(std::vector<Bytes> pieces, const std::vector<Bytes>& other, Damage kind,
                             std::mt19937_64& rng) {
  const std::size_t at = 1 + rng() % (pieces.size() - 1);
  const auto whole = [](const std::vector<Bytes>& from) {
    Bytes bytes;
    for (const Bytes& piece : from) bytes.insert(bytes.end(), piece.begin(), piece.end());
    return bytes;
  };
  const Bytes before = whole(pieces);
  if (kind == Flip) pieces[at][rng() % pieces[at].size()] ^= static_cast<std::byte>(1U << (rng() % 8));
  if (kind == Swap) std::swap(pieces[at], pieces[1 + rng() % (pieces.size() - 1)]);
  if (kind == Drop) pieces.erase(pieces.begin() + static_cast<std::ptrdiff_t>(at));
  if (kind == Repeat) {
    const Bytes copy = pieces[at];
    pieces.insert(pieces.begin() + static_cast<std::ptrdiff_t>(at), copy);
  }
  if (kind == Splice) pieces[at] = other[at % other.size()];
  Bytes bytes = whole(pieces);
  if (kind == Cut) bytes.resize(rng() % bytes.size());
  if (bytes == before) return std::nullopt;
  return bytes;
}

class TfcDamageProperty : public testing::TestWithParam<std::uint64_t> {};

TEST_P(TfcDamageProperty, RefusesEveryRecordThatWasFlippedSwappedDroppedRepeatedSplicedOrCut) {
  const std::uint64_t seed = GetParam();
  const auto pieces = pieces_of(write_tfc(test::random_stack(seed, 12), options_for(seed)).value());
  const auto other = pieces_of(write_tfc(test::random_stack(seed + 100, 12), options_for(seed)).value());
  ASSERT_EQ(pieces.size(), 6U);  // magic, header, three chunks, end
  std::mt19937_64 rng{seed};
  const char* asked = std::getenv("TELEFAB_DAMAGES");  // more for the record, fewer for every day
  const int rounds = asked ? std::atoi(asked) : 240;
  std::array<int, kDamages> refused{};
  for (int i = 0; i < rounds; ++i) {
    const auto kind = static_cast<Damage>(i % kDamages);
    const auto bytes = damaged(pieces, other, kind, rng);
    if (!bytes) continue;
    const auto read = read_tfc(*bytes);
    ASSERT_FALSE(read) << "damage " << kind << " round " << i;
    EXPECT_EQ(read.error().code, ErrorCode::InvalidInput);
    EXPECT_NE(read.error().what.find("byte "), std::string::npos);
    ++refused[kind];
  }
  for (int kind = 0; kind < kDamages; ++kind) {
    EXPECT_GT(refused[static_cast<std::size_t>(kind)], rounds / kDamages / 2) << kind;
    RecordProperty("refused_" + std::to_string(kind), refused[static_cast<std::size_t>(kind)]);
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, TfcDamageProperty, testing::Range<std::uint64_t>(0, 6));

}  // namespace
}  // namespace telefab
