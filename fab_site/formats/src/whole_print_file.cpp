// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/base/file_md5.hpp>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/formats/whole_print_file.hpp>

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

Result<std::vector<std::byte>> part_of(const fs::path& path, std::uint64_t offset, std::size_t count) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(path.c_str(), "rbe"), &std::fclose};
  std::vector<std::byte> part(count);
  if (!file || ::fseeko(file.get(), static_cast<off_t>(offset), SEEK_SET) != 0) return fail_system("read", path, errno);
  errno = 0;
  if (std::fread(part.data(), 1, count, file.get()) != count)
    return std::ferror(file.get()) != 0
               ? fail_system("read", path, errno)
               : fail(ErrorCode::StorageFailed, fmt::format("{} became shorter while it was sent", path.string()));
  return part;
}

}  // namespace

std::string name_on_printer(const PrintPlan& plan) {
  std::string name;
  for (const char c : plan.job) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_';
    if (name.size() < 40) name += plain ? c : '_';
  }
  return fmt::format("{}-{}.goo", name.empty() ? "job" : name, to_hex(plan_digest(plan)).substr(0, 8));
}

Result<void> check_whole_print(const PrintPlan& plan, const MachineProfile& machine) {
  if (machine.file.kind != PrinterFile::Goo || machine.file.model.empty())
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the profile {} does not say what its printer takes; state [file] kind = \"goo\" and model = "
                    "\"...\" as the printer calls itself (telefab-fab printers shows it)",
                    machine.name));
  const auto survey = survey_export(MaskFormat::Goo, plan, machine, "print.goo");
  if (!survey) return tl::unexpected{survey.error()};
  return {};
}

Result<WholePrintFile> whole_print_file(const PrintPlan& plan, MaskSource& masks, const MachineProfile& machine,
                                        const fs::path& path, FileThere there, const ProgressSink& progress,
                                        std::stop_token stop) {
  if (auto ok = plan.fits(machine); !ok) return tl::unexpected{ok.error()};
  if (auto ok = check_whole_print(plan, machine); !ok) return tl::unexpected{ok.error()};
  WholePrintFile made;
  std::error_code error;
  if (there == FileThere::IsMadeAgain || !fs::is_regular_file(path, error)) {
    const auto report = export_masks(MaskFormat::Goo, plan, masks, machine, path, progress, std::move(stop));
    if (!report) return tl::unexpected{report.error()};
    made.other_motions = report->other_motions;
  }
  const auto bytes = fs::file_size(path, error);
  if (error) return fail_system("look at", path, error.value());
  auto md5 = md5_of_file(path);
  if (!md5) return tl::unexpected{md5.error()};
  made.job.plan = plan_digest(plan);
  made.job.file = {name_on_printer(plan), bytes, std::move(*md5),
                   [path](std::uint64_t offset, std::size_t count) { return part_of(path, offset, count); }};
  made.job.file_kind = "GOO";
  made.job.model = machine.file.model;
  made.job.size = plan.mask_size;
  made.job.layers = static_cast<std::uint32_t>(plan.layers.size());
  return made;
}

}  // namespace telefab::fab
