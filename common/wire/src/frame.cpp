// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <telefab/wire/frame.hpp>

namespace telefab {
namespace {

constexpr std::array kKnown{
    FrameType::Hello,       FrameType::Fault,         FrameType::Ping,       FrameType::Pong,
    FrameType::AskMachines, FrameType::Machines,      FrameType::Submit,     FrameType::UploadReady,
    FrameType::UploadBlock, FrameType::AskJobs,       FrameType::Jobs,       FrameType::Command,
    FrameType::AskFiles,    FrameType::Files,         FrameType::AskFile,    FrameType::FileBlock,
    FrameType::Offer,       FrameType::OfferAccepted, FrameType::SendChunk,  FrameType::ChunkStored,
    FrameType::StackEnd,    FrameType::StackStored,   FrameType::JobChanged, FrameType::OfferDeferred};

void put(std::byte* at, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) at[i] = static_cast<std::byte>(value >> (8 * i));
}

std::uint32_t get(const std::byte* at, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value |= static_cast<std::uint32_t>(at[i]) << (8 * i);
  return value;
}

/// Over type and length (bytes 2 to 7 of the header) and the body.
std::uint32_t check_of(const std::byte* header, const std::byte* body, std::size_t size) {
  uLong crc = crc32(0, reinterpret_cast<const Bytef*>(header + 2), 6);
  crc = crc32(crc, reinterpret_cast<const Bytef*>(body), static_cast<uInt>(size));
  return static_cast<std::uint32_t>(crc);
}

}  // namespace

Result<std::vector<std::byte>> to_bytes(const Frame& frame) {
  if (frame.body.size() > kMaxBodyBytes)
    return fail(ErrorCode::TooLarge, fmt::format("a message of {} bytes is above the limit of {} bytes a frame",
                                                 frame.body.size(), kMaxBodyBytes));
  std::vector<std::byte> bytes(kFrameHeaderBytes + frame.body.size());
  bytes[0] = std::byte{'T'};
  bytes[1] = std::byte{'F'};
  put(&bytes[2], static_cast<std::uint32_t>(frame.type), 2);
  put(&bytes[4], static_cast<std::uint32_t>(frame.body.size()), 4);
  std::copy(frame.body.begin(), frame.body.end(), bytes.begin() + kFrameHeaderBytes);
  put(&bytes[8], check_of(bytes.data(), bytes.data() + kFrameHeaderBytes, frame.body.size()), 4);
  return bytes;
}

void FrameReader::feed(std::span<const std::byte> bytes) {
  if (broken_) return;
  if (used_ > 0 && used_ == buffer_.size()) {
    buffer_.clear();
    used_ = 0;
  } else if (used_ > (64U << 10U)) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(used_));
    used_ = 0;
  }
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

Result<std::optional<Frame>> FrameReader::take() {
  if (broken_) return tl::unexpected{*broken_};
  const auto refuse = [&](std::string what) -> Result<std::optional<Frame>> {
    broken_ = Error{ErrorCode::ProtocolBroken, std::move(what)};
    buffer_ = {};
    used_ = 0;
    return tl::unexpected{*broken_};
  };
  const std::byte* header = buffer_.data() + used_;
  const std::size_t available = buffer_.size() - used_;
  // Refused as early as the bytes allow: a peer that nobody knows shall not be able to make us wait for the rest of
  // nonsense.
  if (available >= 1 && header[0] == std::byte{'H'})
    return refuse("frame-mark: the other side speaks HTTP, as a web page does; give the port of the site itself");
  if ((available >= 1 && header[0] != std::byte{'T'}) || (available >= 2 && header[1] != std::byte{'F'}))
    return refuse("frame-mark: the bytes are no Telefab frame; does the other side speak this protocol without TLS?");
  if (available < kFrameHeaderBytes) return std::optional<Frame>{};
  const auto type = static_cast<FrameType>(get(header + 2, 2));
  if (std::find(kKnown.begin(), kKnown.end(), type) == kKnown.end())
    return refuse(fmt::format("frame-type: {} is not a frame of this version", static_cast<int>(type)));
  const std::size_t size = get(header + 4, 4);
  if (size > max_body_bytes_)
    return refuse(fmt::format("frame-size: a body of {} bytes is above the limit of {}", size, max_body_bytes_));
  if (available < kFrameHeaderBytes + size) return std::optional<Frame>{};
  if (get(header + 8, 4) != check_of(header, header + kFrameHeaderBytes, size))
    return refuse("frame-check: the CRC does not hold; the bytes were changed on their way");
  Frame frame{type, {header + kFrameHeaderBytes, header + kFrameHeaderBytes + size}};
  used_ += kFrameHeaderBytes + size;
  return std::optional<Frame>{std::move(frame)};
}

}  // namespace telefab
