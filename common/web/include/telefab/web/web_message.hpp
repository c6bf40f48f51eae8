// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/web/visitor.hpp>
#include <utility>
#include <vector>

namespace telefab {

/// A request as far as the routes care. `target` is as sent, percent-encoded, with its query.
struct WebRequest {
  std::string method = {};
  std::string target = {};
  std::string authorization = {};  ///< the Authorization header, or "Bearer KEY" made of X-Api-Key
  std::string content_type = {};
  std::string body = {};
  std::string host = {};    ///< as sent, with its port
  std::string origin = {};  ///< of the page that asks, as its browser says
  std::string cookie = {};
  std::string address = {};               ///< of the visitor, HOST:PORT
  std::optional<Visitor> certified = {};  ///< by a client certificate that holds now
  bool is_encrypted = false;              ///< came over TLS
  bool is_whole = true;                   ///< false: its head alone has come
  bool goes_on = false;                   ///< was let in when it was whole, and its answer has no end (a stream)
  std::string sent_target = {};           ///< what was sent, where a site reads a shorter `target`; empty: the same
  std::string overwrite = {};             ///< the header of PrusaLink's upload, "?1" or "?0"
  std::string print_after_upload = {};    ///< likewise
};

struct WebResponse {
  unsigned status = 200;
  std::string content_type = "application/json";
  std::string body = {};
  bool cacheable = false;                                         ///< what seldom changes: kept for an hour
  std::string location = {};                                      ///< of what was made; empty: nothing was
  std::string cookie = {};                                        ///< Set-Cookie; empty: none
  std::vector<std::string> challenges = {};                       ///< WWW-Authenticate, one header each
  std::vector<std::pair<std::string, std::string>> headers = {};  ///< further ones, name and value
  bool is_immutable = false;  ///< never changes under its address, query included: the browser asks for it once
};

/// {"error":{"code":...,"what":...}}
[[nodiscard]] WebResponse web_problem(unsigned status, std::string_view code, std::string_view what);
/// The same with the status that fits the error: 400, 403, 404, 409, 413, else 500.
[[nodiscard]] WebResponse web_problem(const Error& error);
/// 503, whatever kind of error it is: what health says of a site that cannot do its work.
[[nodiscard]] WebResponse web_sick(const Error& error);
/// JSON as it is, or the problem.
[[nodiscard]] WebResponse web_json(const Result<std::string>& body);

/// The name that a Host header asks for: in lower case, without the port.
[[nodiscard]] std::string host_name_of(std::string_view host);

/// RFC 3986, 2.1; nothing where a percent sign is followed by something else than two digits.
[[nodiscard]] std::optional<std::string> without_escapes(std::string_view text);

/// The text KEY=TEXT of a target's query, as a form writes it ('+' is a blank); wrong escapes stand as they are.
/// Nothing where it is missing.
[[nodiscard]] std::optional<std::string> query_text(std::string_view target, std::string_view key);
/// The number KEY=N of a target's query; nothing where it is missing, or is not a plain decimal number.
[[nodiscard]] std::optional<std::uint64_t> query_number(std::string_view target, std::string_view key);

/// A file of a page, compiled in, so that an installed daemon serves it from anywhere. "/" is the page itself, which
/// names the others as PATH?v=VERSION.
struct WebAsset {
  std::string_view path;
  std::string_view content_type;
  std::string_view body;
  std::string_view version;  ///< of the bytes
};
/// 404 where there is none of this path. Immutable where its version is asked for: another release is another address.
[[nodiscard]] WebResponse web_asset(std::span<const WebAsset> assets, std::string_view target);

}  // namespace telefab
