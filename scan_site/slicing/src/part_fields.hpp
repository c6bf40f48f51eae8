// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/codec/stack_codec.hpp>
#include <telefab/scan/slicing/slice_part.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

#include "layer_cutter.hpp"
#include "part_archive.hpp"
#include "recorded_slicing.hpp"

// What the values in a part consist of.
namespace telefab {

constexpr SurfaceClass last_of(SurfaceClass) { return SurfaceClass::Doubtful; }
constexpr DoubtReason last_of(DoubtReason) { return kLastDoubtReason; }
constexpr LayerCertificate::Verdict last_of(LayerCertificate::Verdict) { return LayerCertificate::Verdict::Completed; }
constexpr LayerCertificate::Method last_of(LayerCertificate::Method) { return LayerCertificate::Method::Reeb; }
constexpr LayerCertificate::Ground last_of(LayerCertificate::Ground) { return LayerCertificate::Ground::WindingTest; }
constexpr Coding last_of(Coding) { return Coding::Curve; }

void fields(auto& a, scan::Of<SurfaceRun> auto& r) { a(r.kind, r.edges, r.gap_mm, r.error_mm); }
void fields(auto& a, scan::Of<ContourCount> auto& c) { a(c.outers, c.holes); }
void fields(auto& a, scan::Of<Doubt> auto& d) {
  a(d.reason, d.place, d.number, d.size_mm, d.other_mm, d.found, d.other);
}
void fields(auto& a, scan::Of<LayerCertificate> auto& c) {
  a(c.verdict, c.method, c.ground, c.predicted_euler, c.measured_euler, c.doubt, c.specks);
}
void fields(auto& a, scan::Of<Layer> auto& l) { a(l.index, l.z_mm, l.contours, l.certificate); }
void fields(auto& a, scan::Of<Bounds2> auto& b) { a(b.min, b.max); }
void fields(auto& a, scan::Of<StackHeader> auto& h) {
  a(h.machine, h.layer_thickness_mm, h.pixel_pitch_mm, h.layer_count, h.bounds, h.scan_to_build, h.scan_name);
}
void fields(auto& a, scan::Of<CodecOptions> auto& o) {
  a(o.coding, o.layers_per_chunk, o.total_error_pitch, o.chord_error_pitch);
}

}  // namespace telefab

namespace telefab::scan {

constexpr MirrorAxis last_of(MirrorAxis) { return MirrorAxis::Z; }
constexpr StandFor last_of(StandFor) { return StandFor::Quality; }
constexpr StandingSource last_of(StandingSource) { return StandingSource::Spread; }

void fields(auto& a, Of<LayerShare> auto& s) { a(s.index, s.count); }
void fields(auto& a, Of<LayerRange> auto& r) { a(r.first, r.end); }
void fields(auto& a, Of<PartKey> auto& k) { a(k.slicing, k.layers, k.share); }
void fields(auto& a, Of<ContourGap> auto& g) { a(g.place, g.size_mm, g.bridged); }
void fields(auto& a, Of<CutLayer> auto& c) { a(c.layer, c.gaps, c.evaluations); }
void fields(auto& a, Of<Box3> auto& b) { a(b.min, b.max); }
void fields(auto& a, Of<KernelChoice> auto& k) {
  a(k.spacing_mm, k.unevenness, k.noise_mm, k.noise_factor, k.kernel_mm, k.adaptive, k.dropped_samples);
}
void fields(auto& a, Of<PlacementOptions> auto& p) {
  a(p.height_mm, p.scale, p.unit_mm, p.fit, p.mirror, p.turn, p.stand_for, p.axis_scale, p.position_mm);
}
void fields(auto& a, Of<StandingFigures> auto& f) {
  a(f.size_mm, f.part_mm3, f.support_mm3, f.anchors, f.overhang_mm2, f.stepped_mm2, f.surface_mm2, f.is_lifted,
    f.layers, f.trapped_mm3, f.stability);
}
void fields(auto& a, Of<Standing> auto& s) { a(s.turn, s.source, s.figures, s.cost); }
void fields(auto& a, Of<ChosenStanding> auto& c) { a(c.goal, c.standing, c.as_in_file); }
void fields(auto& a, Of<Piece> auto& p) { a(p.points, p.box, p.kept); }
void fields(auto& a, Of<StandingGround> auto& g) { a(g.share, g.up, g.left_out); }
void fields(auto& a, Of<PickReport> auto& p) {
  a(p.points_in, p.cropped, p.strays, p.in_other_pieces, p.pieces, p.ground, p.is_scene, p.before, p.after);
}
void fields(auto& a, Of<Openness> auto& o) { a(o.seen_mm2, o.missing_mm2); }
void fields(auto& a, Of<CompletionSummary> auto& c) {
  a(c.rim_samples, c.virtual_samples, c.largest_gap_mm, c.largest_error_mm);
}
/// What is known before the first layer; the rest is the layers', or of the clock.
void fields(auto& a, Of<SliceReport> auto& r) {
  a(r.header, r.points, r.kernel, r.surface, r.method, r.size_mm, r.placement, r.chosen, r.pick, r.normals_json, r.open,
    r.completion, r.specks.least_mm2, r.warnings, r.surface_euler, r.critical_points, r.inconsistencies);
}

}  // namespace telefab::scan
