// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>
#include <poll.h>

#include <nlohmann/json.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>

namespace telefab::test {

/// Both sites, the scan site with a page.
class ScanPageSite : public TwoSites {
 protected:
  struct Answer {
    int status = 0;
    std::string body;
    [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(body, nullptr, false); }
  };

  void start_with_page() {
    start_fab();
    start_scan_with_page();
  }
  void start_scan_with_page() {
    start_scan({"--web", "127.0.0.1:0"});
    web_port_ = static_cast<std::uint16_t>(std::stoi(text_of(folder() / "scan" / "web-port")));
    token_ = text_of(folder() / "scan" / "web-token");
    token_.erase(token_.find_last_not_of('\n') + 1);
  }
  [[nodiscard]] std::uint16_t web_port() const { return web_port_; }
  [[nodiscard]] const std::string& token() const { return token_; }

  [[nodiscard]] Answer ask(const std::string& method, const std::string& target, const std::string& body = {}) const {
    const std::string answer = http_ask(web_port_, method, target, "Authorization: Bearer " + token_ + "\r\n", body);
    return {answer.size() > 12 ? std::atoi(answer.c_str() + 9) : 0, http_body(answer)};
  }
  [[nodiscard]] nlohmann::json begin(const std::string& name, const std::string& bytes) const {
    const nlohmann::json announced{
        {"name", name}, {"size_bytes", bytes.size()}, {"sha256", to_hex(digest_of(std::as_bytes(std::span{bytes})))}};
    return ask("POST", "/v1/uploads", announced.dump()).json();
  }
  /// What is missing of it, in parts of so many bytes.
  void send_rest(nlohmann::json view, const std::string& bytes, std::size_t part) const {
    while (view["state"] == "receiving") {
      const auto from = view["received_bytes"].get<std::size_t>();
      const Answer answer = ask("POST", fmt::format("/v1/uploads/{}/part?from={}", view["id"].get<std::string>(), from),
                                bytes.substr(from, part));
      ASSERT_EQ(answer.status, 200) << answer.body;
      view = answer.json();
    }
  }
  /// All of a file in one part; the id of its upload.
  [[nodiscard]] std::string upload(const std::string& name, const std::string& bytes) const {
    const nlohmann::json begun = begin(name, bytes);
    send_rest(begun, bytes, bytes.size());
    return begun["id"];
  }
  /// The view once nothing is worked on any more.
  [[nodiscard]] nlohmann::json rested(const std::string& id) const {
    for (int tries = 0; tries < 600; ++tries) {
      const nlohmann::json view = ask("GET", "/v1/uploads/" + id).json();
      bool is_working = view["state"] == "checking";
      for (const char* what : {"reading", "look", "estimate", "orientation"})
        is_working |= view[what]["state"] == "working";
      if (!is_working) return view;
      ::poll(nullptr, 0, 50);
    }
    ADD_FAILURE() << "the stager did not come to rest";
    return {};
  }
  [[nodiscard]] nlohmann::json ended(const std::string& job) const {
    nlohmann::json view;
    for (int tries = 0; tries < 1200; ++tries) {
      view = ask("GET", "/v1/jobs/" + job).json();
      if (view["state"] == "done" || view["state"] == "failed" || view["state"] == "cancelled") return view;
      ::poll(nullptr, 0, 50);
    }
    ADD_FAILURE() << view.dump();
    return view;
  }

 private:
  std::uint16_t web_port_ = 0;
  std::string token_;
};

}  // namespace telefab::test
