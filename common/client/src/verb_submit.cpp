// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <fstream>
#include <telefab/base/text.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/job/readable_scans.hpp>

#include "common_options.hpp"
#include "job_text.hpp"
#include "verbs.hpp"
#include "watch_job.hpp"

namespace telefab::client {
namespace {

constexpr std::size_t kBlockBytes = 256U << 10U;

struct SubmitOptions {
  CommonOptions common;
  std::string scan;
  std::string machine;
  SliceParameters asked;
  bool watch = false;
  bool plain = false;
  double patience_min = 10;
};

/// Reads a file block by block; `take` may fail.
template <class Take>
Result<void> for_each_block(const std::string& path, const Take& take) {
  std::ifstream file{path, std::ios::binary};
  std::vector<std::byte> block(kBlockBytes);
  while (file) {
    file.read(reinterpret_cast<char*>(block.data()), static_cast<std::streamsize>(block.size()));
    const auto got = static_cast<std::size_t>(file.gcount());
    if (got == 0) break;
    if (auto taken = take(std::span{block}.first(got)); !taken) return taken;
  }
  if (!file.eof()) return fail(ErrorCode::StorageFailed, fmt::format("cannot read {}", path));
  return {};
}

Result<Submit> announce(const SubmitOptions& o, RequestId request) {
  if (auto ok = validate(o.asked); !ok) return tl::unexpected{ok.error()};
  const std::filesystem::path path{o.scan};
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) return fail(ErrorCode::NotFound, fmt::format("{} does not exist", o.scan));
  if (!std::filesystem::is_regular_file(status))
    return fail(ErrorCode::InvalidInput, fmt::format("{} is not a regular file; name one scan", o.scan));
  Submit submit{request, path.filename().string(), o.machine, to_json(o.asked), 0, {}};
  submit.size_bytes = std::filesystem::file_size(path, error);
  if (error) return fail(ErrorCode::StorageFailed, fmt::format("cannot read {}: {}", o.scan, error.message()));
  if (submit.size_bytes == 0) return fail(ErrorCode::InvalidInput, fmt::format("{} is empty", o.scan));
  if (submit.size_bytes > kMaxScanBytes)
    return fail(ErrorCode::TooLarge,
                fmt::format("{} has {} bytes; the limit is {}", o.scan, submit.size_bytes, kMaxScanBytes));
  if (!is_file_name(submit.name))
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: a name that begins with a dot, or has a backslash or characters that do not show, "
                            "cannot be sent; rename the file",
                            to_printable(o.scan)));
  if (!std::ifstream{path}) return fail(ErrorCode::NotPermitted, fmt::format("{} may not be read by you", o.scan));
  Hasher hasher;
  auto read = for_each_block(o.scan, [&](std::span<const std::byte> block) -> Result<void> {
    hasher.feed(block);
    return {};
  });
  if (!read) return tl::unexpected{read.error()};
  submit.content = hasher.digest();
  return submit;
}

Result<Job> upload(SiteClient& client, const SubmitOptions& o, const Submit& submit) {
  auto more = client.ask<UploadReady>(submit);
  if (!more) return tl::unexpected{more.error()};
  std::uint64_t offset = 0;
  auto sent = for_each_block(o.scan, [&](std::span<const std::byte> block) -> Result<void> {
    UploadBlock message{submit.request, offset, {block.begin(), block.end()}};
    offset += block.size();
    return client.send(message);
  });
  if (!sent) return tl::unexpected{sent.error()};
  if (offset != submit.size_bytes)
    return fail(ErrorCode::Conflict, fmt::format("{} changed while it was sent", o.scan));
  auto answer = client.receive(client.answer_within());
  if (!answer) return tl::unexpected{answer.error()};
  if (auto* jobs = std::get_if<Jobs>(&*answer); jobs && jobs->jobs.size() == 1) return std::move(jobs->jobs.front());
  return fail(ErrorCode::ProtocolBroken, "the site answered the upload with another message");
}

Result<ExitCode> run(const SubmitOptions& o, std::stop_token stop) {
  const auto announced = announce(o, RequestId{1});
  if (!announced) return tl::unexpected{announced.error()};
  auto client = connect(o.common, stop);
  if (!client) return tl::unexpected{client.error()};
  Submit submit = *announced;
  submit.request = (*client)->next_request();
  auto job = upload(**client, o, submit);
  if (!job) return tl::unexpected{job.error()};
  if (!o.watch) {
    write_output(fmt::format("{}\n", o.common.json ? to_json(*job) : job->id));
    return ExitCode::Ok;
  }
  if (!o.common.json) write_note(fmt::format("job {}\n", job->id));
  auto ended = watch_job(std::move(*client), {[&] { return connect(o.common, stop); }, o.patience_min, stop}, job->id,
                         watch_style(o.common.json, o.plain));
  if (!ended) return tl::unexpected{ended.error()};
  if (o.common.json)
    write_output(fmt::format("{}\n", to_json(*ended)));
  else
    write_output(summary_of(*ended));
  return exit_code_of(*ended);
}

}  // namespace

VerbBody declare_submit(VerbOptions& options) {
  auto o = std::make_shared<SubmitOptions>();
  declare_common(options, o->common);
  options.add("SCAN", o->scan, fmt::format("{}; its points alone are used", kReadableScans)).required();
  options
      .add("--machine", o->machine,
           "which of `telefab machines`: one machine, or a profile, for whichever machine of it is free first")
      .required()
      .names("MACHINE");
  declare_job_parameters(options, o->asked);
  options.flag("--watch", o->watch, "follow the job until it ends; the exit code tells how");
  options.flag("--plain", o->plain, "watch by lines instead of the full screen, as where there is no terminal");
  declare_patience(options, o->patience_min);
  return [o](std::stop_token stop) { return run(*o, std::move(stop)); };
}

}  // namespace telefab::client
