// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <signal.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <telefab/test/loopback.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <thread>

namespace telefab::test {

/// A headless Chromium driven over the WebDriver protocol (W3C WebDriver, 2018). Throws where the browser or the
/// driver does; for tests only.
class Browser {
 public:
  using Json = nlohmann::json;

  [[nodiscard]] static bool is_installed() {
    return std::filesystem::exists("/usr/bin/chromium") && std::filesystem::exists("/usr/bin/chromedriver");
  }

  Browser() {
    start_driver();
    const Json wanted{
        {"browserName", "chrome"},
        {"goog:chromeOptions",
         {{"binary", "/usr/bin/chromium"},
          {"args",
           {"--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
            "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--window-size=1200,1400", "--user-data-dir=" + profile_ + "/profile"}}}}};
    session_ =
        call("POST", "/session", {{"capabilities", {{"alwaysMatch", wanted}}}}).at("sessionId").get<std::string>();
  }
  ~Browser() {
    try {
      if (!session_.empty()) (void)call("DELETE", "/session/" + session_, nullptr);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "closing the browser: %s\n", error.what());
    }
    ::kill(driver_, SIGTERM);
    ::waitpid(driver_, nullptr, 0);
  }
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void open(const std::string& address) { (void)in_session("POST", "/url", {{"url", address}}); }
  /// Runs a function body in the page and gives what it returns.
  Json run(const std::string& body) {
    return in_session("POST", "/execute/sync", {{"script", body}, {"args", Json::array()}});
  }
  /// The same for a body that calls arguments[0] with what it gives.
  Json run_async(const std::string& body) {
    return in_session("POST", "/execute/async", {{"script", body}, {"args", Json::array()}});
  }
  /// The folder that every process of this browser has on its command line.
  [[nodiscard]] const std::string& profile() const { return profile_; }
  /// Runs `body` until it returns true, for at most ten seconds. Each look is a call of its own: one script that waits
  /// in the page would end with the page where that is loaded again.
  bool becomes_true(const std::string& body) {
    using std::chrono::steady_clock;
    for (const auto end = steady_clock::now() + std::chrono::seconds(10);;) {
      if (run("return Boolean((() => { " + body + " })());").get<bool>()) return true;
      if (steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  }
  /// Waits for the dialog, which may come after an answer of the server.
  void accept_dialog() {
    for (int tries = 0;; ++tries) {
      try {
        return (void)in_session("POST", "/alert/accept", Json::object());
      } catch (const std::exception& error) {
        if (tries == 100 || std::string_view{error.what()}.find("no such alert") == std::string_view::npos) throw;
        ::usleep(100'000);
      }
    }
  }
  void click(const std::string& css) { (void)in_session("POST", "/element/" + find(css) + "/click", Json::object()); }
  void type(const std::string& css, const std::string& text) {
    (void)in_session("POST", "/element/" + find(css) + "/value", {{"text", text}});
  }
  /// Keys as they come from the keyboard, wherever the focus is.
  void press(std::initializer_list<std::string> keys) {
    Json actions = Json::array();
    for (const std::string& key : keys)
      for (const char* type : {"keyDown", "keyUp"}) actions.push_back({{"type", type}, {"value", key}});
    const Json keyboard{{"type", "key"}, {"id", "keyboard"}, {"actions", actions}};
    (void)in_session("POST", "/actions", {{"actions", Json::array({keyboard})}});
  }
  /// The mouse goes to the first place, is pressed there and let go at the second; pixels of the window.
  void drag(std::array<int, 2> from, std::array<int, 2> to) {
    const auto move = [](std::array<int, 2> place) {
      return Json{{"type", "pointerMove"}, {"duration", 20}, {"x", place[0]}, {"y", place[1]}};
    };
    const Json actions{
        move(from), {{"type", "pointerDown"}, {"button", 0}}, move(to), {{"type", "pointerUp"}, {"button", 0}}};
    const Json mouse{{"type", "pointer"}, {"id", "mouse"}, {"actions", actions}};
    (void)in_session("POST", "/actions", {{"actions", Json::array({mouse})}});
  }
  void click_at(std::array<int, 2> place) { drag(place, place); }
  /// "dark" or "light", as the system's setting would be.
  void prefer_colours(const std::string& scheme) {
    const Json feature{{"name", "prefers-color-scheme"}, {"value", scheme}};
    (void)in_session("POST", "/goog/cdp/execute",
                     {{"cmd", "Emulation.setEmulatedMedia"}, {"params", {{"features", Json::array({feature})}}}});
  }
  void resize(int width_px, int height_px) {
    (void)in_session("POST", "/window/rect", {{"width", width_px}, {"height", height_px}});
  }
  /// Base64 of a PNG.
  std::string screenshot() { return in_session("GET", "/screenshot", nullptr).get<std::string>(); }

 private:
  /// The driver takes a free port of IPv6 and asks for the same of IPv4, which somebody may have taken meanwhile.
  void start_driver() {
    constexpr int kTries = 5;
    for (int tries = 1;; ++tries) {
      const std::string output = try_driver();
      if (port_ != 0) return;
      if (tries == kTries || output.find("port not available") == std::string::npos)
        throw std::runtime_error("chromedriver did not start: " + output);
    }
  }
  /// What it said; sets port_ where it runs.
  std::string try_driver() {
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error("no pipe");
    driver_ = ::fork();
    if (driver_ == 0) {
      ::dup2(ends[1], STDOUT_FILENO);
      ::close(ends[0]);
      ::execl("/usr/bin/chromedriver", "chromedriver", "--port=0", static_cast<char*>(nullptr));
      ::_exit(127);
    }
    ::close(ends[1]);
    std::string output;
    char buffer[512];
    constexpr std::string_view mark = "successfully on port ";
    while (port_ == 0) {
      const ssize_t got = ::read(ends[0], buffer, sizeof buffer);
      if (got <= 0) {
        ::close(ends[0]);
        ::waitpid(driver_, nullptr, 0);
        return output;
      }
      output.append(buffer, static_cast<std::size_t>(got));
      if (const auto at = output.find(mark); at != std::string::npos && output.find('.', at) != std::string::npos)
        port_ = static_cast<std::uint16_t>(std::stoi(output.substr(at + mark.size())));
    }
    output_ = ends[0];
    return output;
  }

  [[nodiscard]] std::string find(const std::string& css) {
    return in_session("POST", "/element", {{"using", "css selector"}, {"value", css}})
        .begin()
        .value()
        .get<std::string>();
  }
  Json in_session(const std::string& method, const std::string& path, const Json& body) {
    return call(method, "/session/" + session_ + path, body);
  }

  Json call(const std::string& method, const std::string& path, const Json& body) const {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    const timeval limit{30, 0};
    ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    const sockaddr_in address = loopback(port_);
    if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      ::close(fd);
      throw std::runtime_error("chromedriver is gone");
    }
    const std::string text = body.is_null() ? std::string{} : body.dump();
    const std::string request =
        method + " " + path +
        " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\nContent-Length: " +
        std::to_string(text.size()) + "\r\n\r\n" + text;
    (void)!::write(fd, request.data(), request.size());
    // The driver keeps the connection open whatever it is asked, so its Content-Length ends the answer.
    std::string answer;
    std::array<char, 65536> buffer{};
    while (!is_whole(answer)) {
      const ssize_t got = ::read(fd, buffer.data(), buffer.size());
      if (got <= 0) break;
      answer.append(buffer.data(), static_cast<std::size_t>(got));
    }
    ::close(fd);
    const auto end = answer.find("\r\n\r\n");
    if (end == std::string::npos) throw std::runtime_error("chromedriver gave no answer to " + path);
    const Json value = Json::parse(answer.substr(end + 4)).at("value");
    if (value.is_object() && value.contains("error")) throw std::runtime_error(path + ": " + value.dump());
    return value;
  }

  [[nodiscard]] static bool is_whole(const std::string& answer) {
    const auto end = answer.find("\r\n\r\n");
    if (end == std::string::npos) return false;
    std::string head = answer.substr(0, end);
    for (char& c : head) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    constexpr std::string_view field = "content-length:";
    const auto at = head.find(field);
    return at != std::string::npos && answer.size() - end - 4 >= std::stoul(head.substr(at + field.size()));
  }

  ScratchFolder folder_;
  std::string profile_ = folder_.path().string();
  std::string session_;
  pid_t driver_ = -1;
  int output_ = -1;
  std::uint16_t port_ = 0;
};

}  // namespace telefab::test
