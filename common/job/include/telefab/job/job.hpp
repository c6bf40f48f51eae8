// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// Where a job is. Numbers go to disk and over the wire: never renumber.
enum class JobState : std::uint8_t {
  Queued = 1,    ///< accepted, not begun
  Slicing = 2,   ///< scan site: layers are cut, and sent as they come
  Sending = 3,   ///< all layers are cut, some are not acknowledged; at the fab: layers arrive
  Planning = 4,  ///< fab: supports and masks
  Ready = 5,     ///< fab: planned, and approved where that is asked for; waits for the printer
  Printing = 6,
  Paused = 7,  ///< lifted and dark, goes on with the next layer
  Done = 8,
  Failed = 9,  ///< see message
  Cancelled = 10,
  AwaitingApproval = 11,  ///< fab: planned; somebody must approve it before it is printed
};
/// In the order of a job's life.
inline constexpr std::array kJobStates{JobState::Queued,   JobState::Slicing,          JobState::Sending,
                                       JobState::Planning, JobState::AwaitingApproval, JobState::Ready,
                                       JobState::Printing, JobState::Paused,           JobState::Done,
                                       JobState::Failed,   JobState::Cancelled};

/// "queued", "slicing", ...
[[nodiscard]] std::string_view name_of(JobState state);
[[nodiscard]] Result<JobState> job_state_from_name(std::string_view name);
/// Done, Failed and Cancelled are for good.
[[nodiscard]] bool is_final(JobState state);
/// Whether a job is in state `a` earlier in its life than in `b`; by kJobStates, not by the numbers.
[[nodiscard]] bool is_before(JobState a, JobState b);
/// Forward along the list, Printing <-> Paused, Ready -> AwaitingApproval -> Planning, and from every state that is not
/// final to Failed and Cancelled.
[[nodiscard]] bool may_follow(JobState from, JobState to);

/// What somebody may have done to a job. Numbers go over the wire: never renumber.
enum class JobCommand : std::uint8_t {
  Approve = 1,
  Pause = 2,
  Resume = 3,
  Cancel = 4,
  TreatAsExposed = 5,   ///< resume; a layer that was perhaps exposed counts as exposed
  ExposeAgain = 6,      ///< resume; such a layer is exposed again
  Cleared = 7,          ///< about a machine, whose name is in Command::job: its platform is empty
  Forget = 8,           ///< a job that has ended and all its files leave the site
  StartAgain = 9,       ///< resume; a whole printer that perhaps started the print did not, and is asked again
  TreatAsStarted = 10,  ///< resume; it did, and is watched
};
[[nodiscard]] std::string_view name_of(JobCommand command);

/// How far a job is; only ever grows while the job runs.
struct JobCounters {
  std::uint32_t layers = 0;  ///< of the part; 0: not known yet
  std::uint32_t layers_sliced = 0;
  std::uint32_t layers_sent = 0;   ///< acknowledged by the fab as durable
  std::uint32_t print_layers = 0;  ///< with supports below the part; 0: not planned yet
  std::uint32_t layers_planned = 0;
  std::uint32_t layers_printed = 0;
  std::uint64_t scan_bytes = 0;  ///< uploaded by the operator
  std::uint64_t wire_bytes = 0;  ///< contour bytes over the wire, framing included
  friend bool operator==(const JobCounters&, const JobCounters&) = default;
};

/// What a job spends its time on.
enum class JobStage : std::uint8_t { Slice = 1, Send = 2, Plan = 3, Print = 4 };
inline constexpr std::array kJobStages{JobStage::Slice, JobStage::Send, JobStage::Plan, JobStage::Print};
/// "slice", "send", "plan", "print": on disk and over the wire too.
[[nodiscard]] std::string_view name_of(JobStage stage);
[[nodiscard]] Result<JobStage> job_stage_from_name(std::string_view name);

struct StageSeconds {
  JobStage stage{};
  double seconds = 0;
  friend bool operator==(const StageSeconds&, const StageSeconds&) = default;
};

struct Job {
  std::string id;
  std::string name;        ///< file name of the scan
  std::string machine;     ///< that was asked for: a profile, or one machine of the fab
  std::string parameters;  ///< JSON object of what was asked for, as the site wrote it
  std::string owner;       ///< who submitted it, for the audit log
  JobState state = JobState::Queued;
  std::string message;  ///< why it failed, what it waits for; may be empty
  JobCounters counters;
  std::vector<StageSeconds> stages;  ///< in the order in which they were first reported
  std::int64_t created_unix_ms = 0;
  std::int64_t changed_unix_ms = 0;
  std::string instance = {};  ///< machine of the fab that prints it or has printed it; empty: none has got it yet
  friend bool operator==(const Job&, const Job&) = default;
};

/// JSON object of a job on one line, keys in fixed order: what `telefab --json` prints and hooks are told.
[[nodiscard]] std::string to_json(const Job& job);

/// Which jobs of a site are listed, newest first.
struct JobQuery {
  std::uint32_t most = 200;
  /// Only jobs in whose name, owner, id, machine or state each of these words occurs, separated by blanks; capital and
  /// small letters of ASCII are one. Empty: all.
  std::string words = {};
  std::vector<JobState> states = {};  ///< one of these; empty: any
  std::uint64_t before = 0;           ///< JobPage::next of the page before; 0: from the newest
  friend bool operator==(const JobQuery&, const JobQuery&) = default;
};
struct JobPage {
  std::vector<Job> jobs;
  std::uint64_t next = 0;  ///< where the next page goes on, whatever jobs come or are forgotten meanwhile; 0: no more
};

struct JobEvent {
  std::uint64_t number = 0;  ///< rises by one an event over all jobs
  std::int64_t unix_ms = 0;
  std::string text;
};

}  // namespace telefab
