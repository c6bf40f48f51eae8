// SPDX-License-Identifier: GPL-3.0-or-later
#include "part_bytes.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace telefab::scan {
namespace {

constexpr std::string_view kMagic = "TFPART\r\n";  // the line end shows a transfer that translated it

template <class Bytes>
Digest seal_of(const Bytes& bytes) {
  return digest_of(std::span<const std::byte>{bytes});
}

}  // namespace

void write_head(const PartHead& head, ArchiveWriter& to) {
  const auto magic = std::as_bytes(std::span{kMagic});
  to.bytes().assign(magic.begin(), magic.end());
  to(kPartForm, head.key, head.range, head.codec, head.known);
}

std::vector<std::byte> with_seal(std::vector<std::byte> bytes) {
  const Digest seal = seal_of(bytes);
  bytes.insert(bytes.end(), seal.bytes.begin(), seal.bytes.end());
  return bytes;
}

Result<OpenPart> open_part(std::span<const std::byte> bytes) {
  const auto magic = std::as_bytes(std::span{kMagic});
  Digest stated;
  if (bytes.size() < magic.size() + stated.bytes.size() || !std::equal(magic.begin(), magic.end(), bytes.begin()))
    return fail(ErrorCode::InvalidInput,
                "this is not a part of a slicing; telefab-scan slice --part I/N --parts FOLDER makes them");
  const auto body = bytes.first(bytes.size() - stated.bytes.size());
  std::copy(bytes.end() - static_cast<std::ptrdiff_t>(stated.bytes.size()), bytes.end(), stated.bytes.begin());
  if (seal_of(body) != stated)
    return fail(ErrorCode::NotTrusted, "this part is damaged (its digest does not hold); cut it again");
  ArchiveReader from{body.subspan(magic.size())};
  std::uint32_t form = 0;
  from(form);
  if (form != kPartForm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("this part is of form {}, and this program reads form {}; cut it again", form, kPartForm));
  PartHead head;
  from(head.key, head.range);
  const std::size_t behind_range = from.left();
  from(head.codec, head.known);
  const auto malformed = [] { return fail(ErrorCode::NotTrusted, "this part is malformed; cut it again"); };
  if (!from.ok() || head.range.first > head.range.end || head.range.end > head.known.header.layer_count)
    return malformed();
  if (!head.known.header.validate() || !head.codec.validate()) return malformed();
  const auto known = body.subspan(body.size() - behind_range, behind_range - from.left());
  return OpenPart{.head = std::move(head), .known = seal_of(known), .digest = stated, .layers = from};
}

}  // namespace telefab::scan
