// SPDX-License-Identifier: GPL-3.0-or-later
#include "least_cut.hpp"

#include <algorithm>
#include <boost/graph/boykov_kolmogorov_max_flow.hpp>
#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <telefab/base/disjoint_sets.hpp>

namespace telefab::fab {
namespace {

using Graph = boost::compressed_sparse_row_graph<boost::directedS>;
using Pipe = Graph::edge_descriptor;

}  // namespace

/// Every link is two pipes, there and back.
struct LeastCut::Network {
  using Ends = std::pair<std::uint32_t, std::uint32_t>;

  Network(const std::vector<Ends>& links, std::uint32_t nodes) : source{nodes - 1} {
    // The graph keeps its pipes by the node they leave.
    std::vector<std::uint32_t> next(nodes + 1);
    for (const auto& [a, b] : links) ++next[a + 1], ++next[b + 1];
    for (std::uint32_t i = 0; i < nodes; ++i) next[i + 1] += next[i];
    std::vector<std::pair<std::size_t, std::size_t>> pipes(2 * links.size());
    std::vector<std::size_t> at;
    for (const auto& [a, b] : links) {
      pipes[at.emplace_back(next[a]++)] = {a, b};
      pipes[at.emplace_back(next[b]++)] = {b, a};
    }
    graph = Graph{boost::edges_are_sorted, pipes.begin(), pipes.end(), nodes};
    back.resize(pipes.size());
    capacity.resize(pipes.size()), residual.resize(pipes.size());
    there.resize(links.size());
    for (std::size_t i = 0; i < links.size(); ++i) {
      there[i] = at[2 * i];
      back[at[2 * i]] = Pipe{links[i].second, at[2 * i + 1]};
      back[at[2 * i + 1]] = Pipe{links[i].first, at[2 * i]};
    }
    color.resize(nodes), distance.resize(nodes), predecessor.resize(nodes);
  }

  void set(std::size_t link, std::int64_t onwards, std::int64_t backwards) {
    capacity[there[link]] = onwards;
    capacity[back[there[link]].idx] = backwards;
  }

  std::int64_t flow() {
    const auto pipe = get(boost::edge_index, graph);
    const auto node = get(boost::vertex_index, graph);
    const auto over = [](auto& values, auto index) { return boost::make_iterator_property_map(values.begin(), index); };
    return boost::boykov_kolmogorov_max_flow(graph, over(capacity, pipe), over(residual, pipe), over(back, pipe),
                                             over(predecessor, node), over(color, node), over(distance, node), node,
                                             source, std::size_t{0});
  }

  Graph graph;
  std::size_t source;
  std::vector<std::size_t> there;  ///< pipe of a link
  std::vector<Pipe> back;          ///< by pipe, like the next two
  std::vector<std::int64_t> capacity, residual;
  std::vector<boost::default_color_type> color;  ///< by node
  std::vector<long> distance;
  std::vector<Pipe> predecessor;
};

LeastCut::LeastCut(const Moment& moment, const LoadPath& path) : moment_{moment}, path_{path} {
  const auto source = static_cast<std::uint32_t>(moment.pieces.size());
  std::vector<Network::Ends> links;
  for (const CoreEdge& edge : moment.edges) links.emplace_back(edge.a, edge.b);
  for (const Moment::Load& load : moment.loads) {
    links.emplace_back(source, load.node);
    pulled_.push_back(load.pulled);
  }
  network_ = std::make_unique<Network>(links, source + 1);
}

LeastCut::~LeastCut() = default;

void LeastCut::release(std::uint32_t load) { pulled_[load] = 0; }

std::vector<Hanging> LeastCut::beyond(Ratio demand) {
  Network& network = *network_;
  const auto sections = path_.sections();
  for (std::size_t i = 0; i < moment_.edges.size(); ++i) {
    const std::int64_t capacity = sections[moment_.edges[i].section].pixels * demand.over;
    network.set(i, capacity, moment_.edges[i].b == 0 ? 0 : capacity);  // nothing flows out of the platform
  }
  std::int64_t pulled = 0;
  for (std::size_t i = 0; i < moment_.loads.size(); ++i) {
    network.set(moment_.edges.size() + i, pulled_[i] * demand.under, 0);
    pulled += pulled_[i] * demand.under;
  }
  if (network.flow() == pulled) return {};

  const auto is_left = [&](std::uint32_t node) { return node != 0 && network.color[node] == boost::black_color; };
  const auto nodes = static_cast<std::uint32_t>(moment_.pieces.size());
  DisjointSets sets{nodes};
  for (const CoreEdge& edge : moment_.edges)
    if (is_left(edge.a) && is_left(edge.b)) sets.join(edge.a, edge.b);
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::vector<std::uint32_t> number(nodes, kNone);
  std::vector<Hanging> found;
  for (std::uint32_t node = 1; node < nodes; ++node) {
    if (!is_left(node)) continue;
    std::uint32_t& of_set = number[sets.root(node)];
    if (of_set == kNone) {
      of_set = static_cast<std::uint32_t>(found.size());
      found.emplace_back();
    }
    found[of_set].nodes.push_back(node);
    number[node] = of_set;
  }
  for (std::uint32_t i = 0; i < moment_.loads.size(); ++i)
    if (const std::uint32_t node = moment_.loads[i].node; is_left(node)) {
      found[number[node]].loads.push_back(i);
      found[number[node]].pulled += pulled_[i];
    }
  for (std::uint32_t i = 0; i < moment_.edges.size(); ++i) {
    const CoreEdge& edge = moment_.edges[i];
    if (is_left(edge.a) == is_left(edge.b)) continue;
    Hanging& hanging = found[number[is_left(edge.a) ? edge.a : edge.b]];
    hanging.edges.push_back(i);
    hanging.cut += sections[edge.section].pixels;
  }
  // Black ones that no load reaches have nothing to bear.
  std::erase_if(found, [](const Hanging& h) { return h.pulled == 0 || h.cut == 0; });
  return found;
}

}  // namespace telefab::fab
