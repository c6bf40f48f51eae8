// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_book.hpp"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <telefab/base/environment.hpp>
#include <telefab/base/file.hpp>
#include <telefab/net/endpoint.hpp>

namespace telefab::client {
namespace {

constexpr std::uint64_t kMaxBookBytes = 1U << 20U;

bool is_name(std::string_view text) {
  return !text.empty() && text.size() <= 64 &&
         std::ranges::all_of(text, [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-'; });
}

std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

/// Takes the string of a key out of a table; false where it is something else.
bool take(toml::table& table, std::string_view key, std::string& into) {
  const toml::node* node = table.get(key);
  if (!node) return true;
  const auto value = node->value_exact<std::string>();
  if (!value) return false;
  into = *value;
  table.erase(key);
  return true;
}

Result<SiteEntry> entry_from(const std::string& name, toml::table table, std::string_view origin) {
  SiteEntry site;
  site.name = name;
  for (const auto& [key, into] : {std::pair{"address", &site.address}, std::pair{"tls", &site.tls_folder},
                                  std::pair{"tls_name", &site.tls_name}, std::pair{"certificate", &site.certificate}})
    if (!take(table, key, *into))
      return fail(ErrorCode::InvalidInput, fmt::format("{}: [sites.{}] {} must be a string", origin, name, key));
  if (!table.empty())
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: [sites.{}] has the unknown key {}; there are: address, tls, tls_name, certificate",
                            origin, name, std::string_view{table.begin()->first}));
  if (auto valid = validate(site); !valid) return fail_in(origin, valid.error());
  return site;
}

}  // namespace

const SiteEntry* SiteBook::find(std::string_view name) const {
  const auto found = std::ranges::find(sites, name, &SiteEntry::name);
  return found == sites.end() ? nullptr : &*found;
}

std::filesystem::path site_book_path() {
  if (const std::string path = environment_variable("TELEFAB_SITES"); !path.empty()) return path;
  const std::filesystem::path own = config_folder();
  return (own.empty() ? "/etc" : own) / "telefab/sites.toml";
}

Result<SiteBook> site_book_from_toml(std::string_view text, std::string_view origin) {
  toml::table table;
  try {
    table = toml::parse(text);
  } catch (const toml::parse_error& error) {
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: line {}: {}", origin, error.source().begin.line, error.description()));
  }
  SiteBook book;
  if (!take(table, "default", book.default_site))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: default must be the name of a site", origin));
  if (toml::node* sites = table.get("sites")) {
    if (!sites->is_table())
      return fail(ErrorCode::InvalidInput, fmt::format("{}: sites must be tables, as [sites.chicago]", origin));
    for (const auto& [key, node] : *sites->as_table()) {
      if (!node.is_table())
        return fail(ErrorCode::InvalidInput,
                    fmt::format("{}: sites.{} must be a table", origin, std::string_view{key}));
      auto site = entry_from(std::string{std::string_view{key}}, *node.as_table(), origin);
      if (!site) return tl::unexpected{site.error()};
      book.sites.push_back(std::move(*site));
    }
    table.erase("sites");
  }
  if (!table.empty())
    return fail(ErrorCode::InvalidInput, fmt::format("{}: unknown key {}; there are: default, [sites.NAME]", origin,
                                                     std::string_view{table.begin()->first}));
  std::ranges::sort(book.sites, {}, &SiteEntry::name);
  if (!book.default_site.empty() && !book.find(book.default_site))
    return fail(ErrorCode::InvalidInput,
                fmt::format("{}: default names {}, which is not a site of this file", origin, book.default_site));
  return book;
}

Result<SiteBook> read_site_book(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxBookBytes);
  if (!bytes && bytes.error().code == ErrorCode::NotFound) return SiteBook{};
  if (!bytes) return tl::unexpected{bytes.error()};
  return site_book_from_toml({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path.string());
}

std::string to_toml(const SiteBook& book) {
  std::string text = "# Sites of `telefab`; see `telefab sites --help`.\n";
  if (!book.default_site.empty()) text += fmt::format("default = {}\n", toml_string(book.default_site));
  for (const SiteEntry& site : book.sites) {
    text += fmt::format("\n[sites.{}]\naddress = {}\n", site.name, toml_string(site.address));
    if (!site.tls_folder.empty())
      text += fmt::format("tls = {}\ntls_name = {}\n", toml_string(site.tls_folder), toml_string(site.tls_name));
    if (!site.certificate.empty()) text += fmt::format("certificate = {}\n", toml_string(site.certificate));
  }
  return text;
}

Result<void> write_site_book(const std::filesystem::path& path, const SiteBook& book) {
  std::error_code error;
  std::filesystem::create_directories(path.parent_path(), error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot make {}: {}", path.parent_path().string(), error.message()));
  return write_file_atomically(path, to_toml(book));
}

Result<void> validate(const SiteEntry& site) {
  if (!is_name(site.name))
    return fail(ErrorCode::InvalidInput,
                fmt::format("\"{}\" is not a name for a site; use a-z, 0-9 and -, at most 64", site.name));
  const auto endpoint = net::endpoint_from_text(site.address);
  if (!endpoint) return fail_in(site.name, endpoint.error());
  if (site.tls_folder.empty() && !net::is_loopback(*endpoint))
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("{}: {} is not on this machine, so it needs --tls FOLDER with certificates (`telefab certs` "
                    "makes them)",
                    site.name, site.address));
  return {};
}

}  // namespace telefab::client
