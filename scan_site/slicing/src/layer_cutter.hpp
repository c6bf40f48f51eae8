// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <telefab/geometry/layer.hpp>
#include <telefab/scan/contour/grid_tracer.hpp>
#include <telefab/scan/contour/reeb_marcher.hpp>
#include <telefab/scan/slicing/placed_surface.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/topology/height_topology.hpp>

#include "coverage.hpp"
#include "doubtful_places.hpp"

namespace telefab::scan {

/// What all layers of a part share. Immutable while layers are cut; outlives the cutter.
struct CutSetting {
  const ScalarField& field;
  /// The same field, answering everywhere: asked where contours of `field` do not close. None: they are left out.
  const ScalarField* closed = nullptr;
  /// The side that all samples tell, without the field: asked where the field has no contour though there must be one.
  const ScalarField* last_resort = nullptr;
  const HeightTopology* topology = nullptr;  ///< none: nothing is predicted
  SampleSource samples;
  double band_mm = 0;  ///< samples farther than this from a plane are no matter of it: the widest of the bands
  /// Samples this near to a plane, in widths of their own kernel, must lie beside one of its contours. Above half the
  /// distance of rows over the kernel: between the rows of a grid there is else no sample at all.
  double band_kernels = 0.8;
  double cover_kernels = 0.75;  ///< a sample this near (in kernel widths) to a contour of like normal is covered
  double stray_share = 0;       ///< share of the samples near a plane that no surface need pass: outliers
  double noise_mm = 0;          ///< of the samples
  /// So few samples for the size of the part that the field's critical heights may be far from the object's: two
  /// methods that agree on the field then prove nothing, only the critical points do.
  bool sparse = false;
  double chord_mm = 0.014;
  /// A march may ask the field so often for each sample near the plane; what asks more often goes in circles.
  std::uint64_t evaluations_a_sample = 200;
  TraceMethod method = TraceMethod::Auto;
  /// The same samples seen with other kernels. Where they show other contours, the scan does not decide the layer.
  std::vector<const ScalarField*> other_kernels = {};
  /// Whether the scan shows the surface at a place; none: everywhere.
  std::function<bool(const Vec3& place_mm)> measured = {};
  /// What each edge of a contour at this height rests on, one run an edge; none: all is measured.
  std::function<std::vector<SurfaceRun>(const Contour& contour, double z_mm)> surface = {};
  /// A place where something that knows nothing of the field contradicts the contours, or cannot tell; none where it
  /// bears them out. Unset: there is nothing to ask.
  std::function<std::optional<Point2>(std::span<const Contour> contours, double z_mm, const SurfaceSamples& near)>
      contradiction = {};
  /// A place in a gap of the scan where contours may begin, end, part or join: nothing tells at which height between
  /// the two, so no layer between them can be vouched for. It concerns what runs within reach of the line from one to
  /// the other.
  struct UndecidedPlace {
    Vec3 low_mm, high_mm;
    double reach_mm = 0;
  };
  std::vector<UndecidedPlace> undecided = {};
  std::span<const DoubledPlace> doubled = {};  ///< rising in z; what runs within `doubled_reach_mm` of one is doubtful
  double doubled_reach_mm = 0;
  std::optional<Doubt> known_doubt = {};  ///< of the scan as a whole: no layer of it can be vouched for
};

struct CutLayer {
  Layer layer;
  std::vector<ContourGap> gaps;
  std::uint64_t evaluations = 0;
};

/// Cuts layers one after another with one cursor; one cutter a thread. What it cut before changes no byte.
class LayerCutter {
 public:
  explicit LayerCutter(const CutSetting& setting);
  /// The rings at z and what can be vouched for. Fails: TooLarge, Cancelled.
  [[nodiscard]] Result<CutLayer> cut(LayerIndex index, double z_mm, std::stop_token stop);

 private:
  struct Candidate;
  struct Prediction;
  struct Choice;
  [[nodiscard]] Prediction prediction_at(double z_mm) const;
  /// Marches, and looks with the grid as well where the graph alone does not settle it.
  [[nodiscard]] Result<Choice> choose(double z_mm, const Prediction& predicted, std::stop_token stop);
  /// What is against a sound layer although something vouches for it; none where nothing is.
  [[nodiscard]] Result<std::optional<Doubt>> unsettled(const Choice& made, double z_mm, std::span<const Vec3> seeds,
                                                       std::stop_token stop, DoubtfulPlaces& where);
  /// What runs where the scan shows two sheets, the farthest apart; none where nothing does.
  [[nodiscard]] std::optional<Doubt> doubled_sheets(const Choice& made, double z_mm, DoubtfulPlaces& where) const;
  [[nodiscard]] Doubt why_uncertified(const Choice& made, const Prediction& predicted, double z_mm,
                                      DoubtfulPlaces& where) const;
  [[nodiscard]] Result<Candidate> marched(double z_mm, std::span<const Vec3> seeds, std::stop_token stop);
  [[nodiscard]] Result<Candidate> gridded(double z_mm, std::stop_token stop);
  /// Closes what `open` leaves open; each gap stays a fault.
  [[nodiscard]] Result<LayerTrace> closed(const LayerTrace& open, double z_mm, const GridOptions& options,
                                          std::stop_token stop);
  /// The contours of the last resort, doubtful as a whole; none where it has none either.
  [[nodiscard]] Result<std::optional<Candidate>> from_last_resort(double z_mm, std::stop_token stop);
  void judge(Candidate& candidate, double z_mm);
  /// Whether the contours are missing that must be cut.
  [[nodiscard]] static bool lacks_all(const Candidate& candidate);
  [[nodiscard]] static bool better_founded(const Candidate& grid, const Candidate& march);
  /// A place where the surface passes from below the plane to above it, so that something must be cut; none where there
  /// is no such place.
  [[nodiscard]] std::optional<Point2> wall_through(double z_mm);
  /// For an empty layer: a place where the next samples below and above the plane, however far, are walls; none where
  /// one side has none, or only tops and undersides.
  [[nodiscard]] std::optional<Point2> walls_of_next_rows(double z_mm);
  /// The samples that have a say in the plane.
  void gather(double z_mm);
  /// What another kernel finds otherwise; none where all agree.
  [[nodiscard]] Result<std::optional<Doubt>> disagreement(const Candidate& candidate, double z_mm,
                                                          std::span<const Vec3> seeds, std::stop_token stop,
                                                          DoubtfulPlaces& where);
  /// Tells what the contours rest on, and makes the verdict say so.
  [[nodiscard]] Result<void> classify(Layer& layer, const DoubtfulPlaces& where) const;
  [[nodiscard]] MarchOptions march_options() const;
  [[nodiscard]] double width_at(Point2 place, double z_mm) const {
    return setting_.field.kernel_width_mm({place.x_mm, place.y_mm, z_mm});
  }

  const CutSetting& setting_;
  std::unique_ptr<FieldCursor> cursor_;
  std::unique_ptr<FieldCursor> closed_cursor_;               ///< made when first needed
  std::vector<std::unique_ptr<FieldCursor>> other_cursors_;  ///< of the other kernels
  SurfaceSamples near_;
  SurfaceSamples steep_;  ///< those of near_ that must lie beside a contour
};

}  // namespace telefab::scan
