// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/service/file_sender.hpp>

namespace telefab {
namespace {

constexpr std::size_t kBlockBytes = 256U << 10U;
constexpr std::size_t kQueueAheadBytes = 1U << 20U;

}  // namespace

Result<void> FileSender::add(RequestId request, const std::filesystem::path& path) {
  Sending sending{request, std::ifstream{path, std::ios::binary}, 0, 0};
  std::error_code error;
  sending.size = std::filesystem::file_size(path, error);
  if (error || !sending.file)
    return fail(ErrorCode::StorageFailed, fmt::format("cannot read {}", path.filename().string()));
  sending_.push_back(std::move(sending));
  return {};
}

void FileSender::pump(const net::Connection& connection, const std::function<void(const Message&)>& send) {
  while (!sending_.empty() && connection.queued_bytes() < kQueueAheadBytes) {
    Sending& sending = sending_.front();
    FileBlock block{sending.request, sending.offset, sending.size, {}};
    block.content.resize(std::min<std::uint64_t>(kBlockBytes, sending.size - sending.offset));
    sending.file.read(reinterpret_cast<char*>(block.content.data()),
                      static_cast<std::streamsize>(block.content.size()));
    const bool is_whole = static_cast<std::size_t>(sending.file.gcount()) == block.content.size();
    sending.offset += block.content.size();
    const bool is_last = !is_whole || sending.offset == sending.size;
    if (is_last) sending_.pop_front();
    if (is_whole)
      send(block);
    else
      send(Fault{block.request, {ErrorCode::StorageFailed, "the file changed while it was read"}, {}});
  }
}

}  // namespace telefab
