// SPDX-License-Identifier: GPL-3.0-or-later
#include "stack_shelf.hpp"

#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/transfer/chunk_spool.hpp>
#include <telefab/transfer/second_name.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kLongestId = 256;

std::filesystem::path file_of(const std::filesystem::path& folder, const Digest& key) { return folder / to_hex(key); }

}  // namespace

Result<void> StackShelf::put(const Offer& offer) const {
  const auto key = stack_key_of(offer);
  if (!key) return {};
  if (auto made = make_folder(folder_); !made) return made;
  return write_file_atomically(file_of(folder_, *key), offer.job + "\n");
}

std::optional<std::string> StackShelf::job_with(const Offer& offer) const {
  const auto key = stack_key_of(offer);
  if (!key) return std::nullopt;
  const auto bytes = read_file(file_of(folder_, *key), kLongestId);
  if (!bytes) return std::nullopt;
  std::string job{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  while (job.ends_with('\n')) job.pop_back();
  if (!is_job_id(job) || job == offer.job) return std::nullopt;
  return job;
}

Result<bool> take_over_stack(const Offer& offer, const std::filesystem::path& from, const std::filesystem::path& to) {
  const auto theirs = saved_offer(from);
  if (!theirs || stack_key_of(*theirs) != stack_key_of(offer)) return false;
  const auto spool = ChunkSpool::look_into(from / "chunks");
  if (!spool || !spool->finished() || spool->layer_count() != offer.header.layer_count) return false;
  std::error_code error;
  if (std::filesystem::exists(to / "chunks", error) || error) return false;
  // Nothing is written to a spool that is finished.
  return give_second_name(from / "chunks", to / "chunks");
}

}  // namespace telefab::fab
