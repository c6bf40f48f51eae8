// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stdlib.h>

#include <filesystem>
#include <string>
#include <telefab/net/listener.hpp>
#include <telefab/wire/message.hpp>
#include <vector>

namespace telefab::test {

/// A folder that goes with its owner.
class SoakFolder {
 public:
  SoakFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "telefab-soak-XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~SoakFolder() { std::filesystem::remove_all(path_); }
  SoakFolder(const SoakFolder&) = delete;
  SoakFolder& operator=(const SoakFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// One end of a conversation: what it received, and why it ended.
struct Speaker {
  net::ConnectionPtr connection;
  std::vector<Message> received;
  std::optional<Error> lost;

  void start() {
    connection->start({[this](const Frame& frame) {
                         if (auto message = from_frame(frame)) received.push_back(std::move(*message));
                       },
                       {},
                       [this](const Error& why) { lost = why; }});
  }
  [[nodiscard]] bool send(const Message& message) const { return connection->send(to_frame(message)).has_value(); }
  /// The last message of a kind; null: none came.
  template <class Kind>
  [[nodiscard]] const Kind* last() const {
    for (auto each = received.rbegin(); each != received.rend(); ++each)
      if (const auto* wanted = std::get_if<Kind>(&*each)) return wanted;
    return nullptr;
  }
};

}  // namespace telefab::test
