// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/web/scan_web.hpp>

namespace telefab::scan {

/// A backend with one job "job-1" that the fab prints; remembers every command.
class RecordingScanBackend : public PageBackend {
 public:
  Result<std::vector<Job>> jobs() override { return std::vector<Job>{view()}; }
  Result<JobPage> find(const JobQuery& query) override {
    asked_for.push_back(query);
    return JobPage{{view()}, query.before == 0 ? 7U : 0U};
  }
  Result<Job> job(std::string_view id) override {
    if (id != "job-1") return fail(ErrorCode::NotFound, "no job " + std::string{id});
    return view();
  }
  Result<std::vector<JobEvent>> events(std::string_view) override {
    return std::vector<JobEvent>{{1, 1000, "queued"}, {2, 2000, "printing"}};
  }
  Result<std::string> report(std::string_view) override {
    return std::string{
        R"({"points":40000,"size_mm":[20.5,14.25,75],"surface":"unbiased","method":"marching","kernel":{"spacing_mm":0.21,)"
        R"("noise_mm":0.012,"width_mm":0.6,"dropped_samples":12},"normals":{"estimated":true},"layers":500,"layer_mm":0.15,)"
        R"("layers_cut":500,"certified":499,"contours":812,"vertices":98000,"flagged_layers":[{"layer":41,"z_mm":6.225,)"
        R"("reason":"not-cross-checked","text":"nearly level"}],"inconsistencies":[],"seconds":{"read":0.1,"slice":0.4}})"};
  }
  Result<std::string> layer_json(std::string_view, std::uint32_t layer) override {
    if (layer >= 500) return fail(ErrorCode::NotFound, "that layer is not cut");
    return R"({"layer":)" + std::to_string(layer) +
           R"(,"layers":500,"z_mm":1.5,"thickness_mm":0.15,"bounds":[0,0,20,14],"certified":true,)"
           R"("rings":[[[2,2],[18,2],[18,12],[2,12]]],"kinds":[[["measured",2],["completed",1],["doubtful",1]]]})";
  }
  LinkView link() override { return {"127.0.0.1:7420", false, false, "connection refused"}; }
  Result<std::string> fleet() override {
    return R"({"machines":[{"name":"la-a","fab":"la","profile":"a","resin":"grey","size_mm":[120.0,68.0,150.0],)"
           R"("pixel_mm":0.05,"calibrated_unix_ms":0,"readiness":"busy","draining":false,"seen_unix_ms":1,"seen":true}],)"
           R"("jobs":[],"waiting":0})";
  }
  Result<void> act(std::string_view id, JobCommand command, std::string_view) override {
    commands.emplace_back(std::string{id}, command);
    if (command == JobCommand::Approve) return fail(ErrorCode::Conflict, "there is nothing to approve");
    return {};
  }
  Result<void> approve(std::string_view id, std::string_view names, std::string_view) override {
    commands.emplace_back(std::string{id}, JobCommand::Approve);
    although = names;
    return {};
  }
  Result<std::string> preflight(std::string_view) override { return preflight_json; }
  Result<void> healthy() override { return {}; }
  std::uint64_t revision() override { return 1; }

  std::string although;
  std::string preflight_json = R"({"verdict":"passed","items":[]})";
  std::vector<JobQuery> asked_for;
  std::vector<std::pair<std::string, JobCommand>> commands;

 private:
  static Job view() {
    Job job;
    job.id = "job-1";
    job.name = "a \"statue\" <b>.ply";
    job.machine = "machine-a";
    job.owner = "operator";
    job.state = JobState::Printing;
    job.counters = {500, 500, 500, 520, 520, 77, 1'234'567, 44'200};
    job.stages = {{JobStage::Slice, 0.9}, {JobStage::Send, 1.4}};
    return job;
  }
};

}  // namespace telefab::scan
