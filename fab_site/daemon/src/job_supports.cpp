// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_supports.hpp"

#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/service/saved_message.hpp>

namespace telefab::fab {
namespace {

namespace fs = std::filesystem;
using nlohmann::ordered_json;

constexpr const char* kByHand = "supports-by-hand.json";
constexpr const char* kWanted = "supports-wanted.json";
constexpr std::uint64_t kMostBytes = 256U << 20U;

Result<std::string> text_of(const fs::path& path) {
  return read_file(path, kMostBytes).map([](const std::vector<std::byte>& bytes) {
    return std::string{reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  });
}

/// The plan's own list of anchors, with their heights.
Result<ordered_json> anchors_of(const ordered_json& plan, double thickness_mm) {
  ordered_json anchors = ordered_json::array();
  try {
    for (const ordered_json& a : plan.at("anchors")) {
      const auto layer = whole_number<std::uint32_t>(a.at("part_layer"));
      anchors.push_back({{"x_mm", a.at("x_mm").get<double>()},
                         {"y_mm", a.at("y_mm").get<double>()},
                         {"part_layer", layer},
                         {"z_mm", cut_height_mm(LayerIndex{layer}, thickness_mm)},
                         {"tip", a.value("tip", "light")},  // plans of before tip classes have none
                         {"on_part", a.at("on_part").get<bool>()},
                         {"by_hand", a.at("by_hand").get<bool>()}});
    }
  } catch (const ordered_json::exception&) {
    return fail(ErrorCode::InvalidInput, "the list of anchors is damaged; plan the job again");
  }
  return anchors;
}

}  // namespace

Result<HandList> hand_list_in(const fs::path& folder) {
  for (const char* name : {kWanted, kByHand}) {
    const auto text = text_of(folder / name);
    if (!text && text.error().code == ErrorCode::NotFound) continue;
    if (!text) return tl::unexpected{text.error()};
    auto list = hand_list_from_json(*text);
    if (!list) return fail_in((folder / name).string(), list.error());
    return list;
  }
  return HandList{};
}

Result<void> want_hand_list(const fs::path& folder, const HandList& list) {
  return write_file_atomically(folder / kWanted, to_json(list) + "\n");
}

bool wants_hand_list(const fs::path& folder) {
  std::error_code error;
  return fs::exists(folder / kWanted, error);
}

Result<void> keep_wanted_hand_list(const fs::path& folder) {
  if (!wants_hand_list(folder)) return {};
  return put_in_place(folder / kWanted, folder / kByHand);
}

Result<void> drop_wanted_hand_list(const fs::path& folder) {
  std::error_code error;
  fs::remove(folder / kWanted, error);
  if (error) return fail_system("remove", folder / kWanted, error.value());
  return sync_folder_of(folder / kWanted);
}

Result<std::string> supports_json(const fs::path& folder) {
  const auto text = text_of(folder / "plan" / "supports.json");
  if (!text) return fail(ErrorCode::NotFound, "there are no supports before the job is planned");
  const auto offer = saved_offer(folder);
  if (!offer) return tl::unexpected{offer.error()};
  const auto hand = hand_list_in(folder);
  if (!hand) return tl::unexpected{hand.error()};
  const ordered_json plan = json_or_discarded(*text);
  const auto elevation = plan.is_object() ? plan.find("lift_layers") : plan.end();
  if (!plan.is_object() || elevation == plan.end() || !elevation->is_number_unsigned())
    return fail(ErrorCode::InvalidInput,
                (folder / "plan" / "supports.json").string() + " is damaged; plan the job again");
  const double thickness_mm = offer->header.layer_thickness_mm;
  auto anchors = anchors_of(plan, thickness_mm);
  if (!anchors) return fail_in((folder / "plan" / "supports.json").string(), anchors.error());
  return json_text({{"elevation_layers", *elevation},
                    {"thickness_mm", thickness_mm},
                    {"anchors", std::move(*anchors)},
                    {"hand", ordered_json::parse(to_json(*hand))}});
}

}  // namespace telefab::fab
