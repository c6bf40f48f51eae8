// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::client {

/// A site with a name of the operator's choosing.
struct SiteEntry {
  std::string name;        ///< [a-z0-9-]+, at most 64
  std::string address;     ///< HOST:PORT
  std::string tls_folder;  ///< empty: plain TCP on loopback
  std::string tls_name = "operator";
  std::string certificate;  ///< name that its certificate must vouch for; empty: the host of its address
  friend bool operator==(const SiteEntry&, const SiteEntry&) = default;
};

/// The operator's sites and certificates, one TOML file.
struct SiteBook {
  std::vector<SiteEntry> sites;  ///< sorted by name
  std::string default_site;      ///< name; empty: none
  [[nodiscard]] const SiteEntry* find(std::string_view name) const;
  friend bool operator==(const SiteBook&, const SiteBook&) = default;
};

/// $TELEFAB_SITES, else telefab/sites.toml in config_folder(), else in /etc.
[[nodiscard]] std::filesystem::path site_book_path();

/// An absent file is an empty book. InvalidInput names file, line and key; unknown keys are errors.
[[nodiscard]] Result<SiteBook> read_site_book(const std::filesystem::path& path);
[[nodiscard]] Result<SiteBook> site_book_from_toml(std::string_view text, std::string_view origin);
/// from_toml(to_toml(b)) == b.
[[nodiscard]] std::string to_toml(const SiteBook& book);
/// Makes the folder where there is none; the file is replaced as a whole.
[[nodiscard]] Result<void> write_site_book(const std::filesystem::path& path, const SiteBook& book);

/// Name, address and certificate folder are fit to be kept.
[[nodiscard]] Result<void> validate(const SiteEntry& site);

}  // namespace telefab::client
