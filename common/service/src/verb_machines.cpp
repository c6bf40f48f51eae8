// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <memory>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>

#include <telefab/service/shared_verbs.hpp>

namespace telefab {

VerbBody declare_machines(VerbOptions& options) {
  struct Options {
    std::string folder;
    bool keys = false;
  };
  auto o = std::make_shared<Options>();
  declare_machine_folder(options, o->folder);
  options.flag("--keys", o->keys, "list every key a profile may have, with range and reason");
  return [o](std::stop_token) -> Result<ExitCode> {
    if (o->keys) {
      write_output(describe_keys());
      return ExitCode::Ok;
    }
    const auto known = machine_profiles(o->folder);
    if (!known) return tl::unexpected{known.error()};
    write_note(fmt::format("profiles: {}\n", known->origin));
    for (const MachineProfile& m : known->machines)
      write_output(fmt::format("{:<12} {} x {} px, layer {} mm: {}\n", m.name, m.mask_size().width_px,
                               m.mask_size().height_px, m.layers.thickness_mm, m.description));
    return ExitCode::Ok;
  };
}

}  // namespace telefab
