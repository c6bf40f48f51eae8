// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/clock.hpp>
#include <telefab/test/process.hpp>

namespace telefab::test {

/// A fab daemon as a child process with a page, and a small machine: 40 x 30 mm at 0.1 mm, 2 s a layer.
class WebFab {
 public:
  /// `bin` holds telefab-fab; `folder` is emptied. `speed_up`: simulated seconds a second.
  /// Other machines' profiles are taken from `machines`, where it is given.
  WebFab(const std::filesystem::path& bin, const std::filesystem::path& folder, double speed_up,
         const std::filesystem::path& machines = {});

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] const std::string& token() const { return token_; }
  [[nodiscard]] std::filesystem::path data() const { return folder_ / "fab"; }
  /// Uploads a table of so many layers through OctoPrint's API, to be printed at once; the job's id.
  [[nodiscard]] std::string upload(std::uint32_t layers) const;
  /// Uploads the bytes of a .tfc file; printed at once where `print`.
  [[nodiscard]] std::string upload(const std::string& name, std::string_view tfc, bool print) const;
  /// "approve", "pause", ...; whether it was accepted.
  bool act(const std::string& id, const std::string& action) const;
  [[nodiscard]] nlohmann::json job(const std::string& id) const;
  /// Asks until the job is in that state; false when it ended in another one or patience did.
  [[nodiscard]] bool wait_for(const std::string& id, const std::string& state, double patience_s) const;
  [[nodiscard]] std::string text_of(const std::filesystem::path& file) const;
  /// Processor seconds and resident bytes of the daemon, as /proc tells.
  struct Use {
    double cpu_s = 0;
    double resident_mb = 0;
  };
  [[nodiscard]] Use use() const;
  [[nodiscard]] bool is_alive() const;

 private:
  std::filesystem::path folder_;
  std::unique_ptr<Process> process_;
  std::uint16_t port_ = 0;
  std::string token_;
};

/// Asks whatever `port` serves: `count` malformed requests, path tricks, oversized bodies, wrong tokens, and every GET
/// route. Returns how many were answered with a status that is none for them (2xx for what must be refused, 500).
struct HostileCount {
  std::size_t asked = 0;
  std::size_t wrong = 0;
  std::string first_wrong;
};
/// Milliseconds until another layer is drawn after the slider moved.
struct ScrubFigures {
  std::uint32_t layers = 0;
  double first_ms = 0;  ///< at once after the page was loaded; the others a second later
  double mean_ms = 0;
  double p95_ms = 0;
  double worst_ms = 0;
};
/// What a person sees of a page in a headless Chromium: milliseconds until the first paint and until the job's layer
/// is drawn, what its slider takes, megabytes of the page's process.
struct PageFigures {
  double first_paint_ms = 0;
  double job_drawn_ms = 0;
  ScrubFigures scrub;
  double script_mb = 0;   ///< JavaScript's heap
  double process_mb = 0;  ///< proportional set of the renderer's process
};
/// Of the page of either site. Throws where it shows no layer of a job.
[[nodiscard]] PageFigures look_at_page(std::uint16_t port);
[[nodiscard]] std::string sentence_of(const PageFigures& figures);
/// page-wide.png and page-phone.png of the page as it is now, into `folder`.
void take_pictures(std::uint16_t port, const std::filesystem::path& folder);

/// Whose routes are asked.
enum class HostileSite : std::uint8_t { Fab, Scan };
/// `job`: of the scan site, an upload too.
[[nodiscard]] HostileCount ask_hostile(std::uint16_t port, const std::string& job, std::size_t count,
                                       std::uint64_t seed, HostileSite site = HostileSite::Fab);

}  // namespace telefab::test
