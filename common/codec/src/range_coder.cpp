// SPDX-License-Identifier: GPL-3.0-or-later
#include "range_coder.hpp"

#include <algorithm>
#include <array>

namespace telefab::codec {
namespace {

constexpr unsigned kModelBits = 16;
constexpr std::uint8_t kMostSeen = 40;
constexpr std::uint32_t kLeastProbability = 64;
constexpr std::uint32_t kTop = 1U << 24U;

/// 65536 / (seen + 1.5)
constexpr auto kRates = [] {
  std::array<std::uint32_t, kMostSeen + 1U> rates{};
  for (std::uint32_t seen = 0; seen <= kMostSeen; ++seen) rates[seen] = 131072U / (2 * seen + 3);
  return rates;
}();

/// Entry p: bits that an event of probability (p + 1/2) / 4096 takes; binary logarithm by squaring.
constexpr auto kCosts = [] {
  std::array<float, 4096> costs{};
  for (std::uint32_t p = 0; p < 4096; ++p) {
    double x = (p + 0.5) / 4096;
    double bits = 0;
    while (x < 1) {
      x *= 2;
      bits += 1;
    }
    double part = 1;
    for (int i = 0; i < 12; ++i) {
      x *= x;
      part /= 2;
      if (x >= 2) {
        x /= 2;
        bits -= part;
      }
    }
    costs[p] = static_cast<float>(bits);
  }
  return costs;
}();

}  // namespace

void BitModel::learn(unsigned bit) {
  const std::uint32_t rate = kRates[seen];
  if (seen < kMostSeen) ++seen;
  const std::uint32_t now = bit == 0 ? zero + ((65536U - zero) * rate >> 16U) : zero - (zero * rate >> 16U);
  zero = static_cast<std::uint16_t>(std::clamp(now, kLeastProbability, 65536U - kLeastProbability));
}

double cost_of(const BitModel& model, unsigned bit) {
  return static_cast<double>(kCosts[(bit == 0 ? model.zero : 65536U - model.zero) >> 4U]);
}

void RangeEncoder::encode(BitModel& model, unsigned bit) {
  narrow(model.zero, bit);
  model.learn(bit);
}

void RangeEncoder::encode(const BitPair<BitModel>& pair, unsigned bit) {
  narrow(pair.mean().zero, bit);
  pair.learn(bit);
}

void RangeEncoder::narrow(std::uint16_t zero, unsigned bit) {
  const std::uint32_t bound = (range_ >> kModelBits) * zero;
  if (bit == 0) {
    range_ = bound;
  } else {
    low_ += bound;
    range_ -= bound;
  }
  while (range_ < kTop) {
    range_ <<= 8U;
    shift_low();
  }
}

void RangeEncoder::encode_direct(std::uint32_t value, unsigned count) {
  for (unsigned i = count; i > 0; --i) {
    range_ >>= 1U;
    if ((value >> (i - 1)) & 1U) low_ += range_;
    while (range_ < kTop) {
      range_ <<= 8U;
      shift_low();
    }
  }
}

void RangeEncoder::shift_low() {
  // Bytes of all ones wait until it is known whether a carry runs through them.
  if (low_ < 0xFF00'0000ULL || low_ > 0xFFFF'FFFFULL) {
    const auto carry = static_cast<std::uint8_t>(low_ >> 32U);
    std::uint8_t byte = cache_;
    for (; pending_ > 0; --pending_) {
      bytes_.push_back(static_cast<std::byte>(static_cast<std::uint8_t>(byte + carry)));
      byte = 0xFF;
    }
    cache_ = static_cast<std::uint8_t>(low_ >> 24U);
  }
  ++pending_;
  low_ = (low_ & 0x00FF'FFFFULL) << 8U;
}

std::vector<std::byte> RangeEncoder::finish() {
  for (int i = 0; i < 5; ++i) shift_low();
  return std::move(bytes_);
}

RangeDecoder::RangeDecoder(std::span<const std::byte> bytes) : bytes_{bytes} {
  for (int i = 0; i < 5; ++i) code_ = (code_ << 8U) | next_byte();
}

std::uint8_t RangeDecoder::next_byte() {
  if (next_ >= bytes_.size()) {
    overrun_ = true;
    return 0;
  }
  return std::to_integer<std::uint8_t>(bytes_[next_++]);
}

void RangeDecoder::normalise() {
  while (range_ < kTop) {
    range_ <<= 8U;
    code_ = (code_ << 8U) | next_byte();
  }
}

unsigned RangeDecoder::decode(BitModel& model) {
  const unsigned bit = narrow(model.zero);
  model.learn(bit);
  return bit;
}

unsigned RangeDecoder::decode(const BitPair<BitModel>& pair) {
  const unsigned bit = narrow(pair.mean().zero);
  pair.learn(bit);
  return bit;
}

unsigned RangeDecoder::narrow(std::uint16_t zero) {
  const std::uint32_t bound = (range_ >> kModelBits) * zero;
  unsigned bit = 0;
  if (code_ < bound) {
    range_ = bound;
  } else {
    code_ -= bound;
    range_ -= bound;
    bit = 1;
  }
  normalise();
  return bit;
}

std::uint32_t RangeDecoder::decode_direct(unsigned count) {
  std::uint32_t value = 0;
  for (unsigned i = 0; i < count; ++i) {
    range_ >>= 1U;
    const unsigned bit = code_ >= range_ ? 1U : 0U;
    if (bit) code_ -= range_;
    value = (value << 1U) | bit;
    normalise();
  }
  return value;
}

}  // namespace telefab::codec
