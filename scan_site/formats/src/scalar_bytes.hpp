// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

// Numbers out of raw bytes, in either byte order.
namespace telefab::scan {

enum class ScalarType { Int8, Uint8, Int16, Uint16, Int32, Uint32, Int64, Uint64, Float32, Float64 };

[[nodiscard]] constexpr std::size_t size_of(ScalarType type) {
  switch (type) {
    case ScalarType::Int8:
    case ScalarType::Uint8:
      return 1;
    case ScalarType::Int16:
    case ScalarType::Uint16:
      return 2;
    case ScalarType::Int32:
    case ScalarType::Uint32:
    case ScalarType::Float32:
      return 4;
    case ScalarType::Int64:
    case ScalarType::Uint64:
    case ScalarType::Float64:
      return 8;
  }
  return 8;
}

template <class T>
[[nodiscard]] T load(const std::byte* from, bool swapped) {
  std::array<std::byte, sizeof(T)> raw;
  std::memcpy(raw.data(), from, sizeof(T));
  if (swapped) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

/// Calls `use` with a value of the C++ type that `type` names: one switch outside the loop, not one a number.
template <class Use>
decltype(auto) with_type(ScalarType type, Use use) {
  switch (type) {
    case ScalarType::Int8:
      return use(std::int8_t{});
    case ScalarType::Uint8:
      return use(std::uint8_t{});
    case ScalarType::Int16:
      return use(std::int16_t{});
    case ScalarType::Uint16:
      return use(std::uint16_t{});
    case ScalarType::Int32:
      return use(std::int32_t{});
    case ScalarType::Uint32:
      return use(std::uint32_t{});
    case ScalarType::Int64:
      return use(std::int64_t{});
    case ScalarType::Uint64:
      return use(std::uint64_t{});
    case ScalarType::Float32:
      return use(float{});
    case ScalarType::Float64:
      break;
  }
  return use(double{});
}

[[nodiscard]] inline double load_as_double(const std::byte* from, ScalarType type, bool swapped) {
  return with_type(type, [&](auto sample) { return static_cast<double>(load<decltype(sample)>(from, swapped)); });
}

/// One column of `count` records that lie `stride` bytes apart.
inline void load_column(const std::byte* from, std::size_t stride, std::size_t count, ScalarType type, bool swapped,
                        double* out) {
  with_type(type, [&](auto sample) {
    using T = decltype(sample);
    if (swapped)
      for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<double>(load<T>(from + i * stride, true));
    else
      for (std::size_t i = 0; i < count; ++i) out[i] = static_cast<double>(load<T>(from + i * stride, false));
  });
}

}  // namespace telefab::scan
