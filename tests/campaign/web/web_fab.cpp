// SPDX-License-Identifier: GPL-3.0-or-later
#include "web_fab.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/http_client.hpp>

namespace telefab::test {

WebFab::WebFab(const std::filesystem::path& bin, const std::filesystem::path& folder, double speed_up,
               const std::filesystem::path& machines)
    : folder_{folder} {
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder / "machines");
  MachineProfile machine = small_machine();
  machine.devices.speed_up = speed_up;
  std::ofstream{folder / "machines" / "small.toml"} << to_toml(machine);
  if (!machines.empty())
    for (const auto& entry : std::filesystem::directory_iterator{machines})
      std::filesystem::copy(entry, folder / "machines" / entry.path().filename());
  process_ = std::make_unique<Process>(
      std::vector<std::string>{(bin / "telefab-fab").string(), "serve", "--listen", "127.0.0.1:0", "--web",
                               "127.0.0.1:0", "--data", data().string(), "--machines", (folder / "machines").string()});
  if (process_->read_line().empty()) throw std::runtime_error("the fab did not start: " + process_->errors());
  port_ = static_cast<std::uint16_t>(std::stoi(text_of(data() / "web-port")));
  token_ = text_of(data() / "web-token");
  token_.pop_back();
}

std::string WebFab::text_of(const std::filesystem::path& file) const {
  std::stringstream text;
  text << std::ifstream{file, std::ios::binary}.rdbuf();
  return text.str();
}

std::string WebFab::upload(std::uint32_t layers) const {
  const auto tfc = write_tfc(table(layers / 2, layers - layers / 2), {}).value();
  return upload("table.tfc", {reinterpret_cast<const char*>(tfc.data()), tfc.size()}, true);
}

bool WebFab::act(const std::string& id, const std::string& action) const {
  return http_ask(port_, "POST", "/v1/jobs/" + id + "/" + action, "X-Api-Key: " + token_ + "\r\n")
      .starts_with("HTTP/1.1 200");
}

std::string WebFab::upload(const std::string& name, std::string_view tfc, bool print) const {
  const std::string body = "--XX\r\nContent-Disposition: form-data; name=\"file\"; filename=\"" + name + "\"\r\n\r\n" +
                           std::string{tfc} + "\r\n--XX\r\nContent-Disposition: form-data; name=\"print\"\r\n\r\n" +
                           (print ? "true" : "false") + "\r\n--XX--\r\n";
  const std::string answer =
      http_ask(port_, "POST", "/api/files/local",
               "X-Api-Key: " + token_ + "\r\nContent-Type: multipart/form-data; boundary=XX\r\n", body);
  const auto value = nlohmann::json::parse(http_body(answer), nullptr, false);
  if (value.is_discarded() || !value.contains("files")) throw std::runtime_error("the upload failed: " + answer);
  return value["files"]["local"]["path"];
}

nlohmann::json WebFab::job(const std::string& id) const {
  return nlohmann::json::parse(http_body(http_ask(port_, "GET", "/v1/jobs/" + id)), nullptr, false);
}

bool WebFab::wait_for(const std::string& id, const std::string& state, double patience_s) const {
  SystemClock clock;
  const Nanoseconds end = clock.now() + Nanoseconds{static_cast<std::int64_t>(patience_s * 1e9)};
  while (clock.now() < end) {
    const auto now = job(id);
    const std::string seen = now.is_object() ? now.value("state", "") : "";
    if (seen == state) return true;
    if (seen == "done" || seen == "failed" || seen == "cancelled") return false;
    clock.sleep_for(std::chrono::milliseconds{50});
  }
  return false;
}

WebFab::Use WebFab::use() const {
  std::istringstream stat{text_of(fmt::format("/proc/{}/stat", process_->id()))};
  std::string word;
  for (int i = 0; i < 13; ++i) stat >> word;  // the name has no blank
  double user = 0, system = 0;
  stat >> user >> system;
  std::istringstream memory{text_of(fmt::format("/proc/{}/statm", process_->id()))};
  double all = 0, resident = 0;
  memory >> all >> resident;
  return {(user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK)),
          resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6};
}

bool WebFab::is_alive() const { return http_ask(port_, "GET", "/v1/health").starts_with("HTTP/1.1 200"); }

}  // namespace telefab::test
