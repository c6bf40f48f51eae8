// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/machine/profile_catalogue.hpp>

namespace {

using namespace telefab;

void hold_whole(const MachineProfile& profile) {
  const auto again = machine_profile_from_toml(to_toml(profile), "again");
  if (!again || *again != profile) std::abort();
  const PixelSize mask = profile.mask_size();
  if (mask.width_px == 0 || mask.height_px == 0) std::abort();
  for (const double share : tone_of(profile.projection))
    if (!std::isfinite(share)) std::abort();
  if (!std::isfinite(field_at(profile.projection, 0.5, 0.5))) std::abort();
}

void hold_refused(const Error& error) {
  if (error.what.empty()) std::abort();
}

/// What comes as a machine composes to a whole profile, or is refused; its text says the same again.
void hold_part(ProfileKind kind, std::string_view text) {
  const auto part = profile_part_from_toml(kind, text, "wire");
  if (!part) return hold_refused(part.error());
  const std::string written = to_toml(*part);
  const auto again = profile_part_from_toml(kind, written, "wire");
  if (!again || to_toml(*again) != written) std::abort();
  if (kind != ProfileKind::Machine) return;
  const auto catalogue = ProfileCatalogue::from({*part}), same = ProfileCatalogue::from({*again});
  if (catalogue.has_value() != same.has_value()) std::abort();
  if (!catalogue) return hold_refused(catalogue.error());
  if (catalogue->machines() != same->machines()) std::abort();
  for (const MachineProfile& machine : catalogue->machines()) hold_whole(machine);
}

}  // namespace

// The TOML of a profile, as it comes over the wire: an error that says where, or a profile that is written and read
// back without a change and gives masks a size.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  if (const auto profile = machine_profile_from_toml(text, "wire"))
    hold_whole(*profile);
  else
    hold_refused(profile.error());
  for (const ProfileKind kind : kProfileKinds) hold_part(kind, text);
  return 0;
}
