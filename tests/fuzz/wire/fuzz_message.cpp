// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <telefab/wire/message.hpp>

// Two bytes of frame type, then a body: an error, or a message that is written and read back without a change.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  if (size < 2) return 0;
  Frame frame;
  frame.type = static_cast<FrameType>(data[0] | (data[1] << 8));
  const auto* bytes = reinterpret_cast<const std::byte*>(data);
  frame.body.assign(bytes + 2, bytes + size);
  const auto message = from_frame(frame);
  if (!message) return 0;
  const Frame once = to_frame(*message);
  const auto again = from_frame(once);
  if (!again || !(to_frame(*again) == once)) std::abort();
  return 0;
}
