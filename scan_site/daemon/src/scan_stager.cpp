// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_stager.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/scan/slicing/standings.hpp>
#include <telefab/scan/staging/joined_views.hpp>
#include <telefab/scan/staging/print_estimate.hpp>

namespace telefab::scan {
namespace {

using Json = nlohmann::ordered_json;

/// Larger files are cut as they are, unseen: their points would not fit beside those of a job.
constexpr std::uint64_t kMostShown_bytes = 1ULL << 30U;
/// Clouds held at once; the one used longest ago goes.
constexpr std::size_t kMostHeld = 2;
/// Ways to stand that are offered, and how far apart.
constexpr std::size_t kMostWays = 5;
constexpr double kWaysApart_deg = 20;

constexpr std::array<std::string_view, 4> kStates{"none", "working", "done", "failed"};

/// All that decides which points are the object and what surface they carry.
std::string intake_text(const SliceRequest& r) {
  Json text{r.intake.sample_faces, r.intake.pick.pieces, !r.mls.drop_outliers, r.complete};
  if (const auto& crop = r.intake.pick.crop)
    for (const Vec3& corner : {crop->min, crop->max}) text.push_back({corner.x(), corner.y(), corner.z()});
  for (const std::uint32_t number : r.intake.pick.only) text.push_back(number);
  text.push_back(r.most_gap_mm.value_or(0));
  text.push_back(r.thickness_mm.value_or(0));
  text.push_back(r.mls.kernel_mm.value_or(0));
  text.push_back(static_cast<int>(r.mls.surface));
  // What is said in millimetres of the print means another surface at another size.
  if (r.most_gap_mm || r.thickness_mm || r.mls.kernel_mm) {
    const PlacementOptions& p = r.placement;
    for (const double size : {p.height_mm.value_or(0), p.scale.value_or(0), p.unit_mm.value_or(0)})
      text.push_back(size);
    text.push_back(p.fit ? r.machine.name : "");
    for (const double entry : p.turn.matrix().reshaped()) text.push_back(entry);
  }
  return json_text(text);
}

Json standing_json(const Standing& s) {
  return {{"rotate", rotate_text(s.turn)},
          {"source", name_of(s.source)},
          {"cost", s.cost},
          {"figures", json_or_discarded(to_json(s.figures))}};
}

}  // namespace

ScanStager::ScanStager(UploadStore& uploads, std::function<Result<void>(std::uint64_t)> room)
    : uploads_{uploads},
      room_{std::move(room)},
      queue_{"stager", [this](const std::string& task, std::stop_token stop) { run(task, stop); }} {}

bool ScanStager::holds(const std::string& id, const Scan& scan, Kind kind) const {
  if (kind == &Scan::joining) return false;  // what was made may have gone since; the same bytes are the same upload
  if (kind == &Scan::look) return scan.staged != nullptr;
  if (kind != &Scan::reading) return true;
  const auto upload = uploads_.find(id);
  return scan.picture.size() > 0 && upload && upload->state != UploadState::Checking;
}

void ScanStager::ask(const std::string& id, Kind kind, Question question) {
  const std::string task = id + letter_of(kind);
  {
    const std::lock_guard lock{mutex_};
    Scan& scan = scans_[id];
    scan.used = ++next_;
    Question& now = scan.*kind;
    // The same question is not asked twice, while its answer is on its way or holds.
    const bool is_known =
        now.state == Question::State::Working || (now.state == Question::State::Done && holds(id, scan, kind));
    if (is_known && now.asked == question.asked) return;
    now = std::move(question);
    now.state = Question::State::Working;
    now.number = ++next_;
  }
  queue_.drop(task);
  queue_.add(task);
}

void ScanStager::read(const std::string& id) {
  Question question;
  question.asked = "read";
  ask(id, &Scan::reading, std::move(question));
}

void ScanStager::look(const std::string& id, SliceRequest request, std::string asked) {
  read(id);
  Question question;
  question.request = std::move(request);
  question.asked = std::move(asked);
  ask(id, &Scan::look, std::move(question));
}

void ScanStager::estimate(const std::string& id, SliceRequest request, std::optional<ResinPrice> price,
                          std::string asked) {
  Question question;
  question.price = std::move(price);
  question.request = std::move(request);
  question.asked = std::move(asked);
  ask(id, &Scan::estimate, std::move(question));
}

void ScanStager::orient(const std::string& id, SliceRequest request, StandFor goal, std::string asked) {
  Question question;
  question.request = std::move(request);
  question.goal = goal;
  question.asked = std::move(asked);
  ask(id, &Scan::orientation, std::move(question));
}

void ScanStager::join(const std::string& id, std::vector<std::string> with, std::string owner) {
  Question question;
  for (const std::string& other : with) question.asked += (question.asked.empty() ? "" : ",") + other;
  question.with = std::move(with);
  question.owner = std::move(owner);
  ask(id, &Scan::joining, std::move(question));
}

void ScanStager::forget(const std::string& id) {
  {
    const std::lock_guard lock{mutex_};
    scans_.erase(id);
  }
  for (const auto& [kind, letter] : kKinds) queue_.drop(id + letter);
}

void ScanStager::forget_others(const std::string& id) {
  while (true) {
    std::size_t held = 0;
    Scan* oldest = nullptr;
    for (auto& [other, scan] : scans_) {
      if (scan.picture.size() == 0 && !scan.staged) continue;
      ++held;
      if (other != id && (oldest == nullptr || scan.used < oldest->used)) oldest = &scan;
    }
    if (held <= kMostHeld || oldest == nullptr) return;
    // Questions and answers are small, and perhaps somebody waits for them.
    oldest->staged.reset();
    oldest->staged_as.clear();
    oldest->picture = {};
  }
}

void ScanStager::set_progress(const std::string& id, Kind kind, std::uint64_t number, std::string_view stage,
                              double share) {
  const std::lock_guard lock{mutex_};
  const auto found = scans_.find(id);
  if (found == scans_.end() || (found->second.*kind).number != number) return;
  (found->second.*kind).stage = stage;
  (found->second.*kind).share = share;
}

void ScanStager::run(const std::string& task, const std::stop_token& stop) {
  const std::string id = task.substr(0, task.size() - 1);
  const Kind kind = std::ranges::find(kKinds, task.back(), &std::pair<Kind, char>::second)->first;
  Question question;
  {
    const std::lock_guard lock{mutex_};
    const auto found = scans_.find(id);
    if (found == scans_.end() || (found->second.*kind).state != Question::State::Working) return;
    question = found->second.*kind;
  }
  Result<std::string> outcome;
  try {
    outcome = answer(id, kind, question, stop);
  } catch (const std::bad_alloc&) {
    outcome = fail(ErrorCode::TooLarge, "this scan does not fit into the machine's memory");
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("a fault of Telefab: {}", error.what()));
  }
  const std::lock_guard lock{mutex_};
  const auto found = scans_.find(id);
  if (found == scans_.end()) return;
  Question& now = found->second.*kind;
  if (now.number != question.number) return;  // asked again meanwhile
  // Stopped for a question that had come already when this began: its task is in the queue once more.
  if (!outcome && outcome.error().code == ErrorCode::Cancelled) return;
  if (outcome) {
    now.state = Question::State::Done;
    now.answer_json = std::move(*outcome);
  } else {
    now.state = Question::State::Failed;
    now.why = outcome.error();
  }
}

Result<std::string> ScanStager::answer(const std::string& id, Kind kind, const Question& question,
                                       const std::stop_token& stop) {
  if (kind == &Scan::reading) return read_file_of(id, stop);
  if (kind == &Scan::joining) return joined(id, question, stop);
  const auto scan = staged(id, kind, question, stop);
  if (!scan) return tl::unexpected{scan.error()};
  if (kind == &Scan::look) return (*scan)->facts_json;
  if (kind == &Scan::estimate) {
    set_progress(id, kind, question.number, "estimating", 0);
    auto estimate = estimate_print(**scan, question.request, stop);
    if (!estimate) return tl::unexpected{estimate.error()};
    estimate->price = question.price;
    return to_json(*estimate);
  }
  const auto ways =
      standings_of((*scan)->prepared.cloud, question.request, {.goal = question.goal},
                   [&](double share) { set_progress(id, kind, question.number, "judging directions", share); }, stop);
  if (!ways) return tl::unexpected{ways.error()};
  Json list = Json::array();
  for (const Standing& s : best_apart(*ways, kMostWays, kWaysApart_deg)) list.push_back(standing_json(s));
  return json_text({{"for", name_of(question.goal)}, {"ways", list}});
}

Result<std::vector<std::byte>> ScanStager::bytes_of(const std::string& id, std::string& name) const {
  const auto upload = uploads_.find(id);
  if (!upload) return tl::unexpected{upload.error()};
  name = upload->plan.name;
  if (upload->plan.size_bytes > kMostShown_bytes)
    return fail(ErrorCode::TooLarge,
                fmt::format("{} is larger than the {} MiB that are shown here; it can be sent all the same", name,
                            kMostShown_bytes >> 20U));
  const auto path = uploads_.file(id);
  if (!path) return tl::unexpected{path.error()};
  return read_file(*path, kMostShown_bytes);
}

Result<std::string> ScanStager::joined(const std::string& id, const Question& question, const std::stop_token& stop) {
  std::vector<ViewFile> files;
  std::uint64_t bytes = 0;
  std::vector<std::string> ids{id};
  ids.insert(ids.end(), question.with.begin(), question.with.end());
  for (const std::string& each : ids) {
    ViewFile file;
    auto read = bytes_of(each, file.name);
    if (!read) return tl::unexpected{read.error()};
    file.bytes = std::move(*read);
    bytes += file.bytes.size();
    if (bytes > kMostShown_bytes)
      return fail(
          ErrorCode::TooLarge,
          fmt::format("the views are larger together than the {} MiB that are joined here; telefab-scan register "
                      "joins them",
                      kMostShown_bytes >> 20U));
    files.push_back(std::move(file));
  }
  const auto scan = joined_views(
      files,
      [&](const Progress& p) { set_progress(id, &Scan::joining, question.number, label_of(p.stage), p.fraction); },
      stop);
  if (!scan) return tl::unexpected{scan.error()};
  const std::span<const std::byte> content = scan->ply;
  if (auto room = room_(content.size()); !room) return tl::unexpected{room.error()};
  const std::string stem = std::filesystem::path{files.front().name}.stem().string();
  auto upload =
      uploads_.begin({fmt::format("{}-joined.ply", stem), content.size(), digest_of(content), question.owner});
  while (upload && upload->state == UploadState::Receiving) {
    const auto rest = content.subspan(upload->received_bytes);
    upload = uploads_.append(upload->id, upload->received_bytes,
                             rest.first(std::min<std::size_t>(rest.size(), uploads_.limits().part_bytes)));
  }
  if (upload && upload->state == UploadState::Checking) upload = uploads_.check(upload->id, stop);
  if (!upload) return tl::unexpected{upload.error()};
  Json answer = parsed_json(scan->facts_json);
  answer["id"] = upload->id;
  return json_text(answer);
}

Result<std::string> ScanStager::read_file_of(const std::string& id, const std::stop_token& stop) {
  const auto upload = uploads_.find(id);
  if (!upload) return tl::unexpected{upload.error()};
  if (upload->state == UploadState::Checking)
    if (const auto checked = uploads_.check(id, stop); !checked) return tl::unexpected{checked.error()};
  std::string name;
  const auto bytes = bytes_of(id, name);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto raw = raw_scan(*bytes, name, stop);
  if (!raw) return tl::unexpected{raw.error()};
  const std::lock_guard lock{mutex_};
  if (const auto found = scans_.find(id); found != scans_.end()) {
    if (!found->second.staged) {
      found->second.picture = std::move(raw->picture);
      found->second.revision = ++next_;
    }
    forget_others(id);
  }
  return std::move(raw->facts_json);
}

Result<std::shared_ptr<const StagedScan>> ScanStager::staged(const std::string& id, Kind kind, const Question& question,
                                                             const std::stop_token& stop) {
  const std::string as = intake_text(question.request);
  {
    const std::lock_guard lock{mutex_};
    const auto found = scans_.find(id);
    if (found != scans_.end() && found->second.staged && found->second.staged_as == as) return found->second.staged;
  }
  std::string name;
  const auto bytes = bytes_of(id, name);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto made = staged_scan(
      *bytes, name, question.request,
      [&](const Progress& p) { set_progress(id, kind, question.number, label_of(p.stage), p.fraction); }, stop);
  if (!made) return tl::unexpected{made.error()};
  auto scan = std::make_shared<const StagedScan>(std::move(*made));
  const std::lock_guard lock{mutex_};
  if (const auto found = scans_.find(id); found != scans_.end()) {
    found->second.staged = scan;
    found->second.staged_as = as;
    found->second.picture = scan->picture;
    found->second.revision = ++next_;
    forget_others(id);
  }
  return scan;
}

void ScanStager::describe(const std::string& id, Json& view) const {
  const std::lock_guard lock{mutex_};
  static const Scan kNothing;
  const auto found = scans_.find(id);
  const Scan& scan = found == scans_.end() ? kNothing : found->second;
  const auto json_of = [](const Question& q) {
    Json json{{"state", kStates[static_cast<std::size_t>(q.state)]}, {"number", q.number}, {"asked", q.asked}};
    if (q.state == Question::State::Working) {
      json["stage"] = q.stage;
      json["share"] = q.share;
    }
    if (q.state == Question::State::Failed) {
      json["code"] = name_of(q.why.code);
      json["why"] = q.why.what;
    }
    if (q.state == Question::State::Done) json["result"] = json_or_discarded(q.answer_json);
    return json;
  };
  view["reading"] = json_of(scan.reading);
  view["look"] = json_of(scan.look);
  view["estimate"] = json_of(scan.estimate);
  view["orientation"] = json_of(scan.orientation);
  view["joining"] = json_of(scan.joining);
  view["picture"] = {{"revision", scan.revision}, {"levels", scan.picture.levels()}, {"points", scan.picture.size()}};
}

Result<std::vector<std::byte>> ScanStager::level(const std::string& id, std::uint64_t revision,
                                                 std::uint32_t level) const {
  const std::lock_guard lock{mutex_};
  const auto found = scans_.find(id);
  if (found == scans_.end() || found->second.picture.size() == 0)
    return fail(ErrorCode::NotFound, "there is no picture of this scan now; ask to look at it again");
  if (found->second.revision != revision)
    return fail(ErrorCode::Conflict,
                fmt::format("the picture is another one by now: revision {}", found->second.revision));
  if (level >= found->second.picture.levels())
    return fail(ErrorCode::NotFound,
                fmt::format("the picture has {} levels of detail, from 0", found->second.picture.levels()));
  return found->second.picture.level(level);
}

}  // namespace telefab::scan
