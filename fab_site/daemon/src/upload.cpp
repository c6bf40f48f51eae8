// SPDX-License-Identifier: GPL-3.0-or-later
#include "upload.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/codec/tfc_file.hpp>

#include "intake.hpp"

namespace telefab::fab {
namespace {

constexpr const char* kApprovalMark = "wait-for-approval";
constexpr std::size_t kLongestName = 255;

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

Result<void> write_layers(const std::filesystem::path& folder, const Offer& offer, const LayerStack& stack) {
  auto intake = Intake::open(folder, offer);
  if (!intake) return tl::unexpected{intake.error()};
  auto encoder = StackEncoder::start(stack.header(), {.coding = Coding::Exact});
  if (!encoder) return tl::unexpected{encoder.error()};
  const auto keep = [&](const Result<std::optional<Chunk>>& chunk) -> Result<void> {
    if (!chunk) return tl::unexpected{chunk.error()};
    if (!*chunk) return {};
    const Chunk& c = **chunk;
    const Digest chain = chain_after(intake->spool().chain(), c.sequence, c.first_layer, c.layer_count, c.payload);
    return intake->take({offer.job, c.sequence, c.first_layer, c.layer_count, c.payload, chain});
  };
  for (const Layer& layer : stack.layers())
    if (auto kept = keep(encoder->add(layer)); !kept) return kept;
  if (auto kept = keep(encoder->finish()); !kept) return kept;
  return intake->finish(
      {offer.job, intake->spool().chunk_count(), intake->spool().chain(), encoder->stack_digest(), {}});
}

}  // namespace

Result<NewJob> write_upload(const DataFolder& data, const std::vector<MachineProfile>& machines, std::string_view name,
                            std::span<const std::byte> tfc, bool start, std::string_view who) {
  const auto stack = read_tfc(tfc);
  if (!stack) return fail_in(std::string{name}, stack.error());
  const auto machine = find_machine(machines, stack->header().machine);
  if (!machine) return tl::unexpected{machine.error()};
  if (auto fits = check_fits(stack->header(), *machine); !fits) return tl::unexpected{fits.error()};
  const auto id = fresh_id();
  if (!id) return tl::unexpected{id.error()};
  const auto folder = data.job(*id);
  if (!folder) return tl::unexpected{folder.error()};
  const std::string kept_name{name.substr(0, kLongestName)};
  const std::string parameters = fmt::format(R"({{"upload_sha256":"{}"}})", to_hex(digest_of(tfc)));
  const Offer offer{*id,
                    kept_name,
                    machine->name,
                    parameters,
                    digest_of_profile(*machine),
                    stack->header(),
                    static_cast<std::uint32_t>(Coding::Exact),
                    std::string{who},
                    {},
                    {}};
  auto written = write_layers(*folder, offer, *stack);
  if (written && !start) written = hold_for_approval(*folder);
  if (!written) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove_all(*folder, ignored);
    return tl::unexpected{written.error()};
  }
  return NewJob{*id, kept_name, machine->name, parameters, std::string{who}};
}

Result<void> hold_for_approval(const std::filesystem::path& folder) {
  return write_file_atomically(folder / kApprovalMark, std::string_view{"\n"});
}

bool waits_for_approval(const std::filesystem::path& folder) {
  std::error_code error;
  return std::filesystem::exists(folder / kApprovalMark, error);
}

}  // namespace telefab::fab
