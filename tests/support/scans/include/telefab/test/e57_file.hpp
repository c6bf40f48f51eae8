// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace telefab::test {

/// One field of the points: its element in the prototype and its packed values.
struct E57Column {
  std::string element;
  std::string stream;
};
[[nodiscard]] E57Column e57_doubles(std::string_view name, std::span<const double> values);
[[nodiscard]] E57Column e57_floats(std::string_view name, std::span<const double> values);
/// Values minus `least`, in as many bits as `most` - `least` needs.
[[nodiscard]] E57Column e57_integers(std::string_view name, std::span<const std::int64_t> values, std::int64_t least,
                                     std::int64_t most);
/// The same as ScaledInteger: value = integer * scale + offset.
[[nodiscard]] E57Column e57_scaled(std::string_view name, std::span<const std::int64_t> values, std::int64_t least,
                                   std::int64_t most, double scale, double offset);

/// Scans of an E57 file, written as ASTM E2807 says.
class E57File {
 public:
  /// `pose` is the inside of the pose element or empty. Each packet takes `stream_bytes` of every stream, so that
  /// values may be cut; an index packet and an ignored one lie between.
  void add_scan(const std::vector<E57Column>& columns, std::uint64_t records, std::string_view pose = "",
                std::size_t stream_bytes = 64);
  /// More elements of the root, after data3D.
  void add_xml(std::string_view xml) { more_xml_ += xml; }
  /// What lies in the pages: the header without its length, the sections, the XML.
  [[nodiscard]] std::string logical() const;
  [[nodiscard]] std::string bytes() const;

 private:
  std::string body_ = std::string(48, '\0');
  std::string scans_xml_;
  std::string more_xml_;
};

/// Puts bytes that begin with an E57 header on pages with right checksums; writes length and page size into the header.
[[nodiscard]] std::string on_e57_pages(std::string logical);

}  // namespace telefab::test
