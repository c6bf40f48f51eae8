// SPDX-License-Identifier: GPL-3.0-or-later
#include "to_wire.hpp"

namespace telefab::wire {
namespace {

std::string cut(std::string_view text, std::size_t most) { return std::string{text.substr(0, most)}; }

std::string bytes_of(const Digest& digest) {
  return {reinterpret_cast<const char*>(digest.bytes.data()), digest.bytes.size()};
}
std::string bytes_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

void write_job(const Job& job, v1::Job& proto) {
  proto.set_id(job.id);
  proto.set_name(job.name);
  proto.set_machine(job.machine);
  proto.set_parameters(job.parameters);
  proto.set_owner(job.owner);
  proto.set_state(static_cast<std::uint32_t>(job.state));
  proto.set_message(cut(job.message, kMaxTextBytes));
  proto.set_layers(job.counters.layers);
  proto.set_layers_sliced(job.counters.layers_sliced);
  proto.set_layers_sent(job.counters.layers_sent);
  proto.set_print_layers(job.counters.print_layers);
  proto.set_layers_planned(job.counters.layers_planned);
  proto.set_layers_printed(job.counters.layers_printed);
  proto.set_scan_bytes(job.counters.scan_bytes);
  proto.set_wire_bytes(job.counters.wire_bytes);
  for (const StageSeconds& stage : job.stages) {
    auto& row = *proto.add_stages();
    row.set_stage(std::string{name_of(stage.stage)});
    row.set_seconds(stage.seconds);
  }
  proto.set_created_unix_ms(job.created_unix_ms);
  proto.set_changed_unix_ms(job.changed_unix_ms);
  proto.set_instance(job.instance);
}

void write_machine(const MachineStatus& machine, v1::MachineStatus& proto) {
  proto.set_name(machine.name);
  proto.set_profile(machine.profile);
  proto.set_state(static_cast<std::uint32_t>(machine.state));
  proto.set_resin(machine.resin);
  proto.set_job(machine.job);
  proto.set_job_name(machine.job_name);
  proto.set_layer(machine.layer);
  proto.set_layers(machine.layers);
  proto.set_seconds_left(machine.seconds_left);
  proto.set_waiting(machine.waiting);
  proto.set_message(cut(machine.message, kMaxTextBytes));
  proto.set_is_stated(machine.is_stated);
}

void write_header(const StackHeader& header, v1::StackHeader& proto) {
  proto.set_machine(header.machine);
  proto.set_layer_thickness_mm(header.layer_thickness_mm);
  proto.set_pixel_pitch_mm(header.pixel_pitch_mm);
  proto.set_layer_count(header.layer_count);
  proto.mutable_min()->set_x_mm(header.bounds.min.x_mm);
  proto.mutable_min()->set_y_mm(header.bounds.min.y_mm);
  proto.mutable_max()->set_x_mm(header.bounds.max.x_mm);
  proto.mutable_max()->set_y_mm(header.bounds.max.y_mm);
  for (const double entry : header.scan_to_build) proto.add_scan_to_build(entry);
  proto.set_scan_name(header.scan_name);
}

std::uint64_t number_of(RequestId request) { return static_cast<std::uint64_t>(request); }

}  // namespace

void write(const Hello& value, v1::Hello& proto) {
  proto.set_protocol_version(value.protocol_version);
  proto.set_side(static_cast<v1::Side>(value.side));
  proto.set_program(value.program);
  for (const std::string& toml : value.machine_toml) proto.add_machine_toml(toml);
  proto.set_start_policy(value.start_policy);
  for (const std::string& toml : value.resin_toml) proto.add_resin_toml(toml);
  for (const std::string& toml : value.print_toml) proto.add_print_toml(toml);
  proto.set_answers_machines(value.answers_machines);
}
void write(const Fault& value, v1::Fault& proto) {
  proto.set_request(number_of(value.request));
  proto.set_code(static_cast<std::uint32_t>(value.error.code));
  proto.set_what(cut(value.error.what, kMaxTextBytes));
  proto.set_job(value.job);
}
void write(const Ping&, v1::Ping&) {}
void write(const Pong&, v1::Pong&) {}
void write(const AskMachines& value, v1::AskMachines& proto) { proto.set_request(number_of(value.request)); }
void write(const Machines& value, v1::Machines& proto) {
  proto.set_request(number_of(value.request));
  for (const std::string& toml : value.machine_toml) proto.add_machine_toml(toml);
  proto.set_origin(value.origin);
  for (const std::string& toml : value.resin_toml) proto.add_resin_toml(toml);
  for (const std::string& toml : value.print_toml) proto.add_print_toml(toml);
  for (const MachineStatus& machine : value.standing) write_machine(machine, *proto.add_machine());
  proto.set_why_unknown(cut(value.why_unknown, kMaxTextBytes));
}
void write(const Submit& value, v1::Submit& proto) {
  proto.set_request(number_of(value.request));
  proto.set_name(value.name);
  proto.set_machine(value.machine);
  proto.set_parameters(value.parameters);
  proto.set_size_bytes(value.size_bytes);
  proto.set_sha256(bytes_of(value.content));
}
void write(const UploadReady& value, v1::UploadReady& proto) {
  proto.set_request(number_of(value.request));
  proto.set_offset_bytes(value.offset_bytes);
}
void write(const UploadBlock& value, v1::UploadBlock& proto) {
  proto.set_request(number_of(value.request));
  proto.set_offset_bytes(value.offset_bytes);
  proto.set_content(bytes_of(value.content));
}
void write(const AskJobs& value, v1::AskJobs& proto) {
  proto.set_request(number_of(value.request));
  proto.set_job(value.job);
  proto.set_most(value.most);
  proto.set_watch(value.watch);
  proto.set_words(value.words);
  for (const JobState state : value.states) proto.add_state(static_cast<std::uint32_t>(state));
  proto.set_before(value.before);
}
void write(const Jobs& value, v1::Jobs& proto) {
  proto.set_request(number_of(value.request));
  for (const Job& job : value.jobs) write_job(job, *proto.add_job());
  proto.set_next(value.next);
}
void write(const Command& value, v1::Command& proto) {
  proto.set_request(number_of(value.request));
  proto.set_job(value.job);
  proto.set_action(static_cast<v1::Action>(value.command));
  proto.set_who(value.who);
  proto.set_although(value.although);
}
void write(const AskFiles& value, v1::AskFiles& proto) {
  proto.set_request(number_of(value.request));
  proto.set_job(value.job);
}
void write(const Files& value, v1::Files& proto) {
  proto.set_request(number_of(value.request));
  for (const FileEntry& file : value.files) {
    auto& row = *proto.add_file();
    row.set_name(file.name);
    row.set_size_bytes(file.size_bytes);
  }
}
void write(const AskFile& value, v1::AskFile& proto) {
  proto.set_request(number_of(value.request));
  proto.set_job(value.job);
  proto.set_name(value.name);
}
void write(const FileBlock& value, v1::FileBlock& proto) {
  proto.set_request(number_of(value.request));
  proto.set_offset_bytes(value.offset_bytes);
  proto.set_size_bytes(value.size_bytes);
  proto.set_content(bytes_of(value.content));
}
void write(const Offer& value, v1::Offer& proto) {
  proto.set_job(value.job);
  proto.set_name(value.name);
  proto.set_machine(value.machine);
  proto.set_parameters(value.parameters);
  proto.set_profile_sha256(bytes_of(value.profile));
  write_header(value.header, *proto.mutable_header());
  proto.set_coding(value.coding);
  proto.set_owner(value.owner);
  proto.set_public_key(bytes_of(value.public_key));
  proto.set_signature(bytes_of(value.signature));
  if (value.scan != Digest{}) proto.set_scan_sha256(bytes_of(value.scan));
  proto.set_registration_rms_mm(value.registration_rms_mm);
  proto.set_attempt(value.attempt);
}
void write(const OfferAccepted& value, v1::OfferAccepted& proto) {
  proto.set_job(value.job);
  proto.set_next_sequence(value.next_sequence);
  proto.set_complete(value.complete);
}
void write(const OfferDeferred& value, v1::OfferDeferred& proto) {
  proto.set_job(value.job);
  proto.set_reason(static_cast<v1::DeferReason>(value.reason));
  proto.set_retry_after_ms(static_cast<std::uint32_t>(value.retry_after.count()));
  proto.set_what(cut(value.what, kMaxTextBytes));
}
void write(const SendChunk& value, v1::SendChunk& proto) {
  proto.set_job(value.job);
  proto.set_sequence(value.sequence);
  proto.set_first_layer(value.first_layer.count());
  proto.set_layer_count(value.layer_count);
  proto.set_payload(bytes_of(value.payload));
  proto.set_chain_sha256(bytes_of(value.chain));
}
void write(const ChunkStored& value, v1::ChunkStored& proto) {
  proto.set_job(value.job);
  proto.set_sequence(value.sequence);
}
void write(const StackEnd& value, v1::StackEnd& proto) {
  proto.set_job(value.job);
  proto.set_chunk_count(value.chunk_count);
  proto.set_chain_sha256(bytes_of(value.chain));
  proto.set_stack_sha256(bytes_of(value.stack));
  proto.set_signature(bytes_of(value.signature));
}
void write(const StackStored& value, v1::StackStored& proto) { proto.set_job(value.job); }
void write(const JobChanged& value, v1::JobChanged& proto) { write_job(value.job, *proto.mutable_job()); }

}  // namespace telefab::wire
