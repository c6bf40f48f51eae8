// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/web/operator_tokens.hpp>

#include "../scratch_file.hpp"

// The operators' tokens, a file of any bytes: refused and left as it is, or read; then one more is made, opens, and is
// revoked, and the others stay as they were.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const test::ScratchFile file{data, size};
  std::filesystem::permissions(file.path(), std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  const std::string bytes = file.bytes();
  const auto before = read_operator_tokens(file.path());
  const auto added = add_operator_token(file.path(), "fuzzed", Access::Readers, std::chrono::seconds{1});
  if (!before) {
    if (before.error().what.empty() || added || file.bytes() != bytes) std::abort();
    return 0;
  }
  const auto is_fuzzed = [](const OperatorToken& each) { return each.name == "fuzzed"; };
  if (!added) {
    if (added.error().code != ErrorCode::Conflict || std::none_of(before->begin(), before->end(), is_fuzzed))
      std::abort();
    return 0;
  }
  const auto with = read_operator_tokens(file.path());
  if (!with || with->size() != before->size() + 1) std::abort();
  const OperatorToken* owner = owner_of(*with, *added);
  if (owner == nullptr || owner->name != "fuzzed" || owner->may != Access::Readers) std::abort();
  if (owner_of(*before, *added) != nullptr) std::abort();
  if (!revoke_operator_token(file.path(), "fuzzed")) std::abort();
  if (const auto after = read_operator_tokens(file.path()); !after || *after != *before) std::abort();
  return 0;
}
