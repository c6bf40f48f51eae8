#include "predict_plan.hpp"

#include <sys/resource.h>

#include <telefab/base/file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/verify/print_files.hpp>
#include <telefab/image/png.hpp>

#include "read_stack.hpp"

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxTextBytes = 4ULL << 30U;
constexpr int kLowPriority = 15;

Result<std::uint32_t> lift_of(const fs::path& path) {
  const auto bytes = read_file(path, kMaxTextBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto supports = WrittenSupports::from_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  if (!supports) return fail_in(path.string(), supports.error());
  return supports->lift_layers();
}

/// Of the file, or those that the planner kept; nothing where it kept none.
Result<std::optional<LayerStack>> contours_of(const PlannedJob& job, const std::string& file) {
  auto stack = file.empty() ? job.part() : read_stack(file);
  if (stack) return std::optional<LayerStack>{std::move(*stack)};
  if (file.empty() && stack.error().code == ErrorCode::NotFound) return std::optional<LayerStack>{};
  return tl::unexpected{stack.error()};
}

}  // namespace

Result<PlanPrediction> predict_plan(const fs::path& folder, const MachineProfile& machine, const std::string& contours,
                                    const PredictOptions& options, const ProgressSink& progress, std::stop_token stop) {
  auto job = PlannedJob::open(folder);
  if (!job) return tl::unexpected{job.error()};
  const PrintPlan& plan = (*job)->plan();
  auto model = cure_model(machine);
  if (!model) return tl::unexpected{model.error()};
  model->mask = plan.mask_size;
  const auto stack = contours_of(**job, contours);
  if (!stack) return tl::unexpected{stack.error()};
  const auto supports = (*job)->supports();
  if (!supports) return tl::unexpected{supports.error()};
  const auto lift = lift_of(folder / "supports.json");
  if (!lift) return tl::unexpected{lift.error()};

  PrintToPredict print;
  print.layers = static_cast<std::uint32_t>(plan.layers.size());
  print.lift_layers = *lift;
  if (*stack) print.part = (*stack)->layers();
  print.supports = *supports;
  print.light = [&](LayerIndex index) -> Result<LitLayer> {
    LitLayer light;
    const auto exposure = plan.layers[index.count()].exposure;
    if (exposure.count() == 0) return light;
    auto mask = (*job)->mask(index);
    if (!mask) return tl::unexpected{mask.error()};
    light.masks.push_back(std::move(*mask));
    light.lit.push_back(exposure);
    return light;
  };
  auto prediction = predict_print(*model, print, options, progress, std::move(stop));
  if (!prediction) return tl::unexpected{prediction.error()};
  const double leaked = model->leaked_dose(plan.layers.back().exposure);
  return PlanPrediction{std::move(*prediction), std::move(*model), *lift, stack->has_value(), leaked};
}

Result<void> keep_prediction(const fs::path& folder, const MachineProfile& machine, std::stop_token stop) {
  ::setpriority(PRIO_PROCESS, 0, kLowPriority);  // 0: this thread alone, on Linux
  PredictOptions options;
  options.threads = 1;
  const auto made = predict_plan(folder / "plan", machine, {}, options, {}, std::move(stop));
  if (!made) return tl::unexpected{made.error()};
  const auto png = encode_png(made->prediction.picture);
  if (!png) return tl::unexpected{png.error()};
  std::error_code error;
  fs::create_directories(folder / "report", error);
  if (auto kept = write_file_atomically(folder / "report" / "accuracy.json", to_json(made->prediction, made->model));
      !kept)
    return kept;
  return write_file_atomically(folder / "report" / "accuracy.png", *png);
}

}  // namespace telefab::fab
