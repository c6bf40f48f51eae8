// SPDX-License-Identifier: GPL-3.0-or-later
#include "run_deflate.hpp"

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

// RFC 1951 for the blocks, RFC 1950 for the frame around them.

namespace telefab {
namespace {

constexpr std::size_t kLengthBase = 257;
constexpr std::size_t kEndOfBlock = 256;
constexpr std::size_t kLiteralCodes = 286;
constexpr std::size_t kDistanceCodes = 30;
constexpr std::size_t kLongestMatch = 258;
constexpr std::size_t kShortestMatch = 3;
constexpr std::size_t kFarthest = 32768;

struct ExtraBits {
  std::uint16_t code = 0;
  std::uint8_t count = 0;
  std::uint16_t value = 0;
};

/// Code and extra bits of every match length.
constexpr std::array<ExtraBits, kLongestMatch + 1> length_table() {
  std::array<ExtraBits, kLongestMatch + 1> table{};
  std::size_t length = kShortestMatch;
  for (std::uint16_t code = 0; code < 28; ++code) {
    const std::uint8_t extra = code < 8 ? 0 : static_cast<std::uint8_t>((code - 4) / 4);
    for (std::uint16_t value = 0; value < (1U << extra) && length < kLongestMatch; ++value, ++length)
      table[length] = {static_cast<std::uint16_t>(kLengthBase + code), extra, value};
  }
  table[kLongestMatch] = {kLengthBase + 28, 0, 0};
  return table;
}
constexpr auto kLengths = length_table();

ExtraBits distance_code(std::size_t distance) {
  if (distance <= 4) return {static_cast<std::uint16_t>(distance - 1), 0, 0};
  const auto less = static_cast<std::uint32_t>(distance - 1);
  const auto extra = static_cast<std::uint8_t>(std::bit_width(less) - 2);
  const auto code = static_cast<std::uint16_t>(2 * (extra + 1) + ((less >> extra) & 1U));
  return {code, extra, static_cast<std::uint16_t>(less & ((1U << extra) - 1))};
}

/// A literal below 256, else a match: its length above bit 9, in bit 8 whether it is a run.
using Token = std::uint32_t;
constexpr Token kMatch = 256;
constexpr Token kRun = 512;

enum class Source { Run, RowAbove };

/// Literals and matches as they come, with how often each code is needed.
class Tokens {
 public:
  void literal(std::uint8_t value) {
    flush();
    put_literal(value);
  }
  /// `count` bytes equal to those at the source's distance; `bytes` are they.
  void match(Source source, const std::uint8_t* bytes, std::size_t count) {
    if (count_ != 0 && source != source_) flush();
    source_ = source;
    count_ += count;
    last_ = bytes[count - 1];
    before_last_ = count > 1 ? bytes[count - 2] : before_last_;
    // Whole matches are given at once; what is left waits for what follows.
    while (count_ >= kLongestMatch + kShortestMatch) put_match(kLongestMatch), count_ -= kLongestMatch;
  }
  void flush() {
    while (count_ >= kShortestMatch) {
      // Never leave one or two bytes, which would be literals.
      const std::size_t length = count_ <= kLongestMatch ? count_ : std::min(kLongestMatch, count_ - kShortestMatch);
      put_match(length);
      count_ -= length;
    }
    if (count_ == 2) put_literal(before_last_);
    if (count_ >= 1) put_literal(last_);
    count_ = 0;
  }
  [[nodiscard]] const std::vector<Token>& all() const { return tokens_; }
  [[nodiscard]] const std::array<std::uint32_t, kLiteralCodes>& literal_counts() const { return literals_; }
  [[nodiscard]] std::uint32_t runs() const { return runs_; }
  [[nodiscard]] std::uint32_t copies() const { return copies_; }

 private:
  void put_literal(std::uint8_t value) {
    tokens_.push_back(value);
    ++literals_[value];
  }
  void put_match(std::size_t length) {
    const bool run = source_ == Source::Run;
    tokens_.push_back(static_cast<Token>(length << 10U) | kMatch | (run ? kRun : 0));
    ++literals_[kLengths[length].code];
    ++(run ? runs_ : copies_);
  }

  std::vector<Token> tokens_;
  std::array<std::uint32_t, kLiteralCodes> literals_{};
  std::uint32_t runs_ = 0;
  std::uint32_t copies_ = 0;
  Source source_ = Source::Run;
  std::size_t count_ = 0;
  std::uint8_t last_ = 0;
  std::uint8_t before_last_ = 0;
};

std::uint64_t word_at(const std::uint8_t* bytes) {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, sizeof word);
  return word;
}

/// How many of `count` bytes at a and b agree from the first on.
std::size_t agreeing(const std::uint8_t* a, const std::uint8_t* b, std::size_t count) {
  std::size_t i = 0;
  for (; i + 8 <= count; i += 8)
    if (const std::uint64_t differ = word_at(a + i) ^ word_at(b + i))
      return i + static_cast<std::size_t>((std::endian::native == std::endian::little ? std::countr_zero(differ)
                                                                                      : std::countl_zero(differ)) /
                                          8);
  while (i < count && a[i] == b[i]) ++i;
  return i;
}

/// Length-limited Huffman code lengths for `counts`, in place of which codes of no use get 0.
template <std::size_t N>
std::array<std::uint8_t, N> code_lengths(const std::array<std::uint32_t, N>& counts, unsigned longest) {
  std::array<std::uint8_t, N> lengths{};
  std::vector<std::pair<std::uint64_t, std::size_t>> used;
  for (std::size_t i = 0; i < N; ++i)
    if (counts[i] != 0) used.emplace_back(counts[i], i);
  if (used.empty()) return lengths;
  if (used.size() == 1) {
    lengths[used.front().second] = 1;
    return lengths;
  }
  std::sort(used.begin(), used.end());
  // Two queues: leaves by weight, and inner nodes, which come out by weight.
  const std::size_t n = used.size();
  std::vector<std::uint64_t> weight(2 * n - 1);
  std::vector<std::size_t> parent(2 * n - 1);
  for (std::size_t i = 0; i < n; ++i) weight[i] = used[i].first;
  std::size_t leaf = 0, inner = n;
  const auto lightest = [&](std::size_t made) {
    return leaf < n && (inner == made || weight[leaf] <= weight[inner]) ? leaf++ : inner++;
  };
  for (std::size_t made = n; made < 2 * n - 1; ++made) {
    const std::size_t a = lightest(made), b = lightest(made);
    weight[made] = weight[a] + weight[b];
    parent[a] = parent[b] = made;
  }
  std::vector<unsigned> depth(2 * n - 1);
  for (std::size_t i = 2 * n - 2; i-- > 0;) depth[i] = depth[parent[i]] + 1;
  // Too deep leaves are lifted, and others lowered until the code fits again (Kraft's sum is 1).
  std::vector<std::uint32_t> at_depth(longest + 1);
  for (std::size_t i = 0; i < n; ++i) ++at_depth[std::min(depth[i], longest)];
  std::uint64_t sum = 0;
  for (unsigned d = 1; d <= longest; ++d) sum += std::uint64_t{at_depth[d]} << (longest - d);
  for (; sum > std::uint64_t{1} << longest; --sum) {
    unsigned d = longest - 1;
    while (at_depth[d] == 0) --d;
    --at_depth[d];
    at_depth[d + 1] += 2;
    --at_depth[longest];
  }
  std::size_t next = 0;
  for (unsigned d = longest; d > 0; --d)
    for (std::uint32_t k = 0; k < at_depth[d]; ++k) lengths[used[next++].second] = static_cast<std::uint8_t>(d);
  return lengths;
}

template <std::size_t N>
std::array<std::uint16_t, N> codes_of(const std::array<std::uint8_t, N>& lengths) {
  std::array<std::uint32_t, 16> counts{}, next{};
  for (const std::uint8_t length : lengths) ++counts[length];
  counts[0] = 0;
  for (std::size_t d = 1; d < 16; ++d) next[d] = (next[d - 1] + counts[d - 1]) << 1U;
  std::array<std::uint16_t, N> codes{};
  for (std::size_t i = 0; i < N; ++i) {
    std::uint32_t code = lengths[i] != 0 ? next[lengths[i]]++ : 0;
    for (unsigned b = 0; b < lengths[i]; ++b, code >>= 1U)  // codes are sent from their highest bit
      codes[i] = static_cast<std::uint16_t>((codes[i] << 1U) | (code & 1U));
  }
  return codes;
}

class BitWriter {
 public:
  explicit BitWriter(std::vector<std::byte>& out) : out_{out} {}
  void put(std::uint32_t bits, unsigned count) {
    held_ |= std::uint64_t{bits} << count_;
    count_ += count;
    while (count_ >= 8) {
      out_.push_back(static_cast<std::byte>(held_));
      held_ >>= 8U;
      count_ -= 8;
    }
  }
  void align() {
    if (count_ != 0) put(0, 8 - count_);
  }

 private:
  std::vector<std::byte>& out_;
  std::uint64_t held_ = 0;
  unsigned count_ = 0;
};

/// The code lengths themselves, run-length coded and Huffman coded (RFC 1951, 3.2.7).
void put_code_lengths(BitWriter& bits, std::span<const std::uint8_t> literals,
                      std::span<const std::uint8_t> distances) {
  std::vector<std::uint8_t> all(literals.begin(), literals.end());
  all.insert(all.end(), distances.begin(), distances.end());
  struct Symbol {
    std::uint8_t code, extra, value;
  };
  std::vector<Symbol> symbols;
  std::array<std::uint32_t, 19> counts{};
  for (std::size_t i = 0; i < all.size();) {
    std::size_t run = 1;
    while (i + run < all.size() && all[i + run] == all[i] && run < 138) ++run;
    if (all[i] == 0 && run >= 11) {
      symbols.push_back({18, 7, static_cast<std::uint8_t>(run - 11)});
    } else if (all[i] == 0 && run >= 3) {
      symbols.push_back({17, 3, static_cast<std::uint8_t>(run - 3)});
    } else {
      run = 1;
      symbols.push_back({all[i], 0, 0});
    }
    i += run;
  }
  for (const Symbol& s : symbols) ++counts[s.code];
  const auto lengths = code_lengths(counts, 7);
  const auto codes = codes_of(lengths);
  constexpr std::array<std::uint8_t, 19> order{16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15};
  bits.put(static_cast<std::uint32_t>(literals.size() - 257), 5);
  bits.put(static_cast<std::uint32_t>(distances.size() - 1), 5);
  bits.put(19 - 4, 4);
  for (const std::uint8_t i : order) bits.put(lengths[i], 3);
  for (const Symbol& s : symbols) {
    bits.put(codes[s.code], lengths[s.code]);
    bits.put(s.value, s.extra);
  }
}

std::vector<std::byte> coded(const Tokens& tokens, std::size_t row_distance, std::uint32_t checksum) {
  auto counts = tokens.literal_counts();
  ++counts[kEndOfBlock];
  std::array<std::uint32_t, kDistanceCodes> distance_counts{};
  const ExtraBits above = distance_code(std::min(row_distance, kFarthest));
  distance_counts[0] += tokens.runs();
  distance_counts[above.code] += tokens.copies();
  const auto literal_lengths = code_lengths(counts, 15);
  const auto distance_lengths = code_lengths(distance_counts, 15);
  const auto literal_codes = codes_of(literal_lengths);
  const auto distance_codes = codes_of(distance_lengths);
  std::vector<std::byte> out;
  out.reserve(tokens.all().size() * 2 + 512);
  out.push_back(std::byte{0x78});  // 32 KiB of window
  out.push_back(std::byte{0x01});  // packed for speed
  BitWriter bits{out};
  bits.put(1, 1);  // the last block
  bits.put(2, 2);  // with codes of its own
  put_code_lengths(bits, literal_lengths, distance_lengths);
  for (const Token token : tokens.all()) {
    if (token < kMatch) {
      bits.put(literal_codes[token], literal_lengths[token]);
      continue;
    }
    const ExtraBits& length = kLengths[token >> 10U];
    bits.put(literal_codes[length.code], literal_lengths[length.code]);
    bits.put(length.value, length.count);
    const bool run = (token & kRun) != 0;
    const std::size_t code = run ? 0 : above.code;
    bits.put(distance_codes[code], distance_lengths[code]);
    if (!run) bits.put(above.value, above.count);
  }
  bits.put(literal_codes[kEndOfBlock], literal_lengths[kEndOfBlock]);
  bits.align();
  for (int shift = 24; shift >= 0; shift -= 8)
    out.push_back(static_cast<std::byte>(checksum >> static_cast<unsigned>(shift)));
  return out;
}

/// One row: runs, what stands above, and the rest as literals. A run costs a few bits, a copy of the row above some
/// twenty, so it must be worth it.
void tokenise(const std::uint8_t* row, const std::uint8_t* above, std::size_t size, Tokens& tokens) {
  constexpr std::size_t plain_run = 16;
  constexpr std::size_t least_copy = 16;
  for (std::size_t i = 0; i < size;) {
    const std::size_t run = i == 0 ? 0 : agreeing(row + i, row + i - 1, size - i);
    if (run >= plain_run) {
      tokens.match(Source::Run, row + i, run);
      i += run;
      continue;
    }
    const std::size_t begun = i + run;
    if (begun + plain_run < size && agreeing(row + begun + 1, row + begun, plain_run) == plain_run) {
      if (run >= kShortestMatch) tokens.match(Source::Run, row + i, run);
      for (std::size_t k = run >= kShortestMatch ? begun : i; k <= begun; ++k) tokens.literal(row[k]);
      i = begun + 1;
      continue;
    }
    const std::size_t copy = above == nullptr ? 0 : agreeing(row + i, above + i, size - i);
    if (copy >= least_copy && copy > run) {
      tokens.match(Source::RowAbove, row + i, copy);
      i += copy;
    } else if (run >= kShortestMatch) {
      tokens.match(Source::Run, row + i, run);
      i += run;
    } else {
      tokens.literal(row[i++]);
    }
  }
}

}  // namespace

std::optional<std::vector<std::byte>> deflate_runs(std::span<const std::uint8_t> pixels, std::size_t row_bytes) {
  const std::size_t size = row_bytes + 1;
  const std::size_t rows = pixels.size() / row_bytes;
  std::vector<std::uint8_t> here(size), above(size);
  Tokens tokens;
  std::uint32_t checksum = 1;
  const bool reaches = size <= kFarthest;
  for (std::size_t y = 0; y < rows; ++y) {
    const std::uint8_t* row = pixels.data() + y * row_bytes;
    if (y == 0 || !reaches || std::memcmp(row, row - row_bytes, row_bytes) != 0) {
      here.swap(above);
      std::memcpy(here.data() + 1, row, row_bytes);
      tokenise(here.data(), y != 0 && reaches ? above.data() : nullptr, size, tokens);
    } else {
      // A blank row goes on where the blank row above ended; its codes are shorter.
      const bool blank = here[size - 1] == 0 && agreeing(here.data(), here.data() + 1, size - 1) == size - 1;
      tokens.match(blank ? Source::Run : Source::RowAbove, here.data(), size);
    }
    checksum = libdeflate_adler32(checksum, here.data(), size);
    if (tokens.all().size() > (y + 64) * size / 3) return std::nullopt;
  }
  tokens.flush();
  return coded(tokens, size, checksum);
}

}  // namespace telefab
