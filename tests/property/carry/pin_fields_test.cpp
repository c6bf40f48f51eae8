// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <telefab/fab/carry/carry_watch.hpp>
#include <telefab/test/block_stack.hpp>

// The lever rule against frames of beams: random pins under a rigid plate that is pulled somewhere in its middle.
namespace telefab::fab {
namespace {

constexpr double kPitch = 0.1, kThickness = 0.5;
constexpr std::uint32_t kTop = 84;  ///< the plate's first layer
constexpr std::uint32_t kTip = 2;   ///< layers

struct RandomPin {
  double x = 0, y = 0;
  double side = 0, tip_side = 0;  ///< mm; square
  std::uint32_t first = 0;        ///< layer; below it stands a rigid block
};

struct Field {
  std::vector<RandomPin> pins;
  double x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< of the plate
};

Field random_field(std::mt19937_64& random) {
  const auto whole = [&](int low, int high) { return std::uniform_int_distribution<int>{low, high}(random); };
  Field field;
  const int count = whole(4, 20);
  while (static_cast<int>(field.pins.size()) < count) {
    // Pins of 1 mm and tips of 0.4, 0.6 and 0.8 mm on a lattice of pixels, 2 to 40 mm long.
    const RandomPin pin{whole(20, 180) / 10.0, whole(20, 180) / 10.0, 1.0, 0.4 + 0.2 * whole(0, 2),
                        static_cast<std::uint32_t>(kTop - 4 - whole(0, 76))};
    const bool is_free = std::none_of(field.pins.begin(), field.pins.end(), [&](const RandomPin& p) {
      return std::max(std::abs(p.x - pin.x), std::abs(p.y - pin.y)) < 2.2;
    });
    if (is_free) field.pins.push_back(pin);
    if (!is_free && whole(0, 200) == 0) break;
  }
  field.x0 = whole(5, 50) / 10.0, field.y0 = whole(5, 50) / 10.0;
  field.x1 = whole(150, 195) / 10.0, field.y1 = whole(150, 195) / 10.0;
  return field;
}

/// A slab over all pins that its own exposure does not cure, and on it the plate, the one layer that is pulled.
CarryReport judged(const Field& field) {
  CarryWatch watch{{.pitch_mm = kPitch, .thickness_mm = kThickness}};
  const auto square = [](double x, double y, double side) {
    return test::rectangle(x - side / 2, y - side / 2, x + side / 2, y + side / 2);
  };
  for (std::uint32_t k = 0; k < kTop + 2; ++k) {
    std::vector<Contour> rings;
    if (k < kTop)
      for (const RandomPin& pin : field.pins)
        rings.push_back(square(pin.x, pin.y, k < pin.first ? 2.0 : k + kTip < kTop ? pin.side : pin.tip_side));
    else if (k == kTop)
      rings.push_back(test::rectangle(0, 0, 20, 20));
    else
      rings.push_back(test::rectangle(field.x0, field.y0, field.x1, field.y1));
    const LayerRuns runs = LayerRuns::from_contours(rings, {200, 200}, kPitch);
    const LayerLight light{runs, k == kTop + 1 ? runs : LayerRuns::from_contours({}, {200, 200}, kPitch)};
    EXPECT_TRUE(watch.add(runs, runs, &light));
  }
  auto report = watch.finish({});
  EXPECT_TRUE(report);
  return std::move(*report);
}

/// Stress over pull in the middle of each tip, by a frame: every pin a row of beams that stretch and bend, clamped
/// below, welded to the plate above.
std::vector<double> frame_stresses(const Field& field) {
  using Matrix = Eigen::Matrix<double, 6, 6>;
  using Vector = Eigen::Matrix<double, 6, 1>;
  constexpr double kModulus = 160, kShear = kModulus / 2.7;
  /// Moves what happens at (x, y) to the origin of the plate: u + w x r.
  const auto moved = [](double x, double y) {
    Matrix m = Matrix::Identity();
    m(0, 5) = -y, m(1, 5) = x, m(2, 3) = y, m(2, 4) = -x;
    return m;
  };
  const auto pin_stiffness = [&](const RandomPin& pin) {
    // From above: how far a force at the top moves it, beam by beam, z being the distance of a beam's ends from the
    // top.
    Matrix soft = Matrix::Zero();
    struct Beam {
      double side, from, to;
    };
    const double tip = (kTip + 0.5) * kThickness, blocks_top = (kTop - pin.first + 0.5) * kThickness;
    for (const Beam& beam :
         {Beam{pin.tip_side, 0, tip}, Beam{pin.side, tip, blocks_top}, Beam{2.0, blocks_top, kTop * kThickness}}) {
      const double area = beam.side * beam.side, i = area * area / 12, l = beam.to - beam.from;
      const double l2 = (beam.to * beam.to - beam.from * beam.from) / 2;
      const double l3 = (beam.to * beam.to * beam.to - beam.from * beam.from * beam.from) / 3;
      const double ei = kModulus * i;
      soft(2, 2) += l / (kModulus * area);
      soft(0, 0) += l3 / ei, soft(1, 1) += l3 / ei;
      soft(3, 3) += l / ei, soft(4, 4) += l / ei;
      // A push in x turns the top about y, one in y about x the other way.
      soft(0, 4) += l2 / ei, soft(4, 0) += l2 / ei;
      soft(1, 3) -= l2 / ei, soft(3, 1) -= l2 / ei;
      soft(5, 5) += l / (kShear * 0.141 / 0.0833 * i);
    }
    return Matrix{soft.inverse()};
  };
  Matrix all = Matrix::Zero();
  std::vector<Matrix> own;
  for (const RandomPin& pin : field.pins) {
    own.push_back(pin_stiffness(pin));
    const Matrix m = moved(pin.x, pin.y);
    all += m.transpose() * own.back() * m;
  }
  const double pull = (field.x1 - field.x0) * (field.y1 - field.y0);
  Vector force = Vector::Zero();
  force(2) = pull;
  force(3) = pull * (field.y0 + field.y1) / 2;
  force(4) = -pull * (field.x0 + field.x1) / 2;
  const Vector motion = all.ldlt().solve(force);
  std::vector<double> stresses;
  for (std::size_t i = 0; i < own.size(); ++i) {
    const RandomPin& pin = field.pins[i];
    const Vector at_top = own[i] * (moved(pin.x, pin.y) * motion);
    stresses.push_back(at_top(2) / (pin.tip_side * pin.tip_side));
  }
  return stresses;
}

TEST(PinFields, TheWorstTipIsNamedAndItsStressIsThatOfAFrameOfBeams) {
  std::mt19937_64 random{19};
  constexpr int kFields = 200;
  int named = 0;
  double low = 1e9, high = 0;
  for (int i = 0; i < kFields; ++i) {
    const Field field = random_field(random);
    const CarryReport report = judged(field);
    ASSERT_TRUE(report.lever);
    const auto stresses = frame_stresses(field);
    const auto worst = static_cast<std::size_t>(std::max_element(stresses.begin(), stresses.end()) - stresses.begin());
    const double ratio = report.lever->demand / stresses[worst];
    low = std::min(low, ratio), high = std::max(high, ratio);
    EXPECT_GT(ratio, 0.75) << "field " << i;
    EXPECT_LT(ratio, 1.25) << "field " << i;
    const RandomPin& pin = field.pins[worst];
    named += std::abs(report.lever->place.x_mm - pin.x) < 0.01 && std::abs(report.lever->place.y_mm - pin.y) < 0.01;
  }
  EXPECT_GE(named, kFields * 9 / 10);
  RecordProperty("named", named);
  RecordProperty("least", std::to_string(low));
  RecordProperty("most", std::to_string(high));
}

}  // namespace
}  // namespace telefab::fab
