// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/command_line/output.hpp>
#include <telefab/service/shared_verbs.hpp>
#include <telefab/store/audit_log.hpp>

namespace telefab {

VerbBody declare_audit(VerbOptions& options) {
  auto data = std::make_shared<std::string>();
  options.add("--data", *data, "the daemon's folder").required();
  options.footer(
      "Every line holds the digest of the one before, so the head that is printed stands for the whole log.\n");
  return [data](const std::stop_token&) -> Result<ExitCode> {
    const auto path = std::filesystem::path{*data} / "audit.log";
    const auto head = check_audit_log(path);
    if (!head) return tl::unexpected{head.error()};
    write_output(fmt::format("{} entries in {} parts, each following the one before; head {}\n", head->entries,
                             audit_parts(path).size(), to_hex(head->line)));
    return ExitCode::Ok;
  };
}

}  // namespace telefab
