// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <functional>
#include <map>
#include <optional>
#include <telefab/fab/print/print_plan.hpp>
#include <telefab/fab/support/support_plan.hpp>
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_instances.hpp>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/web_page.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/wire/message.hpp>

#include "open_questions.hpp"
#include "upload.hpp"

namespace telefab::fab {

/// An uploaded job, its layers on disk: hands it to the daemon's loop; the answer comes on the loop's thread.
using UploadPost = std::function<void(const NewJob&, std::function<void(Result<Job>)>)>;

/// A job to be planned again with these supports by hand, on the word of `who`: as UploadPost.
using SupportsPost = std::function<void(const std::string& job, const HandList& supports, const std::string& who,
                                        std::function<void(Result<Job>)>)>;

/// What a job waits for that only somebody at the machine knows.
struct JobQuestions {
  OpenQuestion open = OpenQuestion::None;  ///< nobody has decided yet
  std::string platform;                    ///< machine on whose platform another part is; empty: it waits for none
};
/// Any thread.
using QuestionAsker = std::function<JobQuestions(const std::string& job)>;

/// What the machines of the fab are at, and a number that grows with every change of that. Any thread.
struct MachineAsker {
  std::function<std::vector<MachineStatus>()> standing;
  std::function<std::optional<MachineMoment>(std::string_view machine)> moment;
  std::function<std::uint64_t()> revision;
};

/// The daemon as its web page sees it: reads the store and the job folders itself, passes commands on. Lives on the
/// thread "web"; keeps the layers of the job last looked at.
class SitePageBackend final : public PageBackend {
 public:
  /// Store, room, folder and profiles must outlive the backend.
  SitePageBackend(JobStore& store, const DiskRoom& room, const DataFolder& folder, const ProfileCatalogue& profiles,
                  CommandPost post, UploadPost uploaded, SupportsPost supported, QuestionAsker questions,
                  MachineAsker asker)
      : store_{store},
        room_{room},
        folder_{folder},
        profiles_{profiles},
        post_{std::move(post)},
        uploaded_{std::move(uploaded)},
        supported_{std::move(supported)},
        questions_{std::move(questions)},
        asker_{std::move(asker)} {}

  Result<std::vector<JobView>> jobs() override;
  Result<JobViewPage> find(const JobQuery& query) override;
  Result<JobView> job(std::string_view id) override;
  Result<std::vector<JobEventView>> events(std::string_view id) override;
  Result<std::string> report(std::string_view id) override;
  Result<std::string> preflight(std::string_view id) override;
  Result<std::string> exposures(std::string_view id) override;
  Result<std::vector<std::byte>> mask_png(std::string_view id, std::uint32_t layer) override;
  Result<std::vector<std::byte>> preview_png(std::string_view id) override;
  Result<std::vector<std::byte>> view_png(std::string_view id) override;
  Result<std::vector<std::byte>> accuracy_png(std::string_view id) override;
  Result<std::string> layer_json(std::string_view id, std::uint32_t layer) override;
  Result<std::string> supports(std::string_view id) override;
  Result<void> plan_again(std::string_view id, std::string_view hand_list, std::string_view who) override;
  Result<void> act(std::string_view id, JobCommand action, std::string_view who) override;
  Result<void> approve(std::string_view id, std::string_view although, std::string_view who) override;
  Result<void> clear_platform(std::string_view machine, std::string_view who) override;
  Result<std::string> take_file(std::string_view folder, std::string_view name, std::string_view bytes, bool start,
                                std::string_view who) override;
  Result<std::string> print_again(std::string_view id, std::string_view who) override;
  std::optional<MachineMoment> moment(std::string_view machine) override { return asker_.moment(machine); }
  std::vector<MachineStatus> machines() override { return asker_.standing(); }
  std::string devices_json() override;
  Result<void> healthy() override {
    if (auto good = store_.health(); !good) return good;
    return room_.health();
  }
  std::uint64_t revision() override { return store_.revision() + asker_.revision(); }

 private:
  /// What uploads may be for: every machine and profile that some machine of the fab would take a job for.
  [[nodiscard]] std::vector<UploadTarget> upload_targets(std::string_view asked);
  /// The job whose folder was written; its id.
  [[nodiscard]] Result<std::string> make_job(const Result<NewJob>& written);
  struct LayerImages {
    std::string job;
    std::filesystem::file_time_type planned;  ///< of the plan they are of
    LayerStack part;
    std::vector<Layer> supports;                       ///< by print layer
    Bounds2 bounds;                                    ///< of part and supports
    std::optional<std::array<double, 2>> platform_mm;  ///< width and depth; none: the machine is not here any more
  };
  /// What was measured of each print layer; nothing of those that were not made yet.
  struct Measured {
    std::vector<std::optional<double>> exposure_s;
    std::vector<std::optional<double>> resin_celsius;
    std::uint32_t retries = 0;
    void take(std::span<const LayerRecord> made, std::size_t layers);
  };
  /// The same of a print that goes on, as its journal has it.
  struct LiveMeasured {
    std::string job;
    std::uintmax_t journal_bytes = 0;  ///< when it was read
    Measured measured;
  };
  /// What a job's plan and record say of its light; kept as long as the plan is the same.
  struct Light {
    double print_s = 0;             ///< of the whole print on this machine
    std::vector<double> left_s;     ///< of it when each layer is next; one more for the raising of the part
    std::vector<double> share;      ///< of full light, by layer
    std::vector<double> planned_s;  ///< exposure of each layer
    Measured measured;              ///< as recorded; empty until printed
    double irradiance_mw_per_cm2 = 0;
    double resin_ml = 0;                      ///< that the print cures; 0: its preflight does not say
    std::optional<ResinPrice> price;          ///< of the resin; none: its profile states none
    bool is_whole = false;                    ///< read when the job had ended
    std::filesystem::file_time_type planned;  ///< of the plan it was read from
  };
  [[nodiscard]] JobView view_of(const Job& job);
  /// Null until planned.
  [[nodiscard]] const Light* light_of(const Job& job);
  /// Of a job that has not ended.
  [[nodiscard]] const Measured& measured_so_far(const Job& job, std::size_t layers);
  [[nodiscard]] Result<std::filesystem::path> plan_file(std::string_view id, std::string_view name);
  [[nodiscard]] Result<const LayerImages*> layer_images_of(std::string_view id);

  JobStore& store_;
  const DiskRoom& room_;
  const DataFolder& folder_;
  const ProfileCatalogue& profiles_;
  CommandPost post_;
  UploadPost uploaded_;
  SupportsPost supported_;
  QuestionAsker questions_;
  MachineAsker asker_;
  std::optional<LayerImages> layer_images_;
  LiveMeasured live_;                    ///< of the job last asked for
  std::map<std::string, Light> lights_;  ///< by job
};

}  // namespace telefab::fab
