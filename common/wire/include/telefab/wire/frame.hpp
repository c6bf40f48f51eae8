// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// Which message a frame carries. Numbers cross the wire: never renumber, never reuse.
enum class FrameType : std::uint16_t {
  Hello = 1,
  Fault = 2,
  Ping = 3,
  Pong = 4,
  AskMachines = 10,
  Machines = 11,
  Submit = 12,
  UploadReady = 13,
  UploadBlock = 14,
  AskJobs = 15,
  Jobs = 16,
  Command = 17,
  AskFiles = 18,
  Files = 19,
  AskFile = 20,
  FileBlock = 21,
  Offer = 30,
  OfferAccepted = 31,
  SendChunk = 32,
  ChunkStored = 33,
  StackEnd = 34,
  StackStored = 35,
  JobChanged = 36,
  OfferDeferred = 37,
};

/// One message on the wire: its type and its Protobuf body.
struct Frame {
  FrameType type{};
  std::vector<std::byte> body;
  friend bool operator==(const Frame&, const Frame&) = default;
};

inline constexpr std::size_t kMaxBodyBytes = 4U << 20U;     ///< longer frames are refused before memory is taken
inline constexpr std::size_t kMaxHelloBytes = 256U << 10U;  ///< the same for a peer that has not said hello yet
inline constexpr std::size_t kFrameHeaderBytes = 12;

/// Header and body, ready to be sent: "TF", type (2), body length (4), CRC-32 of type, length and body (4), body;
/// all integers little-endian. TooLarge above kMaxBodyBytes.
[[nodiscard]] Result<std::vector<std::byte>> to_bytes(const Frame& frame);

/// Turns a byte stream into frames. Owns no socket, starts no timer. The same bytes give the same frames however
/// they are split.
class FrameReader {
 public:
  explicit FrameReader(std::size_t max_body_bytes = kMaxBodyBytes) : max_body_bytes_{max_body_bytes} {}
  void feed(std::span<const std::byte> bytes);
  /// A frame; nothing yet; or ProtocolBroken, after which the reader stays broken and drops what it is fed.
  [[nodiscard]] Result<std::optional<Frame>> take();
  /// For frames whose header has not been read yet.
  void set_max_body(std::size_t max_body_bytes) { max_body_bytes_ = max_body_bytes; }
  /// True between the first byte of a frame and its last: the peer owes us bytes.
  [[nodiscard]] bool is_inside_frame() const { return !broken_ && used_ < buffer_.size(); }

 private:
  std::size_t max_body_bytes_;
  std::vector<std::byte> buffer_;
  std::size_t used_ = 0;  ///< bytes of the buffer that were taken as frames
  std::optional<Error> broken_;
};

}  // namespace telefab
