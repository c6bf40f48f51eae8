// SPDX-License-Identifier: GPL-3.0-or-later
#include "uploads.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <telefab/base/text.hpp>
#include <telefab/fab/web/accepted_files.hpp>
#include <telefab/web/web_message.hpp>

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 8> kAccepted{".tfc",     ".sl1", ".sl1s", ".goo",
                                                    ".nanodlp", ".cli", ".svg",  ".3mf"};
constexpr std::array<std::string_view, 10> kScans{".ply", ".pcd", ".xyz", ".ptx", ".pts",
                                                  ".txt", ".csv", ".asc", ".stl", ".obj"};

bool ends_with(std::string_view text, std::string_view ending) {
  return text.size() >= ending.size() && std::equal(ending.rbegin(), ending.rend(), text.rbegin(), [](char a, char b) {
           return a == static_cast<char>(std::tolower(static_cast<unsigned char>(b)));
         });
}

bool ends_with_one_of(std::string_view name, std::span<const std::string_view> endings) {
  return std::ranges::any_of(endings, [name](std::string_view ending) { return ends_with(name, ending); });
}

/// Why a file is not taken, with what to do instead.
std::string not_taken(std::string_view name) {
  if (ends_with_one_of(name, kScans))
    return fmt::format(
        "{} is a scan or a mesh, and this is a fab site: it prints layers and cuts none. Send it to a scan site "
        "(telefab submit FILE --machine NAME), or cut it into a .tfc file first (telefab-scan slice FILE --out "
        "part.tfc)",
        name);
  return fmt::format("{} is not a file that a fab prints: its name ends in none of {}", name,
                     fmt::join(kAccepted, " "));
}

}  // namespace

std::span<const std::string_view> accepted_endings() { return kAccepted; }

std::string_view base_name(std::string_view path) {
  const auto slash = path.find_last_of("/\\");
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

namespace {

/// The folder that the file lies in, without those above; empty: none.
std::string_view folder_of(std::string_view path) {
  auto slash = path.find_last_of("/\\");
  if (slash == std::string_view::npos) return {};
  while (slash > 0 && (path[slash - 1] == '/' || path[slash - 1] == '\\')) --slash;
  return base_name(path.substr(0, slash));
}

}  // namespace

tl::expected<std::string, UploadRefusal> take_upload(PageBackend& backend, std::string_view path,
                                                     std::string_view bytes, bool start, std::string_view who) {
  const std::string name{base_name(path)};
  if (!is_file_name(name)) return tl::unexpected{UploadRefusal{400, "the file's name cannot be kept; rename it"}};
  if (!ends_with_one_of(name, kAccepted)) return tl::unexpected{UploadRefusal{415, not_taken(name)}};
  auto job = backend.take_file(folder_of(path), name, bytes, start, who);
  if (!job) return tl::unexpected{UploadRefusal{web_problem(job.error()).status, job.error().what}};
  return std::move(*job);
}

}  // namespace telefab::fab
