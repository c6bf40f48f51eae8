// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/grbl_stage.hpp>
#include <telefab/fab/drivers/model_transport.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/test/layer_motions.hpp>
#include <vector>

namespace telefab::test {

using namespace std::chrono_literals;

/// Masks by formula: a rectangle whose place and grey depend on the layer.
class FormulaMasks final : public fab::MaskSource {
 public:
  explicit FormulaMasks(PixelSize size) : size_{size} {}
  Result<fab::Mask> mask(LayerIndex layer) override {
    fab::Mask m{size_, std::vector<std::uint8_t>(std::size_t{size_.width_px} * size_.height_px)};
    const std::uint32_t k = layer.count();
    for (std::uint32_t y = 2 + k % 3; y < size_.height_px - 3; ++y)
      for (std::uint32_t x = 1 + k % 5; x < size_.width_px - 4; ++x)
        m.rows[std::size_t{y} * size_.width_px + x] = x % 7 == 0 ? static_cast<std::uint8_t>(40 + k % 200) : 255;
    return m;
  }

 private:
  PixelSize size_;
};

inline fab::PrintPlan formula_plan(FormulaMasks& masks, PixelSize size, std::uint32_t layers,
                                   fab::Microseconds exposure, const fab::LayerMotion& motion = {}) {
  fab::PrintPlan plan;
  plan.job = "rig";
  plan.machine = "rig";
  plan.mask_size = size;
  plan.z_travel_mm = 20;
  for (std::uint32_t i = 0; i < layers; ++i)
    plan.layers.push_back({LayerIndex{i}, 0.1 * (i + 1), exposure,
                           digest_of(std::as_bytes(std::span{masks.mask(LayerIndex{i})->rows})), motion});
  return plan;
}

/// Projector and stage models on a virtual clock, the real drivers on top, and a job. The models outlive the drivers,
/// as real devices outlive a daemon.
struct PrintRig {
  explicit PrintRig(std::uint32_t layers, fab::Microseconds exposure = 700ms, const fab::LayerMotion& motion = {})
      : masks{kSize}, plan{formula_plan(masks, kSize, layers, exposure, motion)} {
    projector_model.add_up_dose(false);
  }

  /// Opens the drivers again, as a started daemon does.
  Result<void> connect() {
    projector.reset();
    stage.reset();
    auto p = fab::Dlpc900Projector::open(std::make_unique<fab::ModelUsb>(projector_model, clock),
                                         {.mask = kSize, .led_current = 100}, clock);
    if (!p) return tl::unexpected{p.error()};
    projector = std::move(*p);
    auto s = fab::SerialStage::open(std::make_unique<fab::ModelLine>(stage_model, clock),
                                    {.top_mm = kTop_mm, .homing_mm_per_s = 20}, clock);
    if (!s) return tl::unexpected{s.error()};
    stage = std::move(*s);
    return {};
  }
  Result<fab::PrintRecord> print(const fab::PrintPolicy& policy = {}, const fab::PrintSink& sink = {}) {
    fab::PrintRunner runner{*projector, *stage, masks, journal, clock};
    return runner.run(plan, policy, control, sink, {});
  }
  /// What the mirrors must show for a layer. Digests of two million mirrors are slow, so they are kept.
  [[nodiscard]] Digest mirrors_digest(LayerIndex layer) {
    static std::map<std::uint32_t, Digest> kept;
    const auto [at, fresh] = kept.try_emplace(layer.count());
    if (fresh) {
      const fab::Mask mirrors =
          fab::place_on_mirrors(masks.mask(layer)->view(), projector_model.mirrors(), OpticsTurn::Normal);
      at->second = digest_of(std::as_bytes(std::span{mirrors.rows}));
    }
    return at->second;
  }

  static constexpr PixelSize kSize{48, 32};
  static constexpr double kTop_mm = 25;
  VirtualClock clock;
  fab::MachineLog log;
  fab::Dlpc900Model projector_model{1, 6, clock, &log};
  fab::GrblModel stage_model{kTop_mm, clock, &log};
  FormulaMasks masks;
  fab::PrintPlan plan;
  fab::PrintJournal journal = *fab::PrintJournal::open(fab::memory_journal_file());
  fab::PrintControl control;
  std::unique_ptr<fab::Projector> projector;
  std::unique_ptr<fab::ZStage> stage;
};

}  // namespace telefab::test
