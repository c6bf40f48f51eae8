// SPDX-License-Identifier: GPL-3.0-or-later
#include <memory>
#include <telefab/command_line/output.hpp>
#include <telefab/service/shared_verbs.hpp>
#include <telefab/web/api_page.hpp>

namespace telefab {

VerbBody declare_api(VerbOptions& options, std::string (*openapi)()) {
  auto is_json = std::make_shared<bool>(false);
  options.flag("--json", *is_json, "OpenAPI, as the site answers at /openapi.json");
  return [is_json, openapi](std::stop_token) -> Result<ExitCode> {
    if (*is_json) {
      write_output(openapi() + "\n");
      return ExitCode::Ok;
    }
    const auto page = api_page(openapi());
    if (!page) return tl::unexpected{page.error()};
    write_output(*page);
    return ExitCode::Ok;
  };
}

}  // namespace telefab
