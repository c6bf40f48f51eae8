// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/verify/layer_runs.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// One thing that is wrong, or worth a look.
struct Finding {
  enum class Kind : std::uint8_t {
    Island = 1,          ///< material that rests on nothing: the job must not run
    OutOfReach = 2,      ///< material to be supported, farther than the anchor distance from every anchor
    FreePin = 3,         ///< a support that ends in the resin and holds nothing
    TrappedSupport = 4,  ///< a support inside a closed hollow of the part: it can never be taken out
    SuctionCup = 5,      ///< a hollow closed towards the platform while it is printed: it holds a vacuum (a warning)
    ResinTrap = 6,       ///< a closed hollow full of liquid resin (a warning)
  };
  Kind kind = Kind::Island;
  LayerIndex layer;     ///< of the print, where it begins
  LayerIndex last;      ///< of the print, where it ends
  Point2 place;         ///< one point of it
  double size_mm2 = 0;  ///< largest cross section
  friend bool operator==(const Finding&, const Finding&) = default;
};

[[nodiscard]] std::string_view name_of(Finding::Kind kind);
/// True for what holds a job until an operator overrides it.
[[nodiscard]] bool holds_the_job(Finding::Kind kind);

struct SupportReport {
  std::vector<Finding> findings;  ///< by layer, then y, then x of the place
  std::uint32_t layers = 0;       ///< looked at
  [[nodiscard]] bool passes() const;
  [[nodiscard]] std::size_t count(Finding::Kind kind) const;
};

/// {"passes":true,"layers":500,"counts":{...},"findings":[...]}; at most 1,000 findings are listed, all are counted.
[[nodiscard]] std::string to_json(const SupportReport& report);

/// The grey level from which a pixel cures through one layer, from the profile's dose figures: the exposure reaches
/// the resin's critical dose at the depth of one layer.
[[nodiscard]] std::uint8_t cure_level(const MachineProfile& machine);

/// The grey level from which a pixel of an exposure of that time begins to cure: the critical dose at the surface.
[[nodiscard]] std::uint8_t gel_level(const MachineProfile& machine, double exposure_s);

/// What else is known of a layer where the light of later ones is part of what cures it.
struct LayerLight {
  LayerRuns joined;  ///< pixels of the layer and those that are solid at their top only: what they connect is one body
  LayerRuns lit;     ///< pixels that the layer's own exposure begins to cure
};

/// Islands of fewer solid pixels are let pass, by the planner and by those who judge its plans.
constexpr std::uint32_t kLeastIslandPixels = 4;

/// Watches the masks of a print go by, bottom first. Finds islands of at least `least_pixels` solid pixels
/// (8-connected) that share no pixel with held material below; a smaller floating speck holds nothing above it. Nor
/// does what fewer pixels than that of its own exposure light: it cures together with the layers above, and hangs on
/// them. Finds suction cups and resin traps of at least that many pixels.
class MaskWatch {
 public:
  MaskWatch(double pitch_mm, std::uint32_t least_pixels);
  ~MaskWatch();
  MaskWatch(MaskWatch&&) noexcept;
  MaskWatch& operator=(MaskWatch&&) noexcept;
  /// The next layer. All layers must have the same size; InvalidInput otherwise. `removable`, if given, are the pixels
  /// of supports that `layer` does not hold: in a hollow that closes they are trapped. Without `light` the layer
  /// is what its own exposure cures.
  [[nodiscard]] Result<void> add(LayerRuns layer, const LayerRuns* removable = nullptr,
                                 const LayerLight* light = nullptr);
  /// Of what add() would report as islands of the next layer the pixels of those that have at most so many.
  [[nodiscard]] LayerRuns specks(const LayerRuns& layer, const LayerLight* light, std::uint64_t most_pixels) const;
  /// After the last layer.
  [[nodiscard]] SupportReport finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// What the check knows of a print. Nothing here comes from the generator's inner workings.
struct PrintGeometry {
  std::span<const Layer> part;                              ///< bottom first
  std::uint32_t elevation_layers = 0;                       ///< print layers below part layer 0
  std::function<std::vector<Contour>(LayerIndex)> support;  ///< rings of the support in a print layer
  std::vector<std::pair<Point2, LayerIndex>> anchors;       ///< place, part layer
};

/// Checks final regions: every piece of every layer overlaps the layer below or the platform; every point of each
/// to-support region lies within the anchor distance of an anchor not more than that below; no support ends in the
/// resin; no support in a closed hollow of the part; cups and traps. Own code throughout: shares nothing with the
/// planner but the region arithmetic. Fails: InvalidInput, Cancelled.
[[nodiscard]] Result<SupportReport> check_supports(const PrintGeometry& print, const MachineProfile& machine,
                                                   const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
