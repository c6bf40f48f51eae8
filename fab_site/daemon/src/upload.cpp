// SPDX-License-Identifier: GPL-3.0-or-later
#include "upload.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/fab/formats/foreign_print.hpp>

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
  std::string asked;  ///< as UploadTarget has it
  MachineProfile machine;
  LayerStack stack;
  bool has_masks = false;
};

Result<Given> given_by_tfc(std::span<const std::byte> bytes, const std::vector<UploadTarget>& targets) {
  auto stack = read_tfc(bytes);
  if (!stack) return tl::unexpected{stack.error()};
  std::vector<MachineProfile> machines;
  for (const UploadTarget& target : targets) machines.push_back(target.machine);
  if (auto known = find_machine(machines, stack->header().machine); !known) return tl::unexpected{known.error()};
  Result<void> fits;
  for (const UploadTarget& target : targets) {
    if (target.machine.name != stack->header().machine) continue;
    fits = check_fits(stack->header(), target.machine);
    if (fits) return Given{target.asked, target.machine, std::move(*stack), false};
  }
  return tl::unexpected{fits.error()};
}

/// The first machine that it fits; the reasons of the others where it fits none.
Result<Given> given_by_others(std::span<const std::byte> bytes, const std::vector<UploadTarget>& targets,
                              std::string_view name) {
  const auto kept = std::make_shared<const std::vector<std::byte>>(bytes.begin(), bytes.end());
  std::optional<Error> why;
  for (const auto& [asked, machine] : targets) {
    auto print = read_foreign_print(kept, machine, name, {}, {});
    if (print) return Given{asked, machine, std::move(print->stack), print->ready != nullptr};
    // What is wrong with the file itself is so for every machine.
    if (!why || print.error().what != why->what)
      why = why ? Error{why->code, why->what + "; " + print.error().what} : print.error();
  }
  if (!why) return fail(ErrorCode::Conflict, "this fab has no machine");
  return tl::unexpected{*why};
}

}  // namespace

Result<NewJob> write_upload(const DataFolder& data, const std::vector<UploadTarget>& targets, std::string_view name,
                            std::span<const std::byte> bytes, bool start, std::string_view who) {
  const auto given =
      is_tfc(bytes) || !is_foreign_print(bytes) ? given_by_tfc(bytes, targets) : given_by_others(bytes, targets, name);
  if (!given) return fail_in(std::string{name}, given.error());
  const auto id = fresh_id();
  if (!id) return tl::unexpected{id.error()};
  const auto folder = data.job(*id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::string kept_name{name.substr(0, kLongestName)};
  const std::string parameters = fmt::format(R"({{"upload_sha256":"{}"}})", to_hex(digest_of(bytes)));
  const Offer offer{*id,
                    kept_name,
                    given->asked,
                    parameters,
                    digest_of_profile(given->machine),
                    given->stack.header(),
                    static_cast<std::uint32_t>(Coding::Exact),
                    std::string{who},
                    {},
                    {}};
  Result<void> written;
  if (given->has_masks) written = write_file_atomically(*folder / kReadyFile, bytes);
  if (written) written = write_layers(*folder, offer, given->stack);
  if (written && !start) written = hold_for_approval(*folder);
  if (!written) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove_all(*folder, ignored);
    return tl::unexpected{written.error()};
  }
  return NewJob{*id, kept_name, given->asked, parameters, std::string{who}};
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
  offer.public_key.clear(), offer.signature.clear();
  Result<void> written;
  if (has_ready_print(*from)) {
    const auto masks = read_file(*from / kReadyFile, kMostBytes);
    written = masks ? write_file_atomically(*folder / kReadyFile, *masks) : tl::unexpected{masks.error()};
  }
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
