// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli_reader.hpp"

#include <fmt/format.h>

#include <bit>
#include <cstring>

#include "cli_commands.hpp"
#include "number_reader.hpp"
#include "stated_unit.hpp"

namespace telefab::fab {
namespace {

/// Layers of one file, in the order of their heights.
class CliLayers {
 public:
  explicit CliLayers(double unit_mm) : unit_mm_{unit_mm} {}

  Result<void> start(double z) {
    const double top_mm = z * unit_mm_;
    if (layer_ != nullptr && !(top_mm > layer_->top_mm))
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("a layer at {:.4f} mm follows one at {:.4f} mm; layers must rise", top_mm, layer_->top_mm));
    // The first layer, where it is empty, only says where the next one begins.
    if (layer_ != nullptr && first_ && layer_->rings.empty()) {
      raw_.bottom_mm = layer_->top_mm;
      raw_.layers().clear();
    }
    first_ = layer_ == nullptr;
    auto layer = raw_.at(top_mm);
    if (!layer) return tl::unexpected{layer.error()};
    if ((*layer)->top_mm != top_mm)
      return fail(ErrorCode::InvalidInput, fmt::format("two layers at {:.4f} mm", top_mm));
    layer_ = *layer;
    return {};
  }
  Result<void> add(std::uint32_t id, std::uint32_t direction, std::vector<Point2> vertices) {
    if (layer_ == nullptr) return fail(ErrorCode::InvalidInput, "a polyline before the first layer");
    if (direction == kCliOpenLine)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer at {:.4f} mm: an open line (dir 2) has no inside; close it or leave it out",
                              layer_->top_mm));
    if (direction > kCliOpenLine)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer at {:.4f} mm: {} is not a direction (0, 1 or 2)", layer_->top_mm, direction));
    for (Point2& p : vertices) p = {p.x_mm * unit_mm_, p.y_mm * unit_mm_};
    return RawLayers::add(*layer_, {id, direction == kCliClockwise, std::move(vertices)});
  }
  void skip_hatches(std::uint64_t count) { raw_.skipped_hatches += count; }
  [[nodiscard]] RawLayers take() { return std::move(raw_); }

 private:
  double unit_mm_;
  RawLayers raw_;
  RawLayer* layer_ = nullptr;
  bool first_ = false;
};

tl::unexpected<Error> bad(std::size_t byte, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("CLI file, byte {}: {}", byte, what));
}

/// Commands of the text, "$$NAME" or "$$NAME/parameters". Comments stand between double slashes.
class CliScanner {
 public:
  explicit CliScanner(std::string_view text) : text_{text}, rest_{text} {}

  /// The next name; empty at the end.
  Result<std::string_view> next() {
    for (;;) {
      skip_space(rest_);
      if (!rest_.starts_with("//")) break;
      const auto end = rest_.find("//", 2);
      if (end == std::string_view::npos) return bad(at(), "a comment without an end");
      rest_.remove_prefix(end + 2);
    }
    if (rest_.empty()) return std::string_view{};
    if (!rest_.starts_with("$$")) return bad(at(), "a command should begin here, with $$");
    rest_.remove_prefix(2);
    std::size_t size = 0;
    while (size < rest_.size() && ((rest_[size] >= 'A' && rest_[size] <= 'Z') || rest_[size] == '_')) ++size;
    if (size == 0) return bad(at(), "a command without a name");
    const auto name = rest_.substr(0, size);
    rest_.remove_prefix(size);
    has_parameters_ = rest_.starts_with('/');
    if (has_parameters_) rest_.remove_prefix(1);
    return name;
  }
  /// The parameters up to the end of the line.
  std::string_view line() {
    if (!has_parameters_) return {};
    const auto end = std::min(rest_.find_first_of("\r\n"), rest_.size());
    const auto text = rest_.substr(0, end);
    rest_.remove_prefix(end);
    return text;
  }
  /// The next number of the parameters; commas and space around it are passed.
  Result<double> number() {
    skip_space(rest_);
    if (rest_.starts_with(',')) rest_.remove_prefix(1);
    skip_space(rest_);
    const auto value = take_number(rest_);
    if (!value) return bad(at(), "a number should stand here");
    return *value;
  }
  Result<std::uint32_t> count(std::uint32_t most) {
    const auto value = number();
    if (!value) return tl::unexpected{value.error()};
    if (*value < 0 || *value > most || *value != std::floor(*value))
      return bad(at(), fmt::format("{} is not a whole number from 0 to {}", *value, most));
    return static_cast<std::uint32_t>(*value);
  }
  [[nodiscard]] std::size_t at() const { return static_cast<std::size_t>(rest_.data() - text_.data()); }
  [[nodiscard]] std::size_t left() const { return rest_.size(); }

 private:
  std::string_view text_;
  std::string_view rest_;
  bool has_parameters_ = false;
};

constexpr std::uint32_t kMostIds = 1'000'000;

struct CliHeader {
  bool binary = false;
  double unit_mm = 0;
  std::size_t end = 0;  ///< byte behind $$HEADEREND
};

Result<CliHeader> read_header(std::string_view text, std::optional<double> unit_mm) {
  const auto end = text.substr(0, 1U << 20U).find("$$HEADEREND");
  if (end == std::string_view::npos) return bad(0, "no $$HEADEREND in the first megabyte");
  CliHeader header;
  header.end = end + std::string_view{"$$HEADEREND"}.size();
  CliScanner scanner{text.substr(0, end)};
  bool is_stated = false;
  std::optional<double> stated;
  for (;;) {
    const auto name = scanner.next();
    if (!name) return tl::unexpected{name.error()};
    if (name->empty()) break;
    if (*name == "ASCII" || *name == "BINARY") {
      header.binary = *name == "BINARY";
      is_stated = true;
    } else if (*name == "ALIGN") {
      return bad(scanner.at(), "commands aligned to 32 bits ($$ALIGN) are not read; write the file without");
    } else if (*name == "UNITS") {
      const auto unit = scanner.number();
      if (!unit) return tl::unexpected{unit.error()};
      stated = *unit;
    }
    (void)scanner.line();
  }
  if (!is_stated) return bad(end, "the header says neither $$ASCII nor $$BINARY");
  const auto unit = agreed_unit(stated, unit_mm);
  if (!unit) return tl::unexpected{unit.error()};
  header.unit_mm = *unit;
  return header;
}

Result<RawLayers> read_ascii(std::string_view text, const CliHeader& header) {
  CliScanner scanner{text};
  CliLayers layers{header.unit_mm};
  for (;;) {
    const auto name = scanner.next();
    if (!name) return tl::unexpected{name.error()};
    if (name->empty()) return bad(text.size() + header.end, "the file ends before $$GEOMETRYEND; it is cut off");
    if (*name == "GEOMETRYEND") return layers.take();
    if (*name == "LAYER") {
      const auto z = scanner.number();
      if (!z) return tl::unexpected{z.error()};
      if (auto ok = layers.start(*z); !ok) return tl::unexpected{ok.error()};
    } else if (*name == "POLYLINE") {
      const auto id = scanner.count(kMostIds);
      const auto direction = id ? scanner.count(1000) : id;
      // Two numbers and what parts them take four bytes of the file.
      const auto count =
          direction
              ? scanner.count(static_cast<std::uint32_t>(std::min<std::size_t>(scanner.left() / 4 + 1, 0xFFFF'FFFFU)))
              : direction;
      if (!count) return tl::unexpected{count.error()};
      std::vector<Point2> vertices;
      vertices.reserve(*count);
      for (std::uint32_t i = 0; i < *count; ++i) {
        const auto x = scanner.number();
        const auto y = x ? scanner.number() : x;
        if (!y) return tl::unexpected{y.error()};
        vertices.push_back({*x, *y});
      }
      if (auto ok = layers.add(*id, *direction, std::move(vertices)); !ok) return tl::unexpected{ok.error()};
    } else if (*name == "HATCHES") {
      const auto id = scanner.count(kMostIds);
      const auto count = id ? scanner.count(0xFFFF'FFFFU) : id;
      if (!count) return tl::unexpected{count.error()};
      for (std::uint64_t i = 0; i < std::uint64_t{*count} * 4; ++i)
        if (const auto v = scanner.number(); !v) return tl::unexpected{v.error()};
      layers.skip_hatches(*count);
    } else {
      (void)scanner.line();  // GEOMETRYSTART, and user data
    }
  }
}

class BinaryReader {
 public:
  BinaryReader(std::string_view bytes, std::size_t offset) : bytes_{bytes}, offset_{offset} {}
  [[nodiscard]] bool at_end() const { return at_ == bytes_.size(); }
  [[nodiscard]] bool has(std::uint64_t count) const { return bytes_.size() - at_ >= count; }
  [[nodiscard]] std::size_t at() const { return offset_ + at_; }
  std::uint32_t whole(bool wide) {
    std::uint32_t value = 0;
    for (unsigned i = 0; i < (wide ? 4U : 2U); ++i)
      value |= std::uint32_t{static_cast<unsigned char>(bytes_[at_++])} << (8 * i);
    return value;
  }
  double real(bool wide) {
    const std::uint32_t bits = whole(wide);
    return wide ? static_cast<double>(std::bit_cast<float>(bits)) : bits;
  }
  void skip(std::uint64_t count) { at_ += count; }

 private:
  std::string_view bytes_;
  std::size_t offset_;
  std::size_t at_ = 0;
};

Result<RawLayers> read_binary(std::string_view bytes, const CliHeader& header) {
  // Some writers end the header's line before the first command, although none should.
  std::size_t skipped = 0;
  while (skipped < 2 && skipped < bytes.size() && (bytes[skipped] == '\r' || bytes[skipped] == '\n')) ++skipped;
  BinaryReader reader{bytes.substr(skipped), header.end + skipped};
  CliLayers layers{header.unit_mm};
  const auto cut_off = [&] { return bad(reader.at(), "the file ends within a command; it is cut off"); };
  while (!reader.at_end()) {
    if (!reader.has(2)) return cut_off();
    const std::size_t begin = reader.at();
    const auto command = static_cast<std::uint16_t>(reader.whole(false));
    const bool wide = command == kCliLayerLong || command == kCliPolylineLong || command == kCliHatchesLong;
    const std::uint64_t size = wide ? 4 : 2;
    if (command == kCliLayerLong || command == kCliLayerShort) {
      if (!reader.has(size)) return cut_off();
      if (auto ok = layers.start(reader.real(wide)); !ok)
        return fail_in(fmt::format("CLI file, byte {}", begin), ok.error());
    } else if (command == kCliPolylineLong || command == kCliPolylineShort) {
      if (!reader.has(3 * size)) return cut_off();
      const std::uint32_t id = reader.whole(wide);
      const std::uint32_t direction = reader.whole(wide);
      const std::uint32_t count = reader.whole(wide);
      if (!reader.has(std::uint64_t{count} * 2 * size)) return cut_off();
      std::vector<Point2> vertices(count);
      for (Point2& p : vertices) {
        p.x_mm = reader.real(wide);
        p.y_mm = reader.real(wide);
      }
      if (auto ok = layers.add(id, direction, std::move(vertices)); !ok)
        return fail_in(fmt::format("CLI file, byte {}", begin), ok.error());
    } else if (command == kCliHatchesLong || command == kCliHatchesShort) {
      if (!reader.has(2 * size)) return cut_off();
      reader.skip(size);
      const std::uint32_t count = reader.whole(wide);
      if (!reader.has(std::uint64_t{count} * 4 * size)) return cut_off();
      reader.skip(std::uint64_t{count} * 4 * size);
      layers.skip_hatches(count);
    } else {
      return bad(begin, fmt::format("{} is not a command (127 to 132)", command));
    }
  }
  return layers.take();
}

}  // namespace

Result<RawLayers> read_cli(std::string_view text, std::optional<double> unit_mm) {
  const auto header = read_header(text, unit_mm);
  if (!header) return tl::unexpected{header.error()};
  return header->binary ? read_binary(text.substr(header->end), *header)
                        : read_ascii(text.substr(header->end), *header);
}

}  // namespace telefab::fab
