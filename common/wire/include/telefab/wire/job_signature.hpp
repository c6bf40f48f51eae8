// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/wire/message.hpp>

// A job bears two Ed25519 signatures of its scan site: of what is to be made (the offer), and of what was cut (the
// end of the stack, which takes the offer in). The texts signed stand in proto/README.md.
namespace telefab {

/// Puts the site's public key and its signature into an offer; everything else in it must be final. Fails with
/// InvalidInput where the text is no private Ed25519 key in PEM.
[[nodiscard]] Result<void> sign_offer(Offer& offer, std::string_view private_key_pem);

/// Signs the end of the offer's stack.
[[nodiscard]] Result<void> sign_end(const Offer& offer, StackEnd& end, std::string_view private_key_pem);

[[nodiscard]] bool is_signed(const Offer& offer);

/// NotTrusted ("job-signature: ...") unless the offer's signature is there and holds for its key; with `public_key_pem`
/// it must also be that key.
[[nodiscard]] Result<void> check_offer(const Offer& offer, std::string_view public_key_pem);

/// NotTrusted ("job-signature: ...") unless the end is signed with the key of the offer.
[[nodiscard]] Result<void> check_end(const Offer& offer, const StackEnd& end);

}  // namespace telefab
