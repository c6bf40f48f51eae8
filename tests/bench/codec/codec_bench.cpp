// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>

#include <telefab/codec/stack_codec.hpp>
#include <telefab/test/random_stack.hpp>

namespace telefab {
namespace {

constexpr std::uint32_t kLayers = 64;

std::vector<Chunk> encode(const LayerStack& stack, Coding coding) {
  CodecOptions options;
  options.coding = coding;
  StackEncoder encoder = StackEncoder::start(stack.header(), options).value();
  std::vector<Chunk> chunks;
  for (const Layer& layer : stack.layers())
    if (auto chunk = encoder.add(layer).value()) chunks.push_back(std::move(*chunk));
  if (auto chunk = encoder.finish().value()) chunks.push_back(std::move(*chunk));
  return chunks;
}

void encode_stack(benchmark::State& state) {
  const LayerStack stack = test::random_stack(2, kLayers);
  std::size_t bytes = 0;
  for (auto _ : state) {
    const auto chunks = encode(stack, static_cast<Coding>(state.range(0)));
    bytes = 0;
    for (const Chunk& chunk : chunks) bytes += chunk.payload.size();
  }
  state.SetItemsProcessed(state.iterations() * kLayers);
  state.counters["bytes_a_layer"] = static_cast<double>(bytes) / kLayers;
}
BENCHMARK(encode_stack)->Arg(1)->Arg(3)->Unit(benchmark::kMillisecond);

void decode_stack(benchmark::State& state) {
  const LayerStack stack = test::random_stack(2, kLayers);
  const auto chunks = encode(stack, static_cast<Coding>(state.range(0)));
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  for (auto _ : state)
    for (const Chunk& chunk : chunks) benchmark::DoNotOptimize(decoder.decode(chunk));
  state.SetItemsProcessed(state.iterations() * kLayers);
}
BENCHMARK(decode_stack)->Arg(1)->Arg(3)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace telefab
