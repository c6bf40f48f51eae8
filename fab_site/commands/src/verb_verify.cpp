// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/planning/cured_runs.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/fab/print/provenance.hpp>
#include <telefab/fab/print/whole_print_record.hpp>
#include <telefab/fab/verify/print_files.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

struct VerifyOptions {
  std::string folder;
  MachineChoice machine;
  std::optional<std::string> stack, out, as_built, key;
  std::uint32_t least_pixels = kLeastIslandPixels;
  std::optional<std::uint32_t> grey;
  std::optional<std::string> masks;
  std::string override_by;
};

Result<MaskCheckOptions> check_options(const VerifyOptions& o) {
  MaskCheckOptions options{.least_pixels = o.least_pixels, .grey = {}, .masks = {}};
  if (o.grey) options.grey = static_cast<std::uint8_t>(*o.grey);
  if (o.masks) {
    const auto method = mask_method_from_name(*o.masks);
    if (!method) return tl::unexpected{method.error()};
    options.masks = *method;
  }
  return options;
}

/// The regions, from the layers it was planned of and supports.json.
Result<SupportReport> check_regions(const VerifyOptions& o, const MachineProfile& machine, const ProgressSink& progress,
                                    const std::stop_token& stop) {
  const auto stack = read_stack(*o.stack);
  if (!stack) return tl::unexpected{stack.error()};
  const auto path = std::filesystem::path{o.folder} / "supports.json";
  const auto bytes = read_file(path, 1U << 30U);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto supports = WrittenSupports::from_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  if (!supports) return fail_in(path.string(), supports.error());
  PrintGeometry print;
  print.part = stack->layers();
  print.elevation_layers = supports->elevation_layers();
  print.anchors = supports->anchors();
  const double thickness = stack->header().layer_thickness_mm;
  print.support = [&](LayerIndex k) { return supports->section(k, thickness); };
  return check_supports(print, machine, progress, stop);
}

void print_support_figures(std::string_view what, const SupportReport& report) {
  write_output(
      fmt::format("{}: {} layers, {}\n", what, report.layers, report.passes() ? "nothing floats" : "NOT SOUND"));
  for (int kind = 1; kind <= 6; ++kind)
    if (const auto k = static_cast<Finding::Kind>(kind); report.count(k) > 0)
      write_output(fmt::format("  {:<16} {}{}\n", name_of(k), report.count(k), holds_the_job(k) ? "" : " (warning)"));
  int shown = 0;
  for (const Finding& f : report.findings) {
    if (!holds_the_job(f.kind)) continue;
    if (++shown > 10) break;
    write_output(fmt::format("  {} in layer {} at ({:.3f}, {:.3f}) mm, {:.4f} mm2\n", name_of(f.kind), f.layer.count(),
                             f.place.x_mm, f.place.y_mm, f.size_mm2));
  }
}

/// What the record says it was made of against what lies in the plan folder. One line a finding.
std::vector<std::string> check_provenance(const std::map<std::string, std::string>& provenance,
                                          const std::filesystem::path& folder) {
  std::vector<std::string> findings;
  const auto expect = [&](const char* key, std::string_view what, const Digest& here) {
    const auto recorded = provenance.find(key);
    if (recorded != provenance.end() && recorded->second != to_hex(here))
      findings.push_back(fmt::format("{} of the plan folder are not those of the record: {}... instead of {}...", what,
                                     to_hex(here).substr(0, 12), recorded->second.substr(0, 12)));
  };
  constexpr std::uint64_t kLargestPlanFile = 1U << 30U;
  if (const auto part = read_file(folder / "part.tfc", kLargestPlanFile))
    expect(provenance::kPart, "the contours", digest_of(*part));
  if (const auto supports = read_file(folder / "supports.json", kLargestPlanFile))
    expect(provenance::kSupports, "the supports", digest_of(*supports));
  return findings;
}

struct AsBuilt {
  bool is_as_planned = false;
  bool is_signed = false;
};

/// What an as-built record says, against its plan.
struct ReadRecord {
  std::string made;  ///< for people
  std::vector<std::string> findings;
  std::map<std::string, std::string> provenance;
};

Result<ReadRecord> read_layers(std::string_view text, const PlannedJob& job) {
  const auto record = print_record_from_json(text);
  if (!record) return tl::unexpected{record.error()};
  return ReadRecord{fmt::format("{} layers in {} runs", record->layers.size(), record->runs),
                    compare(*record, job.plan()), record->provenance};
}

Result<ReadRecord> read_whole(std::string_view text, const PlannedJob& job) {
  const auto record = whole_print_record_from_json(text);
  if (!record) return tl::unexpected{record.error()};
  return ReadRecord{fmt::format("{}, light: by the printer ({}), so its layers are its own word",
                                record->end ? name_of(*record->end) : "not over", record->printer),
                    compare(*record, job.plan()), record->provenance};
}

/// The sealed record of the print against its plan.
Result<AsBuilt> check_as_built(const PlannedJob& job, const VerifyOptions& o) {
  constexpr std::uint64_t kLargestRecord = 1U << 28U;
  const auto text = read_file(*o.as_built, kLargestRecord);
  if (!text) return tl::unexpected{text.error()};
  std::string key;
  if (o.key) {
    const auto pem = read_file(*o.key, 64U * 1024U);
    if (!pem) return tl::unexpected{pem.error()};
    key.assign(reinterpret_cast<const char*>(pem->data()), pem->size());
  }
  const auto unsealed = unseal_json({reinterpret_cast<const char*>(text->data()), text->size()}, key);
  if (!unsealed) return tl::unexpected{unsealed.error()};
  const auto read =
      is_whole_print_record(unsealed->record) ? read_whole(unsealed->record, job) : read_layers(unsealed->record, job);
  if (!read) return tl::unexpected{read.error()};
  auto findings = read->findings;
  for (std::string& finding : check_provenance(read->provenance, o.folder)) findings.push_back(std::move(finding));
  write_output(fmt::format("as built: {}, {}\n", read->made, findings.empty() ? "made as planned" : "NOT AS PLANNED"));
  for (const auto& [name, value] : read->provenance)
    if (name != provenance::kParameters) write_output(fmt::format("  {:<16} {}\n", name, value));
  for (const std::string& finding : findings) write_output(fmt::format("  {}\n", finding));
  write_output(unsealed->signed_by.empty() ? std::string{"  NOT SIGNED: anybody could have written it\n"}
                                           : fmt::format("  {:<16} {}{}\n", "signed by", unsealed->signed_by,
                                                         key.empty() ? "; --key says whether that is the site's" : ""));
  return AsBuilt{findings.empty(), !unsealed->signed_by.empty()};
}

Result<ExitCode> verify(const VerifyOptions& o, std::stop_token stop) {
  auto job = PlannedJob::open(o.folder);
  if (!job) return tl::unexpected{job.error()};
  const auto machine = chosen_machine(o.machine, (*job)->plan().machine);
  if (!machine) return tl::unexpected{machine.error()};
  const ProgressSink progress = progress_line();
  const auto options = check_options(o);
  if (!options) return tl::unexpected{options.error()};
  const auto masks = check_masks((*job)->plan(), **job, *machine, *options, progress, stop);
  clear_progress();
  if (!masks) return tl::unexpected{masks.error()};
  print_support_figures("masks", *masks);
  bool passes = masks->passes();
  std::string text = "{\n\"masks\": " + to_json(*masks);
  if (o.stack) {
    const auto regions = check_regions(o, *machine, progress, stop);
    clear_progress();
    if (!regions) return tl::unexpected{regions.error()};
    print_support_figures("regions", *regions);
    passes &= regions->passes();
    text += ",\n\"regions\": " + to_json(*regions);
  }
  bool is_signed = true;
  if (o.as_built) {
    const auto sound = check_as_built(**job, o);
    if (!sound) return tl::unexpected{sound.error()};
    passes &= sound->is_as_planned;
    is_signed = sound->is_signed;
  }
  if (o.out)
    if (auto ok = write_file_atomically(*o.out, text + "}\n"); !ok) return tl::unexpected{ok.error()};
  if (passes) return is_signed ? ExitCode::Ok : ExitCode::NotSigned;
  if (!o.override_by.empty()) {
    write_output(fmt::format("held back, but let through by {}\n", o.override_by));
    return ExitCode::Ok;
  }
  return ExitCode::NotCertified;
}

}  // namespace

VerbBody declare_verify(VerbOptions& options) {
  auto o = std::make_shared<VerifyOptions>();
  options.add("FOLDER", o->folder, "a plan folder, as `telefab-fab plan` writes it").required();
  options.add("--stack", o->stack, "the .tfc file it was planned of: checks regions, anchors and pins as well");
  options.add("--as-built", o->as_built, "the sealed record of the print, report/as-built.json of the job");
  options.add("--key", o->key,
              "public key (PEM) the record must be signed with; without it any key is taken, and named; a record that "
              "nobody signed gives exit code 10");
  declare_machine_choice(options, o->machine, "profile to judge by; default: the plan's own", MachineIs::Optional);
  options.add("--least-pixels", o->least_pixels, "islands of fewer pixels are let pass")
      .shows_default()
      .within(1U, 1'000'000U);
  options
      .add("--grey", o->grey,
           "a pixel is solid from this grey level; where left out: from the light of all layers for masks made by "
           "blend-stack, from the cure level of one exposure for others")
      .within(1U, 255U);
  options
      .add("--masks", o->masks,
           "how the masks were made, for plans of older versions that do not say it: cover, blend or "
           "blend-stack")
      .one_of({"cover", "blend", "blend-stack"});
  options.add_output("--out", o->out, "write the findings as JSON here");
  options.add("--override", o->override_by, "name of the operator who lets the job pass all the same");
  return [o](std::stop_token stop) { return verify(*o, std::move(stop)); };
}

}  // namespace telefab::fab
