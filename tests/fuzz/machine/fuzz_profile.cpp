// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/machine/machine_profile.hpp>

// The TOML of a machine, as it comes over the wire: an error that says where, or a profile that is written and read
// back without a change and gives masks a size.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const auto profile = machine_profile_from_toml({reinterpret_cast<const char*>(data), size}, "wire");
  if (!profile) {
    if (profile.error().what.empty()) std::abort();
    return 0;
  }
  const auto again = machine_profile_from_toml(to_toml(*profile), "again");
  if (!again || *again != *profile) std::abort();
  const PixelSize mask = profile->mask_size();
  if (mask.width_px == 0 || mask.height_px == 0) std::abort();
  for (const double share : tone_of(profile->projection))
    if (!std::isfinite(share)) std::abort();
  if (!std::isfinite(field_at(profile->projection, 0.5, 0.5))) std::abort();
  return 0;
}
