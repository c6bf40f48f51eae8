// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/base/file.hpp>
#include <telefab/scan/slicing/slice_part.hpp>

#include "../seeds.hpp"
#include "sliced.hpp"

// Writes the seeds of fuzz_part: `part_seeds tests/fuzz/corpus`, once after every change of the form. A torus with a
// hole: measured, completed and doubtful contours; without the digest, which the target adds.
namespace telefab {

Result<void> write_seeds(const std::filesystem::path& corpus) {
  auto torn = test::sample_surface(*test::torus(9, 4, 90, 1), {.spacing_mm = 1, .holes = {{{0, 9, 0}, 5}}, .seed = 12});
  const std::string text = scan::text_of(torn);
  const auto scan = std::as_bytes(std::span{text});
  scan::JobParameters parameters{scan::request_for(), {}};
  parameters.slice.layer_mm = 1;
  parameters.slice.chord_mm = 0.2;
  for (std::uint32_t i : {1U, 5U}) {
    parameters.slice.share = scan::LayerShare{i, 9};
    const auto part = scan::cut_part(scan, "torus.xyz", parameters, {},
                                     [](const StackHeader&, Layer&&) -> Result<void> { return {}; }, {}, {});
    if (!part) return tl::unexpected{part.error()};
    const auto unsealed = std::span{part->bytes}.first(part->bytes.size() - Digest{}.bytes.size());
    if (auto ok = write_file_atomically(corpus / "part" / fmt::format("{}-of-9.bin", i), unsealed); !ok) return ok;
  }
  return {};
}

}  // namespace telefab
