// SPDX-License-Identifier: GPL-3.0-or-later
#include "read_stack.hpp"

#include <fmt/format.h>

#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/program.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMaxTfcBytes = 4ULL << 30U;

}  // namespace

Result<StackFile> read_stack_file(const std::string& path) {
  auto bytes = read_file(path, kMaxTfcBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto stack = read_tfc(*bytes);
  if (!stack) return fail_in(path, stack.error());
  return StackFile{std::move(*stack), std::move(*bytes)};
}

Result<LayerStack> read_stack(const std::string& path) {
  auto file = read_stack_file(path);
  if (!file) return tl::unexpected{file.error()};
  return std::move(file->stack);
}

std::array<double, 3> part_size_mm(const LayerStack& stack) {
  const Bounds2 box = bounds_of(stack.layers());
  return {box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm,
          stack.header().layer_count * stack.header().layer_thickness_mm};
}

ProgressSink progress_line() {
  if (!on_terminal()) return {};
  return [shown = std::make_shared<int>(-1)](const Progress& p) {
    const int percent = static_cast<int>(100 * p.fraction);
    if (percent == *shown) return;
    *shown = percent;
    write_note(fmt::format("\r{:<22} {:3} %", label_of(p.stage), percent));
  };
}

void clear_progress() {
  if (on_terminal()) write_note(fmt::format("\r{:30}\r", ""));
}

}  // namespace telefab::fab
