// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/pick_object.hpp>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>

#include "pieces.hpp"
#include "surface_graph.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kLeastPoints = 30;  ///< fewer are no surface
constexpr double kFlat = 1e-9;            ///< least over all of the scatter of points on one plane (squares)
constexpr std::size_t kNeighbours = 16;   ///< as the normals want them
constexpr std::size_t kLeastPiece = 30, kMostSpeck = 100;  ///< a piece has so many points, or this share of all,
constexpr double kSpeckShare = 0.001;
constexpr double kMostStrays = 0.25;        ///< where strays would be more, the cloud is sparse and none is one
constexpr std::size_t kMostNumbers = 1000;  ///< of pieces that are picked one by one
constexpr std::size_t kSceneParts = 8;      ///< a scene has so many pieces,
constexpr double kScenePiece = 0.9;         ///< the largest of which holds less than this share
constexpr double kSmallPiece = 0.05;        ///< of the points; a smaller one that sets the size is named
constexpr double kMuchLarger = 1.25;

Box3 box_of(const PointCloud& cloud, std::span<const std::uint32_t> points) {
  Eigen::Vector3f low = cloud.points[points[0]], high = low;
  for (const std::uint32_t i : points) {
    low = low.cwiseMin(cloud.points[i]);
    high = high.cwiseMax(cloud.points[i]);
  }
  return {cloud.origin + low.cast<double>(), cloud.origin + high.cast<double>()};
}

Box3 box_of(const PointCloud& cloud) {
  std::vector<std::uint32_t> all(cloud.size());
  std::iota(all.begin(), all.end(), 0U);
  return box_of(cloud, all);
}

PointCloud only(PointCloud cloud, const std::vector<bool>& keep) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!keep[i]) continue;
    cloud.copy_point(i, kept++);
  }
  cloud.shrink(kept);
  return cloud;
}

/// A surface encloses something only if its points lie to all sides of their middle.
Result<void> check_shape(std::span<const Eigen::Vector3f> points) {
  if (points.size() < kLeastPoints)
    return fail(ErrorCode::InvalidInput, fmt::format("{} points are too few for a surface; at least {} are needed",
                                                     points.size(), kLeastPoints));
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3f& p : points) {
    const Eigen::Vector3d d = (p - points[0]).cast<double>();
    sum += d;
    square += d * d.transpose();
  }
  const Eigen::Matrix3d scatter = square - sum * sum.transpose() / static_cast<double>(points.size());
  const Eigen::Vector3d spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{scatter}.eigenvalues();
  const double all = spread.sum();
  if (!(all > 0)) return fail(ErrorCode::InvalidInput, "all points lie in one place");
  if (spread[1] < kFlat * all)
    return fail(ErrorCode::InvalidInput,
                fmt::format("all {} points lie on one line: that is not a surface", points.size()));
  if (spread[0] < kFlat * all)
    return fail(ErrorCode::InvalidInput,
                fmt::format("all {} points lie in one plane: a sheet encloses nothing; scan all sides of the object",
                            points.size()));
  return {};
}

/// Which piece is how large, largest first; equal ones in the order of their first point.
std::vector<std::uint32_t> by_size(const PieceMap& map) {
  std::vector<std::uint32_t> order(map.size.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t l, std::uint32_t r) { return map.size[l] > map.size[r]; });
  return order;
}

class Picker {
 public:
  Picker(PointCloud cloud, const PickOptions& options, const std::stop_token& stop)
      : options_{options}, stop_{stop}, cloud_{std::move(cloud)} {}

  Result<PickResult> pick() {
    report_.points_in = cloud_.size();
    if (options_.crop)
      if (auto done = crop(*options_.crop); !done) return tl::unexpected{done.error()};
    if (auto sound = check_shape(cloud_.points); !sound) return tl::unexpected{sound.error()};
    report_.before = box_of(cloud_);
    if (auto done = build_graph(); !done) return tl::unexpected{done.error()};
    keep_.assign(cloud_.size(), true);
    const std::vector<bool> on_ground = mark_ground();
    if (auto done = choose_pieces(on_ground); !done) return tl::unexpected{done.error()};
    if (std::find(keep_.begin(), keep_.end(), false) != keep_.end()) {
      cloud_ = only(std::move(cloud_), keep_);
      if (auto sound = check_shape(cloud_.points); !sound) return fail_in("what is left of the scan", sound.error());
      if (auto done = build_graph(); !done) return tl::unexpected{done.error()};
    }
    report_.after = box_of(cloud_);
    return PickResult{std::move(cloud_), std::move(report_), std::move(graph_)};
  }

 private:
  Result<void> crop(const Box3& box) {
    std::vector<bool> inside(cloud_.size());
    for (std::size_t i = 0; i < cloud_.size(); ++i) inside[i] = box.contains(place(i));
    const Box3 all = box_of(cloud_);
    cloud_ = only(std::move(cloud_), inside);
    report_.cropped = report_.points_in - cloud_.size();
    if (cloud_.size() > 0) return {};
    return fail(ErrorCode::InvalidInput,
                fmt::format("no point lies within the crop ({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g}); the "
                            "scan reaches from ({:.6g}, {:.6g}, {:.6g}) to ({:.6g}, {:.6g}, {:.6g}), unit of the file",
                            box.min.x(), box.min.y(), box.min.z(), box.max.x(), box.max.y(), box.max.z(), all.min.x(),
                            all.min.y(), all.min.z(), all.max.x(), all.max.y(), all.max.z()));
  }

  [[nodiscard]] Vec3 place(std::size_t i) const { return cloud_.origin + cloud_.points[i].cast<double>(); }

  Result<void> build_graph() {
    auto graph = build_surface_graph(cloud_.points, kNeighbours, stop_);
    if (!graph) return tl::unexpected{graph.error()};
    graph_ = std::make_shared<SurfaceGraph>(std::move(*graph));
    return {};
  }

  std::vector<bool> mark_ground() {
    std::vector<bool> on_ground(cloud_.size(), false);
    const auto ground = find_ground(cloud_.points, *graph_);
    if (!ground) return on_ground;
    report_.ground = StandingGround{ground->share, ground->up, is_choosing()};
    if (!is_choosing()) return on_ground;
    for (std::size_t i = 0; i < cloud_.size(); ++i)
      on_ground[i] = std::abs((cloud_.points[i].cast<double>() - ground->place).dot(ground->up)) < ground->thickness;
    return on_ground;
  }

  Result<void> choose_pieces(const std::vector<bool>& on_ground) {
    std::vector<bool> apart = on_ground;
    const std::vector<bool> scattered =
        options_.keep_outliers ? std::vector<bool>(cloud_.size(), false) : scattered_points(cloud_.points, *graph_);
    for (std::size_t i = 0; i < apart.size(); ++i) apart[i] = apart[i] || scattered[i];
    const PieceMap map = find_pieces(cloud_.points, *graph_, apart);
    const auto least = static_cast<std::size_t>(
        std::clamp(kSpeckShare * static_cast<double>(cloud_.size()), double{kLeastPiece}, double{kMostSpeck}));
    std::size_t strays = 0;
    for (std::size_t i = 0; i < cloud_.size(); ++i) strays += !on_ground[i] && map.size[map.of[i]] < least ? 1 : 0;
    const bool drop =
        !options_.keep_outliers && static_cast<double>(strays) <= kMostStrays * static_cast<double>(cloud_.size());
    std::vector<bool> chosen(map.size.size(), false);
    std::size_t count = 0;
    for (const std::uint32_t p : by_size(map)) {
      const bool is_piece = map.size[p] >= least;
      if (!is_piece && drop) continue;
      if (!options_.only.empty())
        chosen[p] = is_piece && std::ranges::binary_search(options_.only, static_cast<std::uint32_t>(count + 1));
      else
        chosen[p] = options_.pieces == 0 || (is_piece && count < options_.pieces);
      if (is_piece) ++count;
    }
    if (!options_.only.empty() && options_.only.back() > count)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("there is no piece {}: without its ground the scan has {}", options_.only.back(), count));
    if (is_choosing() && count == 0)
      return fail(ErrorCode::InvalidInput, "no piece of the scan has enough points to be one; give --pieces all");
    for (std::size_t i = 0; i < cloud_.size(); ++i) {
      const bool wanted = chosen[map.of[i]] && !on_ground[i];
      keep_[i] = wanted && (!options_.surface_box || options_.surface_box->contains(place(i)));
      if (keep_[i]) continue;
      const bool stray = wanted || (!on_ground[i] && map.size[map.of[i]] < least);
      ++(stray ? report_.strays : report_.in_other_pieces);
    }
    list_pieces(map, chosen, least);
    return {};
  }

  /// Between pieces, so that what they stand on joins none of them.
  [[nodiscard]] bool is_choosing() const { return options_.pieces > 0 || !options_.only.empty(); }

  void list_pieces(const PieceMap& map, const std::vector<bool>& chosen, std::size_t least) {
    std::vector<std::vector<std::uint32_t>> members(map.size.size());
    for (std::uint32_t i = 0; i < map.of.size(); ++i)
      if (map.size[map.of[i]] >= least) members[map.of[i]].push_back(i);
    for (const std::uint32_t p : by_size(map))
      if (!members[p].empty()) report_.pieces.push_back({map.size[p], box_of(cloud_, members[p]), chosen[p]});
    if (!report_.pieces.empty())
      report_.is_scene = report_.pieces.size() >= kSceneParts && static_cast<double>(report_.pieces[0].points) <
                                                                     kScenePiece * static_cast<double>(cloud_.size());
  }

  const PickOptions& options_;
  const std::stop_token& stop_;
  PointCloud cloud_;
  PickReport report_;
  std::shared_ptr<SurfaceGraph> graph_;
  std::vector<bool> keep_;
};

/// As --crop takes them.
std::string corners(const Box3& b) {
  return fmt::format("{:.4g},{:.4g},{:.4g},{:.4g},{:.4g},{:.4g}", b.min.x(), b.min.y(), b.min.z(), b.max.x(), b.max.y(),
                     b.max.z());
}
std::string sizes(const Vec3& v) { return fmt::format("{:.4g} x {:.4g} x {:.4g}", v.x(), v.y(), v.z()); }

/// A small piece that makes the whole much larger than the rest.
std::optional<std::string> size_setter(const PickReport& report) {
  std::size_t all = 0;
  for (const Piece& p : report.pieces) all += p.kept ? p.points : 0;
  for (std::size_t i = 1; i < report.pieces.size(); ++i) {
    const Piece& small = report.pieces[i];
    if (!small.kept || static_cast<double>(small.points) > kSmallPiece * static_cast<double>(all)) continue;
    Box3 rest = report.pieces[0].box;
    for (std::size_t k = 1; k < report.pieces.size(); ++k) {
      if (k == i || !report.pieces[k].kept) continue;
      rest.include(report.pieces[k].box);
    }
    if ((report.after.size() - kMuchLarger * rest.size()).maxCoeff() <= 0) continue;
    return fmt::format(
        "a piece of {} points ({:.1f} %) makes the scan {} instead of {} units large; --pieces largest "
        "leaves it out",
        small.points, 100 * static_cast<double>(small.points) / static_cast<double>(all), sizes(report.after.size()),
        sizes(rest.size()));
  }
  return std::nullopt;
}

}  // namespace

bool FramedBox::contains(const Vec3& place) const { return box.contains(to_frame * place.homogeneous()); }

Result<Box3> crop_box_from(std::string_view text) {
  std::array<double, 6> numbers{};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t i = 0; i < 6; ++i) {
    while (at != end && *at == ' ') ++at;
    const auto [after, fault] = std::from_chars(at, end, numbers[i]);
    const bool ends_well = i == 5 ? after == end : after != end && *after == ',';
    if (fault != std::errc{} || !std::isfinite(numbers[i]) || !ends_well)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("a crop is x0,y0,z0,x1,y1,z1: six numbers in the unit of the file, as in "
                              "-10,-10,0,10,10,25; this is \"{}\"",
                              text.substr(0, 80)));
    at = after + 1;
  }
  const Vec3 a{numbers[0], numbers[1], numbers[2]}, b{numbers[3], numbers[4], numbers[5]};
  return Box3{a.cwiseMin(b), a.cwiseMax(b)};
}

Result<std::uint32_t> pieces_from(std::string_view text) {
  if (text == "all") return 0U;
  if (text == "largest") return 1U;
  std::uint32_t count = 0;
  const auto [after, fault] = std::from_chars(text.data(), text.data() + text.size(), count);
  if (fault != std::errc{} || after != text.data() + text.size() || count == 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("pieces are all, largest, how many of the largest, or only:N,M,...; not \"{}\"",
                            text.substr(0, 40)));
  return count;
}

Result<std::vector<std::uint32_t>> piece_numbers_from(std::string_view text) {
  std::vector<std::uint32_t> numbers;
  const auto wrong = [&] {
    return fail(ErrorCode::InvalidInput,
                fmt::format("pieces by number are only:N,M,... from 1, the largest; not \"{}\"", text.substr(0, 40)));
  };
  if (!text.starts_with(kOnlyPieces)) return wrong();
  const char* at = text.data() + kOnlyPieces.size();
  const char* const end = text.data() + text.size();
  while (true) {
    std::uint32_t number = 0;
    const auto [after, fault] = std::from_chars(at, end, number);
    if (fault != std::errc{} || number == 0 || numbers.size() == kMostNumbers) return wrong();
    numbers.push_back(number);
    if (after == end) break;
    if (*after != ',') return wrong();
    at = after + 1;
  }
  std::ranges::sort(numbers);
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  return numbers;
}

Result<PickResult> pick_object(PointCloud cloud, const PickOptions& options, std::stop_token stop) {
  return Picker{std::move(cloud), options, stop}.pick();
}

std::vector<std::string> sentences_of(const PickReport& r) {
  std::vector<std::string> sentences;
  if (r.cropped > 0)
    sentences.push_back(fmt::format("{} of {} points lie outside the crop and are left out", r.cropped, r.points_in));
  if (r.strays > 0) {
    std::string text = fmt::format("{} of {} points belong to no surface and are left out", r.strays, r.points_in);
    const Vec3 moved = (r.after.min - r.before.min).cwiseAbs().cwiseMax((r.after.max - r.before.max).cwiseAbs());
    if (moved.maxCoeff() > 0 && r.in_other_pieces == 0)
      text += fmt::format(": the box shrinks from {} to {} units, its sides move by up to {:.4g}",
                          sizes(r.before.size()), sizes(r.after.size()), moved.maxCoeff());
    sentences.push_back(text + " (--keep-outliers keeps them)");
  }
  if (r.in_other_pieces > 0)
    sentences.push_back(fmt::format("{} points of other pieces{} are left out", r.in_other_pieces,
                                    r.ground && r.ground->left_out ? " and of the ground" : ""));
  if (r.ground && !r.ground->left_out)
    sentences.push_back(fmt::format(
        "a plane holds {:.0f} % of the points and the object stands on it; leave it out with --pieces largest "
        "or --crop",
        100 * r.ground->share));
  if (r.is_scene) {
    const bool chosen = std::ranges::any_of(r.pieces, [](const Piece& p) { return !p.kept; });
    sentences.push_back(fmt::format(
        "this looks like a scene, not one object: {} pieces, the largest with {:.0f} % of the points; {} --crop "
        "X0,Y0,Z0,X1,Y1,Z1 keeps what lies in a box, of all there is in {} (inspect --out-prefix NAME draws it)",
        r.pieces.size(), 100 * static_cast<double>(r.pieces[0].points) / static_cast<double>(r.points_in),
        chosen ? "if more is kept than the object," : "--pieces largest keeps that one,", corners(r.before)));
  }
  if (auto setter = size_setter(r)) sentences.push_back(std::move(*setter));
  return sentences;
}

std::string to_json(const PickReport& r) {
  const auto place = [](const Vec3& v) { return fmt::format("[{:.9g},{:.9g},{:.9g}]", v.x(), v.y(), v.z()); };
  const auto box = [&](const Box3& b) { return fmt::format("[{},{}]", place(b.min), place(b.max)); };
  constexpr std::size_t kListed = 20;
  std::string pieces;
  for (std::size_t i = 0; i < std::min(kListed, r.pieces.size()); ++i)
    pieces += fmt::format(R"({}{{"points":{},"box":{},"kept":{}}})", i == 0 ? "" : ",", r.pieces[i].points,
                          box(r.pieces[i].box), r.pieces[i].kept);
  const std::string ground = r.ground ? fmt::format(R"({{"share":{:.4g},"up":{},"left_out":{}}})", r.ground->share,
                                                    place(r.ground->up), r.ground->left_out)
                                      : std::string{"null"};
  return fmt::format(
      R"({{"points_in":{},"cropped":{},"strays":{},"in_other_pieces":{},"piece_count":{},"pieces":[{}],"ground":{},"scene":{},"box_before":{},"box_after":{}}})",
      r.points_in, r.cropped, r.strays, r.in_other_pieces, r.pieces.size(), pieces, ground, r.is_scene, box(r.before),
      box(r.after));
}

}  // namespace telefab::scan
