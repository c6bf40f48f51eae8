// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/web/sign_in.hpp>

// Programs that send files to a printer ask /api/version first, and by its "text" each takes a host for its own or not.
// No text is right for all, so one API stands below three paths that differ in the text alone.
namespace telefab::fab {

enum class SenderApi : std::uint8_t {
  OctoPrint,  ///< at the page's own address: "OctoPrint ...", which PrusaSlicer's PrusaLink takes too
  PrusaLink,  ///< below /prusalink
  PrusaSla,   ///< below /prusa-sla
};

/// What a request asks of the API, its path as the routes know it.
struct SenderRequest {
  SenderApi api = SenderApi::OctoPrint;
  WebRequest request;
};
[[nodiscard]] SenderRequest read_sender(WebRequest request);

/// Whether a path, as the routes know it, is one of a program that sends files.
[[nodiscard]] bool is_of_sender(std::string_view target);

/// {"api","server","version","text","capabilities"}.
[[nodiscard]] WebResponse version_for(SenderApi api, const std::string& version);

/// The answer to who may not ask: 401 with a challenge to log in by digest, 403 to who is known and may not, and to a
/// wrong key where OctoPrint's answer is expected.
[[nodiscard]] WebResponse refuse_sender(const SenderRequest& asked, const SignIn::Refusal& refusal, SignIn& sign_in);

}  // namespace telefab::fab
