// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/service/serve_options.hpp>

namespace telefab::scan {

/// The private Ed25519 key, in PEM, that this site signs its jobs with: NAME.sign.key of the --tls folder; where there
/// is none, sign.key of the data folder, made at the first start with sign.pub beside it, which a fab that asks for
/// known keys is to be given. Fails as read_file and write_new_secret; InvalidInput where the file holds no such key.
[[nodiscard]] Result<std::string> site_key(const ServeOptions& options, const std::filesystem::path& data);

}  // namespace telefab::scan
