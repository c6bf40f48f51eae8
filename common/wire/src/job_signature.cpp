// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/signature.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab {
namespace {

std::string hex_of(std::span<const std::byte> bytes) {
  std::string text;
  for (const std::byte b : bytes) text += fmt::format("{:02x}", std::to_integer<unsigned>(b));
  return text;
}

/// Of digits that this program wrote.
std::vector<std::byte> bytes_of(std::string_view hex) {
  const auto digit = [](char c) { return static_cast<unsigned>(c <= '9' ? c - '0' : c - 'a' + 10); };
  std::vector<std::byte> bytes(hex.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i)
    bytes[i] = static_cast<std::byte>(digit(hex[2 * i]) * 16 + digit(hex[2 * i + 1]));
  return bytes;
}

std::string hashed(std::string_view text) {
  Hasher hasher;
  hasher.feed(text);
  return to_hex(hasher.digest());
}

/// Free texts stand in it as digests, so that none of them can pass for a line of its own.
std::string text_of(const Offer& offer) {
  std::string optional = offer.scan == Digest{} ? "" : fmt::format("scan {}\n", to_hex(offer.scan));
  if (offer.registration_rms_mm > 0) optional += fmt::format("registration {:.17g}\n", offer.registration_rms_mm);
  if (offer.attempt > 0) optional += fmt::format("attempt {}\n", offer.attempt);
  return fmt::format(
      "telefab job offer 1\njob {}\nname {}\nmachine {}\nprofile {}\nparameters {}\nowner {}\nheader {}\ncoding {}\n{}",
      offer.job, hashed(offer.name), hashed(offer.machine), to_hex(offer.profile), hashed(offer.parameters),
      hashed(offer.owner), hashed(canonical_text(offer.header)), offer.coding, optional);
}

std::string text_of(const Offer& offer, const StackEnd& end) {
  return fmt::format("telefab job stack 1\noffer {}\nchunks {}\nchain {}\nstack {}\n", hashed(text_of(offer)),
                     end.chunk_count, to_hex(end.chain), to_hex(end.stack));
}

Result<void> check(const Offer& offer, std::span<const std::byte> signature, std::string_view text,
                   std::string_view public_key_pem) {
  const auto held = verify_ed25519(Signature{hex_of(signature), hex_of(offer.public_key)}, text, public_key_pem);
  if (held) return {};
  return fail(held.error().code, fmt::format("job-signature: of job {}: {}", offer.job, held.error().what));
}

}  // namespace

Result<void> sign_offer(Offer& offer, std::string_view private_key_pem) {
  const auto made = sign_ed25519(private_key_pem, text_of(offer));
  if (!made) return tl::unexpected{made.error()};
  offer.public_key = bytes_of(made->public_key_hex);
  offer.signature = bytes_of(made->signature_hex);
  return {};
}

Result<void> sign_end(const Offer& offer, StackEnd& end, std::string_view private_key_pem) {
  const auto made = sign_ed25519(private_key_pem, text_of(offer, end));
  if (!made) return tl::unexpected{made.error()};
  end.signature = bytes_of(made->signature_hex);
  return {};
}

bool is_signed(const Offer& offer) { return !offer.public_key.empty() || !offer.signature.empty(); }

Result<void> check_offer(const Offer& offer, std::string_view public_key_pem) {
  if (!is_signed(offer))
    return fail(ErrorCode::NotTrusted, fmt::format("job-signature: job {} is not signed", offer.job));
  return check(offer, offer.signature, text_of(offer), public_key_pem);
}

Result<void> check_end(const Offer& offer, const StackEnd& end) {
  if (end.signature.empty())
    return fail(ErrorCode::NotTrusted, fmt::format("job-signature: the stack of job {} is not signed", offer.job));
  return check(offer, end.signature, text_of(offer, end), {});
}

}  // namespace telefab
