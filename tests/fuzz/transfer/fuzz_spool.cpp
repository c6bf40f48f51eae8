// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/transfer/chunk_spool.hpp>

#include "../scratch_file.hpp"

// A spool of any bytes: refused, or opened with every chunk readable and its end where the next one can begin.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const test::ScratchFile file{data, size};
  {
    auto spool = ChunkSpool::open(file.path());
    if (!spool) {
      if (spool.error().what.empty()) std::abort();
      return 0;
    }
    for (std::uint32_t n = 0; n < spool->chunk_count(); ++n)
      if (!spool->read(n)) std::abort();
    if (spool->finished()) return 0;
    const std::byte payload[] = {std::byte{1}, std::byte{2}};
    if (const auto kept = spool->append(LayerIndex{spool->layer_count()}, 1, payload); !kept) std::abort();
  }
  const auto again = ChunkSpool::open(file.path());
  if (!again || again->damaged()) std::abort();
  return 0;
}
