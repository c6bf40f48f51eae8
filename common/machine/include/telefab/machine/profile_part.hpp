// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

// The three kinds of files that a MachineProfile is composed of (profile_catalogue.hpp), each as it stands alone.
namespace telefab {

/// What a file is about: a printer, a resin, or a way to print.
enum class ProfileKind : std::uint8_t { Machine, Resin, Print };
inline constexpr std::array kProfileKinds{ProfileKind::Machine, ProfileKind::Resin, ProfileKind::Print};
/// "machine", "resin", "print".
[[nodiscard]] std::string_view name_of(ProfileKind kind);
/// "machines", "resins", "prints": what their folders are called.
[[nodiscard]] std::string_view folder_name_of(ProfileKind kind);

/// How long a layer of a resin is exposed on one printer, as somebody has published it.
struct PublishedExposure {
  std::string machine;  ///< a printer, or one that others inherit from
  double thickness_mm = 0;
  double exposure_s = 0;
  double bottom_exposure_s = 0;  ///< 0: not published
  friend bool operator==(const PublishedExposure&, const PublishedExposure&) = default;
};

/// What a litre of a resin costs. It changes nothing of a print, so it is part of no digest.
struct ResinPrice {
  double per_litre = 0;  ///< (0, 1e6]; in the currency
  std::string currency;  ///< three capital letters (ISO 4217): "EUR"
  /// What so much of it costs, in the currency.
  [[nodiscard]] double of_ml(double resin_ml) const { return per_litre * resin_ml / 1000; }
  friend bool operator==(const ResinPrice&, const ResinPrice&) = default;
};

/// One file. What it does not say, the file that it inherits from may.
struct ProfilePart {
  ProfileKind kind = ProfileKind::Machine;
  std::string name;         ///< [a-z0-9-]+
  std::string description;  ///< one line for people
  std::string source;       ///< where its figures were published; empty: nowhere
  std::string inherits;     ///< a file of its kind; empty: none
  bool is_base = false;     ///< there to be inherited from, and not offered itself
  /// One machine of a fab, of the profile that it inherits from: it prints under that profile's name, so that whatever
  /// is made for it is made for any machine of the profile.
  bool is_instance = false;
  bool is_reference = false;  ///< between sites: stands for the built-in file of its name, and says no more
  std::string loaded_resin;   ///< of a machine: what is in its vat, and no other is taken; empty: not stated
  std::string default_print;  ///< of a machine: the way to print of a job that names none; empty: as the machine states
  std::string for_machine;  ///< of a print: its exposures are for that machine or what inherits from it; empty: for all
  std::string for_resin;    ///< of a print: its exposures are for that resin or what inherits from it; empty: for all
  std::vector<PublishedExposure> exposures;  ///< of a resin
  std::optional<ResinPrice> price;           ///< of a resin; none: not stated
  std::vector<std::string> assumed;          ///< keys stated here whose values nobody has published or measured

  MachineProfile values;                ///< of its fields only those that are in `lines`
  std::map<std::string, int> lines;     ///< "resin.penetration_mm" to the line that states it
  std::map<std::string, int> headings;  ///< "inherits", ... to its line
  std::string origin;                   ///< for messages: "resin profile /etc/telefab/resins/x.toml"
  std::string file;                     ///< for people: the file, or "built-in x.toml"

  [[nodiscard]] bool states(const std::string& key) const { return lines.contains(key); }
};

/// Reads one file of that kind. A machine may state every key, a resin those of [resin], a print those of [layers],
/// [supports] and [motion]; none is required. Fails with InvalidInput: kind, `file`, line, key, what is wrong and the
/// legal range.
[[nodiscard]] Result<ProfilePart> profile_part_from_toml(ProfileKind kind, std::string_view text,
                                                         std::string_view file);

/// What the file says, without its comments: from_toml(to_toml(p)) says the same.
[[nodiscard]] std::string to_toml(const ProfilePart& part);

/// Every *.toml of a folder, sorted by file name. Fails on the first bad file and where the folder cannot be listed.
[[nodiscard]] Result<std::vector<ProfilePart>> load_profile_parts(ProfileKind kind,
                                                                  const std::filesystem::path& folder);
/// Those of deploy/config, as they were when the program was built, sorted by file name.
[[nodiscard]] Result<std::vector<ProfilePart>> builtin_profile_parts(ProfileKind kind);

/// Whether load_profile_parts has something to read there, or to complain of: a folder that can be reached, but not be
/// looked into.
[[nodiscard]] bool holds_profiles(const std::filesystem::path& folder);

}  // namespace telefab
