// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/base/result.hpp>

#include "scanout.hpp"

namespace telefab::fab {

// What a program and the guard of its screen tell each other: packets of one size each way, on one computer, between
// two processes of one build.

enum class GuardOrder : std::uint32_t { Open, Beat, Prepare, Show, Ask, Black };

/// From the program. Every order but Beat is answered once.
struct GuardRequest {
  GuardOrder order = GuardOrder::Beat;
  std::uint32_t number = 0;
  std::int64_t at_most_ns = 0;  ///< Show
  // Open: the settings; the shared frame comes along as an open file.
  std::uint32_t width_words = 0, height_px = 0, packing = 0;
  double refresh_hz = 0;
  char connector[256] = {};
  char edid[256] = {};
};

struct GuardReply {
  std::uint32_t number = 0;
  std::uint32_t error = 0;            ///< an ErrorCode; 0: none
  char text[1500] = {};               ///< why; of Open the name of the screen
  std::uint32_t is_shown = 0;         ///< Ask
  std::uint32_t has_tripped = 0;      ///< Ask: it went black for want of a sign of life
  std::int64_t tripped_after_ns = 0;  ///< Ask: from the last sign of life until it was black
  std::int64_t frame_ns = 0;          ///< Open
  std::uint32_t confirms = 0;
  BlackMeans means;  ///< Open; the card comes along as an open file
};

/// Sends one packet, and an open file with it where that is not -1. False: the other end is gone.
template <class Packet>
[[nodiscard]] bool send_packet(int socket, const Packet& packet, int file = -1);
/// The next packet, waiting for so long; nothing where none came. Fails where the other end is gone or sent no such
/// packet.
template <class Packet>
[[nodiscard]] Result<std::optional<Packet>> receive_packet(int socket, Nanoseconds patience, OpenFile* file = nullptr);

}  // namespace telefab::fab
