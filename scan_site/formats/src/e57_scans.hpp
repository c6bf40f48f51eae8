// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

// What the XML section of an E57 file says about its scans.
namespace telefab::scan {

/// One number of every record: how it is packed into its byte stream.
struct E57Field {
  enum class Kind : std::uint8_t { Float32, Float64, Integer, Text };
  std::string name;  ///< without namespace: "cartesianX", "normalX"
  Kind kind = Kind::Float64;
  unsigned bits = 64;      ///< [0, 64]; of one value in the stream
  std::int64_t least = 0;  ///< Integer: the value whose bits are all 0
  std::uint64_t span = 0;  ///< Integer: greatest value minus least
  double scale = 1;        ///< Integer: value = integer * scale + offset
  double offset = 0;
};

struct E57Scan {
  std::vector<E57Field> fields;  ///< in the order of the byte streams
  std::uint64_t offset = 0;      ///< physical, of the compressed vector section
  std::uint64_t records = 0;
  std::optional<Eigen::Isometry3d> pose;  ///< scanner to common frame

  [[nodiscard]] std::optional<std::size_t> field(std::string_view name) const;
};

/// The scans (data3D) of the XML section. Fails: InvalidInput (bad XML, a scan without prototype, numbers that are
/// none, a codec other than bit packing, a pose that is no rotation), TooLarge (more than 64 MiB).
[[nodiscard]] Result<std::vector<E57Scan>> e57_scans_of(std::span<const std::byte> xml);

}  // namespace telefab::scan
