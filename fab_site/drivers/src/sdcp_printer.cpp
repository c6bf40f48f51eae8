// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/text.hpp>
#include <telefab/fab/drivers/sdcp_printer.hpp>

#include "sdcp_words.hpp"

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

std::string text_at(const Json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_string() ? to_printable(found->get<std::string>()) : std::string{};
}
/// A whole number, also where a board writes it as text or with a point.
std::optional<std::int64_t> number_of(const Json& value) {
  constexpr double kMost = 9e15;
  if (value.is_number()) {
    const double number = value.get<double>();
    return number >= -kMost && number <= kMost ? std::optional{static_cast<std::int64_t>(number)} : std::nullopt;
  }
  if (!value.is_string()) return std::nullopt;
  const auto& text = value.get_ref<const std::string&>();
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc{} && end == text.data() + text.size() ? std::optional{number} : std::nullopt;
}
std::optional<std::int64_t> number_at(const Json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() ? number_of(*found) : std::nullopt;
}
const Json& object_at(const Json& object, const char* key) {
  static const Json nothing = Json::object();
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_object() ? *found : nothing;
}
/// Boards put what they push beside `Data` or into it.
const Json& pushed_at(const Json& message, const char* key) {
  const Json& plain = object_at(message, key);
  return plain.empty() ? object_at(object_at(message, "Data"), key) : plain;
}
std::vector<std::string> words_at(const Json& object, const char* key) {
  std::vector<std::string> words;
  const auto found = object.is_object() ? object.find(key) : object.end();
  if (found != object.end() && found->is_array())
    for (const Json& item : *found)
      if (item.is_string()) words.push_back(to_printable(item.get<std::string>()));
  return words;
}
std::string upper(std::string text) {
  for (char& c : text)
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 32);
  return text;
}
std::uint32_t count_of(std::optional<std::int64_t> number) {
  return static_cast<std::uint32_t>(std::clamp<std::int64_t>(number.value_or(0), 0, 10'000'000));
}
std::string without_folders(const std::string& path) { return path.substr(path.rfind('/') + 1); }

WholePrinterFacts facts_of(const Json& attributes, std::string host) {
  WholePrinterFacts f;
  f.name = text_at(attributes, "Name");
  f.model = text_at(attributes, "MachineName");
  f.firmware = text_at(attributes, "FirmwareVersion");
  f.id = text_at(attributes, "MainboardID");
  f.address = std::move(host);
  const std::string pixels = text_at(attributes, "Resolution");
  std::uint32_t width = 0, height = 0;
  const auto x = pixels.find_first_of("xX*");
  if (x != std::string::npos) {
    const auto first = std::from_chars(pixels.data(), pixels.data() + x, width);
    const auto second = std::from_chars(pixels.data() + x + 1, pixels.data() + pixels.size(), height);
    if (first.ec == std::errc{} && second.ec == std::errc{}) f.size = {width, height};
  }
  for (std::string& kind : words_at(attributes, "SupportFileType")) f.file_kinds.push_back(upper(std::move(kind)));
  const auto can = words_at(attributes, "Capabilities");
  f.takes_files = std::find(can.begin(), can.end(), "FILE_TRANSFER") != can.end();
  f.takes_orders = std::find(can.begin(), can.end(), "PRINT_CONTROL") != can.end();
  if (const auto room = number_at(attributes, "RemainingMemory"); room && *room >= 0)
    f.free_bytes = static_cast<std::uint64_t>(*room);  // the document says "bit"; no card is that small
  return f;
}

WholePrinterStatus status_of(const Json& status) {
  WholePrinterStatus s;
  const auto current = status.find("CurrentStatus");
  std::vector<std::int64_t> all;
  if (current != status.end() && current->is_array()) {
    for (const Json& item : *current)
      if (const auto number = number_of(item)) all.push_back(*number);
  } else if (const auto one = number_at(status, "CurrentStatus")) {
    all.push_back(*one);
  }
  for (const std::int64_t number : all) {
    s.activity.prints |= number == sdcp::kPrinting;
    s.activity.receives |= number == sdcp::kTransferring;
    s.activity.tests |= number == sdcp::kExposureTest || number == sdcp::kSelfTest;
  }
  const Json& print = object_at(status, "PrintInfo");
  s.task.id = text_at(print, "TaskId");
  s.task.file = without_folders(text_at(print, "Filename"));
  s.task.state = sdcp::task_state_of(number_at(print, "Status").value_or(-1));
  s.task.layer = count_of(number_at(print, "CurrentLayer"));
  s.task.layers = count_of(number_at(print, "TotalLayer"));
  s.task.elapsed = std::chrono::milliseconds{std::max<std::int64_t>(0, number_at(print, "CurrentTicks").value_or(0))};
  s.task.estimated = std::chrono::milliseconds{std::max<std::int64_t>(0, number_at(print, "TotalTicks").value_or(0))};
  s.task.problem = sdcp::problem_of_error(number_at(print, "ErrorNumber").value_or(0));
  return s;
}

class SdcpPrinter final : public WholePrinter {
 public:
  SdcpPrinter(PrinterNetwork& network, Clock& clock, SdcpOptions options)
      : network_{network}, clock_{clock}, options_{std::move(options)}, id_{options_.id} {}

  Result<WholePrinterFacts> facts() override {
    const auto message = ask_for_push(sdcp::kAttributes, "Attributes");
    if (!message) return tl::unexpected{message.error()};
    return facts_of(*message, options_.address.host);
  }

  Result<WholePrinterStatus> status() override {
    const auto message = ask_for_push(sdcp::kStatus, "Status");
    if (!message) return tl::unexpected{message.error()};
    WholePrinterStatus s = status_of(*message);
    if (s.task.state == TaskState::Stopped && s.task.problem == PrinterProblem::None && !s.task.id.empty())
      s.task.problem = reason_of(s.task.id);
    return s;
  }

  Result<std::optional<PrinterTask>> task(std::string_view id) override {
    const auto answer = request(sdcp::kTaskDetails, {{"Id", Json::array({std::string{id}})}});
    if (!answer) return tl::unexpected{answer.error()};
    const auto list = answer->find("HistoryDetailList");
    if (list != answer->end() && list->is_array())
      for (const Json& item : *list) {
        if (text_at(item, "TaskId") != id) continue;
        PrinterTask known;
        known.id = id;
        known.file = without_folders(text_at(item, "TaskName"));
        known.layer = count_of(number_at(item, "AlreadyPrintLayer"));
        known.problem = sdcp::problem_of_reason(number_at(item, "ErrorStatusReason").value_or(0));
        const std::int64_t status = number_at(item, "TaskStatus").value_or(sdcp::kTaskOther);
        known.state = status == sdcp::kTaskComplete                                 ? TaskState::Complete
                      : status == sdcp::kTaskFailed || status == sdcp::kTaskStopped ? TaskState::Stopped
                                                                                    : TaskState::Unknown;
        return std::optional{std::move(known)};
      }
    return std::optional<PrinterTask>{};
  }

  Result<void> begin_upload(const PrinterUpload& file) override {
    upload_.reset();
    if (!is_file_name(file.name) || file.name.find('"') != std::string::npos)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("\"{}\" is not a name for a file on a printer", to_printable(file.name)));
    if (auto ok = connected(); !ok) return ok;
    const std::string seed = fmt::format("{} {} {} {}", file.name, file.md5, clock_.wall().count(), ++uploads_);
    upload_ = Upload{file, to_hex(digest_of(std::as_bytes(std::span{seed}))).substr(0, 32)};
    pushed_error_.reset();
    return {};
  }

  Result<UploadStep> send_part() override {
    if (!upload_) return fail(ErrorCode::Conflict, "no upload was begun");
    auto step = upload_->sent < upload_->file.bytes || upload_->file.bytes == 0 ? post_part() : checked();
    if (!step || step->is_done || step->problem != PrinterProblem::None) upload_.reset();
    return step;
  }

  Result<void> end_upload() override {
    if (!upload_) return {};
    const Upload given_up = std::move(*upload_);
    upload_.reset();
    const auto answer = request(sdcp::kEndTransfer, {{"Uuid", given_up.uuid}, {"FileName", given_up.file.name}});
    if (!answer) return tl::unexpected{answer.error()};
    return {};  // whatever it says: nothing is sent any more
  }

  Result<PrinterProblem> start(std::string_view file) override {
    if (auto ok = connected(); !ok) {
      // Nothing was asked yet; a time-out or a loss here must not read as "perhaps it starts".
      const bool is_open = ok.error().code == ErrorCode::DeviceTimeout || ok.error().code == ErrorCode::DeviceLost;
      return fail(is_open ? ErrorCode::Unreachable : ok.error().code, ok.error().what);
    }
    auto answer = order(sdcp::kStart, {{"Filename", std::string{file}}, {"StartLayer", 0}});
    // The question is out: whatever came back instead of an answer, nobody knows whether it starts.
    if (!answer && answer.error().code != ErrorCode::DeviceTimeout)
      return fail(ErrorCode::DeviceLost, answer.error().what);
    return answer;
  }
  Result<PrinterProblem> pause() override { return order(sdcp::kPause, Json::object()); }
  Result<PrinterProblem> resume() override { return order(sdcp::kContinue, Json::object()); }
  Result<PrinterProblem> stop() override { return order(sdcp::kStop, Json::object()); }

 private:
  struct Upload {
    PrinterUpload file;
    std::string uuid;
    std::uint64_t sent = 0;
  };

  Result<void> connected() {
    if (socket_) return {};
    if (id_.empty()) {
      const auto found =
          find_sdcp_printers(network_, options_.address.host, options_.connect_timeout, options_.question_port);
      if (!found) return tl::unexpected{found.error()};
      if (found->empty())
        return fail(ErrorCode::Unreachable,
                    fmt::format("no printer answers at {}; is it switched on and in this network? (telefab-fab "
                                "printers lists those that answer)",
                                options_.address.host));
      id_ = found->front().id;
    }
    if (chance_.empty()) {
      auto chance = random_hex(4);
      if (!chance) return tl::unexpected{chance.error()};
      chance_ = std::move(*chance);
    }
    auto socket = network_.connect(options_.address, sdcp::kSocketPath, options_.connect_timeout);
    if (!socket) return tl::unexpected{socket.error()};
    socket_ = std::move(*socket);
    return {};
  }

  /// Sixteen digits, other ones in every process and for every driver: boards send answers to all that are connected.
  std::string next_request() { return fmt::format("{}{:08x}", chance_, ++requests_); }

  /// What was sent may or may not have arrived.
  tl::unexpected<Error> lost(const Error& cause) {
    socket_.reset();
    return tl::unexpected{cause};
  }

  std::string envelope(std::int64_t command, Json data, const std::string& request) const {
    return json_text({{"Id", ""},
                      {"Data",
                       {{"Cmd", command},
                        {"Data", std::move(data)},
                        {"RequestID", request},
                        {"MainboardID", id_},
                        {"TimeStamp", clock_.wall().count() / 1'000'000'000},
                        {"From", 0}}},
                      {"Topic", "sdcp/request/" + id_}});
  }

  /// Takes what the printer sends until `is_it` is true of a message or the time is over.
  template <class IsIt>
  Result<Json> wait_for(const IsIt& is_it) {
    const Nanoseconds end = clock_.now() + options_.answer_timeout;
    for (Nanoseconds left = options_.answer_timeout; left.count() > 0; left = end - clock_.now()) {
      auto text = socket_->receive(left);
      if (!text) return lost(text.error());
      if (!*text) break;
      const Json message = json_or_discarded(**text);
      if (!message.is_object()) continue;  // "pong"
      const std::string topic = text_at(message, "Topic");
      if (const auto end_of_kind = topic.rfind('/');
          end_of_kind != std::string::npos && topic.starts_with("sdcp/") && topic.substr(end_of_kind + 1) != id_)
        return lost(
            {ErrorCode::NotTrusted, fmt::format("{} is the printer {}, not {}; is the address that of another one?",
                                                to_text(options_.address), topic.substr(end_of_kind + 1), id_)});
      if (topic.starts_with("sdcp/error/"))
        pushed_error_ = number_at(object_at(object_at(message, "Data"), "Data"), "ErrorCode").value_or(0);
      if (is_it(message, topic)) return message;
    }
    return lost({ErrorCode::DeviceTimeout,
                 fmt::format("the printer at {} does not answer within {:.0f} s", to_text(options_.address),
                             double(options_.answer_timeout.count()) * 1e-9)});
  }

  /// The innermost Data of the answer. A reply goes by its RequestID alone: one sample of the document has another Cmd.
  Result<Json> request(std::int64_t command, Json data) {
    if (auto ok = connected(); !ok) return tl::unexpected{ok.error()};
    const std::string own = next_request();
    if (auto ok = socket_->send(envelope(command, std::move(data), own), options_.answer_timeout); !ok)
      return lost(ok.error());
    const auto answer = wait_for([&](const Json& message, const std::string& topic) {
      return topic.starts_with("sdcp/response/") && text_at(object_at(message, "Data"), "RequestID") == own;
    });
    if (!answer) return tl::unexpected{answer.error()};
    return object_at(object_at(*answer, "Data"), "Data");
  }

  /// What the printer pushes when it is asked for it, before or behind its answer.
  Result<Json> ask_for_push(std::int64_t command, const char* key) {
    if (auto ok = connected(); !ok) return tl::unexpected{ok.error()};
    const std::string own = next_request();
    if (auto ok = socket_->send(envelope(command, Json::object(), own), options_.answer_timeout); !ok)
      return lost(ok.error());
    bool is_answered = false;
    std::optional<Json> pushed;
    const auto both = wait_for([&](const Json& message, const std::string&) {
      is_answered |= text_at(object_at(message, "Data"), "RequestID") == own;
      if (const Json& content = pushed_at(message, key); !content.empty()) pushed = content;
      return is_answered && pushed;
    });
    if (!both) return tl::unexpected{both.error()};
    return *std::move(pushed);
  }

  Result<PrinterProblem> order(std::int64_t command, Json data) {
    const auto answer = request(command, std::move(data));
    if (!answer) return tl::unexpected{answer.error()};
    const auto ack = number_at(*answer, "Ack");
    if (!ack)
      return lost({ErrorCode::ProtocolBroken,
                   fmt::format("the printer at {} answered without saying yes or no", to_text(options_.address))});
    return sdcp::problem_of_ack(*ack);
  }

  PrinterProblem reason_of(const std::string& id) {
    if (id == explained_task_) return explained_;
    const auto known = task(id);
    if (!known) return PrinterProblem::None;  // the state alone holds; whoever polls sees the loss
    explained_task_ = id;
    explained_ = *known ? (*known)->problem : PrinterProblem::None;
    return explained_;
  }

  std::string form_of(const std::vector<std::byte>& part, std::string_view boundary) const {
    const Upload& u = *upload_;
    std::string body;
    const std::pair<const char*, std::string> fields[] = {{"S-File-MD5", u.file.md5},
                                                          {"Check", "1"},
                                                          {"Offset", std::to_string(u.sent)},
                                                          {"Uuid", u.uuid},
                                                          {"TotalSize", std::to_string(u.file.bytes)}};
    for (const auto& [name, value] : fields)
      body += fmt::format("--{}\r\nContent-Disposition: form-data; name=\"{}\"\r\n\r\n{}\r\n", boundary, name, value);
    body += fmt::format(
        "--{}\r\nContent-Disposition: form-data; name=\"File\"; filename=\"{}\"\r\nContent-Type: "
        "application/octet-stream\r\n\r\n",
        boundary, u.file.name);
    body.append(reinterpret_cast<const char*>(part.data()), part.size());
    return body + fmt::format("\r\n--{}--\r\n", boundary);
  }

  Result<UploadStep> post_part() {
    Upload& u = *upload_;
    const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(sdcp::kPartBytes, u.file.bytes - u.sent));
    const auto part = u.file.read(u.sent, count);
    if (!part) return tl::unexpected{part.error()};
    const std::string boundary = "----telefab" + u.uuid;  // 128 bits by chance do not stand in a file
    const auto reply = network_.post(options_.address, sdcp::kUploadPath, "multipart/form-data; boundary=" + boundary,
                                     form_of(*part, boundary), options_.part_timeout);
    if (!reply) return tl::unexpected{reply.error()};
    const Json json = json_or_discarded(reply->body);
    if (!json.is_object())
      return fail(ErrorCode::ProtocolBroken, fmt::format("the printer at {} answered a part with status {} and no JSON",
                                                         to_text(options_.address), reply->status));
    if (text_at(json, "code") == "000000") {
      u.sent += count;
      return UploadStep{u.sent};
    }
    std::int64_t error = sdcp::kUploadFailed;
    if (const auto messages = json.find("messages"); messages != json.end() && messages->is_array())
      for (const Json& item : *messages)
        if (text_at(item, "field") == "common_field") error = number_at(item, "message").value_or(error);
    switch (error) {
      case sdcp::kCannotOpen:
        return UploadStep{u.sent, false, PrinterProblem::StorageFull};
      case sdcp::kOffsetNegative:
      case sdcp::kOffsetDiffers:
        return fail(ErrorCode::ProtocolBroken,
                    fmt::format("the printer at {} lost its place in the file at byte {}; it is sent again",
                                to_text(options_.address), u.sent));
      default:
        return UploadStep{u.sent, false, PrinterProblem::Other};
    }
  }

  /// Behind the last part: the printer compares the checksum and pushes an error where it does not hold.
  Result<UploadStep> checked() {
    clock_.sleep_for(std::chrono::seconds{1});  // boards refuse a start within the first moment
    const auto s = status();
    if (!s) return tl::unexpected{s.error()};
    UploadStep step{upload_->sent, !s->activity.receives};
    if (pushed_error_) {
      step.is_done = false;
      step.problem = *pushed_error_ == sdcp::kFormatFailed ? PrinterProblem::WrongFormat : PrinterProblem::FileDamaged;
    }
    return step;
  }

  PrinterNetwork& network_;
  Clock& clock_;
  SdcpOptions options_;
  std::string id_;
  std::unique_ptr<MessageSocket> socket_;
  std::optional<Upload> upload_;
  std::optional<std::int64_t> pushed_error_;
  std::string chance_;  ///< first half of the numbers of its requests
  std::uint32_t requests_ = 0;
  std::uint64_t uploads_ = 0;
  std::string explained_task_;
  PrinterProblem explained_ = PrinterProblem::None;
};

}  // namespace

Result<std::vector<FoundPrinter>> find_sdcp_printers(PrinterNetwork& network, std::string_view host, Nanoseconds wait,
                                                     std::uint16_t port) {
  const auto replies = network.ask(host, port, sdcp::kQuestion, wait);
  if (!replies) return tl::unexpected{replies.error()};
  std::vector<FoundPrinter> all;
  for (const Datagram& reply : *replies) {
    const Json json = json_or_discarded(reply.text);
    const Json& data = object_at(json, "Data");
    FoundPrinter p{text_at(data, "Name"),
                   text_at(data, "MachineName"),
                   text_at(data, "BrandName"),
                   text_at(data, "FirmwareVersion"),
                   text_at(data, "ProtocolVersion"),
                   text_at(data, "MainboardID"),
                   reply.host};
    // The sender's address holds, not the one in the text: that of a board with two interfaces may be the other one.
    if (p.id.empty() || !p.protocol.starts_with("V3")) continue;
    const bool is_known = std::any_of(
        all.begin(), all.end(), [&](const FoundPrinter& other) { return other.id == p.id && other.host == p.host; });
    if (!is_known) all.push_back(std::move(p));
  }
  std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.host < b.host; });
  return all;
}

std::unique_ptr<WholePrinter> make_sdcp_printer(PrinterNetwork& network, Clock& clock, SdcpOptions options) {
  return std::make_unique<SdcpPrinter>(network, clock, std::move(options));
}

}  // namespace telefab::fab
