// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <telefab/scan/staging/cloud_picture.hpp>

namespace telefab::scan {
namespace {

constexpr unsigned kMortonBits = 10;
constexpr double kMostQuantum = 65'535;
/// More points than this are thinned in the order of the file before they are sorted.
constexpr std::size_t kMostSorted = 8'000'000;

static_assert(std::endian::native == std::endian::little, "levels are written as they lie in memory");

/// The bits of a number of kMortonBits, two zeros between each.
std::uint32_t spread(std::uint32_t v) {
  v = (v | (v << 16U)) & 0x030000FFU;
  v = (v | (v << 8U)) & 0x0300F00FU;
  v = (v | (v << 4U)) & 0x030C30C3U;
  return (v | (v << 2U)) & 0x09249249U;
}

std::uint64_t reversed(std::uint64_t value, unsigned bits) {
  std::uint64_t out = 0;
  for (unsigned i = 0; i < bits; ++i) out |= ((value >> i) & 1U) << (bits - 1 - i);
  return out;
}

template <class Value>
void put(std::vector<std::byte>& out, std::size_t at, const Value& value) {
  std::memcpy(out.data() + at, &value, sizeof value);
}

std::size_t end_of_level(std::uint32_t level) { return CloudPicture::kFirstLevel << (2 * level); }

}  // namespace

std::vector<std::uint32_t> progressive_order(std::span<const Eigen::Vector3f> points, std::size_t most) {
  Eigen::Vector3f low = Eigen::Vector3f::Zero(), high = Eigen::Vector3f::Zero();
  if (!points.empty()) low = high = points[0];
  for (const Eigen::Vector3f& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const float side = std::max((high - low).maxCoeff(), 1e-30F);
  const float cells = static_cast<float>((1U << kMortonBits) - 1) / side;
  const std::size_t step = std::max<std::size_t>(1, (points.size() + kMostSorted - 1) / kMostSorted);
  std::vector<std::uint64_t> keys;
  keys.reserve(points.size() / step + 1);
  for (std::size_t i = 0; i < points.size(); i += step) {
    const Eigen::Vector3f c = (points[i] - low) * cells;
    const std::uint64_t code = spread(static_cast<std::uint32_t>(c.x())) |
                               (spread(static_cast<std::uint32_t>(c.y())) << 1U) |
                               (spread(static_cast<std::uint32_t>(c.z())) << 2U);
    keys.push_back((code << 32U) | i);
  }
  std::sort(keys.begin(), keys.end());
  const unsigned bits = static_cast<unsigned>(std::bit_width(keys.empty() ? 0 : keys.size() - 1));
  std::vector<std::uint32_t> order;
  order.reserve(std::min(most, keys.size()));
  for (std::uint64_t i = 0; i < (std::uint64_t{1} << bits) && order.size() < std::min(most, keys.size()); ++i)
    if (const std::uint64_t at = reversed(i, bits); at < keys.size())
      order.push_back(static_cast<std::uint32_t>(keys[at] & 0xFFFFFFFFU));
  return order;
}

CloudPicture::CloudPicture(const ShownPoints& shown) : has_normals_{!shown.normals.empty()} {
  const std::vector<std::uint32_t> order = progressive_order(shown.points, kMostPoints);
  if (order.empty()) return;
  Eigen::Vector3f low = shown.points[order[0]], high = low;
  for (const std::uint32_t i : order) {
    low = low.cwiseMin(shown.points[i]);
    high = high.cwiseMax(shown.points[i]);
  }
  low_ = shown.origin + low.cast<double>();
  step_ = std::max(static_cast<double>((high - low).maxCoeff()) / kMostQuantum, 1e-30);
  places_.reserve(4 * order.size());
  if (has_normals_) normals_.reserve(4 * order.size());
  for (const std::uint32_t i : order) {
    const Vec3 p = (shown.points[i] - low).cast<double>() / step_;
    for (const double v : {p.x(), p.y(), p.z()})
      places_.push_back(static_cast<std::uint16_t>(std::clamp(std::round(v), 0.0, kMostQuantum)));
    places_.push_back(static_cast<std::uint16_t>(shown.kinds.empty() ? PointKind::Measured : shown.kinds[i]));
    if (!has_normals_) continue;
    for (const float v : {shown.normals[i].x(), shown.normals[i].y(), shown.normals[i].z()})
      normals_.push_back(static_cast<std::int8_t>(std::clamp(std::round(127 * v), -127.0F, 127.0F)));
    normals_.push_back(0);
  }
}

std::uint32_t CloudPicture::levels() const {
  std::uint32_t count = size() > 0 ? 1 : 0;
  while (count > 0 && end_of_level(count - 1) < size()) ++count;
  return count;
}

std::vector<std::byte> CloudPicture::level(std::uint32_t level) const {
  const std::size_t first = level == 0 ? 0 : std::min(end_of_level(level - 1), size());
  const std::size_t count = std::min(end_of_level(level), size()) - first;
  std::vector<std::byte> out(kHeadBytes + count * (has_normals_ ? 12 : 8));
  std::size_t at = 0;
  for (const std::size_t number : {std::size_t{kMagic}, std::size_t{kVersion}, std::size_t{level},
                                   std::size_t{levels()}, first, count, size(), std::size_t{has_normals_ ? 1U : 0U}}) {
    put(out, at, static_cast<std::uint32_t>(number));
    at += sizeof(std::uint32_t);
  }
  for (const double number : {low_.x(), low_.y(), low_.z(), step_}) {
    put(out, at, number);
    at += sizeof number;
  }
  if (count == 0) return out;
  std::memcpy(out.data() + at, places_.data() + 4 * first, 8 * count);
  if (has_normals_) std::memcpy(out.data() + at + 8 * count, normals_.data() + 4 * first, 4 * count);
  return out;
}

}  // namespace telefab::scan
