// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <telefab/base/digest.hpp>
#include <telefab/base/file.hpp>
#include <telefab/fab/web/router.hpp>

#include "seeds.hpp"

// Writes the seeds of fuzz_sign_in and fuzz_tokens: `web_seeds tests/fuzz/corpus`, once after every new route.
namespace telefab {
namespace {

std::string concrete(std::string_view pattern) {
  std::string path{pattern};
  if (const auto at = path.find("{id}"); at != std::string::npos) path.replace(at, 4, "job-1");
  if (const auto at = path.find("{layer}"); at != std::string::npos) path.replace(at, 7, "2");
  if (const auto at = path.find("{storage}"); at != std::string::npos) path.replace(at, 9, "local");
  if (const auto at = path.find("{path}"); at != std::string::npos) path.replace(at, 6, "part%20a.sl1");
  return path;
}

/// Every route, each with the lines given.
std::string every_route(std::string_view lines) {
  std::string all;
  for (const WebRoute& route : fab::web_routes())
    if (!route.path.starts_with("/v1/sign"))
      all += fmt::format("{} {}\n{}\n\n", route.method, concrete(route.path), lines);
  return all;
}

std::string token_line(std::string_view name, std::string_view role, int number) {
  const std::string salt = fmt::format("{:032x}", number);
  return fmt::format("{} {} {} {} {}\n", name, role, salt, to_hex(digest_of(std::as_bytes(std::span{salt}))), number);
}

/// The line as one of a token that also logs in by digest.
std::string with_keys(std::string line, const std::string& md5) {
  line.pop_back();
  return line + " " + md5 + " " + std::string(64, 'b') + "\n";
}

}  // namespace

Result<void> write_seeds(const std::filesystem::path& corpus) {
  const std::string sign_in = "POST /v1/sign-in\nh localhost:7480\nb {\"token\":\"@a\"}\n\n";
  const std::string here = "h localhost:7480\no http://localhost:7480\nc @s";
  const std::pair<const char*, std::string> seeds[] = {
      {"sign_in/nobody", every_route("h localhost:7480")},
      {"sign_in/token", every_route("a Bearer @a")},
      {"sign_in/reader", every_route("a Bearer @e")},
      {"sign_in/shared", every_route("a Bearer the-shared-token")},
      {"sign_in/session", sign_in + every_route(here)},
      {"sign_in/foreign", sign_in + every_route("h localhost:7480\no http://localhost:9000\nc @s")},
      {"sign_in/other_port", sign_in + every_route("h localhost:7481\no http://localhost:7481\nc @s")},
      {"sign_in/encrypted", sign_in + every_route("t\n" + here)},
      {"sign_in/certificate", every_route("t\nx\nh [::1]:7480") + every_route("t\ny\nh [::1]:7480")},
      {"sign_in/signed_out", sign_in + "POST /v1/sign-out\n" + here + "\n\n" + every_route(here)},
      {"sign_in/too_late", sign_in + every_route("w\n" + here)},
      {"sign_in/resume", sign_in + "POST /v1/jobs/job-1/resume\n" + here + "\nb {\"as\":\"expose-again\"}\n\n" +
                             "POST /v1/jobs/job-1/approve\n" + here + "\nb {\"although\":[\"islands\"]}\n\n"},
      {"sign_in/sign_in_wrongly",
       "POST /v1/sign-in\nb {\"token\":1}\n\nPOST /v1/sign-in\no http://evil\nb {\"token\":\"@e\"}\n"},
      {"tokens/empty", ""},
      {"tokens/two", token_line("ada", "operator", 1) + token_line("eve", "read-only", 2)},
      {"tokens/twice", token_line("ada", "operator", 1) + token_line("ada", "operator", 2)},
      {"tokens/fuzzed", token_line("fuzzed", "operator", 1)},
      {"tokens/role", token_line("ada", "owner", 1)},
      {"tokens/torn", token_line("ada", "operator", 1) + token_line("eve", "read-only", 2).substr(0, 60)},
      {"tokens/fields", token_line("ada", "operator", 1) + "\n"},
      {"tokens/old", token_line("ada", "operator", -1)},
      {"tokens/digest", with_keys(token_line("ada", "operator", 1), std::string(32, 'a'))},
      {"tokens/digest_without_md5", with_keys(token_line("ada", "operator", 1), "")},
      {"tokens/digest_of_another_length", with_keys(token_line("ada", "operator", 1), std::string(31, 'a'))},
  };
  for (const auto& [name, text] : seeds) {
    std::filesystem::create_directories((corpus / name).parent_path());
    if (auto ok = write_file_atomically(corpus / name, std::string_view{text}); !ok) return ok;
  }
  return {};
}

}  // namespace telefab
