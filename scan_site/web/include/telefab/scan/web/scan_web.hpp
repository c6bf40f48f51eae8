// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/job/job.hpp>
#include <telefab/scan/web/staging_backend.hpp>
#include <telefab/web/web_routes.hpp>
#include <telefab/web/web_server.hpp>
#include <telefab/wire/message.hpp>
#include <vector>

namespace telefab::scan {

/// The line to the fab as the page shows it.
struct LinkView {
  std::string fab;        ///< HOST:PORT; of a fleet where its queue is
  bool is_fleet = false;  ///< jobs go to a fleet, and the line is that to its queue
  bool is_up = false;
  std::string why_down;  ///< empty while it is up
};

/// The scan daemon as its page sees it. Calls come from the web thread one at a time; each returns soon.
class PageBackend {
 public:
  virtual ~PageBackend() = default;
  PageBackend(const PageBackend&) = delete;
  PageBackend& operator=(const PageBackend&) = delete;

  /// What is not at its end, and the newest of what is; newest first.
  [[nodiscard]] virtual Result<std::vector<Job>> jobs() = 0;
  /// Jobs of any age.
  [[nodiscard]] virtual Result<JobPage> find(const JobQuery& query) = 0;
  [[nodiscard]] virtual Result<Job> job(std::string_view id) = 0;
  [[nodiscard]] virtual Result<std::vector<JobEvent>> events(std::string_view id) = 0;
  /// JSON of what slicing found (report/slice.json); NotFound until all layers are cut.
  [[nodiscard]] virtual Result<std::string> report(std::string_view id) = 0;
  /// JSON of one layer that is cut: {"layer","z_mm","thickness_mm","layers","bounds":[x0,y0,x1,y1],"certificate",
  /// "rings":[[[x,y],...]],"kinds":[[[kind,edges],...]]}, millimetres on the platform; kinds as SurfaceClass names
  /// them. NotFound where it is not cut yet.
  [[nodiscard]] virtual Result<std::string> layer_json(std::string_view id, std::uint32_t layer) = 0;
  [[nodiscard]] virtual LinkView link() = 0;
  /// {"machines":[...],"jobs":[...],"waiting":N} of the fleet as it was a moment ago; jobs that are not at their end,
  /// in the order in which they are served. NotFound where the jobs are printed by one fab.
  [[nodiscard]] virtual Result<std::string> fleet() = 0;
  /// Cancel ends the job here and at the fab, Forget takes it off this site; the others are passed on to the fab.
  /// Conflict where the state does not allow it, Unreachable where the fab is needed and away. `who` goes into the
  /// audit log.
  [[nodiscard]] virtual Result<void> act(std::string_view id, JobCommand command, std::string_view who) = 0;
  /// Lets a job that waits at the fab print; `although`: names of what holds it and is let through, separated by
  /// commas. Fails as act().
  [[nodiscard]] virtual Result<void> approve(std::string_view id, std::string_view although, std::string_view who) = 0;
  /// JSON of what the fab asked before the light went on; NotFound until planned, Unreachable: the fab is away.
  [[nodiscard]] virtual Result<std::string> preflight(std::string_view id) = 0;
  /// Why changes of jobs cannot be kept now; nothing is wrong where they can.
  [[nodiscard]] virtual Result<void> healthy() = 0;
  /// Grows with every change of any job or of the line.
  [[nodiscard]] virtual std::uint64_t revision() = 0;

 protected:
  PageBackend() = default;
};

/// The API, row by row.
[[nodiscard]] const std::vector<WebRoute>& web_routes();

/// What the site answers at /openapi.json.
[[nodiscard]] std::string open_api_json();

struct WebOptions {
  std::string version;
  std::string three_js = {};  ///< the text of three.min.js (Debian libjs-three) for the 3-D view; empty: no 3-D view
};

/// The page and the API of both backends, which must outlive it, as `sign_in` must. GET and HEAD never change state;
/// whatever does is a POST of an operator whom `sign_in` knows.
class ScanWeb final : public WebSite {
 public:
  ScanWeb(PageBackend& backend, StagingBackend& staging, SignIn& sign_in, WebOptions options)
      : backend_{backend}, staging_{staging}, sign_in_{sign_in}, options_{std::move(options)} {}
  tl::expected<Visitor, WebResponse> admit(const WebRequest& head) override;
  WebResponse answer(const WebRequest& request) override;
  std::uint64_t most_body(const WebRequest& head) override;
  std::string event_data() override;
  std::uint64_t revision() override { return backend_.revision(); }

 private:
  PageBackend& backend_;
  StagingBackend& staging_;
  SignIn& sign_in_;
  WebOptions options_;
};

}  // namespace telefab::scan
