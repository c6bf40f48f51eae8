// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <map>
#include <telefab/scan/topology/height_topology.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::test {
namespace {

using scan::analyse_height;
using scan::CriticalKind;
using scan::HeightTopology;

HeightTopology analysed(const AnalyticField& shape, double spacing_mm = 0.85) {
  const SurfaceSamples samples = sample_surface(shape, {.spacing_mm = spacing_mm});
  auto topology = analyse_height(shape, {samples.points, samples.normals}, {}, {});
  EXPECT_TRUE(topology) << topology.error().what;
  return std::move(*topology);
}

/// As if nobody had seen what lies so near to these places.
Result<HeightTopology> analysed_without(const AnalyticField& shape, const std::vector<Vec3>& places,
                                        double radius_mm = 8) {
  const SurfaceSamples all = sample_surface(shape, {.spacing_mm = 0.85});
  SurfaceSamples seen;
  for (std::size_t i = 0; i < all.points.size(); ++i)
    if (std::all_of(places.begin(), places.end(),
                    [&](const Vec3& p) { return (all.points[i] - p).norm() > radius_mm; })) {
      seen.points.push_back(all.points[i]);
      seen.normals.push_back(all.normals[i]);
    }
  return analyse_height(shape, {seen.points, seen.normals}, {}, {});
}

std::string inconsistencies_of(const HeightTopology& topology) {
  std::string text;
  for (const std::string& d : topology.inconsistencies()) text += d + "\n";
  return text;
}

struct Case {
  const char* name;
  Shape (*make)();
};
std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

const Case kCases[] = {
    {"Sphere", [] { return sphere(20, 1); }},
    {"Ellipsoid",
     [] {
       return ellipsoid({12, 18, 30}, 1, Pose::turned(40, Vec3{1, 2, 3}));
     }},
    {"TorusUpright", [] { return torus(20, 8, 90, 1); }},
    {"TorusLeaning",
     [] {
       return torus(20, 8, 30, 1, {3, 4, 5});
     }},
    {"TorusLyingNearlyFlat", [] { return torus(20, 8, 6, 1); }},
    {"TorusFlat", [] { return torus(20, 8, 0, 1); }},
    {"GenusTwo", [] { return genus_two(20, 1); }},
    {"GenusTwoTurned",
     [] {
       return genus_two(20, 1, Pose::turned(70, Vec3{1, 0.3, 0}));
     }},
    {"TwoBumps", [] { return two_bumps(20, 1); }},
    {"ThinWall", [] { return thin_wall(30, 40, 3, 1); }},
    {"NearTouchingBalls", [] { return near_touching_balls(15, 1.5, 1); }},
    {"FlatBox",
     [] {
       return flat_box({12, 14, 10}, 2, 1);
     }},
    {"SteppedBox", [] { return stepped_box(40, 2, 1); }},
    {"BoredPlate", [] { return bored_plate(3, 5, 1, 1); }},
    {"HollowSphere", [] { return hollow_sphere(20, 5, 1); }},
    {"Bowl", [] { return bowl(20, 5, 1); }},
    {"GyroidBall", [] { return gyroid_ball(20, 16, 1); }},
    {"Bumpy", [] { return bumpy(20, 0.7); }},
};

/// Every case is sampled and analysed once for all its claims.
struct Analysed {
  Shape shape;
  HeightTopology topology;
};
const Analysed& analysed(const Case& c) {
  static std::map<std::string, Analysed> known;
  auto at = known.find(c.name);
  if (at == known.end()) {
    Shape shape = c.make();
    HeightTopology topology = analysed(*shape);
    at = known.emplace(c.name, Analysed{std::move(shape), std::move(topology)}).first;
  }
  return at->second;
}

class HeightTopologyOf : public testing::TestWithParam<Case> {};

TEST_P(HeightTopologyOf, KnowsEulerNumberAndGenusExactly) {
  const auto& [shape, topology] = analysed(GetParam());
  EXPECT_EQ(inconsistencies_of(topology), "");
  if (const auto euler = shape->facts().euler) {
    EXPECT_EQ(topology.euler(), *euler);
  }
  std::vector<int> genus;
  for (const auto& c : topology.components()) genus.push_back(c.genus.value_or(-1));
  std::sort(genus.begin(), genus.end());
  if (!shape->facts().genus.empty()) {
    EXPECT_EQ(genus, shape->facts().genus);
  }
}

class CriticalPointsOf : public testing::TestWithParam<Case> {};

TEST_P(CriticalPointsOf, AreThoseOfTheFormula) {
  const auto& [shape, topology] = analysed(GetParam());
  const ShapeFacts& facts = shape->facts();
  std::vector<double> minima, saddles, maxima;
  for (const auto& c : topology.critical_points())
    (c.is_saddle() ? saddles : c.kind == CriticalKind::Minimum ? minima : maxima).push_back(c.position_mm.z());
  const auto agree = [](const std::vector<double>& found, const std::vector<double>& known) {
    ASSERT_EQ(found.size(), known.size());
    for (std::size_t i = 0; i < known.size(); ++i) EXPECT_NEAR(found[i], known[i], 1e-4);
  };
  agree(minima, facts.minima_mm);
  agree(saddles, facts.saddles_mm);
  agree(maxima, facts.maxima_mm);
}

TEST_P(HeightTopologyOf, PredictsEverySliceAndSeedsEachContourOnce) {
  const auto& [shape, topology] = analysed(GetParam());
  const scan::Box3 box = shape->bounds();
  const auto cursor = shape->cursor();
  constexpr int kLayers = 300;
  int judged = 0;
  for (int i = 0; i < kLayers; ++i) {
    const double z = box.min.z() + (i + 0.5) * (box.max.z() - box.min.z()) / kLayers;
    if (topology.is_near_critical(z)) continue;
    ++judged;
    // The grid resolves what is larger than a pitch: a finer look before a disagreement counts.
    SliceCount truth = count_slice(*shape, z, 0.4);
    const auto predicted = topology.predicted_contours(z);
    ASSERT_TRUE(predicted) << "no prediction at z = " << z;
    if (truth != SliceCount{predicted->outers, predicted->holes}) truth = count_slice(*shape, z, 0.05);
    EXPECT_EQ(topology.predicted_euler(z), truth.euler()) << "z = " << z;
    EXPECT_EQ(predicted->outers, truth.outers) << "z = " << z;
    EXPECT_EQ(predicted->holes, truth.holes) << "z = " << z;
    const auto seeds = topology.seeds(z);
    EXPECT_EQ(static_cast<int>(seeds.size()), truth.outers + truth.holes) << "z = " << z;
    for (const auto& seed : seeds) {
      EXPECT_EQ(seed.point_mm.z(), z);
      EXPECT_LT(std::abs(cursor->at(seed.point_mm).value_mm), 0.05) << "seed off the surface at z = " << z;
    }
  }
  EXPECT_GT(judged, kLayers / 2);
}

std::vector<Case> cases_with_known_critical_points() {
  std::vector<Case> known;
  for (const Case& c : kCases)
    if (!c.make()->facts().minima_mm.empty()) known.push_back(c);
  return known;
}

INSTANTIATE_TEST_SUITE_P(Shapes, CriticalPointsOf, testing::ValuesIn(cases_with_known_critical_points()),
                         [](const auto& named) { return std::string{named.param.name}; });
INSTANTIATE_TEST_SUITE_P(Shapes, HeightTopologyOf, testing::ValuesIn(kCases),
                         [](const auto& named) { return std::string{named.param.name}; });

/// A shape whose upper half is scanned four times as coarsely.
class CoarseAbove final : public scan::ScalarField {
 public:
  explicit CoarseAbove(const AnalyticField& shape) : shape_{shape} {}
  [[nodiscard]] std::unique_ptr<scan::FieldCursor> cursor() const override { return shape_.cursor(); }
  [[nodiscard]] scan::Box3 bounds() const override { return shape_.bounds(); }
  [[nodiscard]] double kernel_width_mm(const Vec3& point_mm) const override { return point_mm.z() < 0 ? 1 : 4; }

 private:
  const AnalyticField& shape_;
};

TEST(HeightTopology, IsNearACriticalHeightByTheKernelAtItsOwnPoint) {
  const auto ball = sphere(20, 1);
  const SurfaceSamples samples = sample_surface(*ball, {.spacing_mm = 0.85});
  const auto topology = analyse_height(CoarseAbove{*ball}, {samples.points, samples.normals}, {}, {});
  ASSERT_TRUE(topology) << topology.error().what;
  EXPECT_TRUE(topology->is_near_critical(-19.95));
  EXPECT_FALSE(topology->is_near_critical(-19.7));
  EXPECT_TRUE(topology->is_near_critical(19.7));
  EXPECT_FALSE(topology->is_near_critical(19.5));
}

TEST(HeightTopology, FlatTopsAreTwoPlateausAndNothingElse) {
  const HeightTopology topology = analysed(*flat_box({12, 14, 10}, 2, 1));
  ASSERT_EQ(topology.plateaus().size(), 2u);
  EXPECT_NEAR(topology.plateaus()[0].low_mm, -10, 1e-4);
  EXPECT_NEAR(topology.plateaus()[1].high_mm, 10, 1e-4);
  for (const auto& c : topology.critical_points()) EXPECT_TRUE(c.plateau);
  EXPECT_FALSE(topology.predicted_contours(-10.0) == (ContourCount{1, 0}));
  EXPECT_TRUE(topology.is_near_critical(10.05));
  EXPECT_FALSE(topology.is_near_critical(9.8));
}

TEST(HeightTopology, AStepHasItsOwnPlateau) {
  const HeightTopology topology = analysed(*stepped_box(40, 2, 1));
  ASSERT_EQ(topology.plateaus().size(), 3u) << inconsistencies_of(topology);
  EXPECT_NEAR(topology.plateaus()[1].low_mm, 0, 1e-4);
}

TEST(HeightTopology, PersistenceIsTheHeightOfTheLowerHorn) {
  const HeightTopology topology = analysed(*two_bumps(20, 1));
  ASSERT_EQ(topology.critical_points().size(), 4u);
  const auto c = topology.critical_points();
  EXPECT_NEAR(c[2].persistence_mm, c[2].position_mm.z() - c[1].position_mm.z(), 1e-9);
  EXPECT_EQ(c[1].persistence_mm, c[2].persistence_mm);
  EXPECT_FALSE(std::isfinite(c[3].persistence_mm));
  EXPECT_FALSE(std::isfinite(c[0].persistence_mm));
}

TEST(HeightTopology, FourIntegralLinesLeaveEverySaddleAndEndAtCriticalPoints) {
  const HeightTopology topology = analysed(*bumpy(20, 0.7));
  std::vector<int> rising(topology.critical_points().size(), 0), falling = rising;
  for (const auto& line : topology.integral_lines()) {
    ++(line.ascending ? rising : falling)[line.saddle];
    EXPECT_TRUE(line.end) << "a line was lost";
    for (std::size_t i = 1; i < line.path_mm.size(); ++i)
      ASSERT_EQ(line.path_mm[i].z() > line.path_mm[i - 1].z(), line.ascending);
  }
  for (std::size_t i = 0; i < rising.size(); ++i) {
    EXPECT_EQ(rising[i], topology.critical_points()[i].is_saddle() ? 2 : 0);
    EXPECT_EQ(falling[i], topology.critical_points()[i].is_saddle() ? 2 : 0);
  }
}

TEST(HeightTopology, SameResultOnOneAndEightThreads) {
  const Shape shape = gyroid_ball(20, 16, 1);
  const SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 0.8});
  const auto run = [&](std::size_t threads) {
    const tbb::global_control limit{tbb::global_control::max_allowed_parallelism, threads};
    return analyse_height(*shape, {samples.points, samples.normals}, {}, {}).value();
  };
  const HeightTopology one = run(1);
  const HeightTopology eight = run(8);
  ASSERT_EQ(one.arcs().size(), eight.arcs().size());
  for (std::size_t i = 0; i < one.arcs().size(); ++i) {
    EXPECT_EQ(one.arcs()[i].lower, eight.arcs()[i].lower);
    EXPECT_EQ(one.arcs()[i].upper, eight.arcs()[i].upper);
    EXPECT_EQ(one.arcs()[i].path_mm, eight.arcs()[i].path_mm);
  }
  ASSERT_EQ(one.critical_points().size(), eight.critical_points().size());
  for (std::size_t i = 0; i < one.critical_points().size(); ++i)
    EXPECT_EQ(one.critical_points()[i].position_mm, eight.critical_points()[i].position_mm);
}

TEST(HeightTopology, OrderOfTheSamplesDoesNotMatter) {
  const Shape shape = genus_two(20, 1);
  SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 0.8});
  const auto forward = analyse_height(*shape, {samples.points, samples.normals}, {}, {}).value();
  std::reverse(samples.points.begin(), samples.points.end());
  std::reverse(samples.normals.begin(), samples.normals.end());
  const auto backward = analyse_height(*shape, {samples.points, samples.normals}, {}, {}).value();
  ASSERT_EQ(forward.critical_points().size(), backward.critical_points().size());
  for (std::size_t i = 0; i < forward.critical_points().size(); ++i)
    EXPECT_EQ(forward.critical_points()[i].position_mm, backward.critical_points()[i].position_mm);
}

TEST(HeightTopology, PredictsNothingWhereNoSampleIsNearLevel) {
  const Shape shape = sphere(20, 1);
  const std::vector<Vec3> belt{{20, 0, 0}, {0, 20, 0}, {-20, 0, 0}};
  const std::vector<Vec3> normals{{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  const HeightTopology topology = analyse_height(*shape, {belt, normals}, {}, {}).value();
  EXPECT_FALSE(topology.predicted_euler(0));
  EXPECT_FALSE(topology.predicted_contours(0));
  EXPECT_FALSE(topology.inconsistencies().empty());
}

TEST(HeightTopology, ASaddleNobodySawHidesOnlyTheHeightsBetweenItAndTheRingThatMissesIt) {
  const Shape shape = two_bumps(20, 1);
  const HeightTopology whole = analysed(*shape);
  const Vec3 saddle = whole.critical_points()[1].position_mm;
  const double lower_top = whole.critical_points()[2].position_mm.z();
  const auto topology = analysed_without(*shape, {saddle});
  ASSERT_TRUE(topology) << topology.error().what;
  ASSERT_EQ(topology->critical_points().size(), 3u);
  ASSERT_FALSE(topology->inconsistencies().empty());
  EXPECT_EQ(topology->predicted_contours(saddle.z() - 0.3), (ContourCount{1, 0}));
  EXPECT_EQ(topology->predicted_contours(0), (ContourCount{1, 0}));
  EXPECT_FALSE(topology->predicted_euler(saddle.z() + 0.1));
  EXPECT_FALSE(topology->predicted_euler(lower_top - 0.1));
  EXPECT_EQ(topology->predicted_contours(lower_top + 0.3), (ContourCount{1, 0}));
}

TEST(HeightTopology, ACountedSliceTellsWhatIsHiddenFromBothEnds) {
  // Turned, so that no steepest line runs into one of the saddles by chance.
  const Shape shape = genus_two(36, 1, Pose::turned(8, Vec3{1, 1, 0}));
  const HeightTopology whole = analysed(*shape);
  const auto points = whole.critical_points();
  auto topology = analysed_without(*shape, {points[1].position_mm, points[points.size() - 2].position_mm}, 3.5);
  ASSERT_TRUE(topology) << topology.error().what;
  const double between_mm =
      (points[points.size() / 2 - 1].position_mm.z() + points[points.size() / 2].position_mm.z()) / 2;
  ASSERT_FALSE(topology->predicted_euler(between_mm));
  const std::vector<scan::HeightRange> ranges = topology->uncounted();
  const auto between = std::find_if(ranges.begin(), ranges.end(), [&](const scan::HeightRange& range) {
    return range.low_mm < between_mm && between_mm < range.high_mm;
  });
  ASSERT_NE(between, ranges.end());
  const scan::HeightRange hidden = *between;
  EXPECT_FALSE(topology->rests_on_a_count(between_mm));
  topology->count(between_mm, *whole.predicted_euler(between_mm));
  EXPECT_EQ(topology->uncounted().size(), ranges.size() - 1);
  EXPECT_TRUE(topology->rests_on_a_count(between_mm));
  EXPECT_FALSE(topology->rests_on_a_count(whole.critical_points()[0].position_mm.z() + 0.5)) << "summed from below";
  int compared = 0;
  for (double z = hidden.low_mm + 0.3; z < hidden.high_mm - 0.3; z += 0.5)
    if (!whole.is_near_critical(z)) {
      ++compared;
      EXPECT_EQ(topology->predicted_euler(z), whole.predicted_euler(z)) << z;
    }
  EXPECT_GT(compared, 10);
}

TEST(HeightTopology, SlicesCountedOnBothSidesOfWhatNobodySawEncloseIt) {
  const Shape shape = near_touching_balls(15, 1.5, 1);
  const HeightTopology whole = analysed(*shape);
  ASSERT_GE(whole.critical_points().size(), 2u);
  const auto top = whole.critical_points().back().position_mm;
  // A ball's top that nobody saw: what is summed from below never comes to nothing.
  auto topology = analysed_without(*shape, {top});
  ASSERT_TRUE(topology) << topology.error().what;
  for (int i = 0; i < 40; ++i) {
    const auto hidden = topology->uncounted();
    const auto tall = std::find_if(hidden.begin(), hidden.end(),
                                   [](const scan::HeightRange& r) { return r.high_mm - r.low_mm > 0.4; });
    if (tall == hidden.end()) break;
    const double middle_mm = (tall->low_mm + tall->high_mm) / 2;
    topology->count(middle_mm, *whole.predicted_euler(middle_mm));
  }
  for (double z = -20; z < 20; z += 0.25)
    if (const auto euler = topology->predicted_euler(z); euler && !whole.is_near_critical(z)) {
      EXPECT_EQ(euler, whole.predicted_euler(z)) << z;
    }
}

TEST(HeightTopology, StopsWhenAsked) {
  const Shape shape = sphere(20, 1);
  const SurfaceSamples samples = sample_surface(*shape, {.spacing_mm = 2});
  std::stop_source stop;
  stop.request_stop();
  const auto result = analyse_height(*shape, {samples.points, samples.normals}, {}, stop.get_token());
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::Cancelled);
}

TEST(HeightTopology, RefusesWhatCannotBeSearched) {
  const Shape shape = sphere(20, 1);
  const std::vector<Vec3> two{{0, 0, 20}, {0, 0, -20}};
  const std::vector<Vec3> one{{0, 0, 1}};
  EXPECT_EQ(analyse_height(*shape, {}, {}, {}).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(analyse_height(*shape, {two, one}, {}, {}).error().code, ErrorCode::InvalidInput);
  for (const scan::TopologyOptions& bad :
       {scan::TopologyOptions{.min_start_nz = 1}, scan::TopologyOptions{.near_critical_kernels = 0},
        scan::TopologyOptions{.noise_mm = -1}, scan::TopologyOptions{.max_critical_points = 0}})
    EXPECT_EQ(analyse_height(*shape, {one, one}, bad, {}).error().code, ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab::test
