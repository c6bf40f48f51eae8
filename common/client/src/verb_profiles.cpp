// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/command_line/output.hpp>
#include <telefab/command_line/profile_listing.hpp>
#include <telefab/machine/profile_catalogue.hpp>

#include "common_options.hpp"
#include "verbs.hpp"

namespace telefab::client {
namespace {

VerbBody declare(VerbOptions& options, ProfileKind kind) {
  struct Options {
    CommonOptions common;
    ProfileListing listing;
  };
  auto o = std::make_shared<Options>();
  declare_common(options, o->common);
  declare_profile_listing(options, kind, o->listing);
  return [o, kind](std::stop_token stop) -> Result<ExitCode> {
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    const auto known = (*client)->ask<Machines>(AskMachines{(*client)->next_request()});
    if (!known) return tl::unexpected{known.error()};
    const auto catalogue =
        ProfileCatalogue::from_texts(known->machine_toml, known->resin_toml, known->print_toml, known->origin);
    if (!catalogue) return tl::unexpected{catalogue.error()};
    const auto text = text_of(o->listing, kind, *catalogue, known->origin, o->common.json, known->standing);
    if (!text) return tl::unexpected{text.error()};
    if (kind == ProfileKind::Machine && !o->listing.names && o->listing.show.empty() && !known->why_unknown.empty())
      write_note(fmt::format("what the machines are at is not known: {}\n", known->why_unknown));
    write_output(*text);
    return ExitCode::Ok;
  };
}

}  // namespace

VerbBody declare_machines(VerbOptions& options) { return declare(options, ProfileKind::Machine); }
VerbBody declare_resins(VerbOptions& options) { return declare(options, ProfileKind::Resin); }
VerbBody declare_prints(VerbOptions& options) { return declare(options, ProfileKind::Print); }

}  // namespace telefab::client
