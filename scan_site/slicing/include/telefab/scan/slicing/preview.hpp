// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <vector>

namespace telefab::scan {

/// A picture of a stack for people, painted while its layers pass: left the part from above and in front, built up
/// layer by layer (flagged layers red), right six of its sections. Contours are grey where they are measured, amber
/// where completed, red where doubtful; a legend says so.
class Preview {
 public:
  /// `first` and `last`: the layers that will come.
  Preview(const StackHeader& header, LayerIndex first, LayerIndex last);
  ~Preview();
  Preview(Preview&&) noexcept;
  Preview& operator=(Preview&&) noexcept;

  /// Layers in order; some are left out of tall stacks.
  void add(const Layer& layer);
  /// The picture so far.
  [[nodiscard]] Result<std::vector<std::byte>> png() const;

 private:
  struct Picture;
  std::unique_ptr<Picture> picture_;
};

}  // namespace telefab::scan
