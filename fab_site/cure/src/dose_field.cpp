// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <telefab/fab/cure/dose_field.hpp>

#include "tile_sampler.hpp"

namespace telefab::fab {
namespace {

constexpr std::size_t kMostTaps = 64;  // of the widest kernel, padded
constexpr int kRowsPerTask = 64;

/// Columns and rows of a mask (rows from its top) that are not black; nothing for a black mask.
struct LitBox {
  int left = 1 << 30, right = -1, top = 1 << 30, bottom = -1;
};

LitBox lit_box(const MaskView& mask) {
  const std::size_t width = mask.size.width_px;
  LitBox box;
  for (std::size_t y = 0; y < mask.size.height_px; ++y) {
    const std::uint8_t* row = mask.rows.data() + y * width;
    // A row is black if its first byte is and every byte equals the one before it.
    if (row[0] == 0 && (width == 1 || std::memcmp(row, row + 1, width - 1) == 0)) continue;
    const auto lit = [](std::uint8_t grey) { return grey != 0; };
    const int first = static_cast<int>(std::find_if(row, row + width, lit) - row);
    std::size_t last = width;
    while (row[last - 1] == 0) --last;
    box.left = std::min(box.left, first);
    box.right = std::max(box.right, static_cast<int>(last) - 1);
    box.top = std::min(box.top, static_cast<int>(y));
    box.bottom = static_cast<int>(y);
  }
  return box;
}

PixelBox united(const PixelBox& a, const PixelBox& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  const int x = std::min(a.x, b.x), y = std::min(a.y, b.y);
  return {x, y, std::max(a.x + a.width, b.x + b.width) - x, std::max(a.y + a.height, b.y + b.height) - y};
}

/// Exposures of one mask as one.
std::vector<MaskExposure> summed(std::span<const MaskExposure> exposures) {
  std::vector<MaskExposure> sums;
  for (const MaskExposure& exposure : exposures) {
    const auto same = std::find_if(sums.begin(), sums.end(), [&](const MaskExposure& other) {
      return other.mask.rows.data() == exposure.mask.rows.data() ||
             std::equal(other.mask.rows.begin(), other.mask.rows.end(), exposure.mask.rows.begin());
    });
    if (same != sums.end())
      same->lit += exposure.lit;
    else
      sums.push_back(exposure);
  }
  return sums;
}

}  // namespace

DoseField::DoseField(std::shared_ptr<const PixelKernel> kernel, PixelBox box, std::vector<float> pixels)
    : kernel_{std::move(kernel)}, box_{box}, pixels_{std::move(pixels)}, bounds_{all_bounds(*this)} {}

float DoseField::pixel(int x, int y) const {
  if (box_.empty()) return 0;
  const int column = std::clamp(x - box_.x, 0, box_.width - 1);
  const int row = std::clamp(y - box_.y, 0, box_.height - 1);
  return pixels_[static_cast<std::size_t>(row) * static_cast<std::size_t>(box_.width) +
                 static_cast<std::size_t>(column)];
}

const float* DoseField::row(int y) const {
  return pixels_.data() +
         static_cast<std::size_t>(std::clamp(y - box_.y, 0, box_.height - 1)) * static_cast<std::size_t>(box_.width);
}

DoseField::Sample DoseField::sample(PixelPlace place) const {
  if (box_.empty()) return {};
  const int reach = kernel_->reach(), taps = 2 * reach + 1, padded = kernel_->padded();
  const double column = std::floor(place.x_px), row = std::floor(place.y_px);
  std::array<float, kMostTaps> wx, wy, dx, dy;
  const auto many = static_cast<std::size_t>(padded);
  kernel_->weights(place.x_px - column, {wx.data(), many}, {dx.data(), many});
  kernel_->weights(place.y_px - row, {wy.data(), many}, {dy.data(), many});
  const int left = static_cast<int>(column) - reach, low = static_cast<int>(row) - reach;
  std::array<float, kMostTaps> sums{}, changes{};
  const bool inside = left >= box_.x && left + padded <= box_.x + box_.width;
  for (int i = 0; i < taps; ++i) {
    const float w = wy[static_cast<std::size_t>(i)], d = dy[static_cast<std::size_t>(i)];
    std::array<float, kMostTaps> gathered;
    const float* pixels = gathered.data();
    if (inside && low + i >= box_.y && low + i < box_.y + box_.height) {
      pixels = pixels_.data() + static_cast<std::size_t>(low + i - box_.y) * static_cast<std::size_t>(box_.width) +
               static_cast<std::size_t>(left - box_.x);
    } else {
      for (int k = 0; k < padded; ++k) gathered[static_cast<std::size_t>(k)] = pixel(left + k, low + i);
    }
    for (std::size_t k = 0; k < many; k += 8)
      for (std::size_t j = k; j < k + 8; ++j) {
        sums[j] += w * pixels[j];
        changes[j] += d * pixels[j];
      }
  }
  Sample sample;
  for (std::size_t k = 0; k < static_cast<std::size_t>(taps); ++k) {
    sample.dose += static_cast<double>(wx[k] * sums[k]);
    sample.slope_x += static_cast<double>(dx[k] * sums[k]);
    sample.slope_y += static_cast<double>(wx[k] * changes[k]);
  }
  return sample;
}

DoseStream::DoseStream(const CureModel& model)
    : model_{model}, kernel_{std::make_shared<const PixelKernel>(model.spread_px)} {}

Result<DoseField> DoseStream::descend(std::span<const MaskExposure> exposures) {
  const auto width = static_cast<int>(model_.mask.width_px), height = static_cast<int>(model_.mask.height_px);
  const std::vector<MaskExposure> shown = summed(exposures);
  PixelBox box = box_;
  const int margin = 2 * kernel_->reach() + 8;  // so that no blur reaches the border, and windows stay inside
  for (const MaskExposure& exposure : shown) {
    if (exposure.mask.size != model_.mask ||
        exposure.mask.rows.size() != std::size_t{model_.mask.width_px} * model_.mask.height_px)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("a mask has {} x {} pixels, the machine {} x {}; plan the job again", exposure.mask.size.width_px,
                      exposure.mask.size.height_px, model_.mask.width_px, model_.mask.height_px));
    if (exposure.lit.count() < 0) return fail(ErrorCode::InvalidInput, "an exposure has a negative time");
    const LitBox lit = lit_box(exposure.mask);
    if (lit.right < 0 || exposure.lit.count() == 0) continue;
    box = united(box, {lit.left - margin, height - 1 - lit.bottom - margin, lit.right - lit.left + 1 + 2 * margin,
                       lit.bottom - lit.top + 1 + 2 * margin});
  }
  if (box.empty()) return DoseField{kernel_};

  const auto columns = static_cast<std::size_t>(box.width);
  std::vector<float> pixels(columns * static_cast<std::size_t>(box.height), 0.0F);
  const auto passed = static_cast<float>(model_.passed());
  const bool flat = model_.projection.field.empty();
  const auto fill_row = [&](int y) {
    float* row = pixels.data() + static_cast<std::size_t>(y - box.y) * columns;
    if (y >= box_.y && y < box_.y + box_.height) {
      const float* old = pixels_.data() + static_cast<std::size_t>(y - box_.y) * static_cast<std::size_t>(box_.width);
      float* to = row + (box_.x - box.x);
      for (int x = 0; x < box_.width; ++x) to[x] = passed * old[x];
    }
    if (y < 0 || y >= height) return;
    const int from = std::max(0, box.x), until = std::min(width, box.x + box.width);
    const double down = (height - 1 - y + 0.5) / height;
    for (const MaskExposure& exposure : shown) {
      const double white = model_.white_per_s * std::chrono::duration<double>(exposure.lit).count();
      std::array<float, 256> dose;
      for (std::size_t grey = 0; grey < dose.size(); ++grey)
        dose[grey] = static_cast<float>(white * static_cast<double>(model_.tone[grey]));
      const std::uint8_t* greys =
          exposure.mask.rows.data() + static_cast<std::size_t>(height - 1 - y) * static_cast<std::size_t>(width);
      for (int x = from; x < until; ++x) {
        const float light = dose[greys[x]];
        if (light == 0) continue;
        row[x - box.x] +=
            flat ? light : light * static_cast<float>(field_at(model_.projection, (x + 0.5) / width, down));
      }
    }
  };
  tbb::parallel_for(0, (box.height + kRowsPerTask - 1) / kRowsPerTask, [&](int task) {
    const int last = std::min(box.height, (task + 1) * kRowsPerTask);
    for (int y = task * kRowsPerTask; y < last; ++y) fill_row(box.y + y);
  });
  box_ = box;
  pixels_ = pixels;
  return DoseField{kernel_, box, std::move(pixels)};
}

}  // namespace telefab::fab
