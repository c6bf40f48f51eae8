#include "range_coder.hpp"

namespace telefab::codec {
namespace {

constexpr unsigned kModelBits = 11;
constexpr unsigned kAdaptShift = 5;
constexpr std::uint32_t kTop = 1U << 24U;

}  // namespace

void RangeEncoder::encode(BitModel& model, unsigned bit) {
  const std::uint32_t bound = (range_ >> kModelBits) * model.zero;
  if (bit == 0) {
    range_ = bound;
    model.zero = static_cast<std::uint16_t>(model.zero + (((1U << kModelBits) - model.zero) >> kAdaptShift));
  } else {
    low_ += bound;
    range_ -= bound;
    model.zero = static_cast<std::uint16_t>(model.zero - (model.zero >> kAdaptShift));
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
  const std::uint32_t bound = (range_ >> kModelBits) * model.zero;
  unsigned bit = 0;
  if (code_ < bound) {
    range_ = bound;
    model.zero = static_cast<std::uint16_t>(model.zero + (((1U << kModelBits) - model.zero) >> kAdaptShift));
  } else {
    code_ -= bound;
    range_ -= bound;
    model.zero = static_cast<std::uint16_t>(model.zero - (model.zero >> kAdaptShift));
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
