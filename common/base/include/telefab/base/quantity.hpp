// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <compare>
#include <cstdint>

namespace telefab {

/// A number with its unit in the type; explicit in, explicit out.
template <class Unit, class Rep = double>
class Quantity {
 public:
  constexpr Quantity() = default;
  constexpr explicit Quantity(Rep value) : value_{value} {}
  [[nodiscard]] constexpr Rep count() const { return value_; }
  friend constexpr auto operator<=>(Quantity, Quantity) = default;
  friend constexpr Quantity operator+(Quantity a, Quantity b) {
    return Quantity{static_cast<Rep>(a.value_ + b.value_)};
  }
  friend constexpr Quantity operator-(Quantity a, Quantity b) {
    return Quantity{static_cast<Rep>(a.value_ - b.value_)};
  }

 private:
  Rep value_{};
};

using Millimetres = Quantity<struct MillimetreUnit>;
using MillimetresPerSecond = Quantity<struct MillimetrePerSecondUnit>;
using LayerIndex = Quantity<struct LayerIndexUnit, std::uint32_t>;  ///< 0 is the first layer, on the platform

}  // namespace telefab
