// SPDX-License-Identifier: GPL-3.0-or-later
#include "upload.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <set>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/fab/formats/foreign_print.hpp>
#include <telefab/transfer/second_name.hpp>

#include "intake.hpp"
#include "job_supports.hpp"

namespace telefab::fab {
namespace {

constexpr const char* kApprovalMark = "wait-for-approval";
constexpr std::size_t kLongestName = 255;
/// A file of masks as it was uploaded, beside the layers that were made of it.
constexpr const char* kReadyFile = "masks-as-sent";
constexpr std::uint64_t kMostBytes = 4ULL << 30U;

/// "u" and twelve hexadecimal digits: no scan site's ids look like that.
Result<std::string> fresh_id() {
  return random_hex(6).map([](const std::string& digits) { return "u" + digits; });
}

Result<void> check_fits(const StackHeader& header, const MachineProfile& machine) {
  const auto differs = [](double a, double b) { return std::abs(a - b) > 1e-9 * std::abs(b); };
  if (differs(header.layer_thickness_mm, machine.layers.thickness_mm) ||
      differs(header.pixel_pitch_mm, machine.projection.pixel_pitch_mm))
    return fail(ErrorCode::InvalidInput,
                fmt::format("the file was cut for layers of {} mm and pixels of {} mm, {} has {} and {}: cut the scan "
                            "again with this fab's profile",
                            header.layer_thickness_mm, header.pixel_pitch_mm, machine.name, machine.layers.thickness_mm,
                            machine.projection.pixel_pitch_mm));
  return {};
}

/// The next chunk of a job that nobody sends.
Result<void> take_next(Intake& intake, const Chunk& c) {
  const Digest chain = chain_after(intake.spool().chain(), c.sequence, c.first_layer, c.layer_count, c.payload);
  return intake.take({intake.offer().job, c.sequence, c.first_layer, c.layer_count, c.payload, chain});
}

Result<void> end_with(Intake& intake, const Digest& layers) {
  return intake.finish({intake.offer().job, intake.spool().chunk_count(), intake.spool().chain(), layers, {}});
}

Result<void> write_chunks(const std::filesystem::path& folder, const Offer& offer, const ReceivedStack& received) {
  auto intake = Intake::open(folder, offer);
  if (!intake) return tl::unexpected{intake.error()};
  for (const Chunk& chunk : received.chunks)
    if (auto taken = take_next(*intake, chunk); !taken) return taken;
  return end_with(*intake, received.digest);
}

Result<void> write_layers(const std::filesystem::path& folder, const Offer& offer, const LayerStack& stack) {
  auto intake = Intake::open(folder, offer);
  if (!intake) return tl::unexpected{intake.error()};
  auto encoder = StackEncoder::start(stack.header(), {.coding = Coding::Exact});
  if (!encoder) return tl::unexpected{encoder.error()};
  const auto keep = [&](const Result<std::optional<Chunk>>& chunk) -> Result<void> {
    if (!chunk) return tl::unexpected{chunk.error()};
    return *chunk ? take_next(*intake, **chunk) : Result<void>{};
  };
  for (const Layer& layer : stack.layers())
    if (auto kept = keep(encoder->add(layer)); !kept) return kept;
  if (auto kept = keep(encoder->finish()); !kept) return kept;
  return end_with(*intake, encoder->stack_digest());
}

/// What is in a file, and for which of the machines.
struct Given {
  const UploadTarget* target = nullptr;
  std::optional<LayerStack> stack;  ///< none: masks, which are traced when they are planned
};

Result<Given> given_by_tfc(std::span<const std::byte> bytes, const std::vector<UploadTarget>& targets) {
  auto stack = read_tfc(bytes);
  if (!stack) return tl::unexpected{stack.error()};
  Result<void> fits = fail(ErrorCode::NotFound, "");
  std::vector<std::string> names;
  for (const UploadTarget& target : targets) {
    names.push_back(target.machine.name);
    if (target.machine.name != stack->header().machine) continue;
    fits = check_fits(stack->header(), target.machine);
    if (fits) return Given{&target, std::move(*stack)};
  }
  if (fits.error().code != ErrorCode::NotFound) return tl::unexpected{fits.error()};
  return fail(ErrorCode::InvalidInput, fmt::format("no machine named {} takes jobs here; there are: {}",
                                                   stack->header().machine, fmt::join(names, ", ")));
}

/// Why a file fits none of the machines, their reasons one after the other.
class Reasons {
 public:
  void add(const Error& why) {
    // What is wrong with the file itself is so for every machine.
    if (!why_)
      why_ = why;
    else if (why.what != why_->what)
      why_->what += "; " + why.what;
  }
  [[nodiscard]] tl::unexpected<Error> error() const {
    return tl::unexpected{why_.value_or(Error{ErrorCode::Conflict, "this fab has no machine"})};
  }

 private:
  std::optional<Error> why_;
};

/// Of several profiles that masks fit, the one whose printer the file names.
Result<Given> chosen_by_model(const std::vector<const UploadTarget*>& fitting, const std::string& model) {
  std::set<std::string> all, named;
  const UploadTarget* first_named = nullptr;
  for (const UploadTarget* target : fitting) {
    all.insert(target->machine.name);
    if (model.empty() || target->machine.file.model != model) continue;
    named.insert(target->machine.name);
    if (first_named == nullptr) first_named = target;
  }
  if (all.size() == 1) return Given{fitting.front(), {}};
  if (named.size() == 1) return Given{first_named, {}};
  return fail(
      ErrorCode::InvalidInput,
      fmt::format("it fits {}, and {}; send it into a folder named as the one that is meant, such as {}/FILE, or "
                  "state in their profiles which printer they are (file.model)",
                  fmt::join(all, " and "),
                  model.empty() ? "names no printer"
                                : fmt::format("the printer that it names, {}, is {}", model,
                                              named.empty() ? "none of them" : "several of them"),
                  *all.begin()));
}

/// Their head alone is read: tracing all pixels takes a planner's time.
Result<Given> given_by_masks(const FileBytes& bytes, const std::vector<UploadTarget>& targets) {
  Reasons reasons;
  std::vector<const UploadTarget*> fitting;
  for (const UploadTarget& target : targets) {
    const auto ready = ready_for(bytes, target.machine);
    if (ready)
      fitting.push_back(&target);
    else
      reasons.add(ready.error());
  }
  if (fitting.empty()) return reasons.error();
  const auto file = read_sliced_file(*bytes);
  if (!file) return tl::unexpected{file.error()};
  return chosen_by_model(fitting, (*file)->job().model);
}

/// The first machine that contours of another program fit.
Result<Given> given_by_contours(const FileBytes& bytes, const std::vector<UploadTarget>& targets,
                                std::string_view name) {
  Reasons reasons;
  for (const UploadTarget& target : targets) {
    auto print = read_foreign_print(bytes, target.machine, name, {}, {});
    if (print) return Given{&target, std::move(print->stack)};
    reasons.add(print.error());
  }
  return reasons.error();
}

Result<Given> given_by(std::span<const std::byte> bytes, const std::vector<UploadTarget>& targets,
                       std::string_view name) {
  if (is_tfc(bytes) || !is_foreign_print(bytes)) return given_by_tfc(bytes, targets);
  const auto kept = std::make_shared<const std::vector<std::byte>>(bytes.begin(), bytes.end());
  return sliced_format_of(bytes) ? given_by_masks(kept, targets) : given_by_contours(kept, targets, name);
}

Offer offer_of(const NewJob& job, const MachineProfile& machine, const StackHeader& header) {
  return {*job.id,
          job.name,
          job.machine,
          job.parameters,
          digest_of_profile(machine),
          header,
          static_cast<std::uint32_t>(Coding::Exact),
          job.owner,
          {},
          {}};
}

/// The masks of one job for another; nothing writes to them any more.
Result<void> share_masks(const std::filesystem::path& from, const std::filesystem::path& to) {
  const auto is_shared = give_second_name(from / kReadyFile, to / kReadyFile);
  if (!is_shared) return tl::unexpected{is_shared.error()};
  return *is_shared ? Result<void>{} : copy_whole(from / kReadyFile, to / kReadyFile, {});
}

}  // namespace

Result<NewJob> write_upload(const DataFolder& data, const std::vector<UploadTarget>& targets, std::string_view name,
                            std::span<const std::byte> bytes, bool start, std::string_view who) {
  const auto given = given_by(bytes, targets, name);
  if (!given) return fail_in(std::string{name}, given.error());
  const auto id = fresh_id();
  if (!id) return tl::unexpected{id.error()};
  const auto folder = data.job(*id);
  if (!folder) return tl::unexpected{folder.error()};
  const NewJob job{*id, std::string{name.substr(0, kLongestName)}, given->target->asked,
                   fmt::format(R"({{"upload_sha256":"{}"}})", to_hex(digest_of(bytes))), std::string{who}};
  Result<void> written =
      given->stack ? write_layers(*folder, offer_of(job, given->target->machine, given->stack->header()), *given->stack)
                   : write_file_atomically(*folder / kReadyFile, bytes);
  if (written && !start) written = hold_for_approval(*folder);
  if (!written) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove_all(*folder, ignored);
    return tl::unexpected{written.error()};
  }
  return job;
}

Result<void> trace_masks(const std::filesystem::path& folder, const Job& job, const MachineProfile& machine,
                         const std::stop_token& stop) {
  if (const auto traced = Intake::reopen(folder); traced && traced->is_complete()) return {};
  const auto ready = ready_print_in(folder, machine);
  if (!ready) return tl::unexpected{ready.error()};
  const auto stack = outlines_of(**ready, machine, job.name, {}, stop);
  if (!stack) return tl::unexpected{stack.error()};
  // What a start before this one left of them is not the end of these.
  std::error_code error;
  std::filesystem::remove_all(folder / "chunks", error);
  if (!error) std::filesystem::remove(folder / "offer", error);
  if (error)
    return fail(ErrorCode::StorageFailed, fmt::format("cannot clear {}: {}", folder.string(), error.message()));
  return write_layers(
      folder, offer_of({job.id, job.name, job.machine, job.parameters, job.owner}, machine, stack->header()), *stack);
}

Result<NewJob> write_again(const DataFolder& data, const Job& job, std::string_view who) {
  const auto from = data.job(job.id);
  if (!from) return tl::unexpected{from.error()};
  const auto before = Intake::reopen(*from);
  if (!before || !before->is_complete())
    return fail(ErrorCode::Conflict, fmt::format("not all layers of job {} are here; submit it again", job.id));
  const auto received = received_stack(*from);
  if (!received) return tl::unexpected{received.error()};
  const auto id = fresh_id();
  if (!id) return tl::unexpected{id.error()};
  const auto folder = data.job(*id);
  if (!folder) return tl::unexpected{folder.error()};
  Offer offer = before->offer();
  offer.job = *id;
  offer.owner = who;
  offer.attempt = 0;  // it is this fab's own
  offer.public_key.clear(), offer.signature.clear();
  Result<void> written;
  if (has_ready_print(*from)) written = share_masks(*from, *folder);
  if (const auto by_hand = hand_list_in(*from); written && !by_hand)
    written = tl::unexpected{by_hand.error()};
  else if (written && !by_hand->is_empty())
    written = want_hand_list(*folder, *by_hand);
  if (written) written = write_chunks(*folder, offer, *received);
  if (written) written = hold_for_approval(*folder);
  if (!written) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove_all(*folder, ignored);
    return tl::unexpected{written.error()};
  }
  return NewJob{*id, offer.name, offer.machine, offer.parameters, std::string{who}};
}

bool has_ready_print(const std::filesystem::path& folder) {
  std::error_code error;
  return std::filesystem::exists(folder / kReadyFile, error);
}

Result<std::shared_ptr<const ReadyPrint>> ready_print_in(const std::filesystem::path& folder,
                                                         const MachineProfile& machine) {
  auto bytes = read_file(folder / kReadyFile, kMostBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto print = ready_for(std::make_shared<const std::vector<std::byte>>(std::move(*bytes)), machine);
  if (!print) return fail_in((folder / kReadyFile).string(), print.error());
  return std::make_shared<const ReadyPrint>(std::move(*print));
}

Result<void> hold_for_approval(const std::filesystem::path& folder) {
  return write_file_atomically(folder / kApprovalMark, std::string_view{"\n"});
}

bool waits_for_approval(const std::filesystem::path& folder) {
  std::error_code error;
  return std::filesystem::exists(folder / kApprovalMark, error);
}

}  // namespace telefab::fab
