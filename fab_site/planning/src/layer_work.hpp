// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/cure/feature_watch.hpp>
#include <telefab/fab/verify/support_check.hpp>
#include <telefab/image/png.hpp>

#include "contact_sheet.hpp"
#include "kept_pass.hpp"

namespace telefab::fab {

/// The time of a print layer's light.
[[nodiscard]] std::chrono::microseconds exposure_of(const MachineProfile& machine, std::uint32_t print_layer);

/// One layer on its way: made, then decided upon, then encoded once. Written by index, read in order.
struct LayerWork {
  Result<void> outcome;
  std::uint32_t index = 0;
  std::shared_ptr<const KeptLayer> made;  ///< as the mask maker gave it; for the next pass
  PackedMask mask;                        ///< empty once it is encoded
  std::vector<Contour> supports;
  LayerRuns runs;  ///< what is solid in the finished print
  LayerRuns firm;  ///< of that, what counts for strength
  LayerLight light;
  std::uint64_t solid_pixels = 0;
  std::vector<std::byte> png;
  Digest digest;
  std::uint64_t grey_sum = 0;
  std::vector<float> at_features;  ///< FeatureWatch::light_of
  Image tile;                      ///< of the contact sheet; empty: the layer is none of its
};

/// A layer as it comes from the mask maker; its own exposure begins to cure from `lit_from` on. Threads: from several
/// at once, like the next two and encode().
[[nodiscard]] LayerWork made_layer(MaskMaker::Made made, const std::function<void(Mask&)>& cured,
                                   std::uint8_t lit_from);
/// The same of a layer that an earlier pass made.
[[nodiscard]] LayerWork kept_layer(std::shared_ptr<const KeptLayer> kept, std::uint32_t index,
                                   std::vector<Contour> section, std::uint8_t lit_from);
/// Takes the light from specks; how many there were. What later layers cure of them hangs on these.
std::uint64_t darken_specks(LayerWork& work, const LayerRuns& specks, std::uint8_t lit_from);
/// The mask as a picture, and all that is known of it alone. Fails as the encoder does.
[[nodiscard]] Result<void> encode(LayerWork& work, std::chrono::microseconds exposure, const FeatureWatch& features,
                                  const ContactSheet& sheet);

}  // namespace telefab::fab
