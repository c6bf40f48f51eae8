// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/geometry/certificate.hpp>
#include <telefab/scan/mls/surface_samples.hpp>
#include <vector>

namespace telefab::scan {

/// Where the height z is stationary on the surface. Saddles are named by the normal (paper 3.2.1): above a bottom
/// saddle (normal up) the solid has parted, at a top saddle (normal down) it closes again, like the two ends of a
/// hole through an upright ring.
enum class CriticalKind : std::uint8_t { Minimum = 1, BottomSaddle = 2, TopSaddle = 3, Maximum = 4 };
[[nodiscard]] std::string_view name_of(CriticalKind kind);

struct CriticalPoint {
  Vec3 position_mm = Vec3::Zero();
  CriticalKind kind = CriticalKind::Minimum;
  bool normal_up = false;                          ///< outward normal along +z: solid below
  Eigen::Vector2d curvature_per_mm{0, 0};          ///< eigenvalues of the height's Hessian, rising; signs give the kind
  Eigen::Matrix2d axes = Eigen::Matrix2d::Zero();  ///< their directions in x, y (columns)
  bool degenerate = false;                         ///< |bend| < 1e-3 / h in some direction: part of a plateau
  double persistence_mm = std::numeric_limits<double>::infinity();  ///< height over which it lives; see simplify
  std::optional<std::size_t> plateau;                               ///< index of the plateau that swallowed it

  [[nodiscard]] bool is_saddle() const { return kind == CriticalKind::BottomSaddle || kind == CriticalKind::TopSaddle; }
  /// Change of (outer - hole contours) of the slice when the plane passes upwards.
  [[nodiscard]] int euler_step() const;
};

/// A place level over more than the kernel can tell apart: flat top, ledge, level ridge, or critical points too
/// close in height to be ordered. What happens inside [low, high] is not predicted; what enters and leaves is.
struct Plateau {
  double low_mm = 0;
  double high_mm = 0;
  Vec3 place_mm = Vec3::Zero();  ///< of one of its critical points
  std::size_t critical_points = 0;
};

/// A steepest line on the surface from a saddle, rising or falling strictly (paper 3.2.2).
struct IntegralLine {
  std::size_t saddle = 0;          ///< index of the critical point it leaves
  std::optional<std::size_t> end;  ///< critical point it reached; none: it was lost
  bool ascending = false;
  std::vector<Vec3> path_mm;  ///< saddle first
};

/// A place where contours begin, end, part or join: one critical point, or a plateau with all of its own.
struct ReebNode {
  double low_mm = 0;
  double high_mm = 0;
  Vec3 place_mm = Vec3::Zero();
  std::vector<std::size_t> critical_points;
  std::optional<std::size_t> plateau;
  std::vector<std::size_t> arcs_below;
  std::vector<std::size_t> arcs_above;
  std::size_t component = 0;
  int euler_step = 0;    ///< change of (outer - hole contours) from below to above
  bool resolved = true;  ///< false: the rings beside it contradict its kind or were lost
};

/// One contour followed from where it begins to where it ends; the path is the enhanced Reeb graph's curve on the
/// surface (paper 3.2.3), strictly rising.
struct ReebArc {
  std::size_t lower = 0;  ///< node
  std::size_t upper = 0;  ///< node
  bool hole = false;      ///< its contours run clockwise, for its whole length
  std::vector<Vec3> path_mm;
};

/// A connected piece of the surface.
struct SurfaceComponent {
  int euler = 0;
  std::optional<int> genus;  ///< 1 - euler / 2; none where a node of the piece is inconsistent, or the number is odd
  std::size_t nodes = 0;
  double low_mm = 0;
  double high_mm = 0;
};

struct HeightRange {
  double low_mm = 0;
  double high_mm = 0;
};

/// Heights about a critical point on an edge too sharp for the kernel: the field rounds it, so its height, and what is
/// cut beside it, may be off by a part of the kernel.
struct RoundedInterval {
  double low_mm = 0;
  double high_mm = 0;
  Vec3 place_mm = Vec3::Zero();
};

/// A point of one contour of the slice at its height.
struct ContourSeed {
  Vec3 point_mm = Vec3::Zero();  ///< near the surface, z exactly the slice's; project in the plane before use
  bool hole = false;
  std::size_t arc = 0;
};

struct TopologyOptions {
  double min_start_nz = 0.866;         ///< (0, 1); samples whose |n_z| is smaller start no search (30 degrees)
  double near_critical_kernels = 0.1;  ///< (0, 1]; heights this near to a critical one are not promised
  double sharp_bend = 0.5;             ///< > 0; bend times kernel width from which on a critical point sits on an edge
  double sharp_reach_kernels = 0.35;   ///< [0, 1]; how far such a point's height may be off
  double noise_mm = 0;                 ///< >= 0; features of less height are called noise (persistence), never dropped
                                       ///< from the prediction
  std::size_t max_critical_points = 20'000;  ///< >= 1; more: TooLarge, the kernel is too narrow for the cloud
  [[nodiscard]] Result<void> validate() const;
};

/// Everything the height function tells about the surface. A value; const methods from any thread, not beside count.
class HeightTopology {
 public:
  struct Parts {
    std::vector<CriticalPoint> critical_points;
    std::vector<Plateau> plateaus;
    std::vector<IntegralLine> lines;
    std::vector<ReebNode> nodes;
    std::vector<ReebArc> arcs;
    std::vector<SurfaceComponent> components;
    /// Heights over which the graph is known to be wrong or incomplete; nothing is predicted inside, and what was
    /// summed on one side does not count on the other.
    std::vector<HeightRange> blind;
    std::vector<RoundedInterval> rounded;
    std::vector<std::string> inconsistencies;
    /// Where a steepest line could not go on and no critical point is known. In any order.
    std::vector<Vec3> losses_mm;
    /// Heights too near to a critical point or plateau, by the kernel there, for a contour to be promised. In any
    /// order.
    std::vector<HeightRange> near;
  };
  explicit HeightTopology(Parts parts);

  /// Sorted by height, then x, then y.
  [[nodiscard]] std::span<const CriticalPoint> critical_points() const { return parts_.critical_points; }
  [[nodiscard]] std::span<const Plateau> plateaus() const { return parts_.plateaus; }
  /// The Morse-Smale complex: two rising and two falling lines a saddle outside plateaus.
  [[nodiscard]] std::span<const IntegralLine> integral_lines() const { return parts_.lines; }
  /// Sorted by height.
  [[nodiscard]] std::span<const ReebNode> nodes() const { return parts_.nodes; }
  [[nodiscard]] std::span<const ReebArc> arcs() const { return parts_.arcs; }
  [[nodiscard]] std::span<const SurfaceComponent> components() const { return parts_.components; }
  /// What does not fit together, for people; empty where graph and critical points agree everywhere.
  [[nodiscard]] std::span<const std::string> inconsistencies() const { return parts_.inconsistencies; }

  /// Where a curve of the graph was lost: there may be a critical point that nobody found.
  [[nodiscard]] std::span<const Vec3> losses() const { return parts_.losses_mm; }

  /// Of the whole surface, from the graph.
  [[nodiscard]] int euler() const;
  /// Whether every piece has a genus: then the sum is the surface's own.
  [[nodiscard]] bool euler_is_certain() const;
  /// Outer minus hole contours of the slice, by summing what every node below changes (or above, where something
  /// below is inconsistent). None inside a plateau, and at heights that inconsistencies hide from both ends. By
  /// bisection.
  [[nodiscard]] std::optional<int> predicted_euler(double z_mm) const;
  /// Whether that was summed from a counted slice alone: true as far as nothing else was missed between the two
  /// heights.
  [[nodiscard]] bool rests_on_a_count(double z_mm) const;
  /// Where predicted_euler has none although nothing is wrong there: between two heights with inconsistencies, or where
  /// the sums from below and from above differ. One slice counted in it settles it, or halves it. Rising.
  [[nodiscard]] std::vector<HeightRange> uncounted() const;
  /// From now on the slice at this height, outside nodes, is known to have this Euler number.
  void count(double z_mm, int euler);
  /// From the arcs; none where they contradict predicted_euler or that has none.
  [[nodiscard]] std::optional<ContourCount> predicted_contours(double z_mm) const;
  /// True within near_critical_kernels of a critical height, by the kernel width at its point, or inside a plateau.
  [[nodiscard]] bool is_near_critical(double z_mm) const;
  /// Where the plane passes beside a rounded edge; none elsewhere.
  [[nodiscard]] std::optional<Vec3> rounded_near(double z_mm) const;
  /// The same of edges whose place counts.
  [[nodiscard]] std::optional<Vec3> rounded_near(double z_mm, const std::function<bool(const Vec3&)>& counts) const;
  /// True within `within_mm` of a height where points and graph contradict each other.
  [[nodiscard]] bool is_inconsistent(double z_mm, double within_mm) const;
  /// One seed a contour where predicted_contours has a value; fewer or more where it has none. Ordered by arc.
  [[nodiscard]] std::vector<ContourSeed> seeds(double z_mm) const;

 private:
  Parts parts_;
  /// Between two of them the prediction is constant.
  struct Event {
    enum class Kind { Begins, Ends, Counted };
    double z_mm;
    Kind kind;
    std::optional<int> value;  ///< change of the Euler number over a node, none: unknown; of Counted the number itself

    /// Nodes that one is in more, above it than below.
    [[nodiscard]] int deeper() const { return kind == Kind::Begins ? 1 : kind == Kind::Ends ? -1 : 0; }
  };
  struct Sum {
    int euler = 0;
    bool counted = false;  ///< from a counted slice on, not from an end
  };
  /// The Euler number above each event, summed from below and from above; what is left open above the top.
  std::optional<int> sum_up();
  [[nodiscard]] std::size_t events_up_to(double z_mm) const;

  std::vector<Event> events_;              ///< rising
  std::vector<std::optional<Sum>> above_;  ///< each event
};

/// Critical points, Morse-Smale complex, enhanced Reeb graph and prediction for every height (paper 3.2.1 to 3.2.3).
/// `samples` lie near the zero set; they start the searches, so every level place larger than a kernel must have one.
/// Fails: InvalidInput (options, unequal lengths, no samples), TooLarge, Cancelled.
/// Cost: about 10 evaluations a near-level sample and 500 a saddle; parallel, same result on any thread count.
[[nodiscard]] Result<HeightTopology> analyse_height(const ScalarField& field, const SampleView& samples,
                                                    const TopologyOptions& options, std::stop_token stop);

}  // namespace telefab::scan
