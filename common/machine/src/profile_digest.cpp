// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/machine/profile_digest.hpp>

namespace telefab {

Digest digest_of_light(const MachineProfile& profile) {
  MachineProfile relevant = profile;
  relevant.description.clear();
  relevant.assumed.clear();
  relevant.devices = {};
  relevant.file = {};
  relevant.devices.led_current = profile.devices.led_current;
  relevant.devices.led_colour = profile.devices.led_colour;
  relevant.devices.light = profile.devices.light;
  relevant.light = {};
  relevant.light.power = profile.light.power;
  relevant.screen = {};
  relevant.screen.rotation = profile.screen.rotation;
  relevant.screen.packing = profile.screen.packing;
  Hasher hasher;
  hasher.feed(to_toml(relevant));
  return hasher.digest();
}

}  // namespace telefab
