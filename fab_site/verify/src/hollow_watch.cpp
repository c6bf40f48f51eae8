// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/verify/hollow_watch.hpp>

namespace telefab::fab {

std::uint32_t HollowWatch::root(std::uint32_t i) const {
  while (spaces_[i].parent != i) i = spaces_[i].parent;
  return i;
}

void HollowWatch::join(std::uint32_t a, std::uint32_t b) {
  a = root(a), b = root(b);
  if (a == b) return;
  Space &keep = spaces_[std::min(a, b)], &gone = spaces_[std::max(a, b)];
  gone.parent = std::min(a, b);
  // A cup that opens into the outside was a cup all the same; one that only meets another cup is one cup.
  if (keep.open != gone.open) list_cup(keep.open ? gone : keep);
  keep.open |= gone.open;
  keep.was_cup |= gone.was_cup;
  keep.hollow.holds_support |= gone.hollow.holds_support;
  keep.hollow.most_pixels = std::max(keep.hollow.most_pixels, gone.hollow.most_pixels);
  keep.hollow.first = std::min(keep.hollow.first, gone.hollow.first);
  keep.hollow.last = std::max(keep.hollow.last, gone.hollow.last);
}

void HollowWatch::list_cup(Space& space) {
  if (space.was_cup || space.hollow.most_pixels < least_ || space.hollow.last == space.hollow.first) return;
  space.was_cup = true;
  found_.push_back(space.hollow);
  found_.back().kind = Hollow::Kind::Cup;
}

void HollowWatch::add(const LayerRuns& solid, const LayerRuns* removable) {
  LayerRuns empty = solid.complement();
  RunComponents gaps = components_of(empty, false);
  const auto first = static_cast<std::uint32_t>(spaces_.size());
  for (const RunComponents::Component& c : gaps.components) {
    Space space;
    space.parent = static_cast<std::uint32_t>(spaces_.size());
    space.open = c.touches_edge;
    space.hollow = {Hollow::Kind::Trap, layers_, layers_, c.column, c.row, c.pixels, false};
    spaces_.push_back(space);
  }
  if (layers_ > 0)
    for_overlaps(empty, empty_, [&](std::uint32_t here, std::uint32_t below) {
      join(first + gaps.of_run[here], space_of_run_[below]);
    });
  space_of_run_.resize(empty.count());
  for (std::uint32_t r = 0; r < empty.count(); ++r) {
    const std::uint32_t top = root(first + gaps.of_run[r]);
    // Later walks from here are short.
    spaces_[first + gaps.of_run[r]].parent = space_of_run_[r] = top;
    spaces_[top].hollow.last = layers_;
  }
  if (removable != nullptr)
    for_overlaps(empty, *removable, [&](std::uint32_t here, std::uint32_t) {
      spaces_[root(space_of_run_[here])].hollow.holds_support = true;
    });
  empty_ = std::move(empty);
  gaps_ = std::move(gaps);
  ++layers_;
}

std::vector<HollowWatch::Opening> HollowWatch::openings() const {
  std::vector<Opening> found;
  std::vector<std::int64_t> number(gaps_.components.size(), -1);
  for (std::uint32_t r = 0; r < empty_.count(); ++r) {
    const Space& space = spaces_[space_of_run_[r]];
    if (space.open) continue;
    std::int64_t& at = number[gaps_.of_run[r]];
    if (at < 0) {
      at = static_cast<std::int64_t>(found.size());
      found.push_back({r, {}, space.hollow.first});
    }
    found[static_cast<std::size_t>(at)].runs.push_back(r);
  }
  return found;
}

std::vector<Hollow> HollowWatch::finish() {
  // What is still open upwards at the last layer drains; what closed below it is a trap.
  std::vector<char> reaches_top(spaces_.size());
  for (const std::uint32_t space : space_of_run_) reaches_top[root(space)] = 1;
  for (std::uint32_t i = 0; i < spaces_.size(); ++i) {
    Space& space = spaces_[i];
    if (space.parent != i || space.open || space.hollow.most_pixels < least_) continue;
    if (reaches_top[i])
      list_cup(space);
    else if (space.hollow.last > space.hollow.first)
      found_.push_back(space.hollow);
  }
  std::vector<Hollow> found = std::move(found_);
  *this = HollowWatch{least_};
  return found;
}

}  // namespace telefab::fab
