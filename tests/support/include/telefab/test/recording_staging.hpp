// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/web/staging_backend.hpp>
#include <vector>

namespace telefab::scan {

/// A backend that knows every upload but "none"; remembers every call that changes something.
class RecordingStaging : public StagingBackend {
 public:
  Result<std::string> uploads() override {
    return std::string{
        R"({"limit_bytes":8589934592,"room_bytes":1000000000,"part_bytes":4194304,"most_uploads":32,"kept_hours":24,"uploads":[]})"};
  }
  Result<std::string> begin(const AnnouncedFile& file, std::string_view who) override {
    calls.push_back("begin " + file.name + " " + std::to_string(file.size_bytes) + " by " + std::string{who});
    return view("scan-1");
  }
  Result<std::string> append(std::string_view id, std::uint64_t from_bytes, std::string_view bytes) override {
    calls.push_back("append " + std::string{id} + " " + std::to_string(from_bytes) + "+" +
                    std::to_string(bytes.size()));
    return view(id);
  }
  Result<std::string> view(std::string_view id) override {
    if (id == "none") return fail(ErrorCode::NotFound, "there is no upload " + std::string{id});
    return std::string{R"({"id":"scan-1","state":"receiving"})"};
  }
  Result<void> discard(std::string_view id, std::string_view who) override {
    calls.push_back("discard " + std::string{id} + " by " + std::string{who});
    return {};
  }
  Result<std::string> look(std::string_view id, const StagingQuestion& question) override {
    return asked("look", id, question);
  }
  Result<std::string> estimate(std::string_view id, const StagingQuestion& question) override {
    return asked("estimate", id, question);
  }
  Result<std::string> orient(std::string_view id, const StagingQuestion& question) override {
    return asked("orient", id, question);
  }
  Result<std::string> join(std::string_view id, const std::vector<std::string>& with, std::string_view) override {
    calls.push_back("join " + std::string{id} + " with " + std::to_string(with.size()));
    return view(id);
  }
  Result<std::string> level(std::string_view, std::uint64_t revision, std::uint32_t level) override {
    if (revision != 7) return fail(ErrorCode::Conflict, "the picture is another one by now");
    return std::string(8, static_cast<char>('0' + level));
  }
  Result<Job> submit(std::string_view id, const StagingQuestion& question, std::string_view who) override {
    calls.push_back("submit " + std::string{id} + " " + question.machine + " " + question.parameters + " by " +
                    std::string{who});
    Job job;
    job.id = "job-9";
    return job;
  }
  std::string profiles() override { return R"({"machines":[],"resins":[],"prints":[]})"; }

  std::vector<std::string> calls;

 private:
  Result<std::string> asked(const std::string& what, std::string_view id, const StagingQuestion& question) {
    calls.push_back(what + " " + std::string{id} + " " + question.machine + " " + question.parameters +
                    (question.goal.empty() ? "" : " for " + question.goal));
    return view(id);
  }
};

}  // namespace telefab::scan
