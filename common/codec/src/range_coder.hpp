// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

// A binary adaptive range coder in integers alone (Martin 1979; the carry-less byte cache follows the LZMA
// specification), so that both sites agree in every bit.
namespace telefab::codec {

/// Probability that the next bit is 0, of 65536. It is the mean of what was seen until 40 bits were seen, then adapts
/// by 1/41 of the error; never closer than 1/1024 to 0 or 1, so that a byte holds at most some 5700 bits.
struct BitModel {
  std::uint16_t zero = 32768;
  std::uint8_t seen = 0;
  void learn(unsigned bit);
};

/// Bits that coding `bit` takes. Integers and a table made by squaring: the same estimate on every machine.
[[nodiscard]] double cost_of(const BitModel& model, unsigned bit);

/// Two models of the same bit that saw it in different contexts. Their mean tells it better than either; both learn.
template <class Model>  // BitModel, const where only the cost is asked
struct BitPair {
  Model& one;
  Model& other;
  [[nodiscard]] BitModel mean() const {
    return {static_cast<std::uint16_t>((std::uint32_t{one.zero} + other.zero) / 2), 0};
  }
  void learn(unsigned bit) const {
    one.learn(bit);
    other.learn(bit);
  }
};
template <class Model>
BitPair(Model&, Model&) -> BitPair<Model>;

class RangeEncoder {
 public:
  void encode(BitModel& model, unsigned bit);
  void encode(const BitPair<BitModel>& pair, unsigned bit);
  /// `count` bits of equal probability, highest first.
  void encode_direct(std::uint32_t value, unsigned count);
  /// Ends the stream; the encoder is spent.
  [[nodiscard]] std::vector<std::byte> finish();
  [[nodiscard]] std::size_t size() const { return bytes_.size() + pending_; }

 private:
  void narrow(std::uint16_t zero, unsigned bit);
  void shift_low();
  std::uint64_t low_ = 0;
  std::uint32_t range_ = 0xFFFF'FFFF;
  std::uint64_t pending_ = 1;
  std::uint8_t cache_ = 0;
  std::vector<std::byte> bytes_;
};

/// Reads zeros past the end and remembers it (overrun), so that a caller need not check every bit.
class RangeDecoder {
 public:
  explicit RangeDecoder(std::span<const std::byte> bytes);
  [[nodiscard]] unsigned decode(BitModel& model);
  [[nodiscard]] unsigned decode(const BitPair<BitModel>& pair);
  [[nodiscard]] std::uint32_t decode_direct(unsigned count);
  [[nodiscard]] bool overrun() const { return overrun_; }
  /// True when exactly all bytes were used.
  [[nodiscard]] bool at_end() const { return !overrun_ && next_ == bytes_.size(); }

 private:
  unsigned narrow(std::uint16_t zero);
  void normalise();
  std::uint8_t next_byte();
  std::span<const std::byte> bytes_;
  std::size_t next_ = 0;
  std::uint32_t range_ = 0xFFFF'FFFF;
  std::uint32_t code_ = 0;
  bool overrun_ = false;
};

/// Whole numbers of any size: a bit length by an adaptive tree, its two highest bits below the first adaptive, the rest
/// direct. `Contexts` separate histories share nothing.
template <unsigned Contexts>
class NumberModel {
 public:
  static constexpr unsigned kLengths = 64;  ///< bit lengths 0 to 32 fit a tree of 6 levels

  void encode(RangeEncoder& coder, std::uint32_t value, unsigned context);
  [[nodiscard]] std::uint32_t decode(RangeDecoder& coder, unsigned context);
  /// As if the value had been coded.
  void learn(std::uint32_t value, unsigned context);
  /// Bits that encode() would take.
  [[nodiscard]] double cost(std::uint32_t value, unsigned context) const;

 private:
  std::array<std::array<BitModel, kLengths>, Contexts> length_{};
  std::array<std::array<BitModel, 4>, 33> high_{};
};

[[nodiscard]] inline unsigned bit_length(std::uint32_t value) {
  unsigned length = 0;
  for (; value; value >>= 1U) ++length;
  return length;
}

template <unsigned Contexts>
void NumberModel<Contexts>::encode(RangeEncoder& coder, std::uint32_t value, unsigned context) {
  const unsigned length = bit_length(value);
  unsigned node = 1;
  for (int level = 5; level >= 0; --level) {
    const unsigned bit = (length >> static_cast<unsigned>(level)) & 1U;
    coder.encode(length_[context][node], bit);
    node = node * 2 + bit;
  }
  if (length < 2) return;
  // The highest bit is known to be 1.
  const unsigned adaptive = length - 1 < 2 ? length - 1 : 2;
  unsigned place = 1;
  for (unsigned i = 0; i < adaptive; ++i) {
    const unsigned bit = (value >> (length - 2 - i)) & 1U;
    coder.encode(high_[length][place], bit);
    place = place * 2 + bit;
  }
  const unsigned rest = length - 1 - adaptive;
  if (rest) coder.encode_direct(value & ((1U << rest) - 1U), rest);
}

template <unsigned Contexts>
void NumberModel<Contexts>::learn(std::uint32_t value, unsigned context) {
  const unsigned length = bit_length(value);
  unsigned node = 1;
  for (int level = 5; level >= 0; --level) {
    const unsigned bit = (length >> static_cast<unsigned>(level)) & 1U;
    length_[context][node].learn(bit);
    node = node * 2 + bit;
  }
}

template <unsigned Contexts>
double NumberModel<Contexts>::cost(std::uint32_t value, unsigned context) const {
  const unsigned length = bit_length(value);
  double bits = 0;
  unsigned node = 1;
  for (int level = 5; level >= 0; --level) {
    const unsigned bit = (length >> static_cast<unsigned>(level)) & 1U;
    bits += cost_of(length_[context][node], bit);
    node = node * 2 + bit;
  }
  return length < 2 ? bits : bits + (length - 1);  // the two adaptive bits below the first are taken for even
}

template <unsigned Contexts>
std::uint32_t NumberModel<Contexts>::decode(RangeDecoder& coder, unsigned context) {
  unsigned node = 1;
  for (int level = 0; level < 6; ++level) node = node * 2 + coder.decode(length_[context][node]);
  unsigned length = node - kLengths;
  if (length > 32) length = 32;  // no encoder writes it; the caller's limits judge the value
  if (length < 2) return length;
  const unsigned adaptive = length - 1 < 2 ? length - 1 : 2;
  std::uint32_t value = 1;
  unsigned place = 1;
  for (unsigned i = 0; i < adaptive; ++i) {
    const unsigned bit = coder.decode(high_[length][place]);
    place = place * 2 + bit;
    value = value * 2 + bit;
  }
  const unsigned rest = length - 1 - adaptive;
  if (rest) value = (value << rest) | coder.decode_direct(rest);
  return value;
}

/// 0, -1, 1, -2, 2, ... as 0, 1, 2, 3, 4, ...
[[nodiscard]] inline std::uint32_t zigzag(std::int32_t value) {
  return (static_cast<std::uint32_t>(value) << 1U) ^ static_cast<std::uint32_t>(value >> 31);
}
[[nodiscard]] inline std::int32_t unzigzag(std::uint32_t value) {
  return static_cast<std::int32_t>(value >> 1U) ^ -static_cast<std::int32_t>(value & 1U);
}

}  // namespace telefab::codec
