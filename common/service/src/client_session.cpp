// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <telefab/base/file.hpp>
#include <telefab/base/text.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/service/message_session.hpp>

namespace telefab {
namespace {

constexpr auto kWatchEvery = std::chrono::milliseconds{50};

/// A scan on its way in. The file is removed unless it was handed over.
class Upload {
 public:
  static Result<std::unique_ptr<Upload>> begin(const Submit& submit, const std::filesystem::path& folder) {
    std::string pattern = (folder / "upload-XXXXXX").string();
    const int file = ::mkostemp(pattern.data(), O_CLOEXEC);
    if (file < 0) return fail_system("make a file in", folder, errno);
    return std::unique_ptr<Upload>{new Upload{submit, pattern, file}};
  }
  ~Upload() {
    ::close(file_);
    std::error_code ignored;  // handed over already
    std::filesystem::remove(path_, ignored);
  }
  Upload(const Upload&) = delete;
  Upload& operator=(const Upload&) = delete;

  Result<void> take(const UploadBlock& block) {
    if (block.offset_bytes != got_ || block.content.empty() || block.content.size() > submit_.size_bytes - got_)
      return fail(ErrorCode::ProtocolBroken, "upload: the blocks do not follow each other within the announced size");
    std::span<const std::byte> rest = block.content;
    while (!rest.empty()) {
      const ssize_t n = ::write(file_, rest.data(), rest.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return fail_system("keep the scan in", path_, errno);
      rest = rest.subspan(static_cast<std::size_t>(n));
    }
    hasher_.feed(block.content);
    got_ += block.content.size();
    return {};
  }
  [[nodiscard]] std::uint64_t missing_bytes() const { return submit_.size_bytes - got_; }
  [[nodiscard]] bool is_whole() const { return missing_bytes() == 0; }
  /// Durable and with the digest that was announced.
  Result<void> finish() const {
    if (hasher_.digest() != submit_.content)
      return fail(ErrorCode::NotTrusted, fmt::format("{} did not arrive as it was sent; send it again", submit_.name));
    if (::fsync(file_) != 0) return fail_system("sync", path_, errno);
    return {};
  }
  [[nodiscard]] const Submit& submit() const { return submit_; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  Upload(Submit submit, std::filesystem::path path, int file)
      : submit_{std::move(submit)}, path_{std::move(path)}, file_{file} {}
  Submit submit_;
  std::filesystem::path path_;
  int file_;
  std::uint64_t got_ = 0;
  Hasher hasher_;
};

class ClientSession final : public MessageSession {
 public:
  ClientSession(net::Loop& loop, net::ConnectionPtr connection, JobService& service, const ClientLimits& limits)
      : MessageSession{loop, std::move(connection), service}, limits_{limits} {}

 private:
  void on_message(const Message& message) override {
    std::visit([&](const auto& question) { answer(question); }, message);
  }
  void on_end() override {
    while (!uploads_.empty()) remove_upload(uploads_.begin()->first);
    watches_.clear();
  }

  [[nodiscard]] bool may_change() const {
    const auto& role = peer().role;
    return !role || *role == net::Role::Operator;
  }
  [[nodiscard]] Error refuse_role(std::string_view operation) {
    service().note(peer().name, fmt::format("refused: {}", operation));
    return {ErrorCode::NotPermitted,
            fmt::format("\"{}\" has the role {} and may not {}", peer().name, net::name_of(*peer().role), operation)};
  }
  [[nodiscard]] std::string who(std::string_view claimed) const {
    if (peer().role || claimed.empty()) return peer().name;
    return std::string{claimed};  // on loopback without certificates the name is what the caller says
  }

  void answer(const AskMachines& question) {
    service().machines([weak = weak_from_this(), request = question.request](Machines machines) {
      machines.request = request;
      if (const auto self = weak.lock()) static_cast<ClientSession&>(*self).send(machines);
    });
  }

  void answer(const Submit& submit) {
    if (!may_change()) return send_fault(submit.request, refuse_role("submit"));
    if (uploads_.size() >= limits_.max_uploads)
      return send_fault(submit.request, {ErrorCode::TooLarge, "upload-limit: too many uploads at once"});
    if (submit.size_bytes == 0)
      return send_fault(submit.request, {ErrorCode::InvalidInput, fmt::format("{} is empty", submit.name)});
    if (auto may = service().may_submit(submit); !may) return send_fault(submit.request, may.error());
    auto upload = Upload::begin(submit, service().incoming());
    if (!upload) return send_fault(submit.request, upload.error());
    remove_upload(submit.request);  // one that was begun under the same number is given up
    service().expect_upload((*upload)->path(), submit.size_bytes);
    uploads_[submit.request] = std::move(*upload);
    send(UploadReady{submit.request, 0});
  }

  void answer(const UploadBlock& block) {
    const auto found = uploads_.find(block.request);
    // Blocks of a refused upload may still be on their way.
    if (found == uploads_.end()) return;
    Upload& upload = *found->second;
    auto taken = upload.take(block);
    service().expect_upload(upload.path(), upload.missing_bytes());
    if (taken && !upload.is_whole()) return;
    if (taken) taken = upload.finish();
    if (!taken) {
      send_fault(block.request, taken.error());
      remove_upload(block.request);
      return;
    }
    auto job = service().submit(upload.submit(), upload.path(), who(""));
    if (job)
      send(Jobs{block.request, {std::move(*job)}});
    else
      send_fault(block.request, job.error());
    remove_upload(block.request);
  }

  /// Handed over, or given up: nobody waits for its bytes any more.
  void remove_upload(RequestId request) {
    const auto found = uploads_.find(request);
    if (found == uploads_.end()) return;  // gone with the connection
    service().expect_upload(found->second->path(), 0);
    uploads_.erase(found);
  }

  void answer(const AskJobs& question) {
    if (question.job.empty()) {
      auto page = service().store().list({question.most, question.words, question.states, question.before});
      if (!page) return send_fault(question.request, page.error());
      return send(Jobs{question.request, std::move(page->jobs), page->next});
    }
    auto job = service().store().find(question.job);
    if (!job) return send_fault(question.request, job.error(), question.job);
    send(Jobs{question.request, {*job}});
    if (!question.watch || is_final(job->state)) return;
    if (watches_.size() >= limits_.max_watches)
      return send_fault(question.request, {ErrorCode::TooLarge, "watch-limit: too many watches"}, question.job);
    watches_[question.request] = std::move(*job);
    if (!is_watching_) watch_again();
  }

  void watch_again() {
    is_watching_ = true;
    loop().after(kWatchEvery, [weak = weak_from_this()] {
      if (const auto self = weak.lock()) static_cast<ClientSession&>(*self).look_at_watches();
    });
  }

  void look_at_watches() {
    is_watching_ = false;
    if (!is_open()) return;
    const std::uint64_t revision = service().store().revision();
    if (revision != seen_revision_) {
      seen_revision_ = revision;
      for (auto each = watches_.begin(); each != watches_.end();) {
        auto job = service().store().find(each->second.id);
        if (job && *job != each->second) {
          send(Jobs{each->first, {*job}});
          if (!is_open()) return;
          each->second = std::move(*job);
        }
        each = is_final(each->second.state) ? watches_.erase(each) : std::next(each);
      }
    }
    if (!watches_.empty()) watch_again();
  }

  void answer(const Command& command) {
    if (!may_change()) return send_fault(command.request, refuse_role(name_of(command.command)), command.job);
    Command with_name = command;
    with_name.who = who(command.who);
    carry_out(with_name);
  }

  void answer(const AskFiles& question) { send_list(question); }

  void answer(const AskFile& question) {
    if (files_under_way() >= limits_.max_files)
      return send_fault(question.request, {ErrorCode::TooLarge, "file-limit: too many files at once"}, question.job);
    send_file(question);
  }

  /// What only sites send each other, or only a site sends a client.
  template <class Other>
  void answer(const Other&) {
    refuse_message("client");
  }

  ClientLimits limits_;
  bool is_watching_ = false;
  std::uint64_t seen_revision_ = 0;
  std::map<RequestId, std::unique_ptr<Upload>> uploads_;
  std::map<RequestId, Job> watches_;
};

}  // namespace

std::vector<FileEntry> files_of(const std::filesystem::path& folder) {
  std::vector<FileEntry> files;
  std::error_code error;  // no folder: no files
  for (const auto& entry : std::filesystem::directory_iterator{folder, error}) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_regular_file(error) || !is_file_name(name)) continue;
    const auto size = entry.file_size(error);
    if (!error) files.push_back({name, size});
  }
  std::sort(files.begin(), files.end(), [](const FileEntry& a, const FileEntry& b) { return a.name < b.name; });
  return files;
}

void serve_client(net::Loop& loop, const net::ConnectionPtr& connection, JobService& service,
                  const ClientLimits& limits) {
  std::make_shared<ClientSession>(loop, connection, service, limits)->begin();
}

}  // namespace telefab
