// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/cure/cure_model.hpp>
#include <telefab/fab/cure/narrow_places.hpp>
#include <telefab/fab/cure/pixel_kernel.hpp>
#include <telefab/geometry/layer.hpp>

namespace telefab::fab {

/// A thin wall or gap and how much dose it bears.
struct ThinFeature {
  NarrowPlace place;
  LayerIndex layer;  ///< of the print
  /// Share by which the dose may be wrong before the feature is lost: too little for a wall, too much for a gap.
  /// Negative: it is lost as planned, -1: by far. Nothing where the dose is not known.
  std::optional<double> latitude;
};

/// What is thin in a print. Features that no neighbouring layer has (the first section of a dome) are not counted.
struct ThinFigures {
  std::uint32_t fine_layers = 0;  ///< layers with places narrower than a pixel
  double fine_mm = 0;             ///< their length, summed over layers
  std::optional<ThinFeature> narrowest;
  std::uint32_t weak_layers = 0;       ///< layers with places that kDoseTolerance loses
  std::optional<ThinFeature> weakest;  ///< of all narrow places
};
struct ThinReport {
  ThinFigures walls, gaps;
  std::vector<ThinFeature> weak;  ///< the weakest of each layer and kind that kDoseTolerance loses, weakest first
  bool dose_known = false;
};
/// Masks show features from this width on; what is narrower is told.
inline constexpr double kFinestFeature_px = 1;
/// How far the dose of a calibrated machine may be off, as a share: lamps drift, and resins differ by the bottle.
inline constexpr double kDoseTolerance = 0.05;

/// {"dose_tolerance":..,"walls":{..},"gaps":{..},"weak":[..]}: at most 100 weak places, one a layer and kind.
[[nodiscard]] std::string to_json(const ThinReport& report);

/// Warns of features too fine for the pixels or too weak for the dose, from contours and masks alone: the light of
/// each exposure at the middle of every narrow place (narrow_places, below two pixels), later exposures faded by the
/// layers between, against the dose that cures to the middle of its layer. At most kMostPlaces a layer are looked at,
/// the narrowest.
class FeatureWatch {
 public:
  static constexpr std::size_t kMostPlaces = 500;

  /// `part` (bottom first) lies above `elevation_layers` of supports and must outlive this. The pitch must be positive.
  /// Without a model the dose is not known.
  FeatureWatch(std::span<const Layer> part, std::uint32_t elevation_layers, double pixel_pitch_mm,
               std::optional<CureModel> model);

  /// Looks for what is narrow in the next print layers, up to but without `until`. On oneTBB.
  void look(std::uint32_t until);
  /// Light of one exposure, in doses of Ec, at the places of its layer and of those below that it shines through to.
  /// Layers up to it must have been looked at. Threads: from several at once.
  [[nodiscard]] std::vector<float> light_of(std::uint32_t print_layer, const MaskExposure& exposure) const;
  /// What light_of found, layer by layer in order, bottom first.
  void add(std::uint32_t print_layer, std::span<const float> light);
  /// After the last layer.
  [[nodiscard]] ThinReport finish();

 private:
  struct Watched {
    std::vector<NarrowPlace> places;
    std::vector<double> dose;  // so far, of every place
  };
  [[nodiscard]] std::uint32_t lowest_lit(std::uint32_t print_layer) const;
  [[nodiscard]] double light_at(const MaskExposure& exposure, Point2 place) const;
  void judge(std::uint32_t print_layer);
  [[nodiscard]] bool has_neighbour(std::uint32_t print_layer, const NarrowPlace& place) const;

  std::span<const Layer> part_;
  std::uint32_t elevation_layers_;
  double pitch_mm_;
  std::optional<CureModel> model_;
  std::optional<PixelKernel> kernel_;
  std::uint32_t reach_ = 1;   // layers below its own that an exposure counts in
  std::uint32_t looked_ = 0;  // print layers
  std::uint32_t judged_ = 0;
  std::vector<Watched> layers_;  // of the print; emptied when done with
  ThinReport report_;
};

}  // namespace telefab::fab
