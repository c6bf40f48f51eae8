// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "blend_model.hpp"

namespace telefab::fab {
namespace {

constexpr double kJoined = 0.125;  // of a layer's thickness: solid so deep, neighbours hang together
constexpr double kAttach = 1.05;   // inner pixels get this times the dose that cures a layer through

/// Upper quantile of the normal distribution by bisection: x with P(X > x) = tail.
double upper_quantile(double tail) {
  double low = -8, high = 8;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2;
    (std::erfc(middle / std::numbers::sqrt2) / 2 > tail ? low : high) = middle;
  }
  return (low + high) / 2;
}

/// The dose at the middle of a pixel.
float blurred(const MaskBlender::Model& m, const DoseTiles& doses, int x, int y) {
  const int taps = m.weights.taps();
  const auto at = m.weights.window(0.5);
  const float* weights = m.weights.node(at.node);
  std::array<float, 24> row{};
  float sum = 0;
  for (int i = 0; i < taps; ++i) {
    doses.copy_row(x + at.first, y + at.first + i, taps, row.data());
    float across = 0;
    for (int k = 0; k < taps; ++k) across += weights[k] * row[static_cast<std::size_t>(k)];
    sum += weights[i] * across;
  }
  return sum;
}

}  // namespace

Result<void> BlendOptions::validate() const {
  const auto share = [](double value) { return value > 0 && value <= 1; };
  if (iterations < 1 || iterations > 1000)
    return fail(ErrorCode::InvalidInput, fmt::format("{} iterations; 1 to 1000 are possible", iterations));
  const std::pair<const char*, double> shares[] = {
      {"regular", regular}, {"corner_weight", corner_weight}, {"support_grey", support_grey}};
  for (const auto& [name, value] : shares)
    if (!share(value))
      return fail(ErrorCode::InvalidInput, fmt::format("{} is {}; above 0 and up to 1 is possible", name, value));
  return {};
}

void BlendFigures::add(const BlendFigures& other) {
  length_px += other.length_px;
  squares_px3 += other.squares_px3;
  tiles += other.tiles;
  unsolved += other.unsolved;
}

double BlendFigures::residual_px() const { return length_px > 0 ? std::sqrt(squares_px3 / length_px) : 0; }

MaskBlender::Model::Model(const MaskFrame& f, const MaskLight& l, const BlendOptions& o)
    : frame{f}, light{l}, options{o}, weights{l.spread_px}, encode{l.tone} {
  const double edge_spread = std::sqrt(l.spread_px * l.spread_px + 1.0 / 12);
  edge_slope = 1 / (std::sqrt(2 * std::numbers::pi) * edge_spread);
  target = static_cast<float>(l.threshold());
  inwards_px = edge_spread * upper_quantile(std::clamp(l.threshold(), 0.02, 0.98));
  passed = static_cast<float>(l.passed());
  attach = static_cast<float>(std::min(1.0, kAttach * l.through()));
  halo = weights.taps() / 2 + 8;
  side = DoseTiles::kSide + 2 * halo;
  for (std::size_t i = 0; i < 256; ++i) {
    tone[i] = static_cast<float>(l.tone[i]);
    const auto leak = static_cast<float>(l.tone[0]);
    grey_of_share[i] = encode(leak + (1 - leak) * static_cast<float>(i) / 255);
  }
}

Result<MaskBlender> MaskBlender::make(const MaskFrame& frame, const MaskLight& light, const BlendOptions& options) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  return MaskBlender{std::make_unique<const Model>(frame, light, options)};
}

MaskBlender::MaskBlender(std::unique_ptr<const Model> model) : model_{std::move(model)} {}
MaskBlender::~MaskBlender() = default;
MaskBlender::MaskBlender(MaskBlender&&) noexcept = default;
MaskBlender& MaskBlender::operator=(MaskBlender&&) noexcept = default;

BlendedLayer MaskBlender::blend(const BlendTask& task) const {
  return work_on_layer(*model_, task, model_->options.iterations, nullptr);
}

struct BlendStack::State {
  const MaskBlender::Model& model;
  DoseTiles above;
};

BlendStack::BlendStack(const MaskBlender& blender)
    : state_{new State{*blender.model_, DoseTiles{blender.model_->frame.size}}} {}
BlendStack::~BlendStack() = default;
BlendStack::BlendStack(BlendStack&&) noexcept = default;
BlendStack& BlendStack::operator=(BlendStack&&) noexcept = default;

BlendedLayer BlendStack::descend(const BlendTask& task, int iterations) {
  return work_on_layer(state_->model, task, iterations, &state_->above);
}

void BlendStack::mark_cured(Mask& mask) const {
  const MaskBlender::Model& m = state_->model;
  const int width = static_cast<int>(m.frame.size.width_px), height = static_cast<int>(m.frame.size.height_px);
  const float least = m.target * m.passed;  // the dose has gone through one layer since
  const float joined = least * static_cast<float>(std::pow(m.light.passed(), 0.5 - kJoined));
  std::ranges::fill(mask.rows, std::uint8_t{0});
  // Beyond a pixel around what is bright enough the blur brings no more.
  const DoseTiles::Box box = state_->above.box_of(joined);
  if (box.is_empty()) return;
  const int left = std::max(0, box.left - 1), right = std::min(width, box.right + 1);
  const int front = std::max(0, box.front - 1), back = std::min(height, box.back + 1);
  // Rows y - 1, y and y + 1 with a pixel of margin: what a pixel's own dose is enough for, one in each nibble.
  const auto stride = static_cast<std::size_t>(right - left) + 2;
  constexpr std::uint8_t kAll = 9, kJoins = 16;
  std::vector<float> doses(stride);
  std::array<std::vector<std::uint8_t>, 3> enough;
  const auto read = [&](int y, std::vector<std::uint8_t>& row) {
    row.resize(stride);
    state_->above.copy_row(left - 1, y, static_cast<int>(stride), doses.data());
    for (std::size_t x = 0; x < stride; ++x)
      row[x] = static_cast<std::uint8_t>((doses[x] >= least) + kJoins * (doses[x] >= joined));
  };
  read(front - 1, enough[0]);
  read(front, enough[1]);
  std::vector<std::uint8_t> columns(stride), around(stride - 2);
  for (int y = front; y < back; ++y) {
    read(y + 1, enough[2]);
    std::uint8_t* row = mask.rows.data() + static_cast<std::ptrdiff_t>(height - 1 - y) * width + left;
    for (std::size_t x = 0; x < stride; ++x)
      columns[x] = static_cast<std::uint8_t>(enough[0][x] + enough[1][x] + enough[2][x]);
    for (std::size_t x = 0; x < around.size(); ++x) {
      around[x] = static_cast<std::uint8_t>(columns[x] + columns[x + 1] + columns[x + 2]);
      row[x] = around[x] == kAll * (kJoins + 1) ? kCuredPixel : 0;
    }
    // The blur is a mean of what is around: only where neighbours differ does it decide.
    for (std::size_t x = 0; x < around.size(); ++x) {
      const int sum = around[x];
      if (sum == 0 || sum == kAll * (kJoins + 1)) continue;
      const float dose = blurred(m, state_->above, left + static_cast<int>(x), y);
      row[x] = dose >= least ? kCuredPixel : dose >= joined ? kJoinedPixel : 0;
    }
    std::swap(enough[0], enough[1]);
    std::swap(enough[1], enough[2]);
  }
}

}  // namespace telefab::fab
