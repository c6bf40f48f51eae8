// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/fab/print/print_record.hpp>

// An as-built record, bare or sealed: what is read is written and read back without a change, and can be judged.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  if (const auto sealed = fab::unseal(text, ""); !sealed && sealed.error().what.empty()) std::abort();
  const auto record = fab::print_record_from_json(text);
  if (!record) {
    if (record.error().what.empty()) std::abort();
    return 0;
  }
  const auto again = fab::print_record_from_json(to_json(*record));
  if (!again || to_json(*again) != to_json(*record)) std::abort();
  const auto sealed = fab::seal(*record, "");
  if (!sealed || !fab::unseal(*sealed, "")) std::abort();
  fab::PrintPlan plan;
  for (std::uint32_t i = 0; i < 3; ++i)
    plan.layers.push_back({LayerIndex{i}, 0.1 * (i + 1), std::chrono::microseconds{1000}, {}});
  (void)compare(*record, plan);
  return 0;
}
