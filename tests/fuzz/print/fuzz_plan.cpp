// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/fab/print/print_plan.hpp>

// A plan that is read is safe to print: it validates, and it is written and read back without a change.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab::fab;
  const auto plan = print_plan_from_json({reinterpret_cast<const char*>(data), size});
  if (!plan) {
    if (plan.error().what.empty()) std::abort();
    return 0;
  }
  if (!plan->validate()) std::abort();
  for (const PlannedLayer& layer : plan->layers)
    if (layer.exposure < std::chrono::microseconds{0} || layer.exposure > std::chrono::hours{1}) std::abort();
  const auto again = print_plan_from_json(to_json(*plan));
  if (!again || *again != *plan || plan_digest(*again) != plan_digest(*plan)) std::abort();
  return 0;
}
