// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/machine/machine_profile.hpp>
#include <variant>
#include <vector>

namespace telefab {

struct NumberKey {
  std::function<double&(MachineProfile&)> field;
  double least;
  double most;
};
struct CountKey {
  std::function<std::uint32_t&(MachineProfile&)> field;
  std::uint32_t least;
  std::uint32_t most;
};
struct TextKey {
  std::function<std::string&(MachineProfile&)> field;
};
struct WordKey {
  std::function<std::string_view(const MachineProfile&)> name;
  std::function<bool(MachineProfile&, std::string_view)> take;  ///< false: not one of them
  std::span<const std::string_view> all;
};
/// Numbers from 0 to 1 that never fall, or none.
struct CurveKey {
  std::function<std::vector<double>&(MachineProfile&)> field;
};
/// Rows of equal length, or none.
struct GridKey {
  std::function<std::vector<std::vector<double>>&(MachineProfile&)> field;
  double least;
  double most;
};
inline constexpr std::size_t kMostCurve = 256;
inline constexpr std::size_t kMostGridSide = 64;

/// Whether a key is part of every profile's text, or only where it differs from its default: texts, and with them the
/// digests, of profiles that know nothing of the key stay what they were.
enum class Written : std::uint8_t { Always, UnlessDefault };

struct Key {
  std::string_view section;
  std::string_view name;
  bool required;
  std::string_view reason;
  std::variant<NumberKey, CountKey, TextKey, WordKey, CurveKey, GridKey> kind;
  Written written = Written::Always;
};

/// Every key of a profile, section by section: what reading, writing and `describe_keys()` go by.
[[nodiscard]] const std::vector<Key>& profile_keys();

/// What a value of that key may be, for people.
[[nodiscard]] std::string range_of(const Key& key);

}  // namespace telefab
