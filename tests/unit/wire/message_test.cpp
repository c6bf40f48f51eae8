// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <telefab/wire/message.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;

StackHeader some_header() {
  StackHeader header;
  header.machine = "machine-a";
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = 500;
  header.bounds = {{1, 2}, {30, 40}};
  header.scan_to_build[3] = 17.25;
  header.scan_name = "vase.ply";
  return header;
}

Job some_job() {
  Job job;
  job.id = "j18f-3";
  job.name = "vase.ply";
  job.machine = "machine-a";
  job.parameters = R"({"height_mm":75})";
  job.owner = "ana";
  job.state = JobState::Printing;
  job.message = "layer 7";
  job.counters = {500, 500, 500, 540, 540, 7, 1'000'000, 35'000};
  job.stages = {{JobStage::Slice, 12.5}, {JobStage::Send, 0.25}};
  job.created_unix_ms = 1'700'000'000'000;
  job.changed_unix_ms = 1'700'000'000'500;
  job.instance = "hall-1";
  return job;
}

MachineStatus some_machine() {
  return {"hall-1", "machine-a", MachineState::Paused, "clear", "j18f-3", "vase.ply", 7, 540, 61.5, 2, "a fault", true};
}

/// One of each; the static_assert below keeps the list whole.
std::vector<Message> every_message() {
  const RequestId request{42};
  const Digest digest = digest_of(std::vector<std::byte>(3));
  const std::vector<std::byte> bytes(100, std::byte{0x5a});
  return {Hello{kProtocolVersion,
                Side::FabSite,
                "telefab-fab 0.1.0",
                {"name = \"a\""},
                "automatic",
                {"name = \"r\""},
                {"name = \"p\""}},
          Fault{request, {ErrorCode::Conflict, "job is done"}, "j1"},
          Ping{},
          Pong{},
          AskMachines{request},
          Machines{request,
                   {"name = \"a\"", "name = \"b\""},
                   "127.0.0.1",
                   {"name = \"r\""},
                   {"name = \"p\""},
                   {some_machine(), {"hall-2", "machine-a"}},
                   "not reached"},
          Submit{request, "vase.ply", "machine-a", "{}", 1000, digest},
          UploadReady{request, 500},
          UploadBlock{request, 500, bytes},
          AskJobs{request, "j1", 5, true, "vase ana", {JobState::Done, JobState::AwaitingApproval}, 7},
          Jobs{request, {some_job(), some_job()}, 7},
          Command{request, "j1", JobCommand::Approve, "ana", "islands,supports"},
          AskFiles{request, "j1"},
          Files{request, {{"preview.png", 1234}}},
          AskFile{request, "j1", "preview.png"},
          FileBlock{request, 900, 1000, bytes},
          Offer{"j1", "vase.ply", "machine-a", "{}", digest, some_header(), 5, "ana", std::vector<std::byte>(32),
                std::vector<std::byte>(64), digest, 0.04},
          OfferAccepted{"j1", 7, false},
          SendChunk{"j1", 7, LayerIndex{64}, 64, bytes, digest},
          ChunkStored{"j1", 7},
          StackEnd{"j1", 8, digest, digest, std::vector<std::byte>(64)},
          StackStored{"j1"},
          JobChanged{some_job()},
          OfferDeferred{"j1", DeferReason::Full, std::chrono::milliseconds{2000}, "the disk is full"}};
}
static_assert(std::variant_size_v<Message> == 24, "add the new message to every_message()");

TEST(Message, ComesBackAsItWasSent) {
  std::size_t index = 0;
  for (const Message& message : every_message()) {
    EXPECT_EQ(message.index(), index++);
    const Frame frame = to_frame(message);
    const auto back = from_frame(frame);
    ASSERT_TRUE(back) << message.index() << back.error().what;
    EXPECT_EQ(back->index(), message.index());
    EXPECT_EQ(to_frame(*back), frame) << message.index();
  }
}

TEST(Message, KeepsWhatAnOfferSaysOfItsScan) {
  Offer offer{"j1", "vase.ply", "machine-a", "{}", {}, some_header(), 5, "ana", {}, {}};
  auto back = from_frame(to_frame(offer));
  ASSERT_TRUE(back);
  EXPECT_EQ(std::get<Offer>(*back).scan, Digest{}) << "not stated";
  offer.scan = digest_of(std::vector<std::byte>(3));
  offer.registration_rms_mm = 0.04;
  back = from_frame(to_frame(offer));
  ASSERT_TRUE(back);
  EXPECT_EQ(std::get<Offer>(*back).scan, offer.scan);
  EXPECT_EQ(std::get<Offer>(*back).registration_rms_mm, 0.04);
}

TEST(Message, KeepsTheAttemptOfAnOfferAndLeavesOneWithoutAsItWas) {
  Offer offer{"j1", "vase.ply", "machine-a", "{}", {}, some_header(), 5, "ana", {}, {}};
  const Frame without = to_frame(offer);
  ASSERT_TRUE(from_frame(without));
  EXPECT_EQ(std::get<Offer>(*from_frame(without)).attempt, 0U);
  for (const std::uint32_t attempt : {1U, 2U, 4'000'000'000U}) {
    offer.job = id_of_attempt("j1", attempt);
    offer.attempt = attempt;
    const auto back = from_frame(to_frame(offer));
    ASSERT_TRUE(back) << offer.job;
    EXPECT_EQ(std::get<Offer>(*back).attempt, attempt);
    EXPECT_NE(to_frame(offer), without);
  }
}

TEST(Message, NamesEachAttemptOfAFleetsJobByAnIdOfItsOwn) {
  EXPECT_EQ(id_of_attempt("j1", 1), "j1");
  EXPECT_EQ(id_of_attempt("j1", 12), "j1-a12");
  EXPECT_EQ(fleet_job_of("j1", 1), "j1");
  EXPECT_EQ(fleet_job_of("j1-a12", 12), "j1");
  EXPECT_EQ(fleet_job_of("j-attic", 1), "j-attic");
  for (const auto& [id, attempt] : std::vector<std::pair<std::string, std::uint32_t>>{{"j1", 0},
                                                                                      {"j1", 2},
                                                                                      {"j1-a2", 1},
                                                                                      {"j1-a2", 3},
                                                                                      {"j1-a02", 2},
                                                                                      {"-a2", 2},
                                                                                      {"j1-a2-a3", 3},
                                                                                      {"J1", 1},
                                                                                      {"", 1}})
    EXPECT_EQ(fleet_job_of(id, attempt), std::nullopt) << id << " in attempt " << attempt;
}

TEST(Message, CarriesTheAnswersAboutALayerPerhapsExposedAndAPrinterPerhapsStarted) {
  for (const JobCommand answer :
       {JobCommand::TreatAsExposed, JobCommand::ExposeAgain, JobCommand::TreatAsStarted, JobCommand::StartAgain}) {
    const auto back = from_frame(to_frame(Command{RequestId{1}, "j1", answer, "ana"}));
    ASSERT_TRUE(back);
    EXPECT_EQ(std::get<Command>(*back).command, answer);
  }
}

TEST(Message, SaysWhyAnOfferIsPutOffAndWhenToOfferAgain) {
  for (const DeferReason reason : {DeferReason::Busy, DeferReason::Full, DeferReason::StorageFault}) {
    const auto back = from_frame(to_frame(OfferDeferred{"j1", reason, std::chrono::milliseconds{1500}, "later"}));
    ASSERT_TRUE(back);
    const auto& deferred = std::get<OfferDeferred>(*back);
    EXPECT_EQ(deferred.reason, reason);
    EXPECT_EQ(deferred.retry_after, std::chrono::milliseconds{1500});
    EXPECT_EQ(deferred.what, "later");
  }
}

TEST(Message, KeepsAJobWhole) {
  const auto back = from_frame(to_frame(JobChanged{some_job()}));
  ASSERT_TRUE(back);
  EXPECT_EQ(std::get<JobChanged>(*back).job, some_job());
}

TEST(Message, NeverCrashesOnChangedBodiesAndRefusesOrReadsThem) {
  std::mt19937 random{3};
  std::size_t refused = 0;
  for (const Message& message : every_message())
    for (int i = 0; i < 300; ++i) {
      Frame frame = to_frame(message);
      for (int k = 0; k < 3 && !frame.body.empty(); ++k)
        frame.body[random() % frame.body.size()] = static_cast<std::byte>(random());
      if (random() % 4 == 0) frame.body.resize(random() % (frame.body.size() + 1));
      refused += from_frame(frame) ? 0 : 1;
    }
  EXPECT_GT(refused, 1000U);
}

struct BadMessage {
  Message message;
  std::string_view field;
};

TEST(Message, RefusesEveryValueOutOfItsRangeByName) {
  const Digest digest;
  StackHeader bad_header = some_header();
  bad_header.layer_thickness_mm = -1;
  Job bad_job = some_job();
  bad_job.state = static_cast<JobState>(0);
  Job timeless = some_job();
  timeless.stages[0].seconds = -1;
  const BadMessage bad[]{
      {AskFile{RequestId{1}, "j1", "../secret"}, "name"},
      {AskFile{RequestId{1}, "J1/..", "a"}, "job"},
      {AskJobs{RequestId{1}, "", 1, true}, "watch"},
      {AskJobs{RequestId{1}, "", 100'000, false}, "most"},
      {AskJobs{RequestId{1}, "", 1, false, std::string(300, 'a')}, "words"},
      {AskJobs{RequestId{1}, "", 1, false, "\x1b[2J"}, "words"},
      {AskJobs{RequestId{1}, "", 1, false, "", {static_cast<JobState>(77)}}, "state"},
      {AskJobs{RequestId{1}, "", 1, false, "", std::vector<JobState>(12, JobState::Done)}, "state"},
      {AskJobs{RequestId{1}, "", 1, false, "", {}, ~std::uint64_t{0}}, "before"},
      {Submit{RequestId{1}, "a/b.ply", "m", "{}", 1, digest}, "name"},
      {Submit{RequestId{1}, "b.ply", "m", "{}", 1ULL << 60U, digest}, "size_bytes"},
      {Submit{RequestId{1}, "b.ply", "m", std::string(20'000, ' '), 1, digest}, "parameters"},
      {UploadBlock{RequestId{1}, 0, std::vector<std::byte>(kMaxBlockBytes + 1)}, "content"},
      {Command{RequestId{1}, "j1", static_cast<JobCommand>(11), ""}, "action"},
      {Offer{"j1", "v", "m", "{}", digest, some_header(), 5, "", {}, {}, {}, -1}, "registration_rms_mm"},
      {Offer{"j1", "v", "m", "{}", digest, some_header(), 5, "", {}, {}, {}, 0, 2}, "attempt"},
      {Offer{"j1-a2", "v", "m", "{}", digest, some_header(), 5, "", {}, {}, {}, 0, 1}, "attempt"},
      {FileBlock{RequestId{1}, 5, 6, std::vector<std::byte>(2)}, "content"},
      {Offer{"j1", "v", "m", "{}", digest, bad_header, 1, "", {}, {}}, "header"},
      {Offer{"j1", "v", "m", "{}", digest, some_header(), 9, "", {}, {}}, "coding"},
      {Offer{"j1", "v", "m", "{}", digest, some_header(), 4, "", {}, {}}, "coding"},
      {Offer{"j1", "v", "m", "{}", digest, some_header(), 5, "", std::vector<std::byte>(31), {}}, "public_key"},
      {SendChunk{"j1", kMaxLayers, LayerIndex{0}, 1, {}, digest}, "sequence"},
      {SendChunk{"j1", 0, LayerIndex{0}, 0, {}, digest}, "layer_count"},
      {SendChunk{"j1", 0, LayerIndex{kMaxLayers - 1}, 2, {}, digest}, "layer_count"},
      {StackEnd{"j1", 0, digest, digest, {}}, "chunk_count"},
      {Hello{1, static_cast<Side>(0), "", {}, ""}, "side"},
      {JobChanged{bad_job}, "state"},
      {JobChanged{timeless}, "seconds"},
      {OfferDeferred{"j1", static_cast<DeferReason>(0), {}, ""}, "reason"},
      {OfferDeferred{"j1", DeferReason::Full, 2 * kLongestDeferral, ""}, "retry_after_ms"},
  };
  for (const BadMessage& each : bad) {
    const auto back = from_frame(to_frame(each.message));
    ASSERT_FALSE(back) << each.field;
    EXPECT_EQ(back.error().code, ErrorCode::ProtocolBroken);
    EXPECT_THAT(back.error().what, HasSubstr(each.field));
  }
}

}  // namespace
}  // namespace telefab
