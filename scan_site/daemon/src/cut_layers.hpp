// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/job/job.hpp>
#include <telefab/transfer/spool_registry.hpp>
#include <vector>

namespace telefab::scan {

/// The layers of jobs, decoded from their spools as they come, a chunk at a time: of a spool no more is read than that
/// and the heads of its records. Threads: one caller.
class CutLayers {
 public:
  /// The registry must outlive it.
  explicit CutLayers(SpoolRegistry& spools) : spools_{spools} {}
  /// As PageBackend::layer_json. Fails: NotFound (not cut yet, or no such layer), as ChunkSpool::open and the decoder.
  [[nodiscard]] Result<std::string> json(const Job& job, const std::filesystem::path& folder, std::uint32_t layer);

 private:
  struct Stack {
    std::unique_ptr<StackDecoder> decoder;
    std::shared_ptr<SharedSpool> spool;
    std::map<std::uint32_t, std::vector<Layer>> chunks;  ///< by sequence; a few
    std::uint64_t used = 0;
  };
  [[nodiscard]] Result<Stack*> stack_of(const Job& job, const std::filesystem::path& folder);

  SpoolRegistry& spools_;
  std::map<std::string, Stack> stacks_;  ///< by job; a few
  std::uint64_t uses_ = 0;
};

}  // namespace telefab::scan
