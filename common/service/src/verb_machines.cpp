// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/profile_listing.hpp>
#include <telefab/machine/profile_reference.hpp>
#include <telefab/service/shared_verbs.hpp>

namespace telefab {
namespace {

struct Options {
  std::string folder;
  ProfileListing listing;
  bool json = false;
  bool keys = false;
  bool markdown = false;
};

VerbBody declare(VerbOptions& options, ProfileKind kind) {
  auto o = std::make_shared<Options>();
  declare_machine_folder(options, o->folder);
  declare_profile_listing(options, kind, o->listing);
  options.flag("--json", o->json, "JSON on standard output");
  if (kind == ProfileKind::Machine) {
    options.flag("--keys", o->keys, "list every key a profile may have, with range and reason");
    options.flag("--markdown", o->markdown, "with --keys: as the page of the documents, with units and defaults");
  }
  return [o, kind](std::stop_token) -> Result<ExitCode> {
    if (o->markdown && !o->keys) return fail(ErrorCode::InvalidInput, "--markdown goes with --keys");
    if (o->keys) {
      write_output(o->markdown ? profile_reference() : describe_keys());
      return ExitCode::Ok;
    }
    const auto known = known_profiles(o->folder);
    if (!known) return tl::unexpected{known.error()};
    const auto text = text_of(o->listing, kind, known->catalogue, known->origin, o->json);
    if (!text) return tl::unexpected{text.error()};
    if (!o->json && !o->listing.names) write_note(fmt::format("profiles: {}\n", known->origin));
    write_output(*text);
    return ExitCode::Ok;
  };
}

}  // namespace

VerbBody declare_machines(VerbOptions& options) { return declare(options, ProfileKind::Machine); }
VerbBody declare_resins(VerbOptions& options) { return declare(options, ProfileKind::Resin); }
VerbBody declare_prints(VerbOptions& options) { return declare(options, ProfileKind::Print); }

}  // namespace telefab
