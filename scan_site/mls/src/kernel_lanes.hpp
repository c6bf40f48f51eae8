// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <xsimd/xsimd.hpp>

#include "kernel.hpp"

// The field at one point, written once for every instruction set. Include it in kernel_*.cpp only.
namespace telefab::scan {
namespace {

/// Eight floats, as one register or several.
template <class Arch>
struct Lanes {
  using Batch = xsimd::batch<float, Arch>;
  static constexpr std::size_t kParts = kLanes / Batch::size;
  static_assert(kLanes % Batch::size == 0);
  Batch part[kParts];

  static Lanes all(float value) {
    Lanes r;
    for (std::size_t i = 0; i < kParts; ++i) r.part[i] = Batch(value);
    return r;
  }
  static Lanes load(const float* from) {
    Lanes r;
    for (std::size_t i = 0; i < kParts; ++i) r.part[i] = Batch::load_aligned(from + i * Batch::size);
    return r;
  }
  void store(float* to) const {
    for (std::size_t i = 0; i < kParts; ++i) part[i].store_aligned(to + i * Batch::size);
  }
  friend Lanes operator+(Lanes a, const Lanes& b) {
    for (std::size_t i = 0; i < kParts; ++i) a.part[i] = a.part[i] + b.part[i];
    return a;
  }
  friend Lanes operator-(Lanes a, const Lanes& b) {
    for (std::size_t i = 0; i < kParts; ++i) a.part[i] = a.part[i] - b.part[i];
    return a;
  }
  friend Lanes operator*(Lanes a, const Lanes& b) {
    for (std::size_t i = 0; i < kParts; ++i) a.part[i] = a.part[i] * b.part[i];
    return a;
  }
};

/// The sums over the lanes of four, in double: ((0 + 1) + (2 + 3)) + ((4 + 5) + (6 + 7)).
template <class Arch>
inline void sum_lanes(const Lanes<Arch>& a, const Lanes<Arch>& b, const Lanes<Arch>& c, const Lanes<Arch>& d,
                      double sums[4]) {
  using Four = float __attribute__((vector_size(16)));
  using Wide = double __attribute__((vector_size(32)));
  alignas(32) float lanes[4][kLanes];
  a.store(lanes[0]);
  b.store(lanes[1]);
  c.store(lanes[2]);
  d.store(lanes[3]);
  Wide half[2];
  for (int h = 0; h < 2; ++h) {
    Four row[4];
    for (int i = 0; i < 4; ++i) __builtin_memcpy(&row[i], &lanes[i][4 * h], sizeof(Four));
    // Lane by lane: {a0, b0, c0, d0} and so on.
    const Four ab_low = __builtin_shufflevector(row[0], row[1], 0, 4, 1, 5);
    const Four ab_high = __builtin_shufflevector(row[0], row[1], 2, 6, 3, 7);
    const Four cd_low = __builtin_shufflevector(row[2], row[3], 0, 4, 1, 5);
    const Four cd_high = __builtin_shufflevector(row[2], row[3], 2, 6, 3, 7);
    const Wide first = __builtin_convertvector(__builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5), Wide);
    const Wide second = __builtin_convertvector(__builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7), Wide);
    const Wide third = __builtin_convertvector(__builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5), Wide);
    const Wide fourth = __builtin_convertvector(__builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7), Wide);
    half[h] = (first + second) + (third + fourth);
  }
  const Wide all = half[0] + half[1];
  __builtin_memcpy(sums, &all, sizeof(Wide));
}

/// exp(-t) for 0 <= t < kCut, 0 from there on. Relative error below 3e-7: 2^f by a polynomial of degree 5 for
/// |f| <= 1/2, the whole part by adding to the exponent; rounding by adding 1.5 * 2^23, so never with -ffast-math.
template <class Arch>
Lanes<Arch> falling_exponential(const Lanes<Arch>& t) {
  using Batch = typename Lanes<Arch>::Batch;
  using Whole = xsimd::batch<std::int32_t, Arch>;
  const Batch magic(12582912.F);
  Lanes<Arch> r;
  for (std::size_t i = 0; i < Lanes<Arch>::kParts; ++i) {
    const Batch y = t.part[i] * Batch(-1.44269504F);
    const Batch shifted = y + magic;
    const Batch f = y - (shifted - magic);
    Batch p(1.33335581e-3F);
    p = p * f + Batch(9.61812911e-3F);
    p = p * f + Batch(5.55041087e-2F);
    p = p * f + Batch(2.40226507e-1F);
    p = p * f + Batch(6.93147181e-1F);
    p = p * f + Batch(1.F);
    const Whole power = xsimd::bitwise_cast<Whole>(shifted) << 23;
    const Batch value = xsimd::bitwise_cast<Batch>(xsimd::bitwise_cast<Whole>(p) + power);
    r.part[i] = xsimd::select(t.part[i] < Batch(kCut), value, Batch(0.F));
  }
  return r;
}

struct Triple {
  double x, y, z;
};
inline double dot(const Triple& a, const Triple& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// The input goes by value: what stores into theta must not make the pointers be read again.

/// theta of every neighbour, and the first sums. p points from the query to the neighbour.
template <class Arch>
struct FirstPass {
  double weight = 0;
  Triple normal{};    ///< sum theta n
  Triple place{};     ///< sum theta p
  double plane = 0;   ///< sum theta p.n
  double square = 0;  ///< sum theta p.p
};

template <class Arch>
FirstPass<Arch> first_pass(const KernelInput in, const Lanes<Arch>& qx, const Lanes<Arch>& qy, const Lanes<Arch>& qz) {
  using L = Lanes<Arch>;
  L w = L::all(0), nx = w, ny = w, nz = w, sx = w, sy = w, sz = w, f = w, q = w;
  for (std::size_t i = 0; i < in.count; i += kLanes) {
    const L px = L::load(in.x + i) - qx;
    const L py = L::load(in.y + i) - qy;
    const L pz = L::load(in.z + i) - qz;
    const L r2 = px * px + py * py + pz * pz;
    const L theta = falling_exponential<Arch>(r2 * L::load(in.k + i));
    theta.store(in.theta + i);
    const L mx = L::load(in.nx + i);
    const L my = L::load(in.ny + i);
    const L mz = L::load(in.nz + i);
    w = w + theta;
    nx = nx + theta * mx;
    ny = ny + theta * my;
    nz = nz + theta * mz;
    sx = sx + theta * px;
    sy = sy + theta * py;
    sz = sz + theta * pz;
    f = f + theta * (px * mx + py * my + pz * mz);
    q = q + theta * r2;
  }
  double one[4], two[4], three[4];
  sum_lanes(w, nx, ny, nz, one);
  sum_lanes(sx, sy, sz, f, two);
  sum_lanes(q, q, q, q, three);
  return {one[0], {one[1], one[2], one[3]}, {two[0], two[1], two[2]}, two[3], three[0]};
}

/// sum over neighbours of 2 theta k (a + b p.n_i + u.p + t.n_i) p
template <class Arch>
Triple weighted_places(const KernelInput in, const Lanes<Arch>& qx, const Lanes<Arch>& qy, const Lanes<Arch>& qz,
                       double a, double b, const Triple& u, const Triple& t) {
  using L = Lanes<Arch>;
  const auto all = [](double v) { return L::all(static_cast<float>(v)); };
  const L la = all(a), lb = all(b), ux = all(u.x), uy = all(u.y), uz = all(u.z), tx = all(t.x), ty = all(t.y),
          tz = all(t.z);
  L sx = L::all(0), sy = sx, sz = sx;
  for (std::size_t i = 0; i < in.count; i += kLanes) {
    const L px = L::load(in.x + i) - qx;
    const L py = L::load(in.y + i) - qy;
    const L pz = L::load(in.z + i) - qz;
    const L mx = L::load(in.nx + i);
    const L my = L::load(in.ny + i);
    const L mz = L::load(in.nz + i);
    const L plane = px * mx + py * my + pz * mz;
    const L share = L::load(in.theta + i) * L::load(in.k + i) *
                    (la + lb * plane + (ux * px + uy * py + uz * pz) + (tx * mx + ty * my + tz * mz));
    sx = sx + share * px;
    sy = sy + share * py;
    sz = sz + share * pz;
  }
  double sums[4];
  sum_lanes(sx, sy, sz, sz, sums);
  return {2 * sums[0], 2 * sums[1], 2 * sums[2]};
}

/// The paper's sums over d = -p.n with the mean unit normal n.
struct PaperSums {
  double d = 0;     ///< sum theta d
  double d_k = 0;   ///< sum theta k d
  double d2 = 0;    ///< sum theta d^2
  double d3_k = 0;  ///< sum theta k d^3
};

template <class Arch>
PaperSums paper_sums(const KernelInput in, const Lanes<Arch>& qx, const Lanes<Arch>& qy, const Lanes<Arch>& qz,
                     const Triple& n) {
  using L = Lanes<Arch>;
  const auto all = [](double v) { return L::all(static_cast<float>(v)); };
  const L nx = all(n.x), ny = all(n.y), nz = all(n.z);
  L d1 = L::all(0), dk = d1, d2 = d1, d3 = d1;
  for (std::size_t i = 0; i < in.count; i += kLanes) {
    const L d = nx * (qx - L::load(in.x + i)) + ny * (qy - L::load(in.y + i)) + nz * (qz - L::load(in.z + i));
    const L td = L::load(in.theta + i) * d;
    const L tdk = td * L::load(in.k + i);
    d1 = d1 + td;
    dk = dk + tdk;
    d2 = d2 + td * d;
    d3 = d3 + tdk * d * d;
  }
  double sums[4];
  sum_lanes(d1, dk, d2, d3, sums);
  return {sums[0], sums[1], sums[2], sums[3]};
}

/// Gradient of the paper's value: by d (through n and x), then by theta. `e` is the mean d^2 (0 and by_e 0 for the
/// literal form), by_e the derivative of the value by e.
template <class Arch>
Triple paper_gradient(const KernelInput in, const Lanes<Arch>& qx, const Lanes<Arch>& qy, const Lanes<Arch>& qz,
                      const FirstPass<Arch>& first, const Triple& n, double length, double value, double e,
                      double by_e) {
  using L = Lanes<Arch>;
  const auto all = [](double v) { return L::all(static_cast<float>(v)); };
  const L nx = all(n.x), ny = all(n.y), nz = all(n.z), lv = all(value), le = all(e), lb = all(by_e);
  const L one = L::all(1), two = L::all(2), three = L::all(3);
  L s = L::all(0), bx = s, by = s, bz = s, gx = s, gy = s, gz = s;
  for (std::size_t i = 0; i < in.count; i += kLanes) {
    const L px = L::load(in.x + i) - qx;
    const L py = L::load(in.y + i) - qy;
    const L pz = L::load(in.z + i) - qz;
    const L theta = L::load(in.theta + i);
    const L k = L::load(in.k + i);
    const L d = L::all(0) - (nx * px + ny * py + nz * pz);
    const L d2 = d * d;
    const L by_d = theta * (one - three * d2 * k + le * k + two * lb * d);
    const L by_theta = theta * k * (d * (one - d2 * k + le * k) - lv + lb * (d2 - le));
    s = s + by_d;
    bx = bx + by_d * px;
    by = by + by_d * py;
    bz = bz + by_d * pz;
    gx = gx + by_theta * px;
    gy = gy + by_theta * py;
    gz = gz + by_theta * pz;
  }
  double turned[4], thinned[4];
  sum_lanes(s, bx, by, bz, turned);
  sum_lanes(gx, gy, gz, gz, thinned);
  const double along = turned[0];
  const Triple b{turned[1], turned[2], turned[3]};
  // n turns with x: sum by_d * d(-p.n)/dn = -b, and dn = (I - n n^T) dN / |N|.
  const double bn = dot(b, n);
  const Triple tilt{(b.x - bn * n.x) / length, (b.y - bn * n.y) / length, (b.z - bn * n.z) / length};
  const Triple turn = weighted_places<Arch>(in, qx, qy, qz, 0, 0, {0, 0, 0}, tilt);
  const double w = first.weight;
  return {(along * n.x - turn.x + 2 * thinned[0]) / w, (along * n.y - turn.y + 2 * thinned[1]) / w,
          (along * n.z - turn.z + 2 * thinned[2]) / w};
}

template <class Arch>
KernelOutput evaluate_lanes(const KernelInput& in, KernelForm form, float x, float y, float z) {
  using L = Lanes<Arch>;
  const L qx = L::all(x), qy = L::all(y), qz = L::all(z);
  const auto s = first_pass<Arch>(in, qx, qy, qz);
  KernelOutput out;
  out.weight = s.weight;
  if (!(s.weight > 1e-12)) return out;
  const double w = s.weight;
  out.closeness = -s.plane / w;
  const auto set = [&](double value, const Triple& g) {
    out.value = value;
    out.gradient[0] = g.x;
    out.gradient[1] = g.y;
    out.gradient[2] = g.z;
  };
  const double length = __builtin_sqrt(dot(s.normal, s.normal));
  if (form == KernelForm::Imls || !(length > 1e-6 * w)) {
    // grad of -F/w: F' = sum 2 theta k p.n p - N, w' = sum 2 theta k p.
    const Triple g = weighted_places<Arch>(in, qx, qy, qz, -s.plane / w, 1, {0, 0, 0}, {0, 0, 0});
    set(out.closeness, {(s.normal.x - g.x) / w, (s.normal.y - g.y) / w, (s.normal.z - g.z) / w});
    return out;
  }
  const Triple n{s.normal.x / length, s.normal.y / length, s.normal.z / length};
  if (form == KernelForm::Unbiased) {
    const double pn = dot(s.place, n);
    // Mean of both distances. Its own first-order fault where samples lie unevenly about the query is
    // -kappa |t|^2 / 2 (t: tangential mean offset), which a sphere fitted to the same sums gives back.
    const double place2 = dot(s.place, s.place) / (w * w);
    const double spread = s.square / w - place2;
    const double kappa = spread > 1e-6 ? (s.plane / w - dot(s.place, s.normal) / (w * w)) / spread : 0;
    const double tangential2 = place2 - pn * pn / (w * w);
    const double mean = -(s.plane + pn) / (2 * w);
    const double sphere = 0.5 * kappa * tangential2;
    // grad of -(F + P.n)/2w; what the small sphere term adds is left out of the gradient.
    const Triple side{(s.place.x - pn * n.x) / length, (s.place.y - pn * n.y) / length,
                      (s.place.z - pn * n.z) / length};
    const Triple g = weighted_places<Arch>(in, qx, qy, qz, 2 * mean, 1, n, side);
    set(mean + sphere, {(s.normal.x + w * n.x - g.x) / (2 * w), (s.normal.y + w * n.y - g.y) / (2 * w),
                        (s.normal.z + w * n.z - g.z) / (2 * w)});
    return out;
  }
  const PaperSums d = paper_sums<Arch>(in, qx, qy, qz, n);
  const bool normalised = form == KernelForm::Paper;
  const double e = normalised ? d.d2 / w : 0;
  const double by_e = normalised ? d.d_k / w : 0;
  const double value = (d.d - d.d3_k + e * d.d_k) / w;
  set(value, paper_gradient<Arch>(in, qx, qy, qz, s, n, length, value, e, by_e));
  return out;
}

}  // namespace
}  // namespace telefab::scan
