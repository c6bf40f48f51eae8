// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstddef>
#include <cstdint>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/usbip_session.hpp>

// Any bytes from a USB/IP client, cut anywhere: refused or answered, never more than its limits.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  VirtualClock clock;
  fab::Dlpc900Model projector{1, 6, clock, nullptr};
  projector.add_up_dose(false);
  fab::GrblModel stage{25, clock, nullptr};
  const auto projector_peer = fab::make_projector_peer(projector, "P");
  const auto stage_peer = fab::make_stage_peer(stage, "S");
  fab::UsbIpSession session{{projector_peer.get(), stage_peer.get()}};
  const auto bytes = std::as_bytes(std::span{data, size});
  const std::size_t cut = size == 0 ? 0 : data[0] % size;
  if (!session.feed(bytes.first(cut)) || !session.feed(bytes.subspan(cut))) return 0;
  clock.advance(std::chrono::milliseconds{20});
  session.advance();
  (void)session.take();
  return 0;
}
