// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/drivers/sdcp_model.hpp>

#include "sdcp_words.hpp"

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

std::optional<std::int64_t> whole_at(const Json& object, const char* key) {
  try {
    return whole_number<std::int64_t>(object.at(key));
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

bool is_text(const Json& object, const char* key, const std::string& text) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() && found->get_ref<const std::string&>() == text;
}

std::uint32_t big_endian(const std::string& bytes, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = value << 8U | static_cast<unsigned char>(bytes.at(at + i));
  return value;
}

/// What the printer looks at in a file before it prints.
struct GooHead {
  std::string model;
  PixelSize size;
  std::uint32_t layers = 0;
};
std::optional<GooHead> goo_head_of(const std::string& bytes) {
  constexpr std::size_t kHeader = 195'477, kModelAt = 92, kModelBytes = 32, kLayersAt = 195'310;
  if (bytes.size() <= kHeader || !bytes.starts_with("V3.0")) return std::nullopt;
  GooHead head;
  head.model = std::string{bytes.substr(kModelAt, kModelBytes).c_str()};
  head.layers = big_endian(bytes, kLayersAt, 4);
  head.size = {big_endian(bytes, kLayersAt + 4, 2), big_endian(bytes, kLayersAt + 6, 2)};
  return head;
}

/// The fields of a form and the bytes of its file; nothing where it is no form as the document has it.
struct Form {
  std::map<std::string, std::string> fields;
  std::string file_name, file;
};
std::optional<Form> form_of(std::string_view content_type, std::string_view body) {
  constexpr std::string_view kType = "multipart/form-data; boundary=";
  if (!content_type.starts_with(kType)) return std::nullopt;
  const std::string boundary = "--" + std::string{content_type.substr(kType.size())};
  Form form;
  while (body.starts_with(boundary)) {
    body.remove_prefix(boundary.size());
    if (body == "--\r\n") return form;
    const auto head_end = body.find("\r\n\r\n");
    if (!body.starts_with("\r\n") || head_end == std::string_view::npos) return std::nullopt;
    const std::string_view head = body.substr(0, head_end);
    body.remove_prefix(head_end + 4);
    const auto end = body.find("\r\n" + boundary);
    if (end == std::string_view::npos) return std::nullopt;
    const auto quoted = [&](std::string_view key) -> std::optional<std::string> {
      const std::string begin = fmt::format(" {}=\"", key);
      const auto at = head.find(begin);
      if (at == std::string_view::npos) return std::nullopt;
      const auto rest = head.substr(at + begin.size());
      return std::string{rest.substr(0, rest.find('"'))};
    };
    const auto name = quoted("name");
    if (!name) return std::nullopt;
    if (const auto file_name = quoted("filename")) {
      form.file_name = *file_name;
      form.file = body.substr(0, end);
    } else {
      form.fields[*name] = body.substr(0, end);
    }
    body.remove_prefix(end + 2);
  }
  return std::nullopt;
}

bool is_hex(const std::string& text, std::size_t size) {
  return text.size() == size && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

HttpReply reply_of(std::int64_t error) {
  if (error == 0)
    return {200, json_text({{"code", "000000"}, {"messages", nullptr}, {"data", Json::object()}, {"success", true}})};
  return {200, json_text({{"code", "111111"},
                          {"messages", Json::array({{{"field", "common_field"}, {"message", error}}})},
                          {"data", nullptr},
                          {"success", false}})};
}

}  // namespace

struct SdcpModel::State {
  State(SdcpModelOptions with, Clock& of) : options{std::move(with)}, clock{of} {}

  struct Task {
    std::string id, file;
    TaskState state = TaskState::Checking;
    std::uint32_t layers = 0;
    std::uint32_t exposed = 0;
    std::int64_t reason = 0;
    Nanoseconds due{};  ///< when the layer under way is exposed
    [[nodiscard]] bool runs() const { return state != TaskState::Stopped && state != TaskState::Complete; }
  };
  struct Upload {
    std::string uuid, md5, name, bytes;
    std::uint64_t total = 0;
  };

  SdcpModelOptions options;
  Clock& clock;
  SdcpFault fault = SdcpFault::None;
  std::size_t fault_at = 0;
  std::optional<SdcpMoment> fault_when;  ///< then fault_at is set
  std::size_t count = 0;
  std::map<std::string, std::string> files;
  std::map<std::string, std::size_t> starts, layers;
  std::vector<Task> tasks;
  std::optional<Upload> upload;
  std::vector<std::string> violations, pushes;
  std::string last_pushed;

  /// A fault that lasts acts by now.
  [[nodiscard]] bool acts(SdcpFault which) const { return fault == which && !fault_when && count > fault_at; }
  /// It is that moment now.
  void comes(SdcpMoment moment) {
    if (fault_when != moment) return;
    fault_when.reset();
    fault_at = count - 1;
  }
  /// One that acts once: at its interaction, or the first one behind it for which it has a meaning.
  bool strikes(SdcpFault which) {
    if (!acts(which)) return false;
    fault = SdcpFault::None;
    return true;
  }
  void violated(std::string what) { violations.push_back(std::move(what)); }
  Task* running() { return !tasks.empty() && tasks.back().runs() ? &tasks.back() : nullptr; }

  void advance() {
    Task* task = running();
    if (task == nullptr) return;
    if (task->state == TaskState::Pausing) task->state = TaskState::Paused;
    if (task->state == TaskState::Stopping) task->state = TaskState::Stopped;
    if (task->state == TaskState::Paused || !task->runs()) return;
    while (task->exposed < task->layers && clock.now() >= task->due) {
      ++task->exposed;
      ++layers[task->file];
      task->due += options.layer_time;
    }
    task->state = task->exposed == task->layers ? TaskState::Complete : TaskState::Exposing;
  }
  void begin_task(const std::string& file, std::uint32_t count_of_layers) {
    Task task;
    const std::string seed = fmt::format("{} {}", file, tasks.size());
    task.id = to_hex(digest_of(std::as_bytes(std::span{seed}))).substr(0, 32);
    task.file = file;
    task.layers = count_of_layers;
    task.due = clock.now() + options.layer_time;
    tasks.push_back(std::move(task));
  }

  /// What happens at the panel, not over the line.
  void act_at_panel() {
    if (acts(SdcpFault::Busy) && running() == nullptr && (tasks.empty() || tasks.back().file != "panel.goo"))
      begin_task("panel.goo", 1'000'000);
    if (acts(SdcpFault::OtherTask))
      if (Task* task = running()) {
        fault = SdcpFault::None;
        task->state = TaskState::Stopped;
        begin_task("other.goo", 3);
      }
  }

  Json attributes() const {
    return {{"Name", options.name},
            {"MachineName", acts(SdcpFault::WrongModel) ? std::string{"another model"} : options.model},
            {"BrandName", "CBD"},
            {"ProtocolVersion", "V3.0.0"},
            {"FirmwareVersion", "V1.0.0"},
            {"Resolution", acts(SdcpFault::WrongResolution)
                               ? std::string{"640x480"}
                               : fmt::format("{}x{}", options.size.width_px, options.size.height_px)},
            {"XYZsize", "218.88x122.88x260"},
            {"MainboardIP", "127.0.0.1"},
            {"MainboardID", options.id},
            {"Capabilities", {"FILE_TRANSFER", "PRINT_CONTROL"}},
            {"SupportFileType", acts(SdcpFault::WrongFormat) ? Json::array({"CTB"}) : Json::array({"CTB", "GOO"})},
            {"RemainingMemory", room()}};
  }
  [[nodiscard]] std::uint64_t room() const {
    if (acts(SdcpFault::FullStorage)) return 1000;
    std::uint64_t used = 0;
    for (const auto& [name, bytes] : files) used += bytes.size();
    return used >= options.storage_bytes ? 0 : options.storage_bytes - used;
  }
  Json status() {
    Json current = Json::array();
    if (running() != nullptr) current.push_back(sdcp::kPrinting);
    if (upload) current.push_back(sdcp::kTransferring);
    if (current.empty()) current.push_back(sdcp::kIdle);
    Json print{{"Status", 0},     {"CurrentLayer", 0}, {"TotalLayer", 0},  {"CurrentTicks", 0},
               {"TotalTicks", 0}, {"Filename", ""},    {"ErrorNumber", 0}, {"TaskId", ""}};
    if (!tasks.empty()) {
      const Task& t = tasks.back();
      print = {{"Status", sdcp::number_of(t.state)},
               {"CurrentLayer", t.exposed},
               {"TotalLayer", t.layers},
               {"CurrentTicks", t.exposed * options.layer_time.count() / 1'000'000},
               {"TotalTicks", t.layers * options.layer_time.count() / 1'000'000},
               {"Filename", "/local/" + t.file},
               {"ErrorNumber", 0},
               {"TaskId", t.id}};
    }
    return {{"CurrentStatus", current}, {"PreviousStatus", 0}, {"PrintInfo", print}};
  }
  [[nodiscard]] std::string push_of(const char* key, Json content, const std::string& topic) const {
    return json_text({{key, std::move(content)},
                      {"MainboardID", options.id},
                      {"TimeStamp", clock.wall().count() / 1'000'000'000},
                      {"Topic", "sdcp/" + topic + "/" + options.id}});
  }
  void push_error(std::int64_t code) {
    pushes.push_back(json_text({{"Id", "simulated"},
                                {"Data",
                                 {{"Data", {{"ErrorCode", std::to_string(code)}}},
                                  {"MainboardID", options.id},
                                  {"TimeStamp", clock.wall().count() / 1'000'000'000}}},
                                {"Topic", "sdcp/error/" + options.id}}));
  }

  std::int64_t start(const Json& data) {
    const auto name = data.find("Filename");
    const auto layer = data.find("StartLayer");
    if (name == data.end() || !name->is_string() || layer == data.end() || *layer != 0) {
      violated("a start without Filename, or not from layer 0");
      return 2;
    }
    if (running() != nullptr || upload) return 1;
    const auto file = files.find(name->get<std::string>());
    if (file == files.end()) return 2;
    const auto head = goo_head_of(file->second);
    if (!head || acts(SdcpFault::WrongFormat)) return 6;
    if (head->size != options.size || acts(SdcpFault::WrongResolution)) return 5;
    if (head->model != options.model || acts(SdcpFault::WrongModel)) return 7;
    begin_task(file->first, head->layers);
    ++starts[file->first];
    return 0;
  }
  std::int64_t control(std::int64_t command) {
    Task* task = running();
    if (task == nullptr) return 1;
    if (command == sdcp::kPause && task->state != TaskState::Paused) task->state = TaskState::Pausing;
    if (command == sdcp::kStop) task->state = TaskState::Stopping;
    if (command == sdcp::kContinue) {
      if (task->state != TaskState::Paused) return 1;
      task->state = TaskState::Exposing;
      task->due = clock.now() + options.layer_time;
    }
    return 0;
  }
  static std::int64_t status_number(const Task& t) {
    if (t.state == TaskState::Complete) return sdcp::kTaskComplete;
    if (t.state != TaskState::Stopped) return sdcp::kTaskOther;
    return t.reason != 0 ? sdcp::kTaskFailed : sdcp::kTaskStopped;
  }
  Json details(const Json& data) {
    Json list = Json::array();
    const auto ids = data.find("Id");
    if (ids != data.end() && ids->is_array())
      for (const Task& t : tasks)
        if (std::find(ids->begin(), ids->end(), Json(t.id)) != ids->end())
          list.push_back({{"TaskName", t.file},
                          {"TaskId", t.id},
                          {"TaskStatus", status_number(t)},
                          {"AlreadyPrintLayer", t.exposed},
                          {"ErrorStatusReason", t.reason}});
    return {{"Ack", 0}, {"HistoryDetailList", list}};
  }

  /// The answer's inner Data, and in `behind` what is pushed behind it.
  std::optional<Json> carry_out(std::int64_t command, const Json& data, std::vector<std::string>& behind) {
    switch (command) {
      case sdcp::kStatus:
        behind.push_back(push_of("Status", status(), "status"));
        return Json{{"Ack", 0}};
      case sdcp::kAttributes:
        behind.push_back(push_of("Attributes", attributes(), "attributes"));
        return Json{{"Ack", 0}};
      case sdcp::kStart:
        return Json{{"Ack", start(data)}};
      case sdcp::kPause:
      case sdcp::kStop:
      case sdcp::kContinue:
        return Json{{"Ack", control(command)}};
      case sdcp::kEndTransfer: {
        const bool is_own = upload && is_text(data, "Uuid", upload->uuid);
        if (is_own) upload.reset();
        return Json{{"Ack", is_own ? 0 : 1}};
      }
      case sdcp::kTaskDetails:
        return details(data);
      default:
        violated(fmt::format("command {}", command));
        return std::nullopt;
    }
  }

  std::int64_t take_part(const Form& form) {
    const auto field = [&](const char* name) {
      const auto found = form.fields.find(name);
      return found == form.fields.end() ? std::string{} : found->second;
    };
    const std::string md5 = field("S-File-MD5"), uuid = field("Uuid");
    const std::string offset_text = field("Offset"), total_text = field("TotalSize");
    const auto is_number = [](const std::string& text) {
      return !text.empty() && text.size() < 16 && text.find_first_not_of("0123456789") == std::string::npos;
    };
    if (!is_hex(md5, 32) || !is_hex(uuid, 32) || field("Check") != "1" || !is_number(total_text) ||
        form.file_name.empty()) {
      violated("a part without S-File-MD5, Uuid, Check, TotalSize or a file's name");
      return sdcp::kUploadFailed;
    }
    if (!is_number(offset_text)) return sdcp::kOffsetNegative;
    const std::uint64_t offset = std::stoull(offset_text), total = std::stoull(total_text);
    if (running() != nullptr) return sdcp::kUploadFailed;
    if (strikes(SdcpFault::LostOffset)) {
      upload.reset();
      return sdcp::kOffsetDiffers;
    }
    if (!upload || upload->uuid != uuid) {
      if (offset != 0) return sdcp::kOffsetDiffers;
      upload = Upload{uuid, md5, form.file_name, {}, total};
    }
    if (total > room()) {
      upload.reset();
      return sdcp::kCannotOpen;
    }
    Upload& u = *upload;
    if (offset != u.bytes.size()) return sdcp::kOffsetDiffers;
    if (u.md5 != md5 || u.total != total || u.name != form.file_name) violated("parts of one upload that differ");
    const bool is_last = offset + form.file.size() == total;
    if (form.file.size() > sdcp::kPartBytes || (!is_last && form.file.size() != sdcp::kPartBytes))
      violated(fmt::format("a part of {} bytes", form.file.size()));
    u.bytes += form.file;
    if (u.bytes.size() < u.total) return 0;
    if (strikes(SdcpFault::BadChecksum)) u.bytes.at(0) = static_cast<char>(u.bytes.at(0) + 1);
    if (md5_hex(std::as_bytes(std::span{u.bytes})) == u.md5)
      files[u.name] = std::move(u.bytes);
    else
      push_error(sdcp::kMd5Failed);
    upload.reset();
    return 0;
  }
};

std::string_view name_of(SdcpFault fault) {
  static constexpr std::array<std::string_view, kSdcpFaults> names{
      "none",        "wrong-model",  "wrong-resolution", "wrong-format", "full-storage", "cut-upload",
      "lost-offset", "bad-checksum", "lost-socket",      "lost-answer",  "no-answer",    "busy",
      "silent",      "other-task",   "too-many-clients", "reboots"};
  return names.at(static_cast<std::size_t>(fault));
}

std::optional<SdcpFault> sdcp_fault_from_name(std::string_view name) {
  for (std::size_t i = 0; i < kSdcpFaults; ++i)
    if (name_of(static_cast<SdcpFault>(i)) == name) return static_cast<SdcpFault>(i);
  return std::nullopt;
}

SdcpModel::SdcpModel(SdcpModelOptions options, Clock& clock)
    : state_{std::make_unique<State>(std::move(options), clock)} {}
SdcpModel::~SdcpModel() = default;

void SdcpModel::inject_when(SdcpFault fault, SdcpMoment moment) {
  state_->fault = fault;
  state_->fault_when = moment;
}

void SdcpModel::inject(SdcpFault fault, std::size_t at) {
  state_->fault = fault;
  state_->fault_when.reset();
  state_->fault_at = at;
}
void SdcpModel::repair() {
  state_->fault = SdcpFault::None;
  if (auto* task = state_->running(); task != nullptr && task->file == "panel.goo") task->state = TaskState::Complete;
}
std::size_t SdcpModel::interactions() const { return state_->count; }
std::size_t SdcpModel::starts_of(const std::string& file) const {
  const auto found = state_->starts.find(file);
  return found == state_->starts.end() ? 0 : found->second;
}
std::size_t SdcpModel::starts() const {
  std::size_t sum = 0;
  for (const auto& [file, count] : state_->starts) sum += count;
  return sum;
}
std::size_t SdcpModel::layers_of(const std::string& file) {
  state_->advance();
  return state_->layers[file];
}
const std::string& SdcpModel::stored(const std::string& file) const {
  static const std::string nothing;
  const auto found = state_->files.find(file);
  return found == state_->files.end() ? nothing : found->second;
}
const std::vector<std::string>& SdcpModel::violations() const { return state_->violations; }

std::optional<std::string> SdcpModel::on_datagram(std::string_view text) {
  State& s = *state_;
  if (text != sdcp::kQuestion || s.acts(SdcpFault::Silent)) return std::nullopt;
  return json_text({{"Id", "simulated"},
                    {"Data",
                     {{"Name", s.options.name},
                      {"MachineName", s.options.model},
                      {"BrandName", "CBD"},
                      {"MainboardIP", "127.0.0.1"},
                      {"MainboardID", s.options.id},
                      {"ProtocolVersion", "V3.0.0"},
                      {"FirmwareVersion", "V1.0.0"}}}});
}

bool SdcpModel::lets_in(std::size_t clients) {
  ++state_->count;
  return clients < state_->options.most_clients && !state_->acts(SdcpFault::TooManyClients) &&
         !state_->acts(SdcpFault::Silent);
}

PeerAnswer SdcpModel::on_message(std::string_view text) {
  State& s = *state_;
  ++s.count;
  s.advance();
  const Json message = json_or_discarded(text);
  const Json none;
  const Json& outer = message.is_object() && message.contains("Data") ? message["Data"] : none;
  if (outer.is_object() && whole_at(outer, "Cmd") == sdcp::kStart) s.comes(SdcpMoment::Start);
  if (s.running() != nullptr) s.comes(SdcpMoment::Watch);
  s.act_at_panel();
  if (s.acts(SdcpFault::Silent)) return {};
  if (s.acts(SdcpFault::TooManyClients) || s.strikes(SdcpFault::LostSocket)) return {{}, true};
  if (s.strikes(SdcpFault::Reboots)) {
    if (State::Task* task = s.running()) {
      task->state = TaskState::Stopped;
      task->reason = 19;
    }
    s.upload.reset();
    return {{}, true};
  }
  if (text == "ping") return {{"pong"}, false};
  const bool is_request = outer.is_object() && whole_at(outer, "Cmd") && whole_at(outer, "TimeStamp") &&
                          whole_at(outer, "From") && outer.contains("Data") && outer["Data"].is_object() &&
                          outer.contains("RequestID") && outer["RequestID"].is_string() && message.contains("Id") &&
                          is_text(message, "Topic", "sdcp/request/" + s.options.id) &&
                          is_text(outer, "MainboardID", s.options.id);
  if (!is_request) {
    s.violated("not a request of this printer: " + std::string{text.substr(0, 200)});
    return {};
  }
  std::vector<std::string> behind;
  const std::int64_t command = *whole_at(outer, "Cmd");
  const auto inner = s.carry_out(command, outer["Data"], behind);
  if (s.strikes(SdcpFault::LostAnswer)) return {{}, true};
  if (!inner || s.strikes(SdcpFault::NoAnswer)) return {};
  PeerAnswer answer;
  answer.messages.push_back(json_text({{"Id", "simulated"},
                                       {"Data",
                                        {{"Cmd", command},
                                         {"Data", *inner},
                                         {"RequestID", outer["RequestID"]},
                                         {"MainboardID", s.options.id},
                                         {"TimeStamp", s.clock.wall().count() / 1'000'000'000}}},
                                       {"Topic", "sdcp/response/" + s.options.id}}));
  answer.messages.insert(answer.messages.end(), behind.begin(), behind.end());
  return answer;
}

std::optional<HttpReply> SdcpModel::on_post(std::string_view path, std::string_view content_type,
                                            std::string_view body) {
  State& s = *state_;
  ++s.count;
  s.comes(SdcpMoment::Upload);
  s.advance();
  s.act_at_panel();
  if (s.acts(SdcpFault::Silent) || s.acts(SdcpFault::CutUpload) || s.acts(SdcpFault::TooManyClients))
    return std::nullopt;
  if (s.strikes(SdcpFault::Reboots)) {
    s.upload.reset();
    return std::nullopt;
  }
  const auto form = form_of(content_type, body);
  if (path != sdcp::kUploadPath || !form) {
    s.violated("a post that is not a part of a file");
    return HttpReply{404, ""};
  }
  const HttpReply reply = reply_of(s.take_part(*form));
  if (s.strikes(SdcpFault::LostAnswer) || s.strikes(SdcpFault::NoAnswer)) return std::nullopt;
  return reply;
}

std::vector<std::string> SdcpModel::pushed() {
  State& s = *state_;
  s.advance();
  if (s.acts(SdcpFault::Silent)) return {};
  std::vector<std::string> all = std::exchange(s.pushes, {});
  const Json now = s.status();
  if (const std::string text = json_text(now); text != s.last_pushed) {
    s.last_pushed = text;
    all.push_back(s.push_of("Status", now, "status"));
  }
  return all;
}

namespace {

class ModelSocket final : public MessageSocket {
 public:
  ModelSocket(PrinterPeer& peer, Clock& clock, std::size_t& open) : peer_{peer}, clock_{clock}, open_{open} { ++open_; }
  ~ModelSocket() override { --open_; }
  Result<void> send(std::string_view text, Nanoseconds) override {
    if (is_closed_) return closed();
    PeerAnswer answer = peer_.on_message(text);
    received_.insert(received_.end(), answer.messages.begin(), answer.messages.end());
    is_closed_ = answer.hangs_up;
    return {};
  }
  Result<std::optional<std::string>> receive(Nanoseconds timeout) override {
    constexpr Nanoseconds kLook = std::chrono::milliseconds{100};
    for (Nanoseconds waited{}; received_.empty() && !is_closed_; waited += kLook) {
      const auto pushes = peer_.pushed();
      received_.insert(received_.end(), pushes.begin(), pushes.end());
      if (!received_.empty()) break;
      if (waited >= timeout) return std::optional<std::string>{};
      clock_.sleep_for(kLook);
    }
    if (received_.empty()) return closed();
    std::optional<std::string> first{std::move(received_.front())};
    received_.erase(received_.begin());
    return first;
  }

 private:
  static tl::unexpected<Error> closed() { return fail(ErrorCode::DeviceLost, "the simulated printer hung up"); }
  PrinterPeer& peer_;
  Clock& clock_;
  std::size_t& open_;
  std::vector<std::string> received_;
  bool is_closed_ = false;
};

class ModelNetwork final : public PrinterNetwork {
 public:
  ModelNetwork(PrinterPeer& peer, Clock& clock) : peer_{peer}, clock_{clock} {}
  Result<std::vector<Datagram>> ask(std::string_view, std::uint16_t, std::string_view text, Nanoseconds wait) override {
    const auto reply = peer_.on_datagram(text);
    if (!reply) clock_.sleep_for(wait);
    return reply ? std::vector<Datagram>{{"127.0.0.1", *reply}} : std::vector<Datagram>{};
  }
  Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress&, std::string_view path,
                                                 Nanoseconds timeout) override {
    if (path != sdcp::kSocketPath || !peer_.lets_in(open_)) {
      clock_.sleep_for(timeout);
      return fail(ErrorCode::DeviceRefused, "the simulated printer declines another connection");
    }
    return std::make_unique<ModelSocket>(peer_, clock_, open_);
  }
  Result<HttpReply> post(const PrinterAddress&, std::string_view path, std::string_view content_type, std::string body,
                         Nanoseconds) override {
    auto reply = peer_.on_post(path, content_type, body);
    if (!reply) return fail(ErrorCode::DeviceLost, "the simulated printer hung up");
    return *std::move(reply);
  }

 private:
  PrinterPeer& peer_;
  Clock& clock_;
  std::size_t open_ = 0;
};

}  // namespace

std::unique_ptr<PrinterNetwork> model_network(PrinterPeer& peer, Clock& clock) {
  return std::make_unique<ModelNetwork>(peer, clock);
}

}  // namespace telefab::fab
