// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/geometry/layer.hpp>
#include <telefab/wire/stack_key.hpp>

namespace telefab {

std::optional<Digest> stack_key_of(const Offer& offer) {
  if (offer.scan == Digest{}) return std::nullopt;
  // Free texts stand in it by their lengths, so that none can pass for another part.
  const std::string header = canonical_text(offer.header);
  Hasher hasher;
  hasher.feed(fmt::format("telefab stack 1\nscan {}\nprofile {}\ncoding {}\nparameters {}\n{}\nheader {}\n{}\n",
                          to_hex(offer.scan), to_hex(offer.profile), offer.coding, offer.parameters.size(),
                          offer.parameters, header.size(), header));
  return hasher.digest();
}

}  // namespace telefab
