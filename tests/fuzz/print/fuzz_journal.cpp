// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <telefab/fab/print/print_journal.hpp>

namespace {

using namespace telefab;
using namespace telefab::fab;

}  // namespace

// The bytes of a journal, watched: nothing may be cut but a tail, and nothing written behind damage.
// The bodies of records, a line each, put into sound record lines where the first byte is 'r', else taken as they are.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view all{reinterpret_cast<const char*>(data), size};
  std::string text;
  if (all.starts_with('r')) {
    std::string_view rest = all.substr(1);
    for (std::uint64_t n = 1; !rest.empty(); ++n) {
      const std::size_t end = std::min(rest.find('\n'), rest.size());
      std::string body{rest.substr(0, end)};
      std::replace_if(
          body.begin(), body.end(), [](unsigned char c) { return c < ' '; }, ' ');
      text += to_record_line(n, body);
      rest.remove_prefix(std::min(end + 1, rest.size()));
    }
  } else {
    text = all;
  }
  const std::string before = text;
  auto journal = PrintJournal::open(memory_journal_file(text));
  if (!journal) {
    if (journal.error().what.empty() || text != before) std::abort();
    return 0;
  }
  if (!before.starts_with(text)) std::abort();
  (void)journal->resume_point();
  (void)journal->gaps();
  (void)journal->layers();
  (void)journal->orders();
  const Order order = journal->order().order;
  const std::string read = text;
  JournalEntry exposing;
  exposing.step = JournalStep::Exposing;
  const auto written = journal->write(exposing);
  if (written && (order == Order::Pause || order == Order::Cancel || !journal->damage().empty())) std::abort();
  if (!written && text != read) std::abort();
  return 0;
}
