// SPDX-License-Identifier: GPL-3.0-or-later
#include "load_core.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kNone = ~std::uint32_t{0};

std::uint32_t other_end(const CoreEdge& edge, std::uint32_t node) { return edge.a == node ? edge.b : edge.a; }
/// The same edge, looked at from `node`.
CoreEdge from(CoreEdge edge, std::uint32_t node) {
  if (edge.a != node) std::swap(edge.a, edge.b);
  return edge;
}

}  // namespace

LoadCore::LoadCore(const LoadPath& path)
    : path_{&path},
      at_(path.pieces().size() + 1),
      weight_(path.pieces().size() + 1),
      number_(path.pieces().size() + 1, kNone) {
  for (std::uint32_t p = 0; p < path.pieces().size(); ++p) {
    const Piece& piece = path.pieces()[p];
    const double units = path.weight_of(piece);
    if (node_of(p) != 0) weight_[node_of(p)] = {units, units * piece.middle.x_mm, units * piece.middle.y_mm};
  }
}

std::vector<std::uint32_t>& LoadCore::edges_at(std::uint32_t node) {
  auto& edges = at_[node];
  std::erase_if(edges, [this](std::uint32_t e) { return is_gone_[e] != 0; });
  return edges;
}

void LoadCore::link(const CoreEdge& edge) {
  const auto number = static_cast<std::uint32_t>(edges_.size());
  edges_.push_back(edge);
  is_gone_.push_back(0);
  at_[edge.a].push_back(number);
  if (edge.b != 0) at_[edge.b].push_back(number);  // nobody asks what stands on the platform
}

/// A node that is taken out leaves its weight to another.
void LoadCore::hang(std::uint32_t node, std::uint32_t on) {
  const Weight gone = std::exchange(weight_[node], {});
  if (on == 0) return;
  weight_[on].units += gone.units, weight_[on].x_mm += gone.x_mm, weight_[on].y_mm += gone.y_mm;
}

/// Takes out nodes that more layers cannot reach: ends in the resin, and those between two edges.
void LoadCore::shorten(std::uint32_t node, std::uint32_t top_first) {
  while (node != 0 && node < top_first) {
    const auto& edges = edges_at(node);
    if (edges.empty() || edges.size() > 2) return;
    const std::uint32_t first = edges[0];
    const CoreEdge one = from(edges_[first], node);
    if (edges.size() == 1) {
      is_gone_[first] = 1;
      at_[node].clear();
      hang(node, one.b);
      node = one.b;
      continue;
    }
    const std::uint32_t second = edges[1];
    const CoreEdge two = from(edges_[second], node);
    is_gone_[first] = is_gone_[second] = 1;
    at_[node].clear();
    const auto sections = path_->sections();
    const bool is_first = sections[one.section].pixels <= sections[two.section].pixels;
    hang(node, is_first ? two.b : one.b);
    if (one.b == two.b) {
      node = one.b;
      continue;
    }
    CoreEdge both{one.b, two.b, is_first ? one.section : two.section, one.softness + two.softness};
    if (both.a == 0) both = from(both, both.b);
    link(both);
    return;
  }
}

Moment LoadCore::add() {
  const std::uint32_t layer = next_++;
  const auto sections = path_->sections();
  for (std::uint32_t s = path_->first_section(layer); s < path_->first_section(layer + 1); ++s)
    link({node_of(sections[s].upper), node_of(sections[s].lower), s, path_->thickness_mm() / sections[s].area_mm2});
  const std::uint32_t top_first = path_->first_piece(layer) + 1;
  if (layer > 1)
    for (std::uint32_t p = path_->first_piece(layer - 1); p < path_->first_piece(layer); ++p)
      shorten(node_of(p), top_first);
  return moment(layer);
}

Moment LoadCore::moment(std::uint32_t layer) {
  Moment out;
  out.layer = layer;
  if (layer == 0) return out;
  std::vector<std::uint32_t> reached;
  for (std::uint32_t p = path_->first_piece(layer); p < path_->first_piece(layer + 1); ++p) {
    if (path_->pieces()[p].pulled == 0) continue;
    if (!path_->stands(p)) {
      out.afloat += path_->pieces()[p].pulled;
      continue;
    }
    const std::uint32_t node = node_of(p);
    number_[node] = static_cast<std::uint32_t>(out.pieces.size());
    out.pieces.push_back(p);
    reached.push_back(node);
    out.loads.push_back({number_[node], path_->pieces()[p].pulled, path_->pieces()[p].pulled_at});
  }
  for (std::size_t i = 0; i < reached.size(); ++i) {
    const std::uint32_t node = reached[i];
    for (const std::uint32_t e : edges_at(node)) {
      const std::uint32_t other = other_end(edges_[e], node);
      if (other != 0 && number_[other] == kNone) {
        number_[other] = static_cast<std::uint32_t>(out.pieces.size());
        out.pieces.push_back(other - 1);
        reached.push_back(other);
      }
      // Each edge once: from its lower number, or from the node that stands on the platform.
      if (other != 0 && number_[other] < number_[node]) continue;
      CoreEdge edge = from(edges_[e], node);
      edge.a = number_[node];
      edge.b = other == 0 ? 0 : number_[other];
      out.edges.push_back(edge);
    }
  }
  for (const std::uint32_t node : reached) {
    const Weight& w = weight_[node];
    if (const std::int64_t units = std::llround(w.units); units > 0)
      out.loads.push_back({number_[node], units, {w.x_mm / w.units, w.y_mm / w.units}});
    number_[node] = kNone;
  }
  return out;
}

}  // namespace telefab::fab
