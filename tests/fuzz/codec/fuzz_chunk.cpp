// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <telefab/codec/stack_codec.hpp>

// Any bytes as the payload of a chunk of eight layers: an error, or layers that keep every promise of the header.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  StackHeader header;
  header.machine = "m";
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = 8;
  header.bounds = {{0, 0}, {260, 160}};
  Chunk chunk;
  chunk.layer_count = 8;
  const auto* bytes = reinterpret_cast<const std::byte*>(data);
  chunk.payload.assign(bytes, bytes + size);
  const auto layers = StackDecoder::start(header)->decode(chunk);
  if (!layers) return 0;
  for (const Layer& layer : *layers)
    if (!validate_layer(header, layer)) std::abort();
  return 0;
}
