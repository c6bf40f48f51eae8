// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <telefab/codec/tfc_file.hpp>

// Any bytes as a .tfc file: an error, or a stack that is written back to the same bytes' meaning.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const auto stack = read_tfc({reinterpret_cast<const std::byte*>(data), size});
  if (!stack) return 0;
  if (digest_of(*stack) !=
      digest_of(*LayerStack::from_layers(stack->header(), {stack->layers().begin(), stack->layers().end()})))
    std::abort();
  return 0;
}
