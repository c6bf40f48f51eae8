// SPDX-License-Identifier: GPL-3.0-or-later
#include "mls_cursor.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <new>

namespace telefab::scan {
namespace {

constexpr std::size_t kArrays = 7;
/// Side of the gather lattice in reference widths: larger cells are gathered less often and evaluated longer.
constexpr double kLatticeWidths = 2;
/// A cell is halved where the narrowest width about it is less than this many references: earlier it costs more
/// gathering than it saves.
constexpr double kHalvedWidths = 0.66;
/// Below this sum of weights the field is noise: farther than about two widths from every sample.
constexpr double kLeastWeight = 0.02;
const float kCutWidths = std::sqrt(kCut);

}  // namespace

ScaleTable::ScaleTable(std::span<const SampleGrid> bands, const Vec3& origin, double reference_mm)
    : reference_mm_{reference_mm} {
  const auto each_sample = [&](auto&& one) {
    for (const SampleGrid& band : bands)
      for (std::uint32_t i = 0; i < band.size(); ++i) one(band.place(i), band.width(i));
  };
  Eigen::Array3f lowest = Eigen::Array3f::Constant(1e30F);
  Eigen::Array3f highest = -lowest;
  each_sample([&](const Eigen::Vector3f& p, float) {
    lowest = lowest.min(p.array());
    highest = highest.max(p.array());
  });
  const Eigen::Array3d low = lowest.cast<double>();
  const Eigen::Array3d high = highest.cast<double>();
  cell_mm_ = 4 * reference_mm;
  // While it is filled a cell takes 17 bytes: not more than a sample or two.
  std::size_t samples = 0;
  for (const SampleGrid& band : bands) samples += band.size();
  const double most = std::max(1e6, 0.5 * static_cast<double>(samples));
  while (((high - low) / cell_mm_ + 3).prod() > most) cell_mm_ *= 1.2;
  low_ = origin + (low - cell_mm_).matrix();
  count_ = ((high - low) / cell_mm_).cast<int>() + 3;
  const auto cells = static_cast<std::size_t>(count_.prod());
  std::vector<float> sum(cells, 0);
  std::vector<std::uint32_t> number(cells, 0);
  std::vector<float> least(cells, 1e30F);
  each_sample([&](const Eigen::Vector3f& p, float width) {
    const std::size_t c = cell_of(origin + p.cast<double>());
    sum[c] += width;
    ++number[c];
    least[c] = std::min(least[c], width);
  });
  width_.assign(cells, static_cast<float>(reference_mm));
  level_.assign(cells, 0);
  for (int k = 0; k < count_.z(); ++k)
    for (int j = 0; j < count_.y(); ++j)
      for (int i = 0; i < count_.x(); ++i) {
        double total = 0;
        std::uint32_t n = 0;
        float smallest = 1e30F;
        for (int c = std::max(0, k - 1); c <= std::min(count_.z() - 1, k + 1); ++c)
          for (int b = std::max(0, j - 1); b <= std::min(count_.y() - 1, j + 1); ++b)
            for (int a = std::max(0, i - 1); a <= std::min(count_.x() - 1, i + 1); ++a) {
              const std::size_t near = (static_cast<std::size_t>(c) * count_.y() + b) * count_.x() + a;
              total += sum[near];
              n += number[near];
              smallest = std::min(smallest, least[near]);
            }
        if (n == 0) continue;
        const std::size_t here = (static_cast<std::size_t>(k) * count_.y() + j) * count_.x() + i;
        width_[here] = static_cast<float>(number[here] > 0 ? sum[here] / static_cast<float>(number[here]) : total / n);
        level_[here] = static_cast<std::int8_t>(
            std::clamp(std::floor(std::log2(smallest / (2 * kHalvedWidths * reference_mm))) + 1, -4.0, 2.0));
      }
}

std::size_t ScaleTable::cell_of(const Vec3& point_mm) const {
  const Eigen::Array3d at = (point_mm - low_).array() / cell_mm_;
  const Eigen::Array3i c = at.max(0.0).min(count_.cast<double>() - 1).cast<int>();
  return (static_cast<std::size_t>(c.z()) * count_.y() + c.y()) * count_.x() + c.x();
}

double ScaleTable::width_mm(const Vec3& point_mm) const {
  return cell_mm_ > 0 ? static_cast<double>(width_[cell_of(point_mm)]) : reference_mm_;
}

int ScaleTable::level(const Vec3& point_mm) const { return cell_mm_ > 0 ? level_[cell_of(point_mm)] : 0; }

void MlsCursor::Gathered::Free::operator()(float* p) const { std::free(p); }

void MlsCursor::Gathered::reserve(std::size_t wanted) {
  if (wanted <= capacity) return;
  const std::size_t grown = (std::max(wanted, capacity + capacity / 4) + 15) / 16 * 16;
  std::unique_ptr<float[], Free> bigger{static_cast<float*>(std::aligned_alloc(64, kArrays * grown * sizeof(float)))};
  if (!bigger) throw std::bad_alloc{};
  for (std::size_t a = 0; a < kArrays && capacity > 0; ++a)
    std::memcpy(bigger.get() + a * grown, floats.get() + a * capacity, capacity * sizeof(float));
  floats = std::move(bigger);
  capacity = grown;
}

MlsCursor::MlsCursor(const FieldParts& parts) : parts_{parts}, slots_(parts.slots) {}

MlsCursor::Gathered& MlsCursor::gathered_at(const Vec3& point_mm) {
  const int level = parts_.scale.level(point_mm);
  const double side = std::ldexp(kLatticeWidths * parts_.scale.reference_mm(), level);
  const Eigen::Array3d at = (point_mm - parts_.origin).array() / side;
  // floor() is a call on machines without the instruction; this is not.
  const auto below = [](double v) {
    const auto whole = static_cast<std::int32_t>(std::clamp(v, -1e9, 1e9));
    return whole - (v < whole ? 1 : 0);
  };
  const std::array<std::int32_t, 4> key{below(at.x()), below(at.y()), below(at.z()), level};
  const std::uint32_t mixed = static_cast<std::uint32_t>(key[0]) * 73856093U ^
                              static_cast<std::uint32_t>(key[1]) * 19349663U ^
                              static_cast<std::uint32_t>(key[2]) * 83492791U ^ static_cast<std::uint32_t>(level) * 7U;
  Gathered& slot = slots_[(mixed ^ mixed >> 15) & (slots_.size() - 1)];
  if (!slot.filled || slot.key != key) {
    slot.key = key;
    slot.filled = true;
    slot.centre_mm = side * Vec3{key[0] + 0.5, key[1] + 0.5, key[2] + 0.5};  // relative to the origin
    gather(slot);
  }
  return slot;
}

void MlsCursor::gather(Gathered& to) {
  const double reference = parts_.scale.reference_mm();
  const auto margin = static_cast<float>(0.8660255 * std::ldexp(kLatticeWidths * reference, to.key[3]));
  const Eigen::Vector3f centre = to.centre_mm.cast<float>();
  std::size_t count = 0;
  for (const SampleGrid& band : parts_.bands) {
    runs_.clear();
    std::size_t most = 0;
    band.visit(centre, kCutWidths * band.widest_mm() + margin, [&](std::uint32_t first, std::uint32_t last) {
      runs_.push_back({first, last});
      most += last - first;
    });
    gathering_.reserve(count + most + kLanes);
    GatherInput in = band.arrays();
    in.x = centre.x();
    in.y = centre.y();
    in.z = centre.z();
    in.margin = margin;
    in.scale = static_cast<float>(1 / reference);
    count =
        parts_.kernels.gather(in, runs_.data(), runs_.size(), {gathering_.floats.get(), gathering_.capacity}, count);
  }
  gathering_.reserve(count + kLanes);
  float* const found = gathering_.floats.get();
  const std::size_t stride = gathering_.capacity;
  for (; count % kLanes != 0; ++count) {
    for (std::size_t a = 0; a < 3; ++a) found[a * stride + count] = 1e4F;
    for (std::size_t a = 3; a < 6; ++a) found[a * stride + count] = 0;
    found[6 * stride + count] = 1;
  }
  // Half of what may come does not: what is remembered takes no more room than it needs.
  to.count = 0;
  to.reserve(count);
  for (std::size_t a = 0; a < kArrays; ++a) std::copy_n(found + a * stride, count, to.floats.get() + a * to.capacity);
  to.count = count;
}

KernelOutput MlsCursor::raw(const Vec3& point_mm) {
  Gathered& near = gathered_at(point_mm);
  if (near.count == 0) return {};
  work_.reserve(near.count);
  const float* const f = near.floats.get();
  const std::size_t c = near.capacity;
  const KernelInput in{near.count, f, f + c, f + 2 * c, f + 3 * c, f + 4 * c, f + 5 * c, f + 6 * c, work_.floats.get()};
  const Eigen::Vector3f q = ((point_mm - parts_.origin - near.centre_mm) / parts_.scale.reference_mm()).cast<float>();
  return parts_.kernels.evaluate(in, parts_.form, q.x(), q.y(), q.z());
}

FieldSample MlsCursor::at(const Vec3& point_mm) {
  const KernelOutput out = raw(point_mm);
  const double reference = parts_.scale.reference_mm();
  FieldSample sample;
  sample.in_reach = out.weight > kLeastWeight;
  sample.value_mm = out.value * reference;
  sample.gradient = {out.gradient[0], out.gradient[1], out.gradient[2]};
  sample.closeness_mm = out.closeness * reference;
  return sample;
}

}  // namespace telefab::scan
