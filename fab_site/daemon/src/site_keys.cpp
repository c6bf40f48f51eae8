// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <telefab/base/file.hpp>
#include <telefab/base/text.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMaxKeyBytes = 4096;
constexpr std::string_view kEnding = ".sign.pub";

std::string name_of_key(const Offer& offer) {
  std::string name;
  for (std::size_t i = 0; i < std::min<std::size_t>(offer.public_key.size(), 8); ++i)
    name += fmt::format("{:02x}", std::to_integer<unsigned>(offer.public_key[i]));
  return name;
}

std::vector<std::filesystem::path> keys_in(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> keys;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{folder, error})
    if (entry.path().filename().string().ends_with(kEnding)) keys.push_back(entry.path());
  std::sort(keys.begin(), keys.end());
  return keys;
}

}  // namespace

Result<std::string> SiteKeys::check(const Offer& offer, const net::Peer& peer) const {
  if (folder_.empty()) {
    if (!is_signed(offer)) return std::string{"not signed"};
    if (auto held = check_offer(offer, {}); !held) return tl::unexpected{held.error()};
    return fmt::format("signed with {}, a key this fab was not told of", name_of_key(offer));
  }
  if (auto held = check_offer(offer, {}); !held) return tl::unexpected{held.error()};
  if (peer.role && !is_file_name(peer.name))
    return fail(ErrorCode::NotTrusted, "job-signature: the site's name cannot name a key");
  const auto keys = peer.role ? std::vector{folder_ / (peer.name + std::string{kEnding})} : keys_in(folder_);
  for (const auto& path : keys) {
    const auto pem = read_file(path, kMaxKeyBytes);
    if (!pem) continue;
    const std::string_view text{reinterpret_cast<const char*>(pem->data()), pem->size()};
    if (check_offer(offer, text))
      return fmt::format("signed with {} ({})", name_of_key(offer), path.filename().string());
  }
  return fail(ErrorCode::NotTrusted,
              fmt::format("job-signature: job {} of {} is signed with {}, which is not a key in {}{}; copy the site's "
                          "sign.pub there if it is to be trusted",
                          offer.job, peer.name, name_of_key(offer), folder_.string(),
                          peer.role ? fmt::format("/{}{}", peer.name, kEnding) : std::string{}));
}

}  // namespace telefab::fab
