// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/job/slice_parameters.hpp>

// What a job asks of its slicing: an error, or values that are legal and are written and read back without a change.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const auto asked = slice_parameters_from_json({reinterpret_cast<const char*>(data), size});
  if (!asked) {
    if (asked.error().what.empty()) std::abort();
    return 0;
  }
  if (!validate(*asked)) std::abort();
  const auto again = slice_parameters_from_json(to_json(*asked));
  if (!again || *again != *asked) std::abort();
  return 0;
}
