// SPDX-License-Identifier: GPL-3.0-or-later
#include <zip.h>
#include <telefab/base/file.hpp>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/test/block_stack.hpp>

#include "seeds.hpp"

namespace telefab {
namespace {

/// Four layers of 8 x 6 pixels with every kind of grey.
class SmallMasks final : public fab::MaskSource {
 public:
  explicit SmallMasks(PixelSize size) : size_{size} {}
  Result<fab::Mask> mask(LayerIndex layer) override {
    fab::Mask mask{size_, std::vector<std::uint8_t>(std::size_t{size_.width_px} * size_.height_px)};
    for (std::size_t i = 0; i < mask.rows.size(); ++i)
      mask.rows[i] = i < 8 ? 0 : i < 20 ? 255 : static_cast<std::uint8_t>(100 + (i + layer.count()) / 3 * 7);
    return mask;
  }

 private:
  PixelSize size_;
};

/// The entries of an archive as the fuzz target takes them.
std::string entries_of(const std::filesystem::path& path) {
  std::string text;
  int code = 0;
  zip_t* zip = zip_open(path.c_str(), ZIP_RDONLY, &code);
  for (zip_int64_t i = 0; zip != nullptr && i < zip_get_num_entries(zip, 0); ++i) {
    zip_stat_t stat;
    zip_stat_index(zip, static_cast<zip_uint64_t>(i), 0, &stat);
    const std::string name = stat.name;
    if (name.starts_with("thumbnail") || name == "3d.png" || name == "info.json" || name == "slicer.json") continue;
    std::string bytes(stat.size, '\0');
    zip_file_t* file = zip_fopen_index(zip, static_cast<zip_uint64_t>(i), 0);
    (void)zip_fread(file, bytes.data(), bytes.size());
    zip_fclose(file);
    text += (text.empty() ? "" : "\n====\n") + name + "\n" + bytes;
  }
  if (zip != nullptr) zip_discard(zip);
  return text;
}

}  // namespace

Result<void> write_seeds(const std::filesystem::path& corpus) {
  MachineProfile machine = test::small_machine();
  machine.platform = {0.81, 0.61, 10};
  machine.motion.peel_mm = 1, machine.motion.peel_speed_mm_per_s = 1;
  machine.motion.approach_mm = 1, machine.motion.approach_speed_mm_per_s = 1;
  SmallMasks masks{machine.mask_size()};
  fab::PrintPlan plan;
  plan.job = "seed";
  plan.machine = machine.name;
  plan.mask_size = machine.mask_size();
  plan.z_travel_mm = 10;
  for (std::uint32_t i = 0; i < 4; ++i)
    plan.layers.push_back({LayerIndex{i}, (i + 1) * 0.1, std::chrono::seconds{i == 0 ? 8 : 2}, Digest{},
                           fab::motion_of(machine.motion, i == 0, 0)});
  struct Seed {
    fab::MaskFormat format;
    const char* folder;
  };
  for (const Seed& seed : {Seed{fab::MaskFormat::Goo, "sliced_goo"},
                           {fab::MaskFormat::Sl1, "sliced_sl1"},
                           {fab::MaskFormat::NanoDlp, "sliced_nanodlp"}}) {
    const auto file = corpus / seed.folder / "seed";
    const auto whole = corpus / seed.folder / "whole";
    if (auto done = fab::export_masks(seed.format, plan, masks, machine, whole, {}, {}); !done)
      return tl::unexpected{done.error()};
    std::string text;
    if (seed.format == fab::MaskFormat::Goo) {
      const auto bytes = read_file(whole, 1U << 22U);
      if (!bytes) return tl::unexpected{bytes.error()};
      constexpr std::size_t kFields = 195'310;
      text = '\1' + std::string{reinterpret_cast<const char*>(bytes->data()) + kFields, bytes->size() - kFields};
    } else {
      text = entries_of(whole);
    }
    if (auto ok = write_file_atomically(file, text); !ok) return ok;
    std::filesystem::remove(whole);
  }
  return {};
}

}  // namespace telefab
