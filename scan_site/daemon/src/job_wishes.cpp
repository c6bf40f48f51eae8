// SPDX-License-Identifier: GPL-3.0-or-later
#include "job_wishes.hpp"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <chrono>
#include <telefab/job/slice_parameters.hpp>

namespace telefab::scan {

Result<std::int64_t> unix_ms_from(std::string_view time) {
  constexpr std::string_view kForm = "dddd-dd-ddTdd:ddZ";  // d: a digit
  const auto wrong = [&] {
    return fail(ErrorCode::InvalidInput,
                fmt::format("parameter deadline: {} is not a time like 2027-03-01T08:00Z", time));
  };
  if (time.size() != kForm.size()) return wrong();
  for (std::size_t i = 0; i < kForm.size(); ++i)
    if (kForm[i] == 'd' ? time[i] < '0' || time[i] > '9' : time[i] != kForm[i]) return wrong();
  const auto number = [&](std::size_t from, std::size_t count) {
    int value = 0;
    std::from_chars(time.data() + from, time.data() + from + count, value);
    return value;
  };
  const std::chrono::year_month_day day{std::chrono::year{number(0, 4)},
                                        std::chrono::month{static_cast<unsigned>(number(5, 2))},
                                        std::chrono::day{static_cast<unsigned>(number(8, 2))}};
  const int hour = number(11, 2), minute = number(14, 2);
  if (!day.ok() || hour > 23 || minute > 59 || day.year() < std::chrono::year{1971}) return wrong();
  const auto point = std::chrono::sys_days{day} + std::chrono::hours{hour} + std::chrono::minutes{minute};
  return std::chrono::duration_cast<std::chrono::milliseconds>(point.time_since_epoch()).count();
}

Result<JobWishes> job_wishes_from(std::string_view machine, std::string_view parameters) {
  const auto asked = slice_parameters_from_json(parameters);
  if (!asked) return tl::unexpected{asked.error()};
  JobWishes wishes;
  wishes.machine = machine;
  wishes.priority = static_cast<int>(asked->priority.value_or(0));
  wishes.copies = static_cast<std::uint32_t>(asked->copies.value_or(1));
  if (asked->deadline) {
    const auto deadline = unix_ms_from(*asked->deadline);
    if (!deadline) return tl::unexpected{deadline.error()};
    wishes.deadline_unix_ms = *deadline;
  }
  return wishes;
}

}  // namespace telefab::scan
