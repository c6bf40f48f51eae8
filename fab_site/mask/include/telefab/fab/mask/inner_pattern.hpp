// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/fab/mask/column_caps.hpp>

namespace telefab::fab {

/// How the inside of a part is lit; its shell always gets all light. Less light inside shrinks and warps less; it
/// changes nothing in what cures by the dose model, and is for trying out on prints.
struct InnerPattern {
  enum class Kind : std::uint8_t {
    Solid = 1,      ///< like the shell
    Checker = 2,    ///< cells lit in turns: what is dark in one layer cures by the light of the next
    ShellCore = 3,  ///< a share of the light
  };
  Kind kind = Kind::Solid;
  double shell_mm = 1;      ///< (0, 100]; what lies nearer to the surface is shell, in the plane and across layers
  double cell_mm = 1;       ///< (0, 100]; side of a cell of Checker, whole pixels
  double core_share = 0.7;  ///< (0, 1]; of ShellCore
  [[nodiscard]] Result<void> validate() const;
};
[[nodiscard]] std::string_view name_of(InnerPattern::Kind kind);
/// solid, checker, shell-core. Fails with InvalidInput.
[[nodiscard]] Result<InnerPattern::Kind> inner_pattern_from_name(std::string_view name);

/// A pattern on one machine: which pixels lie inside, and the most light they get.
class PatternMaker {
 public:
  /// Fails with InvalidInput for figures out of range, a shell so thin that the pattern would show through it, and a
  /// dose that leaves the inside uncured, with a twentieth to spare; says what would do.
  [[nodiscard]] static Result<PatternMaker> make(const InnerPattern& pattern, const MaskLight& light,
                                                 const MaskFrame& frame);
  /// Of shell above and below; so many more layers on both sides must be known.
  [[nodiscard]] std::uint32_t shell_layers() const { return shell_layers_; }
  /// The inside of every layer of a run of layers; the first and last shell_layers() have none.
  [[nodiscard]] std::vector<PixelRuns> cores(std::span<const SolidRows> layers) const;
  /// Lowers the caps (greys as share of white) of row y where it lies inside. `known`: the row has caps already, else
  /// it is filled first if need be. Says whether the row has caps now.
  bool darken(const PixelRuns& core, std::uint32_t print_layer, std::uint32_t y, bool known,
              std::span<std::uint8_t> caps) const;

 private:
  PatternMaker() = default;
  InnerPattern::Kind kind_ = InnerPattern::Kind::Solid;
  std::uint32_t shell_px_ = 0;
  std::uint32_t shell_layers_ = 0;
  std::uint32_t cell_px_ = 1;
  std::uint8_t core_cap_ = 255;
};

}  // namespace telefab::fab
