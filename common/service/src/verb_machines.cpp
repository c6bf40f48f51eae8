// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <memory>
#include <telefab/machine/machine_profile.hpp>

#include <telefab/service/shared_verbs.hpp>

namespace telefab {

VerbBody declare_machines(CLI::App& options) {
  struct Options {
    std::string folder = default_machine_folder();
    bool keys = false;
  };
  auto o = std::make_shared<Options>();
  options.add_option("--machines", o->folder, "folder of machine profiles (*.toml)")->capture_default_str();
  options.add_flag("--keys", o->keys, "list every key a profile may have, with range and reason");
  return [o](std::stop_token) -> Result<ExitCode> {
    if (o->keys) {
      write_output(describe_keys());
      return ExitCode::Ok;
    }
    const auto machines = load_machine_profiles(o->folder);
    if (!machines) return tl::unexpected{machines.error()};
    for (const MachineProfile& m : *machines)
      fmt::print("{:<12} {} x {} px, layer {} mm: {}\n", m.name, m.mask_size().width_px, m.mask_size().height_px,
                 m.layers.thickness_mm, m.description);
    return ExitCode::Ok;
  };
}

}  // namespace telefab
