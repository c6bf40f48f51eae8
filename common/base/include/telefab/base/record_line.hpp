// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace telefab {

/// A line of an append-only text file that tells a torn tail from damage:
/// "r2 SEQUENCE BYTES CHECKSUM BODY\n"; sequences rise by one from 1, BYTES are those of the body, the checksum is the
/// first half of the SHA-256 of all that stands around it.
struct RecordLine {
  std::uint64_t sequence = 0;
  std::string body;
  friend bool operator==(const RecordLine&, const RecordLine&) = default;
};

/// Bytes that are no sound record although something else than a broken-off writing must have made them so.
struct RecordDamage {
  std::uint64_t offset = 0;  ///< in the file
  std::uint64_t bytes = 0;   ///< 0: nothing but missing records
  std::size_t after = 0;     ///< sound records before it
  std::uint64_t lost = 0;    ///< records that are missing here, as far as sequences and line ends tell; may be 0
  friend bool operator==(const RecordDamage&, const RecordDamage&) = default;
};

struct RecordScan {
  std::vector<RecordLine> records;   ///< the sound ones, in the order of the file
  std::vector<RecordDamage> damage;  ///< in the order of the file; empty: the file is sound but for its tail
  std::uint64_t whole_bytes = 0;     ///< what lies before the torn tail
  std::uint64_t torn_bytes = 0;      ///< of a last record whose writing broke off; to be cut
};

/// The line of a record, its end included. `body` holds no line end and no other control character.
[[nodiscard]] std::string to_record_line(std::uint64_t sequence, std::string_view body);

/// The body of a line of an older form, without its end; nothing where it is not sound.
using OldRecordReader = std::optional<std::string> (*)(std::string_view line);

/// Reads every record. A tail is torn, not damaged, where it is the beginning of a record (perhaps none of it) followed
/// by nothing or by zero bytes, as a loss of power leaves it. `old`, if any, reads lines of an older form that stand
/// before the first record; they are numbered like records.
[[nodiscard]] RecordScan scan_record_lines(std::string_view text, OldRecordReader old = nullptr);

}  // namespace telefab
