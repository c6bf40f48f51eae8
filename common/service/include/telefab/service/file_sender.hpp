// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <filesystem>
#include <fstream>
#include <functional>
#include <telefab/net/connection.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// Files on their way out over one connection, block by block, never more queued than the connection takes.
/// Threads: the loop's only.
class FileSender {
 public:
  /// StorageFailed where the file cannot be read.
  [[nodiscard]] Result<void> add(RequestId request, const std::filesystem::path& path);
  /// Gives blocks to `send` while the connection's queue is short. `send` may clear the sender.
  void pump(const net::Connection& connection, const std::function<void(const Message&)>& send);
  void clear() { sending_.clear(); }
  [[nodiscard]] std::size_t size() const { return sending_.size(); }

 private:
  struct Sending {
    RequestId request{};
    std::ifstream file;
    std::uint64_t offset = 0;
    std::uint64_t size = 0;
  };
  std::deque<Sending> sending_;
};

}  // namespace telefab
