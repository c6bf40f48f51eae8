// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_key.hpp"

#include <fmt/format.h>

#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>

namespace telefab::scan {
namespace {

/// The key of `path`, where it can sign.
Result<std::string> usable(Result<std::string> pem, const std::filesystem::path& path) {
  if (!pem) return pem;
  if (const auto tried = sign_ed25519(*pem, "trial"); !tried) return fail_in(path.string(), tried.error());
  return pem;
}

}  // namespace

Result<std::string> site_key(const ServeOptions& options, const std::filesystem::path& data) {
  if (!options.tls_folder.empty()) {
    const auto path = std::filesystem::path{options.tls_folder} / (options.tls_name + ".sign.key");
    auto issued = usable(read_secret(path), path);
    if (issued || issued.error().code != ErrorCode::NotFound) return issued;
  }
  const auto path = data / "sign.key";
  return usable(kept_ed25519_key(path, data / "sign.pub"), path);
}

}  // namespace telefab::scan
