// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>
#include <string>
#include <telefab/net/listener.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/wire/message.hpp>
#include <vector>

namespace telefab::test {

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
