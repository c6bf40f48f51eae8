// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab::fab {

/// How far one layer may reach beyond the material it is attached to, and hold itself. The larger the attached
/// region, the stiffer it is: reach = min(most, least * (1 + growth * sqrt(area))).
struct SelfSupportLaw {
  Millimetres least{0.15};             ///< > 0; of a small attached region
  double growth_per_mm = 0;            ///< >= 0; per square root of the attached area
  Millimetres most{1.5};               ///< >= least; no region reaches further
  Millimetres least_remainder{0.035};  ///< >= 0; remainders narrower than twice this are nothing a mask could show
  double speck_mm2 = 0.04;             ///< >= 0; contacts and islands smaller than this do not survive the mask
  Millimetres contact{0.12};        ///< >= 0; a contact holds where a disc of this radius fits: it lights a pixel twice
  Millimetres neck{0.06};           ///< >= 0; material narrower than twice this does not pass support on
  Millimetres arc_tolerance{0.01};  ///< > 0; of the offset's round joins

  [[nodiscard]] Millimetres reach(double attached_area_mm2) const;
  friend bool operator==(const SelfSupportLaw&, const SelfSupportLaw&) = default;
};

/// The law of a machine's profile; least remainders and specks follow its pixel.
[[nodiscard]] SelfSupportLaw self_support_law(const MachineProfile& machine);

/// What the paper's rule 4.1 makes of two consecutive layers.
struct LayerRegions {
  Region attached;              ///< below AND current
  Region self_supported;        ///< attached grown by the law, AND current
  Region to_support;            ///< current minus that, narrow remainders left out
  std::vector<Region> islands;  ///< parts of `to_support` that show in a mask joined to nothing held: an anchor each
};

/// Splits `current` by what lies below it. Each connected piece of the attached region reaches by its own area; a
/// contact too slight to show in both masks reaches nowhere, and what hangs on the rest by a neck too slight to show is
/// to be supported whole. Nothing below: everything is to be supported.
[[nodiscard]] LayerRegions analyse_layer(const Region& below, const Region& current, const SelfSupportLaw& law);

/// The layers as the rule sees them: islands below the speck size that nothing holds are taken out, so that what
/// grows from such a speck is an island itself. Same count as `layers`.
[[nodiscard]] std::vector<Region> without_specks(std::vector<Region> layers, double speck_mm2);
/// One layer of them; `below` is without specks already.
[[nodiscard]] Region without_specks(Region layer, const Region& below, double speck_mm2);

}  // namespace telefab::fab
