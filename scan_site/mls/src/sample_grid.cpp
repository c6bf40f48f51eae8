// SPDX-License-Identifier: GPL-3.0-or-later
#include "sample_grid.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <numeric>
#include <tuple>

namespace telefab::scan {
namespace {

constexpr std::size_t kGrain = 64;

/// Gives the memory back, which assigning {} does not.
template <class T>
void release(std::vector<T>& v) {
  std::vector<T>{}.swap(v);
}

void put(std::vector<SampleGrid::Block>& blocks, std::size_t i, const Eigen::Vector3f& v) {
  SampleGrid::Block& b = blocks[i / 8];
  b.x[i % 8] = v.x();
  b.y[i % 8] = v.y();
  b.z[i % 8] = v.z();
}

}  // namespace

void SampleGrid::choose_cells(std::span<const Eigen::Vector3f> points, double cell_mm) {
  Eigen::Vector3f high = low_ = points[0];
  for (const Eigen::Vector3f& p : points) {
    low_ = low_.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // A cloud with a far outlier must not buy rows a micrometre apart.
  const double most = std::max(65536.0, 0.25 * static_cast<double>(points.size()));
  const Eigen::Array3d size = (high - low_).cast<double>().array();
  double cell = cell_mm;
  const auto words = [&] { return (size.y() / cell + 1) * (size.z() / cell + 1) * (size.x() / cell / 64 + 1); };
  while (words() > most || size.maxCoeff() / cell > 1e9) cell *= 1.2;
  cell_ = static_cast<float>(cell);
  inverse_cell_ = 1 / cell_;
  const auto cells = [&](int axis) { return static_cast<int>((high[axis] - low_[axis]) * inverse_cell_) + 1; };
  nx_ = cells(0);
  ny_ = cells(1);
  nz_ = cells(2);
  // Room for one cell behind the last, where ranges end.
  words_ = static_cast<std::size_t>(nx_) / 64 + 1;
}

SampleGrid::SampleGrid(std::vector<Eigen::Vector3f> points, std::vector<Eigen::Vector3f> normals,
                       std::span<const float> widths_mm, double cell_mm)
    : count_{static_cast<std::uint32_t>(points.size())} {
  if (count_ == 0) return;
  choose_cells(points, cell_mm);
  const std::size_t rows = static_cast<std::size_t>(ny_) * nz_;
  std::vector<std::uint32_t> row_first(rows + 1, 0);
  std::vector<std::uint32_t> order(count_);
  for (const Eigen::Vector3f& p : points) ++row_first[row_of(p) + 1];
  std::partial_sum(row_first.begin(), row_first.end(), row_first.begin());
  {
    std::vector<std::uint32_t> next(row_first.begin(), row_first.end() - 1);
    for (std::uint32_t i = 0; i < count_; ++i) order[next[row_of(points[i])]++] = i;
  }
  bits_.assign(rows * words_ + 1, 0);
  before_.assign(rows * words_ + 1, 0);
  const auto each_row = [&](auto&& one) {
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, rows, kGrain}, [&](const auto& range) {
      for (std::size_t r = range.begin(); r < range.end(); ++r) one(r);
    });
  };
  const auto column = [&](const Eigen::Vector3f& p) { return index(p.x(), low_.x(), nx_); };
  struct Entry {
    std::uint64_t key;
    std::uint32_t sample;
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, rows, kGrain}, [&](const auto& range) {
    std::vector<Entry> entries;
    for (std::size_t r = range.begin(); r < range.end(); ++r) {
      entries.clear();
      for (std::uint32_t i = row_first[r]; i < row_first[r + 1]; ++i) {
        const Eigen::Vector3f& p = points[order[i]];
        entries.push_back({static_cast<std::uint64_t>(column(p)) << 32U | rising(p.z()), order[i]});
      }
      std::sort(entries.begin(), entries.end(), [&](const Entry& a, const Entry& b) {
        if (a.key != b.key) return a.key < b.key;
        const auto full = [&](std::uint32_t i) {
          const Eigen::Vector3f& p = points[i];
          const Eigen::Vector3f& n = normals[i];
          return std::tuple(p.y(), p.x(), n.z(), n.y(), n.x());
        };
        return full(a.sample) < full(b.sample);
      });
      std::uint32_t at = row_first[r];
      for (const Entry& e : entries) {
        order[at++] = e.sample;
        const auto x = static_cast<std::size_t>(e.key >> 32U);
        bits_[r * words_ + x / 64] |= std::uint64_t{1} << (x % 64);
      }
    }
  });
  for (std::size_t w = 0; w + 1 < bits_.size(); ++w) before_[w + 1] = before_[w] + bit_count(bits_[w]);
  cell_first_.resize(before_.back() + std::size_t{1});
  cell_first_.back() = count_;
  each_row([&](std::size_t r) {
    std::uint32_t cell = before_[r * words_];
    for (std::uint32_t i = row_first[r]; i < row_first[r + 1]; ++i)
      if (i == row_first[r] || column(points[order[i]]) != column(points[order[i - 1]])) cell_first_[cell++] = i;
  });

  const auto sorted_into = [&](std::vector<Block>& blocks, const std::vector<Eigen::Vector3f>& from) {
    blocks.resize((std::size_t{count_} + 7) / 8);
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, blocks.size(), 1024}, [&](const auto& range) {
      for (std::size_t b = range.begin(); b < range.end(); ++b)
        for (std::size_t i = 8 * b; i < 8 * b + 8; ++i) {
          // What fills the last block lies nowhere near: no run holds it.
          if (i < count_)
            put(blocks, i, from[order[i]]);
          else
            put(blocks, i, Eigen::Vector3f::Constant(1e30F));
        }
    });
  };
  sorted_into(places_, points);
  release(points);
  sorted_into(normals_, normals);
  if (widths_mm.empty()) return;
  widths_.assign(places_.size(), {});
  for (std::uint32_t i = 0; i < count_; ++i) widths_[i / 8].width[i % 8] = widths_mm[order[i]];
  widen();
}

SampleGrid SampleGrid::with_cells(double cell_mm) && {
  std::vector<Eigen::Vector3f> points(count_), normals(count_);
  for (std::uint32_t i = 0; i < count_; ++i) points[i] = place(i);
  release(places_);
  for (std::uint32_t i = 0; i < count_; ++i) normals[i] = normal(i);
  release(normals_);
  return {std::move(points), std::move(normals), {}, cell_mm};
}

void SampleGrid::set_width(float width_mm) {
  release(widths_);
  width_mm_ = widest_mm_ = width_mm;
}

void SampleGrid::widen() {
  widest_mm_ = 0;
  for (std::uint32_t i = 0; i < count_; ++i) widest_mm_ = std::max(widest_mm_, width(i));
}

void SampleGrid::set_widths(std::span<const float> widths_mm) {
  widths_.assign((std::size_t{count_} + 7) / 8, {});
  for (std::uint32_t i = 0; i < count_; ++i) widths_[i / 8].width[i % 8] = widths_mm[i];
  widen();
}

void SampleGrid::scale_widths(float factor) {
  width_mm_ *= factor;
  widest_mm_ *= factor;
  for (Widths& block : widths_)
    for (float& w : block.width) w *= factor;
}

void SampleGrid::keep(std::span<const std::uint8_t> flags) {
  std::uint32_t kept = 0;
  for (std::size_t cell = 0; cell + 1 < cell_first_.size(); ++cell) {
    const std::uint32_t first = cell_first_[cell];
    cell_first_[cell] = kept;
    for (std::uint32_t i = first; i < cell_first_[cell + 1]; ++i) {
      if (flags[i] == 0) continue;
      put(places_, kept, place(i));
      put(normals_, kept, normal(i));
      if (!widths_.empty()) widths_[kept / 8].width[kept % 8] = width(i);
      ++kept;
    }
  }
  // A cell may be left without samples: its run is empty.
  cell_first_.back() = kept;
  count_ = kept;
  const std::size_t blocks = (std::size_t{kept} + 7) / 8;
  places_.resize(blocks);
  normals_.resize(blocks);
  if (!widths_.empty()) widths_.resize(blocks);
  widen();
}

GatherInput SampleGrid::arrays() const {
  return {places_.empty() ? nullptr : places_[0].x,
          normals_.empty() ? nullptr : normals_[0].x,
          widths_.empty() ? nullptr : widths_[0].width,
          width_mm_,
          0,
          0,
          0,
          std::sqrt(kCut),
          0,
          1};
}

}  // namespace telefab::scan
