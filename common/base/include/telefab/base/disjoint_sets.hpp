// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace telefab {

/// Which of the members 0 .. count - 1 hang together; each alone at first. Union-find with path halving: what is found
/// does not depend on the order of join().
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count = 0) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0U); }

  [[nodiscard]] std::size_t size() const { return parent_.size(); }
  /// One more member, alone; its number.
  std::uint32_t add() {
    parent_.push_back(static_cast<std::uint32_t>(parent_.size()));
    return parent_.back();
  }

  /// The lowest member of the set of `member`.
  [[nodiscard]] std::uint32_t root(std::uint32_t member) {
    while (parent_[member] != member) member = parent_[member] = parent_[parent_[member]];
    return member;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a), b = root(b);
    if (a != b) parent_[std::max(a, b)] = std::min(a, b);
  }
  /// The number of its set for every member; sets are counted from 0 by their lowest members.
  [[nodiscard]] std::vector<std::uint32_t> numbers() {
    std::vector<std::uint32_t> number(parent_.size());
    std::uint32_t sets = 0;
    for (std::uint32_t member = 0; member < number.size(); ++member) {
      const std::uint32_t lowest = root(member);
      number[member] = lowest == member ? sets++ : number[lowest];
    }
    return number;
  }

 private:
  std::vector<std::uint32_t> parent_;  ///< never above the member itself
};

}  // namespace telefab
