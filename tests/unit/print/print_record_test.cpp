// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/machine/profile_digest.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;

// Made with `openssl genpkey -algorithm ed25519` for this test alone.
constexpr std::string_view kKey =
    "-----BEGIN PRIVATE KEY-----\nMC4CAQAwBQYDK2VwBCIEIIp4gFV7w6bx46pV/L2QdiMLzK3KZtP/EkIJc3F89GNM\n-----END PRIVATE "
    "KEY-----\n";
constexpr std::string_view kPublic =
    "-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEAWBAVDO4RlEcnLj8ZXetnjwGUSJn/0mg8+fe2gkOO2Bc=\n-----END PUBLIC "
    "KEY-----\n";
constexpr std::string_view kOtherPublic =
    "-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEAHDuc+oArr5ZjQEaRzWXfgnj5CsM8hz/F6hLypfkVJCo=\n-----END PUBLIC "
    "KEY-----\n";

PrintPlan two_layers() {
  PrintPlan plan;
  plan.job = "j";
  plan.machine = "m";
  plan.mask_size = {4, 3};
  plan.z_travel_mm = 1;
  plan.layers = {{LayerIndex{0}, 0.1, 2s, {}}, {LayerIndex{1}, 0.2, 1s, {}}};
  return plan;
}

PrintRecord record_of(const PrintPlan& plan) {
  PrintRecord r;
  r.job = plan.job;
  r.plan = plan_digest(plan);
  r.outcome = PrintOutcome::Done;
  r.next = LayerIndex{2};
  r.provenance["scan_sha256"] = "ab";
  for (const PlannedLayer& l : plan.layers)
    r.layers.push_back({l.index, l.z_mm, l.exposure, l.exposure + 3ms, 5s, 1, 1, l.mask, JournalStep::Exposed, 31.5});
  return r;
}

TEST(PrintPlanJson, GivesThePlanBack) {
  const PrintPlan plan = two_layers();
  const auto back = print_plan_from_json(to_json(plan));
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(*back, plan);
  EXPECT_FALSE(print_plan_from_json("{"));
  EXPECT_FALSE(print_plan_from_json("[]"));
}

TEST(PrintPlanJson, RefusesNumbersThatAreNotWholeOrDoNotFit) {
  const std::string text = to_json(two_layers());
  ASSERT_NE(text.find("\"layer\": 1,"), std::string::npos);
  ASSERT_NE(text.find("\"exposure_us\": 1000000,"), std::string::npos);
  for (const std::string_view number : {"8e51", "-1", "1.0", "4294967296", "18446744073709551616", "true", "\"1\""}) {
    std::string layer = text, width = text;
    layer.replace(layer.find("\"layer\": 1,"), 11, "\"layer\": " + std::string{number});
    EXPECT_EQ(print_plan_from_json(layer).error().code, ErrorCode::InvalidInput) << number;
    width.replace(width.find("\"mask_width_px\": 4"), 18, "\"mask_width_px\": " + std::string{number});
    EXPECT_EQ(print_plan_from_json(width).error().code, ErrorCode::InvalidInput) << number;
  }
  for (const std::string_view number : {"8e51", "-1", "1e6", "9223372036854775808"}) {
    std::string exposure = text;
    exposure.replace(exposure.find("\"exposure_us\": 1000000"), 22, "\"exposure_us\": " + std::string{number});
    EXPECT_EQ(print_plan_from_json(exposure).error().code, ErrorCode::InvalidInput) << number;
  }
}

TEST(PrintRecordJson, RefusesNumbersThatDoNotFitAndOutcomesItDoesNotKnow) {
  const std::string text = to_json(record_of(two_layers()));
  for (const auto& [from, to] :
       std::vector<std::pair<std::string, std::string>>{{"\"next_layer\": 2", "\"next_layer\": -1"},
                                                        {"\"retries\": 1", "\"retries\": 1e300"},
                                                        {"\"cause_code\": ", "\"cause_code\": 5e9, \"x\": "},
                                                        {"\"done\"", "\"undone\""}}) {
    std::string changed = text;
    ASSERT_NE(changed.find(from), std::string::npos) << from;
    changed.replace(changed.find(from), from.size(), to);
    EXPECT_EQ(print_record_from_json(changed).error().code, ErrorCode::InvalidInput) << to;
  }
}

TEST(PrintPlanJson, StatesHowTheMasksWereMadeAndRefusesAWayItDoesNotKnow) {
  PrintPlan plan = two_layers();
  const std::string unstated = to_json(plan);
  EXPECT_EQ(unstated.find("masks"), std::string::npos);  // digests of older plans in journals and records still hold
  EXPECT_EQ(print_plan_from_json(unstated)->masks, std::nullopt);
  for (const MaskMethod method : kMaskMethods) {
    plan.masks = method;
    EXPECT_EQ(print_plan_from_json(to_json(plan)).value(), plan);
    EXPECT_NE(plan_digest(plan), plan_digest(two_layers()));
  }
  std::string unknown = to_json(plan);
  unknown.replace(unknown.find("blend-stack"), 11, "blend-waves");
  const auto refused = print_plan_from_json(unknown);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, testing::HasSubstr("blend-waves"));
  EXPECT_FALSE(print_plan_from_json(std::string{unknown}.replace(unknown.find("\"blend-waves\""), 13, "3")));
}

TEST(PrintPlan, IsPrintedByNoOtherProfileThanTheOneItWasMadeFor) {
  MachineProfile machine;
  machine.name = "m";
  machine.projection.irradiance_mw_per_cm2 = 3;
  PrintPlan plan = two_layers();
  EXPECT_EQ(plan.fits(machine).error().code, ErrorCode::Conflict) << "a plan of 0.1 says nothing of its profile";
  plan.profile = digest_of_light(machine);
  EXPECT_TRUE(plan.fits(machine));
  EXPECT_EQ(*print_plan_from_json(to_json(plan)), plan);
  const auto after = [&](auto change) {
    MachineProfile changed = machine;
    change(changed);
    return plan.fits(changed);
  };
  EXPECT_TRUE(after([](MachineProfile& m) { m.devices.speed_up = 100; }));
  EXPECT_TRUE(after([](MachineProfile& m) { m.devices.stage_serial = "A2"; }));
  EXPECT_TRUE(after([](MachineProfile& m) { m.description = "the one by the window"; }));
  EXPECT_THAT(after([](MachineProfile& m) { m.projection.irradiance_mw_per_cm2 = 9; }).error().what,
              testing::HasSubstr("was changed since the job was planned"));
  EXPECT_FALSE(after([](MachineProfile& m) { m.layers.exposure_s = 4; }));
  EXPECT_FALSE(after([](MachineProfile& m) { m.resin.penetration_mm = 0.5; }));
  EXPECT_FALSE(after([](MachineProfile& m) { m.motion.settle_s = 9; }));
  EXPECT_FALSE(after([](MachineProfile& m) { m.devices.led_current = 9; }));
}

TEST(PrintPlan, NamesTheLayerThatIsWrong) {
  const auto wrong = [](auto change) {
    PrintPlan plan = two_layers();
    change(plan);
    const auto ok = plan.validate();
    return ok ? std::string{} : ok.error().what;
  };
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers[1].z_mm = 0.1; }), testing::HasSubstr("layer 1"));
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers[1].z_mm = 1.1; }), testing::HasSubstr("travel"));
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers[0].exposure = -1us; }), testing::HasSubstr("layer 0"));
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers[1].index = LayerIndex{5}; }), testing::HasSubstr("place 1"));
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers.clear(); }), testing::HasSubstr("no layer"));
  EXPECT_THAT(wrong([](PrintPlan& p) { p.layers[1].motion.lift_mm = 0; }), testing::HasSubstr("lift"));
}

TEST(PrintRecord, ComesBackFromItsSeal) {
  const PrintRecord record = record_of(two_layers());
  const auto sealed = seal(record, kKey);
  ASSERT_TRUE(sealed) << sealed.error().what;
  const auto back = unseal(*sealed, kPublic);
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(back->record, record);
  EXPECT_EQ(back->signed_by.size(), 64U);
  const auto unsigned_one = unseal(*seal(record, ""), "");
  ASSERT_TRUE(unsigned_one);
  EXPECT_EQ(unsigned_one->record, record);
  EXPECT_EQ(unsigned_one->signed_by, "") << "who only looks at the hash must be able to tell";
}

TEST(PrintRecord, IsNotTrustedOnceAnythingInItIsChanged) {
  const std::string sealed = *seal(record_of(two_layers()), kKey);
  for (const auto& [from, to] : {std::pair{"\"runs\": 1", "\"runs\": 2"}, std::pair{"2003000", "1003000"},
                                 std::pair{"\"done\"", "\"faulted\""}}) {
    std::string forged = sealed;
    const std::size_t at = forged.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    forged.replace(at, std::string_view{from}.size(), to);
    EXPECT_EQ(unseal(forged, kPublic).error().code, ErrorCode::NotTrusted);
  }
  EXPECT_EQ(unseal(sealed, kOtherPublic).error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(unseal(*seal(record_of(two_layers()), ""), kPublic).error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(unseal("no json", "").error().code, ErrorCode::InvalidInput);
}

TEST(PrintRecord, IsComparedWithItsPlanLayerByLayer) {
  const PrintPlan plan = two_layers();
  EXPECT_THAT(compare(record_of(plan), plan), testing::IsEmpty());
  const auto finding = [&](auto change) {
    PrintRecord r = record_of(plan);
    change(r);
    return compare(r, plan);
  };
  EXPECT_THAT(finding([](PrintRecord& r) { r.layers.pop_back(); }),
              testing::Contains(testing::HasSubstr("1 layers were made")));
  EXPECT_THAT(finding([](PrintRecord& r) { r.layers[1] = r.layers[0]; }),
              testing::Contains(testing::HasSubstr("layer 1")));
  EXPECT_THAT(finding([](PrintRecord& r) { r.layers[0].z_mm += 0.05; }), testing::Contains(testing::HasSubstr("0.15")));
  EXPECT_THAT(finding([](PrintRecord& r) { r.layers[0].mask.bytes[3] = std::byte{9}; }),
              testing::Contains(testing::HasSubstr("another mask")));
  EXPECT_THAT(finding([](PrintRecord& r) { r.layers[0].measured = 1s; }),
              testing::Contains(testing::HasSubstr("lit for")));
  EXPECT_THAT(finding([](PrintRecord& r) { r.plan = {}; }), testing::Contains(testing::HasSubstr("another plan")));
}

TEST(PrintJournal, GoesOnBehindATornLine) {
  const auto path = std::filesystem::temp_directory_path() / ("telefab-journal-" + std::to_string(::getpid()));
  {
    auto journal = PrintJournal::open(std::move(*open_journal_file(path)));
    ASSERT_TRUE(journal);
    ASSERT_TRUE(journal->write({JournalStep::Planned, {}, 1ns, {}, {}, {}, {}}));
    ASSERT_TRUE(journal->write({JournalStep::Exposing, LayerIndex{0}, 2ns, {}, {}, {}, {}}));
  }
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 5);
  {
    auto journal = PrintJournal::open(std::move(*open_journal_file(path)));
    ASSERT_TRUE(journal);
    EXPECT_EQ(journal->resume_point(), (ResumePoint{LayerIndex{0}, false}));
    ASSERT_TRUE(journal->write({JournalStep::Exposing, LayerIndex{0}, 3ns, {}, {}, {}, {}}));
  }
  const auto journal = PrintJournal::open(std::move(*open_journal_file(path)));
  EXPECT_EQ(journal->resume_point(), (ResumePoint{LayerIndex{0}, true}));
  EXPECT_EQ(journal->entries().size(), 2u);
  std::filesystem::remove(path);
}

/// Takes a few bytes of the n-th line, then says that the disk is full.
class FullDisk final : public JournalFile {
 public:
  explicit FullDisk(std::string& text, int good) : text_{text}, good_{good} {}
  Result<std::string> read_all() override { return text_; }
  Result<void> append(std::string_view text) override {
    if (good_-- == 0) {
      text_ += text.substr(0, 7);
      return fail(ErrorCode::StorageFailed, "disk full");
    }
    text_ += text;
    return {};
  }
  Result<void> sync() override { return {}; }
  Result<void> truncate(std::uint64_t bytes) override {
    text_.resize(bytes);
    return {};
  }
  Result<void> set_aside(std::string_view text) override {
    text_ = text;
    return {};
  }
  Result<void> reserve(std::uint64_t) override { return {}; }

 private:
  std::string& text_;
  int good_;
};

TEST(PrintJournal, KeepsEveryLineBehindAWriteThatFailed) {
  std::string text;
  auto journal = PrintJournal::open(std::make_unique<FullDisk>(text, 1));
  ASSERT_TRUE(journal->write({JournalStep::Exposing, LayerIndex{4}, 1ns, {}, {}, {}, {}}));
  EXPECT_EQ(journal->write({JournalStep::Exposed, LayerIndex{4}, 2ns, {}, {}, {}, {}}).error().code,
            ErrorCode::StorageFailed);
  ASSERT_TRUE(journal->write({JournalStep::Exposed, LayerIndex{4}, 3ns, {}, {}, {}, {}}));
  const auto again = PrintJournal::open(std::make_unique<FullDisk>(text, 9));
  EXPECT_EQ(again->resume_point(), (ResumePoint{LayerIndex{5}, false}));
}

}  // namespace
}  // namespace telefab::fab
