// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>

#include <algorithm>
#include <telefab/wire/message.hpp>

#include "from_wire.hpp"
#include "to_wire.hpp"

namespace telefab {
namespace {

template <class Value, class Proto>
Result<Message> read_as(const Frame& frame) {
  // Protobuf would print a line about every damaged message: anybody could fill our log with it.
  [[maybe_unused]] static const auto silenced = google::protobuf::SetLogHandler(nullptr);
  Proto proto;
  if (!proto.ParseFromArray(frame.body.data(), static_cast<int>(frame.body.size())))
    return fail(ErrorCode::ProtocolBroken,
                fmt::format("message-body: the body of frame type {} is damaged", static_cast<int>(frame.type)));
  Value value;
  wire::Reading reading;
  wire::read(reading, proto, value);
  if (reading.fault) return fail(ErrorCode::ProtocolBroken, *reading.fault);
  return Message{std::move(value)};
}

template <class Proto, class Value>
Frame write_as(FrameType type, const Value& value) {
  Proto proto;
  wire::write(value, proto);
  Frame frame{type, std::vector<std::byte>(proto.ByteSizeLong())};
  proto.SerializeToArray(frame.body.data(), static_cast<int>(frame.body.size()));
  return frame;
}

}  // namespace

bool is_job_id(std::string_view text) {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

std::string id_of_attempt(std::string_view fleet_job, std::uint32_t attempt) {
  return attempt == 1 ? std::string{fleet_job} : fmt::format("{}-a{}", fleet_job, attempt);
}

std::optional<std::string> fleet_job_of(std::string_view offered, std::uint32_t attempt) {
  // The last "-aN", where the id ends in one: a job whose own id does would be two of them.
  const auto digits = [](std::string_view text) {
    return !text.empty() && std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
  };
  const std::size_t mark = offered.rfind("-a");
  const bool is_marked = mark != std::string_view::npos && mark > 0 && digits(offered.substr(mark + 2));
  if (attempt == 0 || !is_job_id(offered) || is_marked != (attempt > 1)) return std::nullopt;
  std::string job{attempt == 1 ? offered : offered.substr(0, mark)};
  if (id_of_attempt(job, attempt) != offered || (attempt > 1 && !fleet_job_of(job, 1))) return std::nullopt;
  return job;
}

std::string_view name_of(DeferReason reason) {
  switch (reason) {
    case DeferReason::Busy:
      return "busy";
    case DeferReason::Full:
      return "full";
    case DeferReason::StorageFault:
      return "storage-fault";
  }
  return "unknown";
}

Frame to_frame(const Message& message) {
  return std::visit(
      [](const auto& value) {
        using Value = std::decay_t<decltype(value)>;
        using Row = wire::RowOf<Value>;
        return write_as<typename Row::Proto>(Row::type, value);
      },
      message);
}

Result<Message> from_frame(const Frame& frame) {
  Result<Message> outcome =
      fail(ErrorCode::ProtocolBroken, fmt::format("frame-type: {} carries no message", static_cast<int>(frame.type)));
  // One row a message; the first whose number it is reads the body.
  const auto try_row = [&]<class Value>(std::type_identity<Value>) {
    using Row = wire::RowOf<Value>;
    if (Row::type != frame.type) return false;
    outcome = read_as<Value, typename Row::Proto>(frame);
    return true;
  };
  [&]<class... Value>(std::type_identity<std::variant<Value...>>) {
    (void)(try_row(std::type_identity<Value>{}) || ...);
  }(std::type_identity<Message>{});
  return outcome;
}

}  // namespace telefab
