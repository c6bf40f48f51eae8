// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <string>

#include "ply_header.hpp"
#include "readers.hpp"
#include "scan_builder.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

/// Where in a vertex record the numbers we take stand; -1 = not there.
struct VertexColumns {
  std::array<int, 3> position{-1, -1, -1};
  std::array<int, 3> normal{-1, -1, -1};
  int confidence = -1;
  int sheets_apart = -1;
  [[nodiscard]] bool has_normal() const { return *std::min_element(normal.begin(), normal.end()) >= 0; }
};

Result<VertexColumns> find_columns(const PlyElement& vertex) {
  static constexpr std::array<std::string_view, 3> kPosition{"x", "y", "z"};
  static constexpr std::array<std::string_view, 3> kNormal{"nx", "ny", "nz"};
  static constexpr std::array<std::string_view, 3> kLongNormal{"normal_x", "normal_y", "normal_z"};
  VertexColumns columns;
  for (std::size_t i = 0; i < vertex.properties.size(); ++i) {
    const PlyProperty& p = vertex.properties[i];
    if (p.count_type) continue;
    std::string name = p.name;
    std::transform(name.begin(), name.end(), name.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (name == kPosition[axis]) columns.position[axis] = static_cast<int>(i);
      if (name == kNormal[axis] || name == kLongNormal[axis]) columns.normal[axis] = static_cast<int>(i);
    }
    if (name == "confidence") columns.confidence = static_cast<int>(i);
    if (name == kSheetsApartProperty) columns.sheets_apart = static_cast<int>(i);
  }
  if (*std::min_element(columns.position.begin(), columns.position.end()) < 0)
    return fail(ErrorCode::InvalidInput, "element vertex has no properties x, y and z");
  return columns;
}

void add_record(ScanBuilder& builder, const VertexColumns& c, const double* v) {
  const auto triple = [&](const std::array<int, 3>& at) { return Vec3{v[at[0]], v[at[1]], v[at[2]]}; };
  builder.add(triple(c.position));
  if (c.has_normal()) builder.add_normal(triple(c.normal));
  if (c.confidence >= 0) builder.add_confidence(static_cast<float>(v[c.confidence]));
  if (c.sheets_apart >= 0) builder.add_sheets_apart(static_cast<float>(v[c.sheets_apart]));
}

/// Fills a range view from lists of at most one index, cell by cell.
class GridFiller {
 public:
  explicit GridFiller(const PlyHeader& header, std::uint64_t cells) {
    view_.columns = header.grid_columns;
    view_.rows = header.grid_rows;
    view_.point_at.reserve(cells);
  }
  void add_cell(std::optional<std::int64_t> index) {
    view_.point_at.push_back(index ? static_cast<std::int32_t>(std::clamp<std::int64_t>(*index, -2, INT32_MAX))
                                   : RangeView::kEmpty);
  }
  [[nodiscard]] Result<RangeView> finish(std::size_t points) && {
    if (std::uint64_t{view_.columns} * view_.rows != view_.point_at.size() || view_.columns == 0)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("range_grid has {} cells but obj_info num_cols {} and num_rows {} ask for {}",
                      view_.point_at.size(), view_.columns, view_.rows, std::uint64_t{view_.columns} * view_.rows));
    for (const std::int32_t p : view_.point_at)
      if (p != RangeView::kEmpty && (p < 0 || static_cast<std::size_t>(p) >= points))
        return fail(ErrorCode::InvalidInput, fmt::format("range_grid names point {} of {}", p, points));
    return std::move(view_);
  }

 private:
  RangeView view_;
};

bool names_corners(const PlyElement& element) { return element.name == "face" || element.name == "tristrips"; }

/// The common walk over the elements; how one element is read is left to the encoding.
class PlyBody {
 public:
  PlyBody(const PlyHeader& header, const ReadOptions& options, const std::stop_token& stop)
      : header_{header}, builder_{ScanFormat::Ply, options}, stop_{stop} {}
  virtual ~PlyBody() = default;
  PlyBody(const PlyBody&) = delete;
  PlyBody& operator=(const PlyBody&) = delete;

  [[nodiscard]] Result<ScanFile> read() {
    bool has_vertices = false;
    std::optional<GridFiller> grid;
    for (const PlyElement& element : header_.elements)
      if (element.count > 0 && (element.name == "range_grid" || (names_corners(element) && builder_.keeps_faces())))
        builder_.points_are_named();
    for (const PlyElement& element : header_.elements) {
      Result<void> done;
      const std::uint64_t each = std::max<std::uint64_t>(1, element.least_bytes(header_.encoding));
      if (element.count > 0 && !element.properties.empty() && element.count > bytes_left() / each)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("the header claims {} items of element {} but only {} bytes are left; the file is "
                                "truncated or its header is wrong",
                                element.count, element.name, bytes_left()));
      if (element.name == "vertex" && !has_vertices) {
        has_vertices = true;
        const auto columns = find_columns(element);
        if (!columns) return tl::unexpected{columns.error()};
        done = builder_.expect(element.count, bytes_left(), each);
        if (done) done = read_vertices(element, *columns);
      } else if (element.name == "range_grid" && element.properties.size() == 1 && element.has_list() && !grid) {
        grid.emplace(header_, element.count);
        done = read_grid(element, *grid);
      } else if (!element.properties.empty()) {
        if (element.count > 0 && names_corners(element)) builder_.points_are_corners();
        done = skip(element);
      }
      if (!done) return fail_in("element " + element.name.substr(0, 40), done.error());
    }
    if (!has_vertices) return fail(ErrorCode::InvalidInput, "no element named vertex");
    if (grid) {
      auto view = std::move(*grid).finish(builder_.size());
      if (!view) return tl::unexpected{view.error()};
      builder_.add_view(std::move(*view));
      builder_.zeros_are_no_return();
    }
    return std::move(builder_).finish();
  }

 protected:
  [[nodiscard]] virtual std::uint64_t bytes_left() const = 0;
  [[nodiscard]] virtual Result<void> read_vertices(const PlyElement&, const VertexColumns&) = 0;
  [[nodiscard]] virtual Result<void> read_grid(const PlyElement&, GridFiller&) = 0;
  [[nodiscard]] virtual Result<void> skip(const PlyElement&) = 0;
  [[nodiscard]] bool stopped(std::uint64_t item) const { return item % kStopEvery == 0 && stop_.stop_requested(); }

  const PlyHeader& header_;
  ScanBuilder builder_;
  const std::stop_token& stop_;
};

tl::unexpected<Error> truncated(std::uint64_t item) {
  return fail(ErrorCode::InvalidInput, fmt::format("the file ends within item {}: it is truncated", item));
}

class BinaryPly final : public PlyBody {
 public:
  BinaryPly(std::span<const std::byte> body, const PlyHeader& header, const ReadOptions& options,
            const std::stop_token& stop)
      : PlyBody{header, options, stop},
        at_{body.data()},
        end_{body.data() + body.size()},
        swapped_{(header.encoding == PlyEncoding::BigEndian) != (std::endian::native == std::endian::big)} {}

 private:
  std::uint64_t bytes_left() const override { return static_cast<std::uint64_t>(end_ - at_); }

  Result<void> read_vertices(const PlyElement& element, const VertexColumns& columns) override {
    if (element.has_list()) return read_vertices_with_lists(element, columns);
    const std::size_t stride = element.least_bytes(header_.encoding);
    std::vector<int> wanted(columns.position.begin(), columns.position.end());
    if (columns.has_normal()) wanted.insert(wanted.end(), columns.normal.begin(), columns.normal.end());
    const auto place_of = [&](int column) {
      if (column >= 0) wanted.push_back(column);
      return wanted.size() - 1;
    };
    const std::size_t confidence = place_of(columns.confidence), sheets_apart = place_of(columns.sheets_apart);
    std::vector<std::size_t> offsets;
    for (const int column : wanted) {
      std::size_t offset = 0;
      for (int i = 0; i < column; ++i) offset += size_of(element.properties[static_cast<std::size_t>(i)].type);
      offsets.push_back(offset);
    }
    constexpr std::size_t kBlock = 512;
    std::vector<std::array<double, kBlock>> values(wanted.size());
    for (std::uint64_t first = 0; first < element.count; first += kBlock) {
      if (stopped(first)) return cancelled("reading points");
      const std::size_t count = std::min<std::uint64_t>(kBlock, element.count - first);
      for (std::size_t c = 0; c < wanted.size(); ++c)
        load_column(at_ + offsets[c], stride, count, element.properties[static_cast<std::size_t>(wanted[c])].type,
                    swapped_, values[c].data());
      for (std::size_t i = 0; i < count; ++i) {
        builder_.add({values[0][i], values[1][i], values[2][i]});
        if (columns.has_normal()) builder_.add_normal({values[3][i], values[4][i], values[5][i]});
        if (columns.confidence >= 0) builder_.add_confidence(static_cast<float>(values[confidence][i]));
        if (columns.sheets_apart >= 0) builder_.add_sheets_apart(static_cast<float>(values[sheets_apart][i]));
      }
      at_ += stride * count;
    }
    return {};
  }

  Result<void> read_vertices_with_lists(const PlyElement& element, const VertexColumns& columns) {
    std::vector<double> record(element.properties.size());
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      for (std::size_t k = 0; k < element.properties.size(); ++k) {
        const PlyProperty& p = element.properties[k];
        if (p.count_type ? !skip_list(p) : !take(p.type, record[k])) return truncated(i);
      }
      add_record(builder_, columns, record.data());
    }
    return {};
  }

  Result<void> read_grid(const PlyElement& element, GridFiller& grid) override {
    const PlyProperty& list = element.properties.front();
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      double count = 0, index = 0;
      if (!take(*list.count_type, count)) return truncated(i);
      if (count < 0 || count > 1)
        return fail(ErrorCode::InvalidInput, fmt::format("cell {} holds {} points", i, count));
      if (count > 0 && !take(list.type, index)) return truncated(i);
      grid.add_cell(count > 0 ? std::optional{static_cast<std::int64_t>(std::clamp(index, -2.0, 4e9))} : std::nullopt);
    }
    return {};
  }

  Result<void> skip(const PlyElement& element) override {
    if (!element.has_list()) {
      at_ += element.least_bytes(header_.encoding) * element.count;  // the walk checked that they are there
      return {};
    }
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      for (const PlyProperty& p : element.properties) {
        double ignored = 0;
        const bool is_face =
            builder_.keeps_faces() && element.name == "face" && p.count_type && p.name.starts_with("vertex_ind");
        if (is_face ? !take_face(p) : p.count_type ? !skip_list(p) : !take(p.type, ignored)) return truncated(i);
      }
    }
    return {};
  }
  [[nodiscard]] bool take_face(const PlyProperty& p) {
    double count = 0, index = 0;
    if (!take(*p.count_type, count) || count < 0 ||
        count * static_cast<double>(size_of(p.type)) > static_cast<double>(bytes_left()))
      return false;
    corners_.clear();
    for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
      if (!take(p.type, index)) return false;
      corners_.push_back(index < 0 ? UINT64_MAX : static_cast<std::uint64_t>(index));
    }
    builder_.add_face(corners_);
    return true;
  }

  [[nodiscard]] bool take(ScalarType type, double& value) {
    if (bytes_left() < size_of(type)) return false;
    value = load_as_double(at_, type, swapped_);
    at_ += size_of(type);
    return true;
  }
  [[nodiscard]] bool skip_list(const PlyProperty& p) {
    double count = 0;
    if (!take(*p.count_type, count) || count < 0) return false;
    if (count * static_cast<double>(size_of(p.type)) > static_cast<double>(bytes_left())) return false;
    at_ += static_cast<std::size_t>(count) * size_of(p.type);
    return true;
  }

  const std::byte* at_;
  const std::byte* end_;
  bool swapped_;
  std::vector<std::uint64_t> corners_;
};

/// A vertex stands in a line of its own; what the other elements hold is walked over word by word.
class AsciiPly final : public PlyBody {
 public:
  AsciiPly(std::string_view body, const PlyHeader& header, const ReadOptions& options, const std::stop_token& stop)
      : PlyBody{header, options, stop}, lines_{body} {}

 private:
  std::uint64_t bytes_left() const override { return lines_.bytes_left(); }

  Result<void> read_vertices(const PlyElement& element, const VertexColumns& columns) override {
    std::vector<double> record(element.properties.size());
    bool decimal_comma = false;
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      const std::string_view line = take_row();
      if (line.empty()) return truncated(i);
      FieldCursor fields{line, CommaRule::Decimal};
      for (std::size_t k = 0; k < element.properties.size(); ++k) {
        const PlyProperty& p = element.properties[k];
        if (p.count_type) {
          if (!skip_list(fields)) return bad_row(i, line, fields);
          continue;
        }
        const auto value = fields.take<double>();
        if (!value) return bad_row(i, line, fields);
        record[k] = *value;
      }
      if (!fields.at_end())
        return fail(ErrorCode::InvalidInput,
                    fmt::format("item {}: '{}' has more than the {} values of a vertex{}", i, line.substr(0, 60),
                                element.properties.size(), about_commas(line)));
      if (fields.saw_decimal_comma() && !decimal_comma) {
        decimal_comma = true;
        builder_.note(ScanRemark::DecimalComma,
                      fmt::format("numbers have a decimal comma: the first vertex that has is {}", line.substr(0, 60)));
      }
      add_record(builder_, columns, record.data());
    }
    return {};
  }

  Result<void> read_grid(const PlyElement& element, GridFiller& grid) override {
    FieldCursor fields = rest();
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      const auto count = fields.take<std::uint64_t>();
      if (!count) return bad_number(i, fields);
      if (*count > 1) return fail(ErrorCode::InvalidInput, fmt::format("cell {} holds {} points", i, *count));
      std::optional<std::int64_t> index;
      if (*count == 1) {
        index = fields.take<std::int64_t>();
        if (!index) return bad_number(i, fields);
      }
      grid.add_cell(index);
    }
    lines_ = TextCursor{fields.rest()};
    return {};
  }

  Result<void> skip(const PlyElement& element) override {
    FieldCursor fields = rest();
    for (std::uint64_t i = 0; i < element.count; ++i) {
      if (stopped(i)) return cancelled("reading points");
      for (const PlyProperty& p : element.properties) {
        const bool is_face =
            builder_.keeps_faces() && element.name == "face" && p.count_type && p.name.starts_with("vertex_ind");
        if (is_face ? !take_face(fields) : p.count_type ? !skip_list(fields) : fields.take_word().empty())
          return bad_number(i, fields);
      }
    }
    lines_ = TextCursor{fields.rest()};
    return {};
  }

  /// The next line that is not blank; empty at the end.
  std::string_view take_row() {
    while (!lines_.at_end()) {
      const std::string_view line = lines_.take_line();
      if (line.find_first_not_of(" \t") != std::string_view::npos) return line;
    }
    return {};
  }
  [[nodiscard]] FieldCursor rest() const { return FieldCursor{lines_.rest()}; }
  [[nodiscard]] bool take_face(FieldCursor& fields) {
    const auto count = fields.take<std::uint64_t>();
    corners_.clear();
    for (std::uint64_t k = 0; count && k < *count; ++k) {
      const auto corner = fields.take<std::uint64_t>();
      if (!corner) return false;
      corners_.push_back(*corner);
    }
    builder_.add_face(corners_);
    return count.has_value();
  }
  [[nodiscard]] static bool skip_list(FieldCursor& fields) {
    const auto count = fields.take<std::uint64_t>();
    if (!count) return false;
    for (std::uint64_t i = 0; i < *count; ++i)
      if (fields.take_word().empty()) return false;
    return true;
  }
  [[nodiscard]] tl::unexpected<Error> bad_row(std::uint64_t item, std::string_view line, FieldCursor& fields) const {
    if (fields.at_end() && lines_.at_end()) return truncated(item);
    if (fields.at_end())
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("item {}: the line '{}' ends before the vertex does; each must stand in a line of its own{}",
                      item, line.substr(0, 60), about_commas(line)));
    return bad_number(item, fields);
  }
  [[nodiscard]] static tl::unexpected<Error> bad_number(std::uint64_t item, FieldCursor& fields) {
    if (fields.at_end()) return truncated(item);
    const std::string_view word = fields.take_word();
    return fail(ErrorCode::InvalidInput, fmt::format("item {}: '{}' is not a number", item, word.substr(0, 40)));
  }

  TextCursor lines_;
  std::vector<std::uint64_t> corners_;
};

}  // namespace

Result<ScanFile> read_ply(std::span<const std::byte> bytes, const ReadOptions& options, const std::stop_token& stop) {
  const auto header = read_ply_header(as_text(bytes));
  if (!header) return tl::unexpected{header.error()};
  const auto body = bytes.subspan(header->body_offset);
  if (header->encoding == PlyEncoding::Ascii) return AsciiPly{as_text(body), *header, options, stop}.read();
  return BinaryPly{body, *header, options, stop}.read();
}

}  // namespace telefab::scan
