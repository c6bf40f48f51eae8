// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string>
#include <string_view>
#include <telefab/command_line/options.hpp>
#include <telefab/job/machine_status.hpp>
#include <telefab/machine/profile_catalogue.hpp>

namespace telefab {

/// What the verbs `machines`, `resins` and `prints` are asked for, at every program alike.
struct ProfileListing {
  bool names = false;  ///< names alone, one a line
  std::string show;    ///< one of them, value by value; empty: a line for each
  std::string resin;   ///< with --show of a machine
  std::string print;   ///< with --show of a machine
};

/// --names and --show; for machines --resin and --print too. `listing` must outlive the parsing.
void declare_profile_listing(VerbOptions& options, ProfileKind kind, ProfileListing& listing);

/// What such a verb prints. `origin`: whose profiles they are, for JSON. `standing`: what the machines of a fab are at,
/// shown beside those of their names. Fails with InvalidInput: a name that is not
/// known, --resin or --print without --show, and as ProfileCatalogue::compose does.
[[nodiscard]] Result<std::string> text_of(const ProfileListing& listing, ProfileKind kind,
                                          const ProfileCatalogue& catalogue, std::string_view origin, bool is_json,
                                          std::span<const MachineStatus> standing = {});

}  // namespace telefab
