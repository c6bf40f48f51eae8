// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/machine/profile_part.hpp>
#include <vector>

namespace telefab {

/// What a job is printed with. Empty resin: what the machine has loaded, or states itself; empty print: its default
/// way to print, or as it states.
struct ProfileChoice {
  std::string machine;
  std::string resin = {};
  std::string print = {};
  friend bool operator==(const ProfileChoice&, const ProfileChoice&) = default;
};

/// Where a value of a composed profile comes from.
enum class ValueOrigin : std::uint8_t {
  Stated,     ///< by the file of the machine, resin or print that was chosen
  Inherited,  ///< by one that it inherits from
  Derived,    ///< an exposure: from Ec, Dp, irradiance and thickness
  Default,    ///< nobody states it; what the program assumes
};
/// "stated", "inherited", "derived", "default".
[[nodiscard]] std::string_view name_of(ValueOrigin origin);

struct ComposedValue {
  std::string key;    ///< "resin.penetration_mm"
  std::string value;  ///< as TOML writes it
  ValueOrigin origin = ValueOrigin::Default;
  std::string file;         ///< that states it; empty: none does
  bool is_assumed = false;  ///< stated, but neither published nor measured; or derived from such
};

struct ComposedProfile {
  MachineProfile profile;
  std::string resin;                  ///< name of the resin's file; empty: the machine states its own
  std::string print;                  ///< of the print's file; empty: as the machine states
  std::vector<ComposedValue> values;  ///< every key, in the order of the table
  std::optional<ResinPrice> price;    ///< of the resin; none: no file states one
};

/// Machines, resins and ways to print, and what is composed of them. A value of the machine is overridden by one of the
/// resin, that by one of the print. Another resin than the machine's own takes with it all of [resin] but the size of
/// the vat. An exposure is taken, in this order, from the print, if it is for this machine and resin; from what the
/// resin's file publishes for this machine and thickness; from the machine, for the resin and thickness that it states
/// itself; else derived: two layers are cured deep, E = Ec exp(2 t / Dp), exposure = E / irradiance, bottom =
/// bottom_factor times that, to a millisecond. Invariant: names are unique by kind, every parent exists and no chain of
/// them is a ring, and every machine composes with what it has loaded.
class ProfileCatalogue {
 public:
  /// `parents`: files that may be inherited from where `parts` has none of that name; those that are come along as
  /// bases. Fails with InvalidInput, by file and line: an unknown parent, a ring, two of one name, a resin loaded that
  /// is not known, a machine that is not whole or does not fit together.
  [[nodiscard]] static Result<ProfileCatalogue> from(std::vector<ProfilePart> parts,
                                                     const std::vector<ProfilePart>& parents = {});

  /// What texts() of another one gave. `origin`: who sent them, for messages. A built-in file that this release has not
  /// is left out. Fails as profile_part_from_toml and from.
  [[nodiscard]] static Result<ProfileCatalogue> from_texts(std::span<const std::string> machines,
                                                           std::span<const std::string> resins,
                                                           std::span<const std::string> prints,
                                                           std::string_view origin);
  /// Every file of a kind, bases too, as TOML: from them the same is composed elsewhere. Of those that are as they are
  /// built in only the name, so that a line that is cut often need not carry the catalogue each time.
  [[nodiscard]] std::vector<std::string> texts(ProfileKind kind) const;

  /// Of all kinds, bases too.
  [[nodiscard]] std::span<const ProfilePart> parts() const { return parts_; }
  /// What is offered of one kind, in the order they were given.
  [[nodiscard]] std::vector<const ProfilePart*> offered(ProfileKind kind) const;
  /// Every machine as it prints without choice of resin and print; one machine of a profile under that one's name.
  [[nodiscard]] const std::vector<MachineProfile>& machines() const { return machines_; }

  /// Fails with InvalidInput: a name that is not known lists those there are; what does not fit together; an exposure
  /// that cannot be derived within its range. Conflict: the machine has another resin loaded.
  [[nodiscard]] Result<ComposedProfile> compose(const ProfileChoice& choice) const;

  /// The resin's own values under the program's defaults, its parents' included. Fails as compose.
  [[nodiscard]] Result<ComposedProfile> resin(std::string_view name) const;
  /// Those of a way to print, in the same way. Fails as compose.
  [[nodiscard]] Result<ComposedProfile> print(std::string_view name) const;

 private:
  explicit ProfileCatalogue(std::vector<ProfilePart> parts) : parts_{std::move(parts)} {}
  [[nodiscard]] const ProfilePart* find(ProfileKind kind, std::string_view name) const;
  [[nodiscard]] Result<const ProfilePart*> choose(ProfileKind kind, std::string_view name) const;
  /// The part and what it inherits from, the eldest first.
  [[nodiscard]] std::vector<const ProfilePart*> chain_of(const ProfilePart& part) const;

  friend class Composition;
  std::vector<ProfilePart> parts_;
  std::vector<MachineProfile> machines_;
};

/// The machines of a folder, with the resins and prints of the folders of those names beside it. What of built-in
/// resins and prints has no file of its name there is offered too; built-in files of each kind may be inherited from.
/// Fails as load_profile_parts and ProfileCatalogue::from do, and with NotFound where there is no machine.
[[nodiscard]] Result<ProfileCatalogue> load_profiles(const std::filesystem::path& machine_folder);
/// All that are built in.
[[nodiscard]] Result<ProfileCatalogue> builtin_profiles();

}  // namespace telefab
