// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <span>
#include <telefab/base/digest.hpp>
#include <telefab/base/record_line.hpp>

namespace telefab {
namespace {

constexpr std::string_view kMark = "r2 ";
constexpr std::size_t kChecksumDigits = 32;
constexpr std::size_t kLongestNumber = 20;

std::string checksum_of(std::uint64_t sequence, std::string_view body) {
  Hasher hasher;
  hasher.feed(std::string_view{fmt::format("{} {} ", sequence, body.size())});
  hasher.feed(body);
  return to_hex(hasher.digest()).substr(0, kChecksumDigits);
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_hex(char c) { return is_digit(c) || (c >= 'a' && c <= 'f'); }
bool is_text(char c) { return static_cast<unsigned char>(c) >= 0x20; }

/// Takes the number and the space behind it off the front.
std::optional<std::uint64_t> take_number(std::string_view& text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end == text.data() || end == text.data() + text.size() || *end != ' ') return {};
  text.remove_prefix(static_cast<std::size_t>(end - text.data()) + 1);
  return value;
}

struct Parsed {
  RecordLine record;
  std::size_t bytes = 0;  ///< without the line end
};

/// A sound record at the front of the text, whatever follows it.
std::optional<Parsed> parse(std::string_view text) {
  std::string_view rest = text;
  if (!rest.starts_with(kMark)) return {};
  rest.remove_prefix(kMark.size());
  const auto sequence = take_number(rest);
  if (!sequence) return {};
  const auto size = take_number(rest);
  if (!size || rest.size() < kChecksumDigits + 1 || *size > rest.size() - kChecksumDigits - 1) return {};
  const std::string_view body = rest.substr(kChecksumDigits + 1, *size);
  if (rest[kChecksumDigits] != ' ' || rest.substr(0, kChecksumDigits) != checksum_of(*sequence, body)) return {};
  const auto bytes = static_cast<std::size_t>(body.data() - text.data()) + body.size();
  return Parsed{{*sequence, std::string{body}}, bytes};
}

/// Whether a writer of records that was stopped anywhere could have left these bytes.
bool is_beginning_of_record(std::string_view text) {
  std::size_t at = 0;
  const auto ended = [&] { return at == text.size(); };
  const auto run = [&](auto accepts, std::size_t most) {
    const std::size_t from = at;
    while (!ended() && at - from < most && accepts(text[at])) ++at;
    return at - from;
  };
  for (; at < kMark.size(); ++at)
    if (ended())
      return true;
    else if (text[at] != kMark[at])
      return false;
  std::uint64_t size = 0;
  for (int number = 0; number < 2; ++number) {
    const std::size_t digits = run(is_digit, kLongestNumber);
    if (ended()) return true;
    if (digits == 0 || text[at] != ' ') return false;
    (void)std::from_chars(text.data() + at - digits, text.data() + at, size);
    ++at;
  }
  const std::size_t sum = run(is_hex, kChecksumDigits);
  if (ended()) return true;
  if (sum != kChecksumDigits || text[at] != ' ') return false;
  ++at;
  // A body of all its bytes lacks its line end alone; a longer one was not broken off.
  return text.size() - at <= size && std::all_of(text.begin() + static_cast<std::ptrdiff_t>(at), text.end(), is_text);
}

/// Where the next sound record begins behind a line end at or after `from`; npos: nowhere.
std::size_t next_sound(std::string_view text, std::size_t from) {
  for (std::size_t end = text.find('\n', from); end != std::string_view::npos; end = text.find('\n', end + 1))
    if (parse(text.substr(end + 1))) return end + 1;
  return std::string_view::npos;
}

bool is_torn(std::string_view tail, bool is_old_form) {
  const auto last = tail.find_last_not_of('\0');
  const std::string_view text = last == std::string_view::npos ? std::string_view{} : tail.substr(0, last + 1);
  if (is_old_form) return text.find('\n') == std::string_view::npos;
  return is_beginning_of_record(text);
}

/// One walk over the text. What is not sound is skipped up to the next sound record.
class Scanner {
 public:
  Scanner(std::string_view text, OldRecordReader old) : text_{text}, old_{old}, is_old_form_{old != nullptr} {}

  RecordScan scan() {
    while (at_ < text_.size() && !is_at_tail_) step();
    end();
    return std::move(scan_);
  }

 private:
  void step() {
    const std::string_view rest = text_.substr(at_);
    if (auto found = parse(rest)) return take(std::move(*found));
    const std::size_t line_end = rest.find('\n');
    if (is_old_form_ && line_end != std::string_view::npos) {
      auto body = old_(rest.substr(0, line_end));
      if (body) {
        if (skipped_from_ != kNone) lose(skipped_from_, at_ - skipped_from_, 1);
        skipped_from_ = kNone;
        scan_.records.push_back({due(), std::move(*body)});
      } else {
        skip_from_here();
      }
      at_ += line_end + 1;
      return;
    }
    skip_from_here();
    const std::size_t next = is_old_form_ ? std::string_view::npos : next_sound(text_, at_);
    if (next == std::string_view::npos)
      is_at_tail_ = true;
    else
      at_ = next;
  }

  void take(Parsed found) {
    is_old_form_ = false;
    // One that lacks its line end alone was broken off, and the next one would stand on its line.
    if (at_ + found.bytes == text_.size()) {
      is_at_tail_ = true;
      return;
    }
    const std::uint64_t sequence = found.record.sequence;
    const std::size_t from = skipped_from_ != kNone ? skipped_from_ : at_;
    if (skipped_from_ != kNone || sequence != due()) lose(from, at_ - from, sequence > due() ? sequence - due() : 0);
    skipped_from_ = kNone;
    scan_.records.push_back(std::move(found.record));
    at_ += found.bytes;
    if (text_[at_] != '\n') lose(at_, 1, 0);  // its line end was hit
    ++at_;
  }

  /// What is left is a torn tail, damage, or nothing.
  void end() {
    const std::size_t tail = skipped_from_ != kNone ? skipped_from_ : at_;
    scan_.whole_bytes = tail;
    if (tail == text_.size()) return;
    const std::string_view lost = text_.substr(tail);
    if (is_torn(lost, is_old_form_)) {
      scan_.torn_bytes = lost.size();
      return;
    }
    const auto ends = static_cast<std::uint64_t>(std::count(lost.begin(), lost.end(), '\n'));
    lose(tail, lost.size(), ends + (lost.back() == '\n' ? 0 : 1));
    scan_.whole_bytes = text_.size();
  }

  void lose(std::size_t offset, std::size_t bytes, std::uint64_t lost) {
    scan_.damage.push_back({offset, bytes, scan_.records.size(), lost});
  }
  void skip_from_here() {
    if (skipped_from_ == kNone) skipped_from_ = at_;
  }
  [[nodiscard]] std::uint64_t due() const { return scan_.records.empty() ? 1 : scan_.records.back().sequence + 1; }

  static constexpr std::size_t kNone = std::string_view::npos;
  std::string_view text_;
  OldRecordReader old_;
  bool is_old_form_;
  bool is_at_tail_ = false;
  std::size_t at_ = 0;
  std::size_t skipped_from_ = kNone;
  RecordScan scan_;
};

}  // namespace

std::string to_record_line(std::uint64_t sequence, std::string_view body) {
  return fmt::format("{}{} {} {} {}\n", kMark, sequence, body.size(), checksum_of(sequence, body), body);
}

RecordScan scan_record_lines(std::string_view text, OldRecordReader old) { return Scanner{text, old}.scan(); }

}  // namespace telefab
