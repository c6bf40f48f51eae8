// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>

#include "common_options.hpp"
#include "job_text.hpp"
#include "verbs.hpp"

namespace telefab::client {
namespace {

constexpr std::uint64_t kMaxReportFileBytes = 256ULL << 20U;

Result<std::vector<std::byte>> fetch(SiteClient& client, const std::string& job, const FileEntry& file) {
  if (auto sent = client.send(AskFile{client.next_request(), job, file.name}); !sent)
    return tl::unexpected{sent.error()};
  std::vector<std::byte> content;
  while (true) {
    auto received = client.receive(client.answer_within());
    if (!received) return tl::unexpected{received.error()};
    const auto* block = std::get_if<FileBlock>(&*received);
    if (!block || block->offset_bytes != content.size())
      return fail(ErrorCode::ProtocolBroken, fmt::format("{}: the site sent something else than the file", file.name));
    if (block->size_bytes > kMaxReportFileBytes)
      return fail(ErrorCode::TooLarge, fmt::format("{} has {} bytes", file.name, block->size_bytes));
    content.insert(content.end(), block->content.begin(), block->content.end());
    if (content.size() == block->size_bytes) return content;
  }
}

}  // namespace

VerbBody declare_report(VerbOptions& options) {
  struct Options {
    CommonOptions common;
    std::string job;
    std::string out;
  };
  auto o = std::make_shared<Options>();
  declare_common(options, o->common);
  options.add("JOB", o->job, "id of the job").required();
  options.add_output("--out", o->out, "folder for the files; made where there is none").required();
  return [o](std::stop_token stop) -> Result<ExitCode> {
    if (auto named = check_job_id(o->job); !named) return tl::unexpected{named.error()};
    auto client = connect(o->common, std::move(stop));
    if (!client) return tl::unexpected{client.error()};
    auto jobs = (*client)->ask<Jobs>(AskJobs{(*client)->next_request(), o->job, 1, false});
    if (!jobs) return tl::unexpected{jobs.error()};
    auto files = (*client)->ask<Files>(AskFiles{(*client)->next_request(), o->job});
    if (!files) return tl::unexpected{files.error()};
    const std::filesystem::path folder{o->out};
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error)
      return fail(ErrorCode::StorageFailed, fmt::format("cannot make the folder {}: {}", o->out, error.message()));
    nlohmann::ordered_json written = nlohmann::ordered_json::array();
    const auto keep = [&](const std::string& name, const auto& content) -> Result<void> {
      const auto path = folder / name;
      if (auto done = write_file_atomically(path, content); !done) return done;
      if (!o->common.json) write_output(fmt::format("{}\n", path.string()));
      written.push_back(path.string());
      return {};
    };
    for (const Job& job : jobs->jobs)
      if (auto done = keep("job.json", std::string_view{to_json(job) + "\n"}); !done)
        return tl::unexpected{done.error()};
    for (const FileEntry& file : files->files) {
      auto content = fetch(**client, o->job, file);
      if (!content) return tl::unexpected{content.error()};
      if (auto done = keep(file.name, std::span<const std::byte>{*content}); !done) return tl::unexpected{done.error()};
    }
    if (o->common.json) write_output(fmt::format("{}\n", json_text(written, 2)));
    return ExitCode::Ok;
  };
}

}  // namespace telefab::client
