// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <type_traits>

namespace telefab {

// What a machine profile says by a word: an enumeration, and its words in the same order below.

/// What the optics do to a mask.
enum class OpticsTurn : std::uint8_t { Normal, MirrorX, MirrorY, Rotate180 };
/// Who drives the mirrors. Of two controllers each shows one half of the columns of the turned mask; the first one's
/// is named first. Auto: what the device says, the first one left.
enum class MirrorControllers : std::uint8_t { Auto, One, LeftRight, RightLeft };
enum class ProjectorKind : std::uint8_t { Virtual, Dlpc900, Screen };
enum class StageKind : std::uint8_t { Virtual, Grbl, Marlin };
/// Who switches the light and times it: the projector, or the board of the stage while the projector shows the mask.
enum class LightSwitch : std::uint8_t { Projector, Stage };
/// By what a stage's board switches a light: GRBL's spindle, a fan or a pin of Marlin.
enum class LightCommand : std::uint8_t { Spindle, Fan, Pin };
/// By how much a mask is turned to stand upright on the panel of a screen, clockwise.
enum class ScreenTurn : std::uint8_t { None, Quarter, Half, ThreeQuarters };
/// How grey pixels stand in the words of a screen: one in all three colours; three in one word, the first one in red or
/// in blue; three in 16 bits, the first one in the high bits.
enum class PixelPacking : std::uint8_t { Grey, Rgb, Bgr, Bits565, Bits555 };
enum class LedColour : std::uint8_t { Red, Green, Blue };
/// The PWM polarity under which more current is more light on a board, as its maker says.
enum class LedPolarity : std::uint8_t { Unstated, Normal, Inverted };
/// What darkens a board's LEDs: their enable lines, or only these and a current of zero.
enum class LedOff : std::uint8_t { Enable, EnableAndCurrent };
/// What darkens the LEDs of such a board where this computer dies: nothing, or a watchdog before them.
enum class LedCutoff : std::uint8_t { None, Watchdog };
/// Which of a board's sensors hangs in the resin.
enum class Thermometer : std::uint8_t { None, Hotend, Bed, Chamber };

/// A printer that owns its light and its stage and takes a file; None: projector and stage are driven from here.
enum class PrinterKind : std::uint8_t { None, Sdcp };
/// The file that a printer takes.
enum class PrinterFile : std::uint8_t { None, Goo, Sl1, NanoDlp };
/// How the printer's program lets the exposures of an SL1 archive fall over its numFade layers: slafw since 2024 (and
/// PrusaSlicer), slafw up to 2022, Odyssey.
enum class FadeReader : std::uint8_t { Slafw, Slafw2022, Odyssey };

/// What joins the feet of supports on the platform. Auto: bars beside a part that stands, a plate a group of feet under
/// a lifted one.
enum class RaftKind : std::uint8_t { Auto, Plates, Plate, Skate, None };
/// Where pins may stand.
enum class PinGround : std::uint8_t { Anywhere, Platform };

template <class Word>
inline constexpr std::nullptr_t kMachineWords = nullptr;
template <>
inline constexpr std::array<std::string_view, 4> kMachineWords<OpticsTurn>{"normal", "mirror-x", "mirror-y",
                                                                           "rotate-180"};
template <>
inline constexpr std::array<std::string_view, 4> kMachineWords<MirrorControllers>{"auto", "one", "left-right",
                                                                                  "right-left"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<ProjectorKind>{"virtual", "dlpc900", "screen"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<StageKind>{"virtual", "grbl", "marlin"};
template <>
inline constexpr std::array<std::string_view, 2> kMachineWords<LightSwitch>{"projector", "stage"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<LightCommand>{"spindle", "fan", "pin"};
template <>
inline constexpr std::array<std::string_view, 4> kMachineWords<ScreenTurn>{"0", "90", "180", "270"};
template <>
inline constexpr std::array<std::string_view, 5> kMachineWords<PixelPacking>{"grey", "rgb", "bgr", "5-6-5", "5-5-5"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<LedColour>{"red", "green", "blue"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<LedPolarity>{"unstated", "normal", "inverted"};
template <>
inline constexpr std::array<std::string_view, 2> kMachineWords<LedOff>{"enable", "enable-and-current"};
template <>
inline constexpr std::array<std::string_view, 2> kMachineWords<LedCutoff>{"none", "watchdog"};
template <>
inline constexpr std::array<std::string_view, 4> kMachineWords<Thermometer>{"none", "hotend", "bed", "chamber"};
template <>
inline constexpr std::array<std::string_view, 2> kMachineWords<PrinterKind>{"none", "sdcp"};
template <>
inline constexpr std::array<std::string_view, 4> kMachineWords<PrinterFile>{"none", "goo", "sl1", "nanodlp"};
template <>
inline constexpr std::array<std::string_view, 3> kMachineWords<FadeReader>{"slafw", "slafw-2022", "odyssey"};
template <>
inline constexpr std::array<std::string_view, 5> kMachineWords<RaftKind>{"auto", "plates", "plate", "skate", "none"};
template <>
inline constexpr std::array<std::string_view, 2> kMachineWords<PinGround>{"anywhere", "platform"};

template <class T>
concept MachineWord = !std::is_null_pointer_v<std::remove_cv_t<decltype(kMachineWords<T>)>>;

/// "mirror-x", ...
template <MachineWord Word>
[[nodiscard]] constexpr std::string_view name_of(Word word) {
  return kMachineWords<Word>.at(static_cast<std::size_t>(word));
}

/// Its place among the words. Fails with InvalidInput and lists them.
[[nodiscard]] Result<std::size_t> place_among(std::string_view name, std::span<const std::string_view> words);

/// Fails with InvalidInput and lists the words there are.
template <MachineWord Word>
[[nodiscard]] Result<Word> machine_word_from(std::string_view name) {
  return place_among(name, kMachineWords<Word>).map([](std::size_t place) { return static_cast<Word>(place); });
}

}  // namespace telefab
