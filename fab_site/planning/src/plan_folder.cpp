// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/planning/print_view.hpp>
#include <telefab/geometry/contour_lines.hpp>

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxPlanBytes = 256U << 20U;
constexpr std::uint64_t kMaxMaskBytes = 256U << 20U;
constexpr std::uint64_t kMaxPartBytes = 4ULL << 30U;
constexpr const char* kPartFile = "part.tfc";
constexpr const char* kSupportsFile = "supports.jsonl";
constexpr const char* kViewFile = "view.png";

std::string mask_name(LayerIndex layer) { return fmt::format("{:05}.png", layer.count()); }

/// A folder beside the wanted one, removed unless it took its place.
class FolderUnderWay {
 public:
  explicit FolderUnderWay(fs::path wanted) : wanted_{std::move(wanted)}, path_{wanted_.string() + ".partial"} {}
  ~FolderUnderWay() {
    std::error_code ignored;  // what is left is named .partial and says so
    fs::remove_all(path_, ignored);
  }
  FolderUnderWay(const FolderUnderWay&) = delete;
  FolderUnderWay& operator=(const FolderUnderWay&) = delete;

  [[nodiscard]] const fs::path& path() const { return path_; }

  [[nodiscard]] Result<void> begin() const {
    std::error_code error;
    fs::remove_all(path_, error);
    if (!error) fs::create_directories(path_ / "masks", error);
    if (error) return fail_system("make the folder", path_, error.value());
    return {};
  }

  /// Takes the place of the wanted folder, which is empty, missing, or holds an older plan.
  [[nodiscard]] Result<void> arrive() const {
    if (auto synced = sync_file_system(path_); !synced) return synced;
    std::error_code error;
    const fs::path old = wanted_.string() + ".old";
    fs::remove_all(old, error);
    if (fs::exists(wanted_)) fs::rename(wanted_, old, error);
    if (!error) fs::rename(path_, wanted_, error);
    if (error) return fail_system("replace the folder", wanted_, error.value());
    fs::remove_all(old, error);
    if (error) return fail_system("remove the older plan", old, error.value());
    return {};
  }

 private:
  fs::path wanted_;
  fs::path path_;
};

Result<void> may_be_replaced(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return {};
  if (!fs::is_directory(folder, error))
    return fail(ErrorCode::Conflict, fmt::format("{} is a file; name a folder", folder.string()));
  if (fs::is_empty(folder, error) || fs::exists(folder / "plan.json", error)) return {};
  return fail(ErrorCode::Conflict,
              fmt::format("{} holds something else than a plan; name another folder", folder.string()));
}

/// PNG of the print as it stands; `supports`: by print layer.
Result<std::vector<std::byte>> view_of_print(const LayerStack& stack, std::uint32_t elevation_layers,
                                             std::span<const Layer> supports) {
  const auto viewer = [&](LayerIndex index, const std::function<void(const ViewedLayer&)>& look) -> Result<void> {
    const std::uint32_t i = index.count();
    const std::span<const Contour> part =
        i < elevation_layers ? std::span<const Contour>{} : stack.layers()[i - elevation_layers].contours;
    look({supports[i].z_mm, part, supports[i].contours});
    return {};
  };
  const auto image = draw_print(LayerIndex{static_cast<std::uint32_t>(supports.size())}, viewer);
  if (!image) return tl::unexpected{image.error()};
  return encode_png(*image);
}

/// A line a layer; of what is written the contours are given back.
std::string lines_of(std::vector<Layer>& layers) {
  std::string lines;
  for (Layer& layer : layers) {
    lines += to_json_line(layer) + '\n';
    layer.contours = {};
  }
  return lines;
}

}  // namespace

Result<PlanSummary> write_plan_folder(const fs::path& folder, const LayerStack& stack, const MachineProfile& machine,
                                      const PlanOptions& options, const Clock& clock, const ProgressSink& progress,
                                      std::stop_token stop, std::span<const std::byte> tfc) {
  if (auto ok = may_be_replaced(folder); !ok) return tl::unexpected{ok.error()};
  // "out/" and "out" are the same folder.
  const fs::path wanted = folder.has_filename() ? folder : folder.parent_path();
  const FolderUnderWay under_way{wanted};
  if (auto ok = under_way.begin(); !ok) return tl::unexpected{ok.error()};
  std::vector<Layer> supports;
  const auto keep = [&](const PlannedImage& layer_image) -> Result<void> {
    if (layer_image.index.count() == 0) supports.clear();  // planned again
    Layer& layer = supports.emplace_back();
    layer.index = layer_image.index;
    layer.z_mm = cut_height_mm(layer_image.index, stack.header().layer_thickness_mm);
    layer.contours.assign(layer_image.supports.begin(), layer_image.supports.end());
    return write_new_file(under_way.path() / "masks" / mask_name(layer_image.index), layer_image.png);
  };
  auto summary = plan_job(stack, machine, options, keep, clock, progress, stop);
  if (!summary) return summary;
  const auto preview = encode_png(summary->preview);
  if (!preview) return tl::unexpected{preview.error()};
  const auto view = view_of_print(stack, summary->elevation_layers, supports);
  if (!view) return tl::unexpected{view.error()};
  std::vector<std::byte> encoded;
  if (tfc.empty()) {
    auto bytes = write_tfc(stack, CodecOptions{.coding = Coding::Exact});
    if (!bytes) return fail_in("keeping the part's contours", bytes.error());
    tfc = encoded = std::move(*bytes);
  }
  const std::string support_lines = lines_of(supports);
  const auto as_bytes = [](const std::string& text) { return std::as_bytes(std::span{text}); };
  const std::string plan_text = to_json(summary->plan);
  const std::string report_text = to_json(*summary);
  const std::string preflight_text = to_json(preflight_of(stack, machine, *summary));
  const std::pair<const char*, std::span<const std::byte>> files[] = {
      {"plan.json", as_bytes(plan_text)},
      {"supports.json", as_bytes(summary->supports_json)},
      {kSupportsFile, as_bytes(support_lines)},
      {"report.json", as_bytes(report_text)},
      {"preflight.json", as_bytes(preflight_text)},
      {kPartFile, tfc},
      {"preview.png", *preview},
      {kViewFile, *view}};
  for (const auto& [name, bytes] : files)
    if (auto done = write_new_file(under_way.path() / name, bytes); !done) return tl::unexpected{done.error()};
  if (auto done = under_way.arrive(); !done) return tl::unexpected{done.error()};
  return summary;
}

Result<std::unique_ptr<PlannedJob>> PlannedJob::open(const fs::path& folder) {
  const auto text = read_file(folder / "plan.json", kMaxPlanBytes);
  if (!text && text.error().code == ErrorCode::NotFound)
    return fail(ErrorCode::NotFound,
                fmt::format("{} is not the folder of a plan: it holds no plan.json; make one with: telefab-fab plan "
                            "FILE.tfc --out DIR",
                            folder.string()));
  if (!text) return tl::unexpected{text.error()};
  auto plan = print_plan_from_json({reinterpret_cast<const char*>(text->data()), text->size()});
  if (!plan) return fail_in((folder / "plan.json").string(), plan.error());
  auto job = std::unique_ptr<PlannedJob>{new PlannedJob{folder, std::move(*plan)}};
  std::error_code error;
  for (const PlannedLayer& layer : job->plan_.layers)
    if (!fs::is_regular_file(job->mask_path(layer.index), error))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the plan has no mask {}; plan the job again", job->mask_path(layer.index).string()));
  return job;
}

fs::path PlannedJob::mask_path(LayerIndex layer) const { return folder_ / "masks" / mask_name(layer); }

Result<Mask> PlannedJob::mask(LayerIndex layer) {
  if (layer.count() >= plan_.layers.size())
    return fail(ErrorCode::NotFound,
                fmt::format("the plan has {} layers, no layer {}", plan_.layers.size(), layer.count()));
  const fs::path path = mask_path(layer);
  const auto bytes = read_file(path, kMaxMaskBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto image = decode_png(*bytes, std::uint64_t{plan_.mask_size.width_px} * plan_.mask_size.height_px);
  if (!image) return fail_in(path.string(), image.error());
  if (image->channels != 1 || image->width_px != plan_.mask_size.width_px ||
      image->height_px != plan_.mask_size.height_px)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} has {} x {} pixels, the machine {} x {}; plan the job again", path.string(),
                            image->width_px, image->height_px, plan_.mask_size.width_px, plan_.mask_size.height_px));
  Mask mask{plan_.mask_size, std::move(image->pixels)};
  if (digest_of(std::as_bytes(std::span{mask.rows})) != plan_.layers[layer.count()].mask)
    return fail(ErrorCode::NotTrusted,
                fmt::format("{} is not the mask that was planned (digest); plan the job again", path.string()));
  return mask;
}

Result<LayerStack> PlannedJob::part() const {
  const auto bytes = read_file(folder_ / kPartFile, kMaxPartBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto stack = read_tfc(*bytes);
  if (!stack) return fail_in((folder_ / kPartFile).string(), stack.error());
  return stack;
}

Result<std::vector<std::vector<Contour>>> PlannedJob::supports() const {
  const fs::path path = folder_ / kSupportsFile;
  const auto bytes = read_file(path, kMaxPartBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  std::vector<std::vector<Contour>> layers;
  const std::string_view text{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  const auto read = read_json_lines(text, [&](Layer layer) -> Result<void> {
    if (layer.index.count() != layers.size())
      return fail(ErrorCode::InvalidInput, fmt::format("layer {} stands here", layer.index.count()));
    layers.push_back(std::move(layer.contours));
    return {};
  });
  if (!read) return fail_in(path.string(), read.error());
  if (layers.size() != plan_.layers.size())
    return fail(ErrorCode::InvalidInput, fmt::format("{} has {} layers, the plan {}; plan the job again", path.string(),
                                                     layers.size(), plan_.layers.size()));
  return layers;
}

}  // namespace telefab::fab
