// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_key.hpp"

#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/base/signature.hpp>

namespace telefab::scan {
namespace {

constexpr std::uint64_t kMaxKeyBytes = 4096;

Result<std::string> key_in(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxKeyBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  std::string pem{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  if (const auto tried = sign_ed25519(pem, "trial"); !tried) return fail_in(path.string(), tried.error());
  return pem;
}

}  // namespace

Result<std::string> site_key(const ServeOptions& options, const std::filesystem::path& data) {
  if (!options.tls_folder.empty()) {
    auto issued = key_in(std::filesystem::path{options.tls_folder} / (options.tls_name + ".sign.key"));
    if (issued || issued.error().code != ErrorCode::NotFound) return issued;
  }
  const auto path = data / "sign.key";
  auto kept = key_in(path);
  if (kept || kept.error().code != ErrorCode::NotFound) return kept;
  const auto made = new_ed25519_key();
  if (!made) return tl::unexpected{made.error()};
  if (auto written = write_file_atomically(data / "sign.pub", made->public_pem); !written)
    return tl::unexpected{written.error()};
  if (auto written = write_new_secret(path, made->private_pem); !written) return tl::unexpected{written.error()};
  return made->private_pem;
}

}  // namespace telefab::scan
