// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/cure/calibration_band.hpp>
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/cure/surface_points.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/image/frame.hpp>

namespace telefab::fab {

/// A print whose outcome is wanted. Views must outlive the call.
struct PrintToPredict {
  std::uint32_t layers = 0;            ///< of the print
  std::uint32_t elevation_layers = 0;  ///< below layer 0 of the part
  LightSource light;
  std::span<const Layer> part;                     ///< from its layer 0 up; empty: nothing is compared
  std::span<const std::vector<Contour>> supports;  ///< rings by print layer, as many as layers; or empty
};

struct PredictOptions {
  int sub_pixels = 4;                 ///< 1 to 16 a pixel and axis
  int spacing_px = 1;                 ///< 1 to 64; distance of surface points
  bool supports = false;              ///< their surface points as well
  int threads = 0;                    ///< 0: all cores; the prediction is the same for any number
  std::optional<LayerIndex> picture;  ///< print layer whose edges are drawn; empty: the one of most contour
  PictureCaption caption = {};        ///< of the picture: whose it is; legend, scale and axes are filled in
  [[nodiscard]] Result<void> validate() const;
};

struct Prediction {
  std::vector<SurfacePoint> points;  ///< print frame, from the platform up
  CuredSolid solid;
  std::vector<EdgeFigures> layers;  ///< by part layer, at the middle of the layer
  EdgeFigures edges;                ///< all of them
  DistanceTally undersides;         ///< in layers; positive: cured too deep
  double contour_mm3 = 0;           ///< inside the contours of part and supports, layers times thickness
  std::size_t support_points = 0;   ///< left out or in, as asked
  Image picture;                    ///< the part on its supports, shaded, and the edges of one layer
  LayerIndex pictured;
};

/// Cures the print and compares it with its contours. Fails as cure_solid does, and with InvalidInput where the counts
/// of layers do not agree. Same prediction on any number of threads.
[[nodiscard]] Result<Prediction> predict_print(const CureModel& model, const PrintToPredict& print,
                                               const PredictOptions& options, const ProgressSink& progress,
                                               std::stop_token stop);

/// How far the part may be from the prediction, with 95 % confidence, by what the calibration leaves open.
struct PredictionBand {
  CalibrationBand calibration;
  double edges_px = 0;       ///< edges at mid-layer, either way
  double undersides_mm = 0;  ///< either way
};
[[nodiscard]] PredictionBand band_of(const Prediction& prediction, const CalibrationBand& calibration);

/// report.json of a prediction: lengths in pixels and millimetres, overall and by layer; the band where there is one.
[[nodiscard]] std::string to_json(const Prediction& prediction, const CureModel& model,
                                  const std::optional<PredictionBand>& band);

}  // namespace telefab::fab
