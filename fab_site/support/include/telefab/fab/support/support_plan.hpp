// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/fab/support/covering.hpp>
#include <telefab/fab/support/layer_rule.hpp>
#include <telefab/fab/support/part_regions.hpp>
#include <telefab/fab/support/structure.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// How much a tip bears and how wide a mark it leaves.
enum class TipClass : std::uint8_t { Light = 1, Medium = 2, Heavy = 3 };
[[nodiscard]] std::string_view name_of(TipClass tip);

/// Places an operator wants held, or kept free of anchors. Millimetres; build frame of the part as it stands in its
/// own stack (z = 0 at the part's first layer, the elevation not included).
struct HandList {
  struct Extra {
    Point2 place;
    double z_mm = 0;  ///< the anchor holds the first material at or above this height
  };
  struct Forbidden {
    Point2 place;
    double radius_mm = 0;
    double from_z_mm = 0;
    double to_z_mm = 0;
  };
  /// An anchor that would be placed by itself, and is not wanted. Those around it stay where they are, and no other is
  /// placed within a light tip's radius of it.
  struct Removed {
    Point2 place;
    LayerIndex layer;  ///< of the part
  };
  std::vector<Extra> extra;
  std::vector<Forbidden> forbidden;
  std::vector<Removed> removed;
  [[nodiscard]] bool is_empty() const { return extra.empty() && forbidden.empty() && removed.empty(); }
};

/// {"extra":[{"x_mm":1,"y_mm":2,"z_mm":0}],"forbidden":[{"x_mm":1,"y_mm":2,"radius_mm":3,"from_z_mm":0,"to_z_mm":9}],
/// "removed":[{"x_mm":1,"y_mm":2,"part_layer":7}]}. Each list may be missing. InvalidInput: unknown keys, numbers that
/// are not finite, layers that are not whole numbers, and more than 10,000 entries.
[[nodiscard]] Result<HandList> hand_list_from_json(std::string_view text);
/// The text that hand_list_from_json reads back, on one line; all three lists are there. Millimetres in full.
[[nodiscard]] std::string to_json(const HandList& list);

struct SupportOptions {
  /// Cover: anchors where something hangs. Auto: those, and wider tips and more anchors until all bear the pull of the
  /// film on each layer in turn, by the machine's carried_demand().
  enum class Mode : std::uint8_t { None = 1, Auto = 2, Cover = 3 };
  /// Auto: the part stands on the platform where its first layer is at least `stand_area_share` (machine profile) of
  /// its largest layer, and is lifted on pins otherwise. Always: elevation 0. Never: always lifted.
  enum class Stand : std::uint8_t { Auto = 1, Always = 2, Never = 3 };

  /// Where material floats in masks although regions are held: what a check of the masks found.
  struct Floating {
    Point2 place;
    LayerIndex layer;  ///< of the part
  };
  /// An anchor of an earlier plan that stays.
  struct Bearing {
    Point2 place;
    LayerIndex layer;  ///< of the part
    TipClass tip = TipClass::Light;
    double strength = 1;  ///< (0, 1]; what its tip was found to bear over what it should
  };

  Mode mode = Mode::Auto;
  Stand stand = Stand::Auto;
  HandList hand;
  /// Each gets an anchor of its own where the part's layer has material within two pixels of the place. Not for None.
  std::vector<Floating> floating;
  /// Auto only. Where there are some no tip is made narrower again.
  std::vector<Bearing> bearing;
  int threads = 0;  ///< 0 (all cores) to 1024; the result is the same for any number
  [[nodiscard]] Result<void> validate() const;
};

/// One place where the structure holds the part.
struct Anchor {
  Point2 place;
  LayerIndex layer;      ///< of the part: the material of this layer rests on the anchor
  bool by_hand = false;  ///< from the hand list
  bool on_part = false;  ///< its pin stands on the part, not on the platform
  TipClass tip = TipClass::Light;
  double strength = 1;  ///< as SupportOptions::Bearing has it
  Point2 foot;          ///< where its pin stands
  double demand = 0;    ///< stress over pull at its worst moment, as planned; 0: not planned for
  friend bool operator==(const Anchor&, const Anchor&) = default;
};

/// What the analysis found, for reports.
struct SupportFigures {
  std::uint32_t layers_with_regions = 0;  ///< layers with something to support
  double to_support_mm2 = 0;              ///< summed over layers
  double waived_mm2 = 0;                  ///< of that, in places forbidden by hand
  std::uint32_t removed = 0;              ///< anchors that would hold the part and were removed by hand
  std::uint32_t feet_on_part = 0;
  std::uint32_t braces = 0;
  std::uint32_t thin_pins = 0;   ///< pins in places too tight for a full one
  std::uint32_t may_buckle = 0;  ///< pins that stand free for too long for their load
  std::uint32_t unreached = 0;   ///< anchors without a pin, where pins may stand on the platform only
  double part_mm3 = 0;
  double support_mm3 = 0;
  std::uint32_t floating = 0;  ///< anchors under what floated in the masks
  std::uint32_t medium_tips = 0, heavy_tips = 0;
  std::uint32_t bearing = 0;      ///< anchors that only bear the pull
  double bearing_demand = 0;      ///< of the worst tip, stress over pull, as planned; 0: not planned for
  std::uint32_t stabilising = 0;  ///< anchors that only keep a lifted part over its pins
  double stability_mm = 0;  ///< least slack of the centre of mass inside the hull of what holds the print, counted
                            ///< from a twentieth of its height; negative: it may tip over
  LayerIndex least_stable;  ///< of the part: the moment of that
  friend bool operator==(const SupportFigures&, const SupportFigures&) = default;
};

/// Supports of one part. Print layers count from the platform; part layer k is print layer k + elevation_layers().
class SupportPlan {
 public:
  SupportPlan(std::uint32_t elevation_layers, std::vector<Anchor> anchors, StructureSections sections,
              SupportFigures figures)
      : elevation_layers_{elevation_layers},
        anchors_{std::move(anchors)},
        sections_{std::move(sections)},
        figures_{figures} {}

  /// Layers inserted below the part; 0 when it stands on the platform.
  [[nodiscard]] std::uint32_t elevation_layers() const { return elevation_layers_; }
  /// Sorted by layer, then y, then x.
  [[nodiscard]] std::span<const Anchor> anchors() const { return anchors_; }
  [[nodiscard]] const Structure& structure() const { return sections_.structure(); }
  [[nodiscard]] const SupportFigures& figures() const { return figures_; }
  /// The support's rings in that print layer, canonical order; may overlap the part at tips and feet.
  [[nodiscard]] std::vector<Contour> section(LayerIndex print_layer) const;
  /// The same as a region.
  [[nodiscard]] Region section_region(LayerIndex print_layer) const { return sections_.section(print_layer); }
  /// Whether another plan of the same part has the same section there, as StructureSections has it.
  [[nodiscard]] bool has_same_section(const SupportPlan& other, LayerIndex print_layer) const {
    return elevation_layers_ == other.elevation_layers_ && sections_.has_same_section(other.sections_, print_layer);
  }

 private:
  std::uint32_t elevation_layers_;
  std::vector<Anchor> anchors_;
  StructureSections sections_;
  SupportFigures figures_;
};

/// Plans the supports of one part again and again, as its masks show what floats and which pins are too weak. What does
/// not depend on that is found once: what hangs, the anchors that cover it, columns and places of pins.
/// Deterministic on any number of threads. Threads: one caller at a time.
class SupportPlanner {
 public:
  /// Of a part that was analysed before; `floating` and `bearing` of the options are passed over. Fails with
  /// InvalidInput: options, a part that was analysed for another machine or has another number of layers than the
  /// header says.
  [[nodiscard]] static Result<SupportPlanner> make(std::shared_ptr<const PartRegions> part, const StackHeader& header,
                                                   const MachineProfile& machine, const SupportOptions& options);
  /// Analyses the part first; `layers` are the whole of it, bottom first. Fails as the other, and as analyse_part does.
  [[nodiscard]] static Result<SupportPlanner> make(std::span<const Layer> layers, const StackHeader& header,
                                                   const MachineProfile& machine, const SupportOptions& options,
                                                   const ProgressSink& progress, const std::stop_token& stop);
  ~SupportPlanner();
  SupportPlanner(SupportPlanner&&) noexcept;
  SupportPlanner& operator=(SupportPlanner&&) noexcept;

  /// As plan_supports() with these of its options. Fails: InvalidInput, TooLarge, Cancelled.
  [[nodiscard]] Result<SupportPlan> plan(std::vector<SupportOptions::Floating> floating,
                                         std::vector<SupportOptions::Bearing> bearing, const ProgressSink& progress,
                                         const std::stop_token& stop);

 private:
  struct State;
  explicit SupportPlanner(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Analyses all layers (4.1), covers what is to be supported (4.2), and builds pins, braces and base. `layers` are
/// the whole part, bottom first. Deterministic on any number of threads.
/// Fails: InvalidInput (options, coordinates, layer order), TooLarge, Cancelled.
[[nodiscard]] Result<SupportPlan> plan_supports(std::span<const Layer> layers, const StackHeader& header,
                                                const MachineProfile& machine, const SupportOptions& options,
                                                const ProgressSink& progress, std::stop_token stop);

/// The same of a part that was analysed before, by analyse_part or as its layers came. Fails with InvalidInput where it
/// was analysed for another machine or has another number of layers than the header says.
[[nodiscard]] Result<SupportPlan> plan_supports(const PartRegions& part, const StackHeader& header,
                                                const MachineProfile& machine, const SupportOptions& options,
                                                const ProgressSink& progress, std::stop_token stop);

/// The four regions of one layer, for pictures and tests; the same analysis as plan_supports.
[[nodiscard]] Result<LayerRegions> regions_of_layer(std::span<const Layer> layers, LayerIndex layer,
                                                    const MachineProfile& machine);

/// supports.json: elevation, figures, anchors, elements and plates; numbers rounded to nanometres; same plan, same
/// text.
[[nodiscard]] std::string to_json(const SupportPlan& plan);

}  // namespace telefab::fab
