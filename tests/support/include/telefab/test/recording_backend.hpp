// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <string>
#include <telefab/fab/web/page_backend.hpp>
#include <vector>

namespace telefab::fab {

/// A backend with one planned job "job-1" of three layers; remembers every action.
class RecordingBackend : public PageBackend {
 public:
  [[nodiscard]] Result<std::vector<JobView>> jobs() override { return std::vector<JobView>{view()}; }
  [[nodiscard]] Result<JobViewPage> find(const JobQuery& query) override {
    asked_for.push_back(query);
    return JobViewPage{{view()}, query.before == 0 ? 7U : 0U};
  }
  [[nodiscard]] Result<JobView> job(std::string_view id) override {
    if (id != "job-1") return fail(ErrorCode::NotFound, "no job " + std::string{id});
    return view();
  }
  [[nodiscard]] Result<std::vector<JobEventView>> events(std::string_view) override {
    return std::vector<JobEventView>{{1000, "queued"}};
  }
  [[nodiscard]] Result<std::string> report(std::string_view) override { return std::string{R"({"layers":3})"}; }
  [[nodiscard]] Result<std::string> preflight(std::string_view) override {
    return std::string{
        R"({"verdict":"held","items":[{"name":"islands","verdict":"held","text":"1 found <b>","value":1,"unit":"findings"},{"name":"time","verdict":"passed","text":"2 h 3 min","value":7380,"unit":"s"}]})"};
  }
  [[nodiscard]] Result<std::string> exposures(std::string_view) override {
    return std::string{
        R"({"irradiance_mw_per_cm2":3,"planned_s":[36,36,9,9],"light_share":[1,1,1,1],"measured_s":[36.1,36],"resin_celsius":[]})"};
  }
  [[nodiscard]] Result<std::vector<std::byte>> mask_png(std::string_view, std::uint32_t layer) override {
    if (layer >= 3) return fail(ErrorCode::NotFound, "no such layer");
    return std::vector<std::byte>{std::byte{0x89}};
  }
  [[nodiscard]] Result<std::vector<std::byte>> preview_png(std::string_view) override {
    return std::vector<std::byte>{std::byte{0x89}};
  }
  [[nodiscard]] Result<std::vector<std::byte>> view_png(std::string_view) override {
    return std::vector<std::byte>{std::byte{0x89}};
  }
  [[nodiscard]] Result<std::vector<std::byte>> accuracy_png(std::string_view) override {
    return std::vector<std::byte>{std::byte{0x89}};
  }
  [[nodiscard]] Result<std::string> layer_json(std::string_view, std::uint32_t layer) override {
    return R"({"layer":)" + std::to_string(layer) +
           R"(,"z_mm":0.1,"thickness_mm":0.2,"bounds":[0,0,1,1],"part":[],"supports":[],"certificate":"certified"})";
  }
  [[nodiscard]] Result<std::string> supports(std::string_view) override {
    return std::string{
        R"({"elevation_layers":1,"thickness_mm":0.2,"anchors":[{"x_mm":12,"y_mm":8,"part_layer":3,"z_mm":0.7,"tip":"light","on_part":false,"by_hand":false}],"hand":{"extra":[],"forbidden":[],"removed":[]}})"};
  }
  [[nodiscard]] Result<void> plan_again(std::string_view id, std::string_view hand_list,
                                        std::string_view who) override {
    if (hand_list.empty()) return fail(ErrorCode::InvalidInput, "hand list: not a JSON object");
    names.emplace_back(who);
    hand_lists.emplace_back(std::string{id}, std::string{hand_list});
    return {};
  }
  [[nodiscard]] Result<void> act(std::string_view id, JobCommand action, std::string_view who) override {
    names.emplace_back(who);
    actions.emplace_back(std::string{id}, action);
    return {};
  }
  [[nodiscard]] Result<void> approve(std::string_view id, std::string_view although, std::string_view) override {
    approvals.emplace_back(std::string{id}, std::string{although});
    if (although.empty()) return fail(ErrorCode::Conflict, "the job does not wait for approval");
    return {};
  }
  [[nodiscard]] Result<void> clear_platform(std::string_view machine, std::string_view) override {
    cleared.emplace_back(machine);
    return {};
  }
  [[nodiscard]] Result<std::string> take_file(std::string_view folder, std::string_view name, std::string_view tfc,
                                              bool start, std::string_view) override {
    folders.emplace_back(folder);
    if (tfc.empty()) return fail(ErrorCode::InvalidInput, "this is not a .tfc file");
    files.push_back({std::string{name}, std::string{tfc}, start});
    return std::string{"u1"};
  }
  [[nodiscard]] Result<std::string> print_again(std::string_view id, std::string_view who) override {
    if (id != "job-1") return fail(ErrorCode::Conflict, "not all layers of the job are here");
    names.emplace_back(who);
    ++printed_again;
    return std::string{"u2"};
  }
  [[nodiscard]] std::optional<MachineMoment> moment(std::string_view machine) override {
    if (machine != "hall-1") return std::nullopt;
    return MachineMoment{"exposing", true, 0.4, 24.5};
  }
  [[nodiscard]] std::vector<MachineStatus> machines() override {
    return {
        {"hall-1",
         "machine-a",
         MachineState::Printing,
         "clear",
         "job-1",
         "a \"statue\" <b>.ply",
         1,
         3,
         84,
         2,
         {},
         true},
        {"hall-2", "machine-a", MachineState::Occupied, "clear", "job-0", "vase.ply", 3, 3, -1, 0,
         "take the part off, then telefab cleared hall-2", true},
        {"hall-3", "machine-b", MachineState::Fault, "tough", {}, {}, 0, 0, -1, 0, "the stage does not answer", true},
        {"hall-4", "machine-b", MachineState::Idle, "tough", {}, {}, 0, 0, -1, 0, {}, true}};
  }
  [[nodiscard]] std::string devices_json() override { return R"({"projector":"virtual","light":"off"})"; }
  [[nodiscard]] Result<void> healthy() override { return health; }
  Result<void> health;
  [[nodiscard]] std::uint64_t revision() override { return revised; }

  struct File {
    std::string name;
    std::string content;
    bool start;
  };
  std::vector<std::pair<std::string, JobCommand>> actions;
  std::vector<JobQuery> asked_for;
  std::vector<std::pair<std::string, std::string>> hand_lists;  ///< job, JSON
  std::vector<std::string> names;                               ///< who gave each of them
  std::vector<std::pair<std::string, std::string>> approvals;   ///< job, although
  std::vector<std::string> cleared;                             ///< machines
  std::vector<File> files;
  std::atomic<std::uint64_t> revised = 1;  ///< raised: watchers are told
  int printed_again = 0;
  std::vector<std::string> folders;  ///< of the files

 private:
  static JobView view() {
    JobView job;
    job.id = "job-1";
    job.name = "a \"statue\" <b>.ply";
    job.machine = "machine-a";
    job.state = JobState::Printing;
    job.layers = 3;
    job.layers_printed = 1;
    job.stage_seconds = {{JobStage::Plan, 4.5}};
    return job;
  }
};

}  // namespace telefab::fab
