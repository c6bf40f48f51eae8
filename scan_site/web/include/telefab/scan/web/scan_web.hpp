// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/job/job.hpp>
#include <telefab/web/web_routes.hpp>
#include <telefab/web/web_server.hpp>
#include <telefab/wire/message.hpp>
#include <vector>

namespace telefab::scan {

/// The line to the fab as the page shows it.
struct LinkView {
  std::string fab;  ///< HOST:PORT
  bool is_up = false;
  std::string why_down;  ///< empty while it is up
};

/// The scan daemon as its page sees it. Calls come from the web thread one at a time; each returns soon.
class PageBackend {
 public:
  virtual ~PageBackend() = default;
  PageBackend(const PageBackend&) = delete;
  PageBackend& operator=(const PageBackend&) = delete;

  /// Newest first.
  [[nodiscard]] virtual Result<std::vector<Job>> jobs() = 0;
  [[nodiscard]] virtual Result<Job> job(std::string_view id) = 0;
  [[nodiscard]] virtual Result<std::vector<JobEvent>> events(std::string_view id) = 0;
  /// JSON of what slicing found (report/slice.json); NotFound until all layers are cut.
  [[nodiscard]] virtual Result<std::string> report(std::string_view id) = 0;
  [[nodiscard]] virtual LinkView link() = 0;
  /// Cancel ends the job here and at the fab, Forget takes it off this site; the others are passed on to the fab.
  /// Conflict where the state does not allow it, Unreachable where the fab is needed and away. `who` goes into the
  /// audit log.
  [[nodiscard]] virtual Result<void> act(std::string_view id, JobCommand command, std::string_view who) = 0;
  /// Why changes of jobs cannot be kept now; nothing is wrong where they can.
  [[nodiscard]] virtual Result<void> healthy() = 0;
  /// Grows with every change of any job or of the line.
  [[nodiscard]] virtual std::uint64_t revision() = 0;

 protected:
  PageBackend() = default;
};

/// The API, row by row.
[[nodiscard]] const std::vector<WebRoute>& web_routes();

/// The page and the API of a backend, which must outlive it, as `sign_in` must. GET and HEAD never change state;
/// whatever does is a POST of an operator whom `sign_in` knows.
class ScanWeb final : public WebSite {
 public:
  ScanWeb(PageBackend& backend, SignIn& sign_in, std::string version)
      : backend_{backend}, sign_in_{sign_in}, version_{std::move(version)} {}
  tl::expected<Visitor, WebResponse> admit(const WebRequest& head) override;
  WebResponse answer(const WebRequest& request) override;
  std::uint64_t most_body(const WebRequest&) override { return 0; }
  std::string event_data() override;
  std::uint64_t revision() override { return backend_.revision(); }

 private:
  PageBackend& backend_;
  SignIn& sign_in_;
  std::string version_;
};

}  // namespace telefab::scan
