#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <telefab/fab/support/pictures.hpp>

namespace telefab::fab {
namespace {

static_assert(std::endian::native == std::endian::little, "the PLY is written as it lies in memory");
using Rgb = std::array<std::uint8_t, 3>;

class PlyMesh {
 public:
  std::int32_t vertex(double x, double y, double z, Rgb colour) {
    const std::array<float, 3> xyz{static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)};
    append(vertices_, xyz.data(), sizeof xyz);
    append(vertices_, colour.data(), colour.size());
    return vertex_count_++;
  }
  void triangle(std::int32_t a, std::int32_t b, std::int32_t c) {
    const std::array<std::int32_t, 3> abc{a, b, c};
    faces_ += '\3';
    append(faces_, abc.data(), sizeof abc);
    ++face_count_;
  }
  void quad(std::int32_t a, std::int32_t b, std::int32_t c, std::int32_t d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }
  [[nodiscard]] std::string text() const {
    return fmt::format(
               "ply\nformat binary_little_endian 1.0\ncomment part grey, supports orange, millimetres\n"
               "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
               "property uchar green\nproperty uchar blue\nelement face {}\n"
               "property list uchar int vertex_indices\nend_header\n",
               vertex_count_, face_count_) +
           vertices_ + faces_;
  }

 private:
  static void append(std::string& to, const void* from, std::size_t bytes) {
    to.append(static_cast<const char*>(from), bytes);
  }
  std::string vertices_, faces_;
  std::int32_t vertex_count_ = 0, face_count_ = 0;
};

constexpr Rgb kPart{198, 204, 214}, kSupport{240, 150, 40};

/// A closed solid between two level rings of the same count.
void solid(PlyMesh& mesh, const std::vector<Point3>& low, const std::vector<Point3>& high) {
  std::vector<std::int32_t> a, b;
  for (const Point3& p : low) a.push_back(mesh.vertex(p.x_mm, p.y_mm, p.z_mm, kSupport));
  for (const Point3& p : high) b.push_back(mesh.vertex(p.x_mm, p.y_mm, p.z_mm, kSupport));
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::size_t j = (i + 1) % a.size();
    mesh.quad(a[i], a[j], b[j], b[i]);
    if (i > 0 && i + 1 < a.size()) {
      mesh.triangle(a[0], a[j], a[i]);
      mesh.triangle(b[0], b[i], b[j]);
    }
  }
}

std::vector<Point3> level_disc(Point3 c, double r) {
  std::vector<Point3> ring;
  for (int i = 0; i < 12; ++i) {
    const double a = 2 * std::numbers::pi * i / 12;
    ring.push_back({c.x_mm + r * std::cos(a), c.y_mm + r * std::sin(a), c.z_mm});
  }
  return ring;
}

std::vector<Point3> level_stadium(Point2 a, Point2 b, double r, double z) {
  const double along = std::atan2(b.y_mm - a.y_mm, b.x_mm - a.x_mm);
  std::vector<Point3> ring;
  for (int i = 0; i < 16; ++i) {
    const Point2 c = i < 8 ? b : a;
    const double turn = along - std::numbers::pi / 2 + std::numbers::pi * (i < 8 ? i : i - 1) / 7;
    ring.push_back({c.x_mm + r * std::cos(turn), c.y_mm + r * std::sin(turn), z});
  }
  return ring;
}

}  // namespace

std::string structure_ply(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                          Millimetres tolerance) {
  PlyMesh mesh;
  for (const Stick& s : plan.structure().sticks)
    solid(mesh, level_disc(s.bottom, s.bottom_radius_mm), level_disc(s.top, s.top_radius_mm));
  for (const Plate& p : plan.structure().plates) {
    const double bevel = p.height_mm / 2;
    solid(mesh, level_stadium(p.a, p.b, p.radius_mm, 0), level_stadium(p.a, p.b, p.radius_mm, bevel));
    solid(mesh, level_stadium(p.a, p.b, p.radius_mm, bevel), level_stadium(p.a, p.b, p.radius_mm - bevel, p.height_mm));
  }
  for (const Layer& layer : part) {
    const auto region = Region::from_contours(layer.contours);
    if (!region) continue;
    const double z0 = (layer.index.count() + plan.lift_layers()) * thickness_mm, z1 = z0 + thickness_mm;
    const Region plain = simplified(*region, tolerance);
    for (const GridRing& ring : plain.rings()) {
      std::vector<std::int32_t> low, high;
      for (const GridPoint& g : ring) {
        const Point2 p = to_mm(g);
        low.push_back(mesh.vertex(p.x_mm, p.y_mm, z0, kPart));
        high.push_back(mesh.vertex(p.x_mm, p.y_mm, z1, kPart));
      }
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const std::size_t j = (i + 1) % ring.size();
        mesh.quad(low[i], low[j], high[j], high[i]);
      }
    }
  }
  return mesh.text();
}

}  // namespace telefab::fab
