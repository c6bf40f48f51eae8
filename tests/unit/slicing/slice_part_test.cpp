// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/slice_part.hpp>

#include <gmock/gmock.h>

#include <algorithm>
#include <random>

#include "part_bytes.hpp"
#include "sliced.hpp"

// Layers that several workers cut, put together.
namespace telefab::scan {
namespace {

constexpr std::string_view kName = "torus.xyz";

using Bytes = std::vector<std::byte>;

/// A limb that was cut through, rough: measured, completed and doubtful layers.
const std::string& torn_text() {
  static const std::string text = [] {
    auto torn =
        test::sample_surface(*test::torus(9, 4, 90, 1), {.spacing_mm = 0.7, .holes = {{{0, 9, 0}, 5}}, .seed = 12});
    for (std::size_t i = 0; i < torn.points.size(); ++i)
      torn.points[i] += (i % 2 == 0 ? 0.15 : -0.15) * torn.normals[i];
    return text_of(torn);
  }();
  return text;
}

SliceReport without_times(SliceReport report) {
  report.times.clear();
  return report;
}

struct Part {
  std::string name;
  Bytes bytes;
};

Result<CutPart> cut(const std::string& scan, SliceRequest request, std::optional<LayerShare> share,
                    std::stop_token stop = {}) {
  request.share = share;
  const LayerSink nobody = [](const StackHeader&, Layer&&) -> Result<void> { return {}; };
  const auto bytes = std::as_bytes(std::span{scan});
  const Digest slicing =
      digest_of_slicing(digest_of(bytes), kName, {.height_mm = request.placement.height_mm}, request);
  return cut_part(bytes, kName, {request, {}}, slicing, nobody, {}, stop);
}

std::vector<Part> parts_of(const std::string& scan, const SliceRequest& request, std::uint32_t count) {
  std::vector<Part> parts;
  for (std::uint32_t i = 1; i <= count; ++i) {
    const LayerShare share{i, count};
    auto part = cut(scan, request, share);
    EXPECT_TRUE(part) << part.error().what;
    if (part) parts.push_back({fmt::format("{}-of-{}", i, count), std::move(part->bytes)});
  }
  return parts;
}

std::vector<PartSource> sources_of(const std::vector<Part>& parts) {
  std::vector<PartSource> sources;
  for (const Part& part : parts)
    sources.push_back({part.name, [bytes = part.bytes]() -> Result<Bytes> { return bytes; }});
  return sources;
}

Outcome merged(const std::vector<Part>& parts) {
  Outcome outcome;
  const auto sequence = PartSequence::of(sources_of(parts), {});
  if (!sequence) {
    outcome.report = tl::unexpected{sequence.error()};
    return outcome;
  }
  if (auto ok = sequence->is_whole(); !ok) {
    outcome.report = tl::unexpected{ok.error()};
    return outcome;
  }
  const LayerSink sink = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    outcome.text += canonical_text(layer);
    outcome.layers.push_back(std::move(layer));
    return {};
  };
  outcome.report = sequence->replay(sink, {}, {});
  return outcome;
}

std::string refusal_of(const std::vector<Part>& parts, ErrorCode code = ErrorCode::InvalidInput) {
  const Outcome outcome = merged(parts);
  EXPECT_FALSE(outcome.report);
  if (outcome.report) return {};
  EXPECT_EQ(outcome.report.error().code, code);
  return outcome.report.error().what;
}

/// What is not in the layers, as people and programs get it.
std::string json_of(const Result<SliceReport>& report) { return report ? to_json(without_times(*report)) : ""; }

TEST(SliceParts, GiveTheLayersAndTheReportOfOneProcessForAnyNumberAndInAnyOrder) {
  std::mt19937 rng{5};
  SliceRequest request = request_for();
  request.placement.height_mm = 20;
  request.placement.turn = *turn_from_rotate("10,20,30");
  request.placement.mirror = MirrorAxis::X;
  const Outcome whole = slice(torn_text(), request);
  ASSERT_TRUE(whole.report) << whole.report.error().what;
  ASSERT_GT(whole.report->flagged.size(), 0U) << "certificates with doubts take part";
  ASSERT_GT(whole.report->completed, 0U) << "contours with runs take part";
  for (const std::uint32_t count : {1U, 2U, 3U, 7U}) {
    std::vector<Part> parts = parts_of(torn_text(), request, count);
    std::shuffle(parts.begin(), parts.end(), rng);
    const Outcome together = merged(parts);
    ASSERT_TRUE(together.report) << together.report.error().what;
    EXPECT_EQ(together.text, whole.text) << count;
    EXPECT_EQ(json_of(together.report), json_of(whole.report)) << count;
  }
}

TEST(SliceParts, GiveAllOfThemWhereThereAreMorePartsThanLayers) {
  SliceRequest request = request_for();
  request.layer_mm = 1;
  request.placement.height_mm = 8;
  const Outcome whole = slice(torus_text(), request);
  ASSERT_EQ(whole.layers.size(), 8U);
  const Outcome together = merged(parts_of(torus_text(), request, 11));
  ASSERT_TRUE(together.report) << together.report.error().what;
  EXPECT_EQ(together.text, whole.text);
  EXPECT_EQ(json_of(together.report), json_of(whole.report));
}

TEST(SliceParts, SayHowTheScanStandsWhereThatWasChosen) {
  SliceReport known;
  known.header.machine = "bench";
  known.header.layer_thickness_mm = 0.5;
  known.header.pixel_pitch_mm = 0.1;
  known.header.layer_count = 3;
  known.header.bounds = {{0, 0}, {10, 10}};
  const Turn turn = *turn_from_rotate("10,20,30");
  known.chosen = ChosenStanding{
      StandFor::Quality, {turn, StandingSource::FlatSide, {.part_mm3 = 2, .is_lifted = true, .layers = 7}, 0.25}, {}};
  known.chosen->as_in_file = StandingFigures{.support_mm3 = 3, .anchors = 5, .stability = -0.5};
  ArchiveWriter to;
  write_head({.key = {}, .codec = {}, .range = {0, 0}, .known = known}, to);
  const Bytes bytes = with_seal(std::move(to.bytes()));
  const auto read = open_part(bytes);
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_EQ(to_json(read->head.known), to_json(known));
  ASSERT_TRUE(read->head.known.chosen);
  EXPECT_EQ(rotate_text(read->head.known.chosen->standing.turn), rotate_text(turn));
}

TEST(SliceParts, AreTheSameBytesOnAnyNumberOfThreads) {
  const auto one = cut(torus_text(), request_for(1), LayerShare{2, 3});
  const auto eight = cut(torus_text(), request_for(8), LayerShare{2, 3});
  ASSERT_TRUE(one && eight);
  EXPECT_EQ(one->bytes, eight->bytes);
}

TEST(SliceParts, RefuseToBeAStackWhereOneIsMissingAndNameIt) {
  std::vector<Part> parts = parts_of(torus_text(), request_for(), 4);
  parts.erase(parts.begin() + 2);
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("part 3 of 4: layers 26 to 38; cut them"));
  parts.erase(parts.begin());
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("part 1 of 4: layers 0 to 12; part 3 of 4: layers 26 to 38"));
}

TEST(SliceParts, RefuseOthersOfAnotherScanParameterMachineOrProgram) {
  std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  const Bytes own = parts[1].bytes;
  SliceRequest other = request_for();
  other.placement.height_mm = 20;
  parts[1] = {"another", parts_of(torus_text(), other, 2)[1].bytes};
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("1-of-2 and another are parts of different slicings"));
  const Digest scan = digest_of(std::as_bytes(std::span{torus_text()}));
  const SliceRequest one = request_for();
  const Digest plain = digest_of_slicing(scan, kName, {}, one);
  EXPECT_EQ(digest_of_slicing(scan, kName, {}, request_for(8)), plain) << "threads change no byte";
  EXPECT_NE(digest_of_slicing(Digest{}, kName, {}, one), plain);
  EXPECT_NE(digest_of_slicing(scan, "other.xyz", {}, one), plain);
  EXPECT_NE(digest_of_slicing(scan, kName, {.fit = true}, one), plain);
  SliceRequest resin = one, fewer = one;
  resin.machine.resin.shrink_x_percent = 1;
  fewer.intake.most_points = 1000;
  EXPECT_NE(digest_of_slicing(scan, kName, {}, resin), plain);
  EXPECT_NE(digest_of_slicing(scan, kName, {}, fewer), plain);
}

TEST(SliceParts, RefuseThoseOfAnotherDivision) {
  std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  parts.push_back(parts_of(torus_text(), request_for(), 3)[2]);
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("2-of-2 (part 2 of 2) and 3-of-3 (part 3 of 3) both hold layers 34 "
                                                    "to 51"));
}

TEST(SliceParts, RefuseTheSamePartTwice) {
  std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  parts.push_back({"copy", parts[0].bytes});
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("1-of-2 (part 1 of 2) and copy (part 1 of 2) both hold"));
}

TEST(SliceParts, RefuseADamagedOneWhereverItIsDamaged) {
  std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  const Bytes sound = parts[1].bytes;
  std::mt19937 rng{3};
  for (int trial = 0; trial < 60; ++trial) {
    parts[1].bytes = sound;
    const std::size_t at = 8 + rng() % (sound.size() - 8);
    parts[1].bytes[at] ^= std::byte{1} << (rng() % 8);
    EXPECT_THAT(refusal_of(parts, ErrorCode::NotTrusted), testing::HasSubstr("2-of-2: this part is damaged")) << at;
  }
  parts[1].bytes.assign(sound.begin(), sound.end() - 100);
  EXPECT_THAT(refusal_of(parts, ErrorCode::NotTrusted), testing::HasSubstr("damaged"));
  parts[1].bytes.assign(sound.begin(), sound.begin() + 20);
  EXPECT_THAT(refusal_of(parts), testing::HasSubstr("2-of-2: this is not a part of a slicing"));
}

TEST(SliceParts, RefuseOneThatIsReplacedWhileTheyArePutTogether) {
  const std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  const std::vector<Part> others = parts_of(torus_text(), request_for(), 3);
  std::size_t reads = 0;
  std::vector<PartSource> sources = sources_of(parts);
  sources[1].read = [&]() -> Result<Bytes> { return reads++ == 0 ? parts[1].bytes : others[2].bytes; };
  const auto sequence = PartSequence::of(std::move(sources), {});
  ASSERT_TRUE(sequence) << sequence.error().what;
  const auto report = sequence->replay([](const StackHeader&, Layer&&) -> Result<void> { return {}; }, {}, {});
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::Conflict);
}

TEST(SliceParts, SayThatTheContoursAreNoPartOnlyWhenAllLayersAreThere) {
  // Far above the object a clump of points sets the height: no half of it has contours.
  auto samples = test::sample_surface(*test::torus(9, 4, 90, 1), {.spacing_mm = 0.7, .seed = 11});
  const auto far = test::sample_surface(*test::sphere(0.4, 1), {.spacing_mm = 0.35, .seed = 2});
  for (std::size_t i = 0; i < far.points.size(); ++i) {
    samples.points.push_back(far.points[i] + Vec3{0, 0, 110});
    samples.normals.push_back(far.normals[i]);
  }
  SliceRequest request = request_for();
  request.placement.height_mm = 40;
  request.intake.pick.keep_outliers = true;
  request.mls.drop_outliers = false;
  const std::string text = text_of(samples);
  const Outcome whole = slice(text, request);
  const std::vector<Part> parts = parts_of(text, request, 2);
  const Outcome together = merged(parts);
  ASSERT_FALSE(whole.report);
  ASSERT_FALSE(together.report);
  EXPECT_EQ(together.report.error(), whole.report.error());
}

TEST(SliceParts, EndWithinABlockOfLayersWhenStopped) {
  std::stop_source stop;
  stop.request_stop();
  const auto part = cut(torus_text(), request_for(), LayerShare{1, 2}, stop.get_token());
  ASSERT_FALSE(part);
  EXPECT_EQ(part.error().code, ErrorCode::Cancelled);
  const std::vector<Part> parts = parts_of(torus_text(), request_for(), 2);
  const auto sequence = PartSequence::of(sources_of(parts), stop.get_token());
  ASSERT_FALSE(sequence);
  EXPECT_EQ(sequence.error().code, ErrorCode::Cancelled);
}

TEST(LayerShares, AreEqualButForALayerAndLeaveNoneOut) {
  SliceRequest request;
  for (const std::uint32_t layers : {1U, 5U, 52U, 667U, 2000U})
    for (const std::uint32_t count : {1U, 2U, 3U, 8U, 64U, 1000U}) {
      std::uint32_t next = 0, least = layers, most = 0;
      for (std::uint32_t i = 1; i <= count; ++i) {
        request.share = LayerShare{i, count};
        const auto range = range_of(request, layers);
        ASSERT_TRUE(range);
        EXPECT_EQ(range->first, next);
        next = range->end;
        least = std::min(least, range->count());
        most = std::max(most, range->count());
      }
      EXPECT_EQ(next, layers);
      EXPECT_LE(most - least, 1U);
    }
}

TEST(LayerShares, AreReadOrRefused) {
  const LayerShare third{3, 8};
  EXPECT_EQ(layer_share_from("3/8"), third);
  for (const char* wrong : {"", "3", "/8", "3/", "0/8", "9/8", "3/8x", "-1/8", "3:8", "1/200001"})
    EXPECT_FALSE(layer_share_from(wrong)) << wrong;
}

TEST(PartKey, HasAnotherFileNameForOtherLayers) {
  const Digest d = digest_of(std::as_bytes(std::span{kName}));
  const LayerShare second{2, 8};
  std::vector<std::string> names{file_name_of({d, {}, {}}), file_name_of({d, {}, second}),
                                 file_name_of({d, {{0, 99}}, {}}), file_name_of({d, {{0, 99}}, second}),
                                 file_name_of({Digest{}, {}, {}})};
  EXPECT_TRUE(names[1].ends_with(".2-of-8.tfpart")) << names[1];
  EXPECT_TRUE(names[2].ends_with(".layers-0-99.tfpart")) << names[2];
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::unique(names.begin(), names.end()), names.end());
}

}  // namespace
}  // namespace telefab::scan
