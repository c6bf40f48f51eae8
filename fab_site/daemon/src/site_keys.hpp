// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/net/trust.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::fab {

/// Whose jobs the fab takes: a folder with SITE.sign.pub (Ed25519, PEM) of every scan site, looked at for every job,
/// so that a key added or removed counts at once.
class SiteKeys {
 public:
  /// With an empty folder every job is taken: such a fab serves its own machine only.
  explicit SiteKeys(std::filesystem::path folder) : folder_{std::move(folder)} {}

  /// Who signed, for the audit log: "signed with KEY". NotTrusted ("job-signature: ...") for a signature that does not
  /// hold and, where there is a folder, for a job that is not signed or not with the key of the site that offers it; a
  /// peer without certificate may use any key of the folder.
  [[nodiscard]] Result<std::string> check(const Offer& offer, const net::Peer& peer) const;

 private:
  std::filesystem::path folder_;
};

}  // namespace telefab::fab
