// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace telefab {

/// Number of each key, counted up from 0 in the order of first appearance. Open addressing; nothing is ever removed.
class KeyTable {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;

  /// The key's number, and whether it is new.
  std::pair<std::uint32_t, bool> number(std::uint64_t key) {
    if (2 * (keys_.size() + 1) > slots_.size()) grow();
    std::uint32_t& slot = slots_[find(key)];
    if (slot != kNone) return {slot, false};
    slot = static_cast<std::uint32_t>(keys_.size());
    keys_.push_back(key);
    return {slot, true};
  }
  /// kNone where the key is not known.
  [[nodiscard]] std::uint32_t known(std::uint64_t key) const { return slots_.empty() ? kNone : slots_[find(key)]; }
  [[nodiscard]] const std::vector<std::uint64_t>& keys() const { return keys_; }

 private:
  [[nodiscard]] std::size_t find(std::uint64_t key) const {
    std::uint64_t h = key * 0x9e3779b97f4a7c15ULL;
    std::size_t at = (h >> 32U) & (slots_.size() - 1);
    while (slots_[at] != kNone && keys_[slots_[at]] != key) at = (at + 1) & (slots_.size() - 1);
    return at;
  }
  void grow() {
    slots_.assign(slots_.empty() ? 256 : 2 * slots_.size(), kNone);
    for (std::size_t i = 0; i < keys_.size(); ++i) slots_[find(keys_[i])] = static_cast<std::uint32_t>(i);
  }
  std::vector<std::uint32_t> slots_;
  std::vector<std::uint64_t> keys_;
};

}  // namespace telefab
