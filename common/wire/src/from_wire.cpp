// SPDX-License-Identifier: GPL-3.0-or-later
#include "from_wire.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/text.hpp>

namespace telefab::wire {
namespace {

constexpr std::uint64_t kMostPlace = std::uint64_t{1} << 62U;

/// Remembers the first fault; later ones are its consequences.
void expect(Reading& reading, bool holds, std::string_view field, std::string_view claim) {
  if (!holds && !reading.fault) reading.fault = fmt::format("message-field: {} {}", field, claim);
}

std::string text(Reading& reading, const std::string& from, std::size_t most, std::string_view field) {
  expect(reading, from.size() <= most, field, fmt::format("is longer than {} bytes", most));
  return reading.fault ? std::string{} : from;
}

/// A name: what the other side says of itself, its people and its machines. It stands in logs and on terminals.
std::string name(Reading& reading, const std::string& from, std::string_view field) {
  expect(reading, is_printable(from), field, "has characters that cannot be shown");
  return text(reading, from, kMaxNameBytes, field);
}

/// Words for people; what could steer a terminal or forge a line of a log is taken out of them.
std::string words(Reading& reading, const std::string& from, std::string_view field) {
  return to_printable(text(reading, from, kMaxTextBytes, field));
}

std::string job_id(Reading& reading, const std::string& from) {
  expect(reading, is_job_id(from), "job", "is not a job id");
  return reading.fault ? std::string{} : from;
}

std::string plain_name(Reading& reading, const std::string& from, std::string_view field) {
  expect(reading, is_file_name(from), field, "is not a plain file name");
  return reading.fault ? std::string{} : from;
}

std::vector<std::byte> content(Reading& reading, const std::string& from, std::size_t most, std::string_view field) {
  expect(reading, from.size() <= most, field, fmt::format("is longer than {} bytes", most));
  if (reading.fault) return {};
  const auto* first = reinterpret_cast<const std::byte*>(from.data());
  return {first, first + from.size()};
}

Digest digest(Reading& reading, const std::string& from, std::string_view field) {
  Digest value;
  expect(reading, from.size() == value.bytes.size(), field, "is not a SHA-256");
  if (!reading.fault)
    std::transform(from.begin(), from.end(), value.bytes.begin(), [](char c) { return static_cast<std::byte>(c); });
  return value;
}

RequestId request(std::uint64_t from) { return static_cast<RequestId>(from); }

template <class Texts>
std::vector<std::string> profiles(Reading& reading, const Texts& from, std::string_view field) {
  expect(reading, static_cast<std::size_t>(from.size()) <= kMaxProfiles, field, "lists too many profiles");
  std::vector<std::string> list;
  if (reading.fault) return list;
  for (const std::string& toml : from) list.push_back(text(reading, toml, kMaxParametersBytes, field));
  return list;
}

Job read_job(Reading& reading, const v1::Job& proto) {
  Job job;
  job.id = job_id(reading, proto.id());
  job.name = name(reading, proto.name(), "name");
  job.machine = name(reading, proto.machine(), "machine");
  job.parameters = text(reading, proto.parameters(), kMaxParametersBytes, "parameters");
  job.owner = name(reading, proto.owner(), "owner");
  job.message = words(reading, proto.message(), "message");
  const bool known = std::any_of(kJobStates.begin(), kJobStates.end(),
                                 [&](JobState state) { return static_cast<std::uint32_t>(state) == proto.state(); });
  expect(reading, known, "state", "is not a state of a job");
  if (known) job.state = static_cast<JobState>(proto.state());
  job.counters = {proto.layers(),         proto.layers_sliced(),  proto.layers_sent(), proto.print_layers(),
                  proto.layers_planned(), proto.layers_printed(), proto.scan_bytes(),  proto.wire_bytes()};
  expect(reading, proto.stages_size() <= 32, "stages", "lists too many stages");
  if (!reading.fault)
    for (const v1::StageSeconds& row : proto.stages()) {
      expect(reading, std::isfinite(row.seconds()) && row.seconds() >= 0, "seconds", "is not a duration");
      const auto stage = job_stage_from_name(name(reading, row.stage(), "stage"));
      expect(reading, stage.has_value(), "stage", "is not a stage of a job");
      if (stage) job.stages.push_back({*stage, row.seconds()});
    }
  job.created_unix_ms = proto.created_unix_ms();
  job.changed_unix_ms = proto.changed_unix_ms();
  job.instance = name(reading, proto.instance(), "instance");
  return job;
}

MachineStatus read_machine(Reading& reading, const v1::MachineStatus& proto) {
  MachineStatus machine;
  machine.name = name(reading, proto.name(), "name");
  machine.profile = name(reading, proto.profile(), "profile");
  const bool known = std::any_of(kMachineStates.begin(), kMachineStates.end(), [&](MachineState state) {
    return static_cast<std::uint32_t>(state) == proto.state();
  });
  expect(reading, known, "state", "is not a state of a machine");
  if (known) machine.state = static_cast<MachineState>(proto.state());
  machine.resin = name(reading, proto.resin(), "resin");
  if (!proto.job().empty()) machine.job = job_id(reading, proto.job());
  machine.job_name = name(reading, proto.job_name(), "job_name");
  machine.layer = proto.layer();
  machine.layers = proto.layers();
  expect(reading, std::isfinite(proto.seconds_left()), "seconds_left", "is not a duration");
  machine.seconds_left = proto.seconds_left();
  machine.waiting = proto.waiting();
  machine.message = words(reading, proto.message(), "message");
  machine.is_stated = proto.is_stated();
  return machine;
}

StackHeader read_header(Reading& reading, const v1::StackHeader& proto) {
  StackHeader header;
  header.machine = name(reading, proto.machine(), "machine");
  header.layer_thickness_mm = proto.layer_thickness_mm();
  header.pixel_pitch_mm = proto.pixel_pitch_mm();
  header.layer_count = proto.layer_count();
  header.bounds = {{proto.min().x_mm(), proto.min().y_mm()}, {proto.max().x_mm(), proto.max().y_mm()}};
  header.scan_name = name(reading, proto.scan_name(), "scan_name");
  expect(reading, proto.scan_to_build_size() == 16, "scan_to_build", "has not 16 entries");
  if (reading.fault) return header;
  std::copy(proto.scan_to_build().begin(), proto.scan_to_build().end(), header.scan_to_build.begin());
  if (auto valid = header.validate(); !valid) expect(reading, false, "header:", valid.error().what);
  return header;
}

}  // namespace

void read(Reading& reading, const v1::Hello& proto, Hello& value) {
  value.protocol_version = proto.protocol_version();
  expect(reading, proto.side() >= 1 && proto.side() <= 3, "side", "is neither client nor scan site nor fab site");
  value.side = static_cast<Side>(proto.side());
  value.program = name(reading, proto.program(), "program");
  value.machine_toml = profiles(reading, proto.machine_toml(), "machine_toml");
  value.start_policy = name(reading, proto.start_policy(), "start_policy");
  value.resin_toml = profiles(reading, proto.resin_toml(), "resin_toml");
  value.print_toml = profiles(reading, proto.print_toml(), "print_toml");
  value.answers_machines = proto.answers_machines();
}
void read(Reading& reading, const v1::Fault& proto, Fault& value) {
  value.request = request(proto.request());
  expect(reading, proto.code() >= 1 && proto.code() <= static_cast<std::uint32_t>(ErrorCode::Internal), "code",
         "is not an error code of this version");
  if (reading.fault) return;
  value.error = {static_cast<ErrorCode>(proto.code()), words(reading, proto.what(), "what")};
  if (!proto.job().empty()) value.job = job_id(reading, proto.job());
}
void read(Reading&, const v1::Ping&, Ping&) {}
void read(Reading&, const v1::Pong&, Pong&) {}
void read(Reading&, const v1::AskMachines& proto, AskMachines& value) { value.request = request(proto.request()); }
void read(Reading& reading, const v1::Machines& proto, Machines& value) {
  value.request = request(proto.request());
  value.machine_toml = profiles(reading, proto.machine_toml(), "machine_toml");
  value.origin = name(reading, proto.origin(), "origin");
  value.resin_toml = profiles(reading, proto.resin_toml(), "resin_toml");
  value.print_toml = profiles(reading, proto.print_toml(), "print_toml");
  expect(reading, static_cast<std::size_t>(proto.machine_size()) <= kMaxMachines, "machine", "lists too many machines");
  if (reading.fault) return;
  for (const v1::MachineStatus& machine : proto.machine()) value.standing.push_back(read_machine(reading, machine));
  value.why_unknown = words(reading, proto.why_unknown(), "why_unknown");
}
void read(Reading& reading, const v1::Submit& proto, Submit& value) {
  value.request = request(proto.request());
  value.name = plain_name(reading, proto.name(), "name");
  value.machine = name(reading, proto.machine(), "machine");
  value.parameters = text(reading, proto.parameters(), kMaxParametersBytes, "parameters");
  expect(reading, proto.size_bytes() <= kMaxScanBytes, "size_bytes", "is above the limit for scans");
  value.size_bytes = proto.size_bytes();
  value.content = digest(reading, proto.sha256(), "sha256");
}
void read(Reading&, const v1::UploadReady& proto, UploadReady& value) {
  value.request = request(proto.request());
  value.offset_bytes = proto.offset_bytes();
}
void read(Reading& reading, const v1::UploadBlock& proto, UploadBlock& value) {
  value.request = request(proto.request());
  value.offset_bytes = proto.offset_bytes();
  value.content = content(reading, proto.content(), kMaxBlockBytes, "content");
}
void read(Reading& reading, const v1::AskJobs& proto, AskJobs& value) {
  value.request = request(proto.request());
  if (!proto.job().empty()) value.job = job_id(reading, proto.job());
  expect(reading, proto.most() <= kMaxJobsListed, "most", "is above the limit of jobs listed at once");
  value.most = proto.most();
  expect(reading, !proto.watch() || !proto.job().empty(), "watch", "needs one job");
  value.watch = proto.watch();
  value.words = name(reading, proto.words(), "words");
  expect(reading, static_cast<std::size_t>(proto.state_size()) <= kJobStates.size(), "state", "names too many states");
  if (reading.fault) return;
  for (const std::uint32_t number : proto.state()) {
    expect(reading,
           std::find(kJobStates.begin(), kJobStates.end(), static_cast<JobState>(number)) != kJobStates.end() &&
               number < 256,
           "state", "is none of this version");
    value.states.push_back(static_cast<JobState>(number));
  }
  expect(reading, proto.before() <= kMostPlace, "before", "is not a place in a list");
  value.before = proto.before();
}
void read(Reading& reading, const v1::Jobs& proto, Jobs& value) {
  value.request = request(proto.request());
  expect(reading, static_cast<std::size_t>(proto.job_size()) <= kMaxJobsListed, "job", "lists too many jobs");
  if (reading.fault) return;
  for (const v1::Job& job : proto.job()) value.jobs.push_back(read_job(reading, job));
  expect(reading, proto.next() <= kMostPlace, "next", "is not a place in a list");
  value.next = proto.next();
}
void read(Reading& reading, const v1::Command& proto, Command& value) {
  value.request = request(proto.request());
  value.job = job_id(reading, proto.job());
  expect(reading, proto.action() >= 1 && proto.action() <= 10, "action", "is none of this version");
  value.command = static_cast<JobCommand>(proto.action());
  value.who = name(reading, proto.who(), "who");
  value.although = name(reading, proto.although(), "although");
}
void read(Reading& reading, const v1::AskFiles& proto, AskFiles& value) {
  value.request = request(proto.request());
  value.job = job_id(reading, proto.job());
}
void read(Reading& reading, const v1::Files& proto, Files& value) {
  value.request = request(proto.request());
  expect(reading, proto.file_size() <= 1000, "file", "lists too many files");
  if (reading.fault) return;
  for (const v1::FileEntry& row : proto.file())
    value.files.push_back({plain_name(reading, row.name(), "name"), row.size_bytes()});
}
void read(Reading& reading, const v1::AskFile& proto, AskFile& value) {
  value.request = request(proto.request());
  value.job = job_id(reading, proto.job());
  value.name = plain_name(reading, proto.name(), "name");
}
void read(Reading& reading, const v1::FileBlock& proto, FileBlock& value) {
  value.request = request(proto.request());
  value.content = content(reading, proto.content(), kMaxBlockBytes, "content");
  expect(reading,
         proto.size_bytes() <= kMaxScanBytes && proto.offset_bytes() <= proto.size_bytes() &&
             proto.content().size() <= proto.size_bytes() - proto.offset_bytes(),
         "content", "lies outside of the file");
  value.offset_bytes = proto.offset_bytes();
  value.size_bytes = proto.size_bytes();
}
void read(Reading& reading, const v1::Offer& proto, Offer& value) {
  value.job = job_id(reading, proto.job());
  value.name = plain_name(reading, proto.name(), "name");
  value.machine = name(reading, proto.machine(), "machine");
  value.parameters = text(reading, proto.parameters(), kMaxParametersBytes, "parameters");
  value.profile = digest(reading, proto.profile_sha256(), "profile_sha256");
  value.header = read_header(reading, proto.header());
  expect(reading, proto.coding() >= kFirstCoding && proto.coding() <= kLastCoding, "coding", "is none of this version");
  value.coding = proto.coding();
  value.owner = name(reading, proto.owner(), "owner");
  expect(reading, proto.public_key().empty() || proto.public_key().size() == 32, "public_key", "is not an Ed25519 key");
  expect(reading, proto.signature().empty() || proto.signature().size() == 64, "signature",
         "is not an Ed25519 signature");
  value.public_key = content(reading, proto.public_key(), 32, "public_key");
  value.signature = content(reading, proto.signature(), 64, "signature");
  if (!proto.scan_sha256().empty()) value.scan = digest(reading, proto.scan_sha256(), "scan_sha256");
  expect(reading, proto.registration_rms_mm() >= 0 && proto.registration_rms_mm() < 1e6, "registration_rms_mm",
         "is not a length");
  value.registration_rms_mm = proto.registration_rms_mm();
  value.attempt = proto.attempt();
  expect(reading, value.attempt == 0 || fleet_job_of(value.job, value.attempt).has_value(), "attempt",
         "is not that of the job's id");
}
void read(Reading& reading, const v1::OfferAccepted& proto, OfferAccepted& value) {
  value.job = job_id(reading, proto.job());
  expect(reading, proto.next_sequence() <= kMaxLayers, "next_sequence", "is above the limit of chunks");
  value.next_sequence = proto.next_sequence();
  value.complete = proto.complete();
}
void read(Reading& reading, const v1::OfferDeferred& proto, OfferDeferred& value) {
  value.job = job_id(reading, proto.job());
  expect(reading, proto.reason() >= 1 && proto.reason() <= 3, "reason", "is none of this version");
  value.reason = static_cast<DeferReason>(proto.reason());
  expect(reading, proto.retry_after_ms() <= kLongestDeferral.count(), "retry_after_ms", "is above the limit");
  value.retry_after = std::chrono::milliseconds{proto.retry_after_ms()};
  value.what = words(reading, proto.what(), "what");
}
void read(Reading& reading, const v1::SendChunk& proto, SendChunk& value) {
  value.job = job_id(reading, proto.job());
  expect(reading, proto.sequence() < kMaxLayers, "sequence", "is above the limit of chunks");
  expect(reading,
         proto.first_layer() < kMaxLayers && proto.layer_count() >= 1 &&
             proto.layer_count() <= kMaxLayers - proto.first_layer(),
         "first_layer, layer_count", "are no range of layers");
  value.sequence = proto.sequence();
  value.first_layer = LayerIndex{proto.first_layer()};
  value.layer_count = proto.layer_count();
  value.payload = content(reading, proto.payload(), kMaxChunkBytes, "payload");
  value.chain = digest(reading, proto.chain_sha256(), "chain_sha256");
}
void read(Reading& reading, const v1::ChunkStored& proto, ChunkStored& value) {
  value.job = job_id(reading, proto.job());
  expect(reading, proto.sequence() < kMaxLayers, "sequence", "is above the limit of chunks");
  value.sequence = proto.sequence();
}
void read(Reading& reading, const v1::StackEnd& proto, StackEnd& value) {
  value.job = job_id(reading, proto.job());
  expect(reading, proto.chunk_count() >= 1 && proto.chunk_count() <= kMaxLayers, "chunk_count", "is out of range");
  value.chunk_count = proto.chunk_count();
  value.chain = digest(reading, proto.chain_sha256(), "chain_sha256");
  value.stack = digest(reading, proto.stack_sha256(), "stack_sha256");
  expect(reading, proto.signature().empty() || proto.signature().size() == 64, "signature",
         "is not an Ed25519 signature");
  value.signature = content(reading, proto.signature(), 64, "signature");
}
void read(Reading& reading, const v1::StackStored& proto, StackStored& value) {
  value.job = job_id(reading, proto.job());
}
void read(Reading& reading, const v1::JobChanged& proto, JobChanged& value) {
  value.job = read_job(reading, proto.job());
}

}  // namespace telefab::wire
