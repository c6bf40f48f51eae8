// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <limits>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/fab/verify/support_check.hpp>
#include <vector>

namespace telefab::fab {

/// How a print is judged. Stress and pull enter as their ratio alone, the demand: a place carries where its demand is
/// at most strength / (safety * pull), see carried_demand() of the machine's profile.
struct CarryOptions {
  double pitch_mm = 0;        ///< > 0; of a pixel
  double thickness_mm = 0;    ///< > 0; of a layer
  double sideways_share = 0;  ///< >= 0; force in the layer's plane, any direction, as share of the pull
  double weight_share = 0;    ///< >= 0; weight of a layer over the pull on as much area
  double vacuum_share = 0;    ///< >= 0; vacuum under the opening of a hollow that the film closes, over the pull
  double doubled_at_mm = 0;   ///< >= 0; area over perimeter of a piece that is pulled twice as hard; 0: by area alone
  double limit = std::numeric_limits<double>::infinity();  ///< > 0; places with a larger demand are listed
  double least_held_mm2 = 10;                              ///< >= 0; what holds less is judged apart
  double most_torn_mm2 = 1;  ///< >= 0; a section up to that may tear where the rest of the print carries without it
};

/// A section of the print and what it bears at the moment at which that is most.
struct CarryPlace {
  enum class Check : std::uint8_t {
    Cut = 1,      ///< mean of the least cut
    Lever = 2,    ///< its parts bear by their stiffness, and more where the pull is off their middle
    Bending = 3,  ///< the same at the rim of a part of it, and at every level section as of beams
  };
  Check check = Check::Cut;
  LayerIndex moment;       ///< of the print: the layer just exposed
  LayerIndex layer;        ///< of the print: the upper of the two layers that meet in the section
  Point2 place;            ///< its middle
  double section_mm2 = 0;  ///< its area
  double held_mm2 = 0;     ///< what hangs on the whole cut, as so much area is pulled
  Point2 pulled_at;        ///< the middle of that
  double demand = 0;       ///< stress over pull
  friend bool operator==(const CarryPlace&, const CarryPlace&) = default;
};
[[nodiscard]] std::string_view name_of(CarryPlace::Check check);

struct CarryReport {
  std::optional<CarryPlace> cut, lever, bending;  ///< the worst by each check, of what holds at least `least_held_mm2`
  std::optional<CarryPlace> small;                ///< the worst by any check, of what holds less
  std::vector<CarryPlace> weak;                   ///< above the limit, the worst of each section; worst first
  std::vector<CarryPlace> weak_small;             ///< the same of what holds less
  /// The worst that the rest bears once all of `weak` has torn off, where that loses no more than those places: each is
  /// small, nothing floats without them, and what is left carries. None: the print is lost with them, or nobody knows.
  std::optional<CarryPlace> without_weak;
  double afloat_mm2 = 0;  ///< most area pulled at one moment that nothing joins to the platform: not judged
  double base_mm2 = 0;    ///< of the first layer
  std::uint32_t layers = 0;
  /// The worst of all checks, of what holds at least `least_held_mm2`; none where nothing does.
  [[nodiscard]] const CarryPlace* worst() const;
};

/// {"layers":500,"base_mm2":..,"afloat_mm2":..,"cut":{..},"lever":{..},"bending":{..},"small":{..},"weak":[..],
/// "weak_small":[..],"without_weak":{..}}; at most 200 places a list, all are counted.
[[nodiscard]] std::string to_json(const CarryReport& report);

/// Of the solid pixels those that count for strength: lit at half of white or more in that layer's mask, or with none
/// but solid ones around. The others are rims that light of other layers and the spread of pixels cured.
[[nodiscard]] LayerRuns firm_pixels(const MaskView& mask, const LayerRuns& solid);

/// Watches the solid pixels of a print go by, bottom first, and judges whether they carry the pull on each layer just
/// exposed. At moment k the layers 0 to k exist, every piece of layer k is pulled in proportion to its area, a hollow
/// that opens in it and is closed towards the platform pulls on the piece around it, all hang by their weight, and
/// layer 0 stands fast. Pieces are 8-connected, two of consecutive layers meet in the pixels that they share, and a
/// piece is rigid in its plane. Areas are of firm pixels where there are any. Knows nothing of how the print was
/// planned.
class CarryWatch {
 public:
  explicit CarryWatch(const CarryOptions& options);
  ~CarryWatch();
  CarryWatch(CarryWatch&&) noexcept;
  CarryWatch& operator=(CarryWatch&&) noexcept;
  /// The next layer and, of its pixels, the firm ones, pulled `pull_share` times as hard as others; with `light` as
  /// MaskWatch takes it: what hangs together at the layer's top is one piece, and a piece of which its own exposure
  /// begins to cure next to nothing is not pulled. InvalidInput: another size than before.
  [[nodiscard]] Result<void> add(const LayerRuns& solid, const LayerRuns& firm, const LayerLight* light = nullptr,
                                 double pull_share = 1);
  /// After the last layer; in parallel on oneTBB's workers, the same on any number of them. Fails: Cancelled.
  [[nodiscard]] Result<CarryReport> finish(const std::stop_token& stop);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::fab
