// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>

#include "part_bytes.hpp"

// Any bytes as a part whose digest holds: an error, or layers that a stack may have.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  using namespace telefab::scan;
  const auto given = std::as_bytes(std::span{data, size});
  const std::vector<std::byte> sealed = with_seal({given.begin(), given.end()});
  const auto parts = PartSequence::of({{"part", [&]() -> Result<std::vector<std::byte>> { return sealed; }}}, {});
  if (!parts) {
    if (parts.error().what.empty()) std::abort();
    return 0;
  }
  const LayerSink sink = [](const StackHeader& header, Layer&& layer) -> Result<void> {
    if (!validate_layer(header, layer)) std::abort();
    return {};
  };
  const auto report = parts->replay(sink, {}, {});
  if (report && to_json(*report).empty()) std::abort();
  return 0;
}
