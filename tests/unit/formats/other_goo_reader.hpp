// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace telefab::test {

/// A second reader of GOO files, from Elegoo's document by its byte numbers and sharing nothing with the product's.
/// Throws where the file is not as the document says.
class OtherGooReader {
 public:
  struct Layer {
    float z_mm, exposure_s, before_lift_s, after_lift_s, after_retract_s;
    float lift_mm, lift_speed, lift2_mm, lift2_speed, retract_mm, retract_speed, retract2_mm, retract2_speed;
    unsigned pwm;
    std::vector<std::uint8_t> pixels;
  };

  explicit OtherGooReader(std::span<const std::byte> bytes) : b_{bytes} {
    require(b_.size() > 195'477, "shorter than its header");
    require(text(0, 4) == "V3.0" && text(6 + 2, 3) == "DLP", "magic");
    require(number(27'106, 2) == 0x0D0A && number(195'308, 2) == 0x0D0A, "preview delimiters");
    require(number(195'470, 4) == 195'477, "offset of the layers");
    width = number(195'314, 2);
    height = number(195'316, 2);
    std::size_t at = 195'477;
    for (unsigned i = number(195'310, 4); i > 0; --i) at = read_layer(at);
    require(at + 11 == b_.size() && number(at, 3) == 0 && text(at + 7, 3) == "DLP", "ending");
  }
  [[nodiscard]] unsigned number(std::size_t at, unsigned size) const {
    unsigned value = 0;
    for (unsigned i = 0; i < size; ++i) value = value * 256 + std::to_integer<unsigned>(b_[at + i]);
    return value;
  }
  [[nodiscard]] float real(std::size_t at) const { return std::bit_cast<float>(number(at, 4)); }
  [[nodiscard]] std::string text(std::size_t at, std::size_t size) const {
    std::string all(reinterpret_cast<const char*>(b_.data()) + at, size);
    return all.substr(0, all.find('\0'));
  }
  unsigned width = 0, height = 0;
  std::vector<Layer> layers;

 private:
  static void require(bool holds, const char* what) {
    if (!holds) throw std::runtime_error(what);
  }
  std::size_t read_layer(std::size_t at) {
    Layer l{real(at + 6),  real(at + 10), real(at + 18), real(at + 22),      real(at + 26),
            real(at + 30), real(at + 34), real(at + 38), real(at + 42),      real(at + 46),
            real(at + 50), real(at + 54), real(at + 58), number(at + 62, 2), {}};
    require(number(at + 64, 2) == 0x0D0A, "end of a definition");
    const std::size_t size = number(at + 66, 4), begin = at + 70, end = begin + size;
    require(number(end, 2) == 0x0D0A, "end of pixels");
    require(number(begin, 1) == 0x55, "begin of pixels");
    unsigned sum = 0;
    for (std::size_t i = begin + 1; i + 1 < end; ++i) sum += number(i, 1);
    require((~sum & 0xFFU) == number(end - 1, 1), "checksum");
    unsigned grey = 0;
    for (std::size_t i = begin + 1; i + 1 < end;) {
      const unsigned head = number(i++, 1);
      unsigned run = 1;
      if (head >> 6U == 2) {
        grey = (head & 0x20U) != 0 ? grey - (head & 15U) : grey + (head & 15U);
        if ((head & 0x10U) != 0) run = number(i++, 1);
      } else {
        grey = head >> 6U == 0 ? 0 : head >> 6U == 3 ? 255 : number(i++, 1);
        const unsigned more = head >> 4U & 3U;
        run = number(i, more) * 16 + (head & 15U);
        i += more;
      }
      l.pixels.insert(l.pixels.end(), run, static_cast<std::uint8_t>(grey));
    }
    require(l.pixels.size() == std::size_t{width} * height, "pixels of a layer");
    layers.push_back(std::move(l));
    return end + 2;
  }
  std::span<const std::byte> b_;
};

}  // namespace telefab::test
