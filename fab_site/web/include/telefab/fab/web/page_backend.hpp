// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/job/job.hpp>
#include <telefab/job/machine_status.hpp>
#include <vector>

namespace telefab::fab {

/// What the page shows of one job. Plain values; the daemon fills them from its store.
struct JobView {
  std::string id;
  std::string name;      ///< file name of the scan
  std::string owner;     ///< who submitted it
  std::string machine;   ///< that was asked for: a profile, or one machine
  std::string instance;  ///< machine that it is on or was on; empty: none yet
  JobState state{};
  std::string message;                ///< why it failed, what it waits for; may be empty
  bool exposure_unknown = false;      ///< paused because a layer was perhaps exposed: somebody must say whether it was
  bool start_unknown = false;         ///< paused because a whole printer was perhaps started: likewise
  bool waits_for_platform = false;    ///< another part is on the platform: somebody must take it off and say so
  std::string platform;               ///< of that machine; empty: it waits for none
  std::uint32_t layers = 0;           ///< of the print, supports included; 0: not known yet
  std::uint32_t layers_received = 0;  ///< of the part
  std::uint32_t layers_printed = 0;
  std::uint64_t bytes_received = 0;
  double progress = 0;       ///< 0 to 1 of the present state
  double seconds_left = -1;  ///< of the print; below 0: not known
  double print_seconds = 0;  ///< of the whole print as planned; 0: not planned yet
  double resin_ml = 0;       ///< that the print cures, supports included; 0: not planned yet
  double cost = 0;           ///< of that resin; 0: not planned yet, or its profile states no price
  std::string currency;      ///< of the cost; empty where there is none
  std::int64_t created_unix_s = 0;
  std::int64_t planned_unix_ms = 0;  ///< another time is another plan, with other pictures; 0: not planned yet
  std::vector<StageSeconds> stage_seconds;
  double planned_exposure_s = 0;   ///< light of the whole print; 0: not planned yet
  double measured_exposure_s = 0;  ///< light that the device reported; 0: not printed yet
  std::uint32_t retries = 0;       ///< device commands that had to be repeated
};

/// As JobPage.
struct JobViewPage {
  std::vector<JobView> jobs;
  std::uint64_t next = 0;
};

/// One line of a job's log.
struct JobEventView {
  std::int64_t unix_ms = 0;
  std::string text;
};

/// What the print on a machine does this moment.
struct MachineMoment {
  std::string phase;                    ///< name of a PrintPhase, or what a printer says of itself
  bool is_lit = false;                  ///< an exposure goes on
  std::optional<double> z_mm;           ///< of the platform, as last reported; none: the printer does not say
  std::optional<double> resin_celsius;  ///< where the machine has a thermometer
  friend bool operator==(const MachineMoment&, const MachineMoment&) = default;
};

/// The daemon as the web page sees it. Calls come from the web thread one at a time; each returns at once.
class PageBackend {
 public:
  virtual ~PageBackend() = default;
  PageBackend(const PageBackend&) = delete;
  PageBackend& operator=(const PageBackend&) = delete;

  /// What is not at its end, and the newest of what is; newest first.
  [[nodiscard]] virtual Result<std::vector<JobView>> jobs() = 0;
  /// Jobs of any age.
  [[nodiscard]] virtual Result<JobViewPage> find(const JobQuery& query) = 0;
  [[nodiscard]] virtual Result<JobView> job(std::string_view id) = 0;
  [[nodiscard]] virtual Result<std::vector<JobEventView>> events(std::string_view id) = 0;
  /// The JSON report of the plan and, once printed, of the print. NotFound until there is one.
  [[nodiscard]] virtual Result<std::string> report(std::string_view id) = 0;
  /// JSON of what was asked before the light went on; NotFound until planned.
  [[nodiscard]] virtual Result<std::string> preflight(std::string_view id) = 0;
  /// JSON of the light of every print layer: {"irradiance_mw_per_cm2":i,"planned_s":[...],"light_share":[...],
  /// "measured_s":[...],"resin_celsius":[...]}; the share is of full light; the last two are empty, or hold nulls,
  /// where nothing was measured. NotFound until planned.
  [[nodiscard]] virtual Result<std::string> exposures(std::string_view id) = 0;
  /// PNG of the mask of a print layer; NotFound until planned.
  [[nodiscard]] virtual Result<std::vector<std::byte>> mask_png(std::string_view id, std::uint32_t layer) = 0;
  /// PNG contact sheet of the plan.
  [[nodiscard]] virtual Result<std::vector<std::byte>> preview_png(std::string_view id) = 0;
  /// PNG of the print as it stands on its platform; NotFound until planned, and of plans that have none.
  [[nodiscard]] virtual Result<std::vector<std::byte>> view_png(std::string_view id) = 0;
  /// PNG of the predicted part and how far its edges lie from the contours; NotFound until that was computed.
  [[nodiscard]] virtual Result<std::vector<std::byte>> accuracy_png(std::string_view id) = 0;
  /// JSON of one print layer, millimetres, build frame; z_mm is its middle, bounds are those of the whole print:
  /// {"layer":n,"z_mm":z,"thickness_mm":t,"platform_mm":[w,d],"bounds":[x0,y0,x1,y1],"part":[rings],"supports":[rings],
  /// "certificate":"..."}; the platform is null where its machine is not known here any more
  [[nodiscard]] virtual Result<std::string> layer_json(std::string_view id, std::uint32_t layer) = 0;
  /// JSON of the anchors of the plan and of the list of supports by hand it was made with: {"elevation_layers":n,
  /// "thickness_mm":t,"anchors":[{"x_mm":x,"y_mm":y,"part_layer":k,"z_mm":z,"tip":"light","on_part":b,"by_hand":b}],
  /// "hand":{"extra":[...],"forbidden":[...],"removed":[...]}}; build frame. NotFound until planned.
  [[nodiscard]] virtual Result<std::string> supports(std::string_view id) = 0;
  /// Plans a job that waits for approval again with the JSON of a whole list of supports by hand. InvalidInput: not
  /// such a list; Conflict: the job is elsewhere. `who` goes into the audit log.
  [[nodiscard]] virtual Result<void> plan_again(std::string_view id, std::string_view hand_list,
                                                std::string_view who) = 0;
  /// Conflict where the state does not allow it. `who` goes into the audit log.
  [[nodiscard]] virtual Result<void> act(std::string_view id, JobCommand action, std::string_view who) = 0;
  /// Lets a planned job print. `although`: names of what holds it, separated by commas. NotPermitted: something that
  /// holds it is not named; Conflict: it waits for no approval.
  [[nodiscard]] virtual Result<void> approve(std::string_view id, std::string_view although, std::string_view who) = 0;
  /// The platform of the machine was emptied. Conflict: it is empty already, or its part is still being made.
  [[nodiscard]] virtual Result<void> clear_platform(std::string_view machine, std::string_view who) = 0;
  /// Makes a job of the bytes of a file of an accepted kind (accepted_endings), judged by name and content; its id.
  /// Printed as soon as it is planned where `start`, else it waits for approval. `who` owns it. `folder`: that its
  /// sender put it in; one that is named as a machine, or a profile, asks for that. InvalidInput: not what its name
  /// says, damaged, for a machine this fab has not, or for any of several profiles.
  [[nodiscard]] virtual Result<std::string> take_file(std::string_view folder, std::string_view name,
                                                      std::string_view bytes, bool start, std::string_view who) = 0;
  /// Makes a new job of the layers of another, as they are and for what it was for; its id. It waits for approval and
  /// is `who`'s. Conflict: not all of its layers are here.
  [[nodiscard]] virtual Result<std::string> print_again(std::string_view id, std::string_view who) = 0;
  /// Of a machine by its name; nothing where no print is under way on it.
  [[nodiscard]] virtual std::optional<MachineMoment> moment(std::string_view machine) = 0;
  /// Every machine that stands in the fab, in the order of its list.
  [[nodiscard]] virtual std::vector<MachineStatus> machines() = 0;
  /// JSON of projector and stage: names, light, Z, temperature if there is one.
  [[nodiscard]] virtual std::string devices_json() = 0;
  /// Why changes of jobs cannot be kept now; nothing is wrong where they can.
  [[nodiscard]] virtual Result<void> healthy() = 0;
  /// Grows with every change of any job; the event stream sends when it does.
  [[nodiscard]] virtual std::uint64_t revision() = 0;

 protected:
  PageBackend() = default;
};

}  // namespace telefab::fab
