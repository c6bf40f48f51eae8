// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/web/scan_web.hpp>

namespace telefab::scan {

/// A request on its way to its row.
struct Call {
  const WebRequest& request;
  const Routed& routed;
  PageBackend& backend;
  StagingBackend& staging;
  SignIn& sign_in;
  const WebOptions& options;

  [[nodiscard]] const std::string& id() const { return routed.arguments.id; }
  [[nodiscard]] const std::string& who() const { return routed.visitor.name; }
};

/// A part of an upload, as the store takes it.
inline constexpr std::uint64_t kMostPart_bytes = 4U << 20U;

/// {"name","size_bytes","sha256"}.
[[nodiscard]] WebResponse begin_upload(const Call& call);
[[nodiscard]] WebResponse add_part(const Call& call);
[[nodiscard]] WebResponse show_level(const Call& call);
/// {"with":["ID",...]}.
[[nodiscard]] WebResponse join_uploads(const Call& call);
[[nodiscard]] WebResponse discard_upload(const Call& call);
/// {"machine","parameters":{...}}; 201 and the job.
[[nodiscard]] WebResponse submit(const Call& call);

/// The body {"machine","parameters":{...},"for"} of a question. Fails: InvalidInput.
[[nodiscard]] Result<StagingQuestion> question_of(const WebRequest& request);

template <Result<std::string> (StagingBackend::*asked)(std::string_view, const StagingQuestion&)>
[[nodiscard]] WebResponse ask(const Call& call) {
  const auto question = question_of(call.request);
  if (!question) return web_problem(question.error());
  return web_json((call.staging.*asked)(call.id(), *question));
}

}  // namespace telefab::scan
