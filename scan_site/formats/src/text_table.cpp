// SPDX-License-Identifier: GPL-3.0-or-later
#include "text_table.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <limits>
#include <string>

#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_blank(char c) { return c == ' ' || c == '\t'; }

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"') text = text.substr(1, text.size() - 2);
  return text;
}

/// What the commas within one word can be.
enum class Commas { None, Decimal, Grouping, Marks };

Commas commas_of(std::string_view word) {
  const auto commas = std::count(word.begin(), word.end(), ',');
  if (commas == 0) return Commas::None;
  const std::size_t at = word.find(',');
  const std::size_t point = word.find('.');
  if (point == std::string_view::npos)
    return commas == 1 && at > 0 && at + 1 < word.size() && is_digit(word[at - 1]) && is_digit(word[at + 1])
               ? Commas::Decimal
               : Commas::Marks;
  // 1.234,56 or 1,234.56: groups of three digits behind the first
  const std::size_t first = std::min(at, point);
  const std::size_t last = std::max(word.find_last_of(".,"), first);
  const bool last_is_other = word[last] != word[first] && word.find(word[last]) == last;
  std::size_t run = 0;
  for (std::size_t i = first + 1; i < last; ++i) {
    if (word[i] != word[first] && !is_digit(word[i])) return Commas::Marks;
    if (is_digit(word[i])) {
      ++run;
    } else {
      if (run != 3) return Commas::Marks;
      run = 0;
    }
  }
  return last_is_other && run == 3 ? Commas::Grouping : Commas::Marks;
}

tl::unexpected<Error> unclear(const TextLine& line, std::string_view word, std::string_view why) {
  return fail(ErrorCode::InvalidInput, fmt::format("line {}: '{}' {}; write numbers with a decimal point, and no comma "
                                                   "or other mark within them",
                                                   line.number, word.substr(0, 40), why));
}

/// Lines whose only marks are commas: they part the columns, unless something tells that they are decimal commas.
Result<TextDialect> by_commas_alone(std::span<const TextLine> lines) {
  const TextDialect commas{CellMark::Comma, false};
  std::vector<std::string_view> cells;
  std::size_t columns = 0;
  bool has_points = false, has_leading_zero = false, is_ragged = false;
  for (const TextLine& line : lines) {
    split_cells(line.text, commas, cells);
    if (columns == 0) columns = cells.size();
    is_ragged |= cells.size() != columns;
    for (const std::string_view cell : cells) {
      has_points |= cell.find('.') != std::string_view::npos;
      has_leading_zero |= cell.size() > 1 && cell[0] == '0' && is_digit(cell[1]);
      if (std::any_of(cell.begin(), cell.end(), is_blank)) return TextDialect{};
    }
  }
  if (!has_points && columns >= 4 && (has_leading_zero || is_ragged))
    return unclear(lines.front(), lines.front().text,
                   "seems to have a decimal comma in its numbers, and commas between them too");
  return commas;
}

}  // namespace

Result<TextDialect> dialect_of(std::span<const TextLine> lines) {
  const auto all_have = [&](char c) {
    return std::all_of(lines.begin(), lines.end(),
                       [&](const TextLine& l) { return l.text.find(c) != std::string_view::npos; });
  };
  const auto any_has = [&](char c) {
    return std::any_of(lines.begin(), lines.end(),
                       [&](const TextLine& l) { return l.text.find(c) != std::string_view::npos; });
  };
  const bool by_semicolon = all_have(';');
  if (!by_semicolon && !any_has(',')) {
    if (!all_have('\t')) return TextDialect{};
    std::vector<std::string_view> cells;
    for (const TextLine& line : lines) {
      split_cells(line.text, {CellMark::Tab, false}, cells);
      for (const std::string_view cell : cells)
        if (cells.size() < 3 || std::any_of(cell.begin(), cell.end(), is_blank)) return TextDialect{};
    }
    return TextDialect{CellMark::Tab, false};
  }

  const TextDialect parted{by_semicolon ? CellMark::Semicolon : CellMark::Blank, false};
  std::array<std::size_t, 4> words{};
  const TextLine* odd = nullptr;
  std::string_view odd_word;
  std::size_t points = 0, fewest = SIZE_MAX;
  std::vector<std::string_view> cells;
  for (const TextLine& line : lines) {
    split_cells(line.text, parted, cells);
    fewest = std::min(fewest, cells.size());
    for (const std::string_view cell : cells) {
      const Commas kind = commas_of(cell);
      ++words[static_cast<std::size_t>(kind)];
      points += cell.find('.') != std::string_view::npos ? 1 : 0;
      if (kind != Commas::None && !odd) odd = &line, odd_word = cell;
      if (by_semicolon && std::any_of(cell.begin(), cell.end(), is_blank)) return TextDialect{};
    }
  }
  const auto count = [&](Commas kind) { return words[static_cast<std::size_t>(kind)]; };
  if (!odd) return by_semicolon ? Result<TextDialect>{parted} : by_commas_alone(lines);
  if (fewest < 3) {
    if (by_semicolon || count(Commas::Marks) > 0 || points > 0)
      return by_semicolon ? TextDialect{} : by_commas_alone(lines);
    return unclear(*odd, odd->text, "may have a decimal comma in its numbers, or commas between them");
  }
  if (count(Commas::Grouping) > 0 && count(Commas::Marks) == 0)
    return unclear(*odd, odd_word, "has both a point and a comma, so that either may be a decimal comma or point");
  if (count(Commas::Marks) > 0) return TextDialect{};
  if (points > 0) return unclear(*odd, odd_word, "has a decimal comma where other numbers have a decimal point");
  return TextDialect{parted.mark, true};
}

void split_cells(std::string_view line, const TextDialect& dialect, std::vector<std::string_view>& cells) {
  cells.clear();
  const char* at = line.data();
  const char* const end = at + line.size();
  if (dialect.mark == CellMark::Mixed || dialect.mark == CellMark::Blank) {
    const bool mixed = dialect.mark == CellMark::Mixed;
    const auto parts = [&](char c) { return is_blank(c) || (mixed && (c == ',' || c == ';')); };
    while (true) {
      while (at != end && parts(*at)) ++at;
      if (at == end) return;
      const char* const from = at;
      while (at != end && !parts(*at)) ++at;
      std::string_view word{from, static_cast<std::size_t>(at - from)};
      while (word.size() > 1 && (word.back() == ',' || word.back() == ';')) word.remove_suffix(1);
      cells.push_back(word);
    }
  }
  const char mark = static_cast<char>(dialect.mark);
  while (true) {
    const char* const from = at;
    bool quoted = false;
    while (at != end && (quoted || *at != mark)) quoted ^= *at++ == '"';
    cells.push_back(trimmed({from, static_cast<std::size_t>(at - from)}));
    if (at == end) return;
    ++at;
  }
}

std::optional<double> number_of(std::string_view cell, const TextDialect& dialect) {
  FieldCursor field{cell, dialect.decimal_comma ? CommaRule::Decimal : CommaRule::Mark};
  const auto value = field.take<double>();
  if (value && field.at_end()) return value;
  if (value) return std::nullopt;
  std::string word{cell};
  std::transform(word.begin(), word.end(), word.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array<std::string_view, 7> kMissing{"", "na", "n/a", "null", "none", "-", "#n/a"};
  if (std::find(kMissing.begin(), kMissing.end(), word) != kMissing.end())
    return std::numeric_limits<double>::quiet_NaN();
  return std::nullopt;
}

}  // namespace telefab::scan
