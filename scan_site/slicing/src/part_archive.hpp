// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <array>
#include <bit>
#include <concepts>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <telefab/base/digest.hpp>
#include <telefab/base/quantity.hpp>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/placing/turn.hpp>
#include <vector>

// Values to bytes and back, exactly. What a struct consists of is listed once, in a function `fields` for both ways.
namespace telefab::scan {

/// `T`, as somebody who writes or one who reads has it.
template <class T, class Wanted>
concept Of = std::same_as<std::remove_const_t<T>, Wanted>;

/// Appends values, little-endian.
class ArchiveWriter {
 public:
  template <class... Values>
  void operator()(const Values&... values) {
    (put(values), ...);
  }
  [[nodiscard]] std::vector<std::byte>& bytes() { return bytes_; }

 private:
  template <std::integral T>
  void put(T value) {
    for (unsigned i = 0; i < sizeof value; ++i)
      bytes_.push_back(static_cast<std::byte>(static_cast<std::uint64_t>(value) >> (8 * i)));
  }
  void put(double value) { put(std::bit_cast<std::uint64_t>(value)); }
  void put(LayerIndex value) { put(value.count()); }
  void put(Point2 value) { (*this)(value.x_mm, value.y_mm); }
  void put(const Digest& value) { bytes_.insert(bytes_.end(), value.bytes.begin(), value.bytes.end()); }
  void put(const std::string& text) {
    put(text.size());
    const auto bytes = std::as_bytes(std::span{text});
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  template <class T>
  void put(const std::optional<T>& value) {
    put(value.has_value());
    if (value) put(*value);
  }
  template <class T>
  void put(const std::vector<T>& values) {
    put(values.size());
    for (const T& value : values) put(value);
  }
  template <class T, std::size_t count>
  void put(const std::array<T, count>& values) {
    for (const T& value : values) put(value);
  }
  template <class T, int rows, int columns>
  void put(const Eigen::Matrix<T, rows, columns>& m) {
    for (const T& value : m.reshaped()) put(value);
  }
  void put(const Turn& turn) { put(turn.matrix()); }
  void put(const Contour& contour) {
    put(std::vector<Point2>{contour.vertices().begin(), contour.vertices().end()});
    put(std::vector<SurfaceRun>{contour.runs().begin(), contour.runs().end()});
  }
  template <class T>
  requires std::is_enum_v<T>
  void put(T value) { put(static_cast<std::underlying_type_t<T>>(value)); }
  template <class T>
  requires std::is_class_v<T>
  void put(const T& value) { fields(*this, value); }

  std::vector<std::byte> bytes_;
};

/// Takes them off again. Where bytes are missing or mean no value, all that follows is empty and ok() is false.
class ArchiveReader {
 public:
  explicit ArchiveReader(std::span<const std::byte> bytes) : bytes_{bytes} {}
  template <class... Values>
  void operator()(Values&... values) {
    (take(values), ...);
  }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size(); }

 private:
  std::span<const std::byte> raw(std::size_t size) {
    if (!ok_ || size > bytes_.size()) {
      ok_ = false;
      return {};
    }
    const auto from = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return from;
  }
  /// How many values follow, each of which has at least a byte.
  std::size_t count() {
    std::size_t many = 0;
    take(many);
    ok_ = ok_ && many <= bytes_.size();
    return ok_ ? many : 0;
  }
  template <std::integral T>
  void take(T& value) {
    std::uint64_t bits = 0;
    const auto from = raw(sizeof value);
    for (std::size_t i = 0; i < from.size(); ++i) bits |= std::to_integer<std::uint64_t>(from[i]) << (8 * i);
    if constexpr (std::same_as<T, bool>) ok_ = ok_ && bits <= 1;
    value = static_cast<T>(bits);
  }
  void take(double& value) {
    std::uint64_t bits = 0;
    take(bits);
    value = std::bit_cast<double>(bits);
  }
  void take(LayerIndex& value) {
    std::uint32_t index = 0;
    take(index);
    value = LayerIndex{index};
  }
  void take(Point2& value) { (*this)(value.x_mm, value.y_mm); }
  void take(Digest& value) {
    const auto from = raw(value.bytes.size());
    std::copy(from.begin(), from.end(), value.bytes.begin());
  }
  void take(std::string& text) {
    const auto from = raw(count());
    text.assign(reinterpret_cast<const char*>(from.data()), from.size());
  }
  template <class T>
  void take(std::optional<T>& value) {
    bool is_there = false;
    take(is_there);
    value.reset();
    if (ok_ && is_there) take(value.emplace());
  }
  template <class T>
  void take(std::vector<T>& values) {
    values.clear();
    for (std::size_t i = count(); i > 0 && ok_; --i) take(values.emplace_back());
  }
  void take(std::vector<Contour>& contours) {
    contours.clear();
    std::vector<Point2> vertices;
    std::vector<SurfaceRun> runs;
    for (std::size_t i = count(); i > 0 && ok_; --i) {
      (*this)(vertices, runs);
      const auto ring = Contour::from_vertices(vertices);
      if (!ok_ || !ring) return lose();
      auto known = ring->with_runs(runs.empty() ? std::vector{all_measured(vertices.size())} : runs);
      if (!known) return lose();
      contours.push_back(std::move(*known));
    }
  }
  template <class T, std::size_t count>
  void take(std::array<T, count>& values) {
    for (T& value : values) take(value);
  }
  template <class T, int rows, int columns>
  void take(Eigen::Matrix<T, rows, columns>& m) {
    for (T& value : m.reshaped()) take(value);
  }
  void take(Turn& turn) {
    Eigen::Matrix3d matrix;
    take(matrix);
    if (auto read = Turn::from_matrix(matrix); ok_ && read)
      turn = *read;
    else
      lose();
  }
  template <class T>
  requires std::is_enum_v<T>
  void take(T& value) {
    std::underlying_type_t<T> number{};
    take(number);
    // Every enumeration here begins with 1.
    ok_ = ok_ && number >= 1 && number <= static_cast<std::underlying_type_t<T>>(last_of(T{}));
    if (ok_) value = static_cast<T>(number);
  }
  template <class T>
  requires std::is_class_v<T>
  void take(T& value) { fields(*this, value); }
  void lose() { ok_ = false; }
  static SurfaceRun all_measured(std::size_t edges) {
    return {.kind = SurfaceClass::Measured, .edges = static_cast<std::uint32_t>(edges)};
  }

  std::span<const std::byte> bytes_;
  bool ok_ = true;
};

}  // namespace telefab::scan
