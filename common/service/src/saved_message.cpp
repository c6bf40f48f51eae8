// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <span>
#include <telefab/base/file.hpp>
#include <telefab/service/saved_message.hpp>

namespace telefab {
namespace {

constexpr const char* kOffer = "offer";
constexpr const char* kEnd = "end";

Result<void> save(const std::filesystem::path& path, const Message& message) {
  const auto bytes = to_bytes(to_frame(message));
  if (!bytes) return tl::unexpected{bytes.error()};
  return write_file_atomically(path, std::span<const std::byte>{*bytes});
}

template <class Value>
Result<Value> saved(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxBodyBytes + kFrameHeaderBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  FrameReader reader;
  reader.feed(*bytes);
  auto frame = reader.take();
  if (!frame) return fail_in(path.string(), frame.error());
  if (!*frame) return fail(ErrorCode::InvalidInput, fmt::format("{} is truncated", path.string()));
  auto message = from_frame(**frame);
  if (!message) return fail_in(path.string(), message.error());
  if (auto* value = std::get_if<Value>(&*message)) return std::move(*value);
  return fail(ErrorCode::InvalidInput, fmt::format("{} holds another message", path.string()));
}

}  // namespace

Result<void> save_offer(const std::filesystem::path& folder, const Offer& offer) {
  return save(folder / kOffer, offer);
}

Result<void> save_end(const std::filesystem::path& folder, const StackEnd& end) { return save(folder / kEnd, end); }

Result<Offer> saved_offer(const std::filesystem::path& folder) { return saved<Offer>(folder / kOffer); }

Result<StackEnd> saved_end(const std::filesystem::path& folder) { return saved<StackEnd>(folder / kEnd); }

}  // namespace telefab
