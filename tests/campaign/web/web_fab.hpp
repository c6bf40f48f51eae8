#pragma once
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <telefab/base/clock.hpp>

#include "../../integration/fax/process.hpp"

namespace telefab::test {

/// A fab daemon as a child process with a page, and a small machine: 40 x 30 mm at 0.1 mm, 2 s a layer.
class WebFab {
 public:
  /// `bin` holds telefab-fab; `folder` is emptied. `speed_up`: simulated seconds a second.
  WebFab(const std::filesystem::path& bin, const std::filesystem::path& folder, double speed_up);

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] const std::string& token() const { return token_; }
  [[nodiscard]] std::filesystem::path data() const { return folder_ / "fab"; }
  /// Uploads a table of so many layers through OctoPrint's API, to be printed at once; the job's id.
  [[nodiscard]] std::string upload(std::uint32_t layers) const;
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
[[nodiscard]] HostileCount ask_hostile(std::uint16_t port, const std::string& job, std::size_t count,
                                       std::uint64_t seed);

}  // namespace telefab::test
