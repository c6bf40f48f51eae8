// SPDX-License-Identifier: GPL-3.0-or-later
#include "support_choice.hpp"

#include <telefab/base/file.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMaxHandListBytes = 16U << 20U;

}  // namespace

void declare_support_choice(VerbOptions& app, SupportChoice& choice) {
  app.add("--supports", choice.supports,
          "auto: pins where something hangs, and so many and so wide that they bear the pull of the film; cover: where "
          "something hangs alone; none")
      .one_of({"auto", "cover", "none"})
      .shows_default();
  app.add("--stand", choice.stand, "stand on the platform: auto (where the first layer is large enough), always, never")
      .one_of({"auto", "always", "never"})
      .shows_default();
  app.add("--hand-list", choice.hand_list, "JSON file of extra and forbidden places for anchors");
}

Result<void> apply(const SupportChoice& choice, SupportOptions& options) {
  options.stand = choice.stand == "always"  ? SupportOptions::Stand::Always
                  : choice.stand == "never" ? SupportOptions::Stand::Never
                                            : SupportOptions::Stand::Auto;
  options.mode = choice.supports == "none"    ? SupportOptions::Mode::None
                 : choice.supports == "cover" ? SupportOptions::Mode::Cover
                                              : SupportOptions::Mode::Auto;
  if (choice.hand_list.empty()) return {};
  const auto text = read_file(choice.hand_list, kMaxHandListBytes);
  if (!text) return tl::unexpected{text.error()};
  auto hand = hand_list_from_json({reinterpret_cast<const char*>(text->data()), text->size()});
  if (!hand) return fail_in(choice.hand_list, hand.error());
  options.hand = std::move(*hand);
  return {};
}

}  // namespace telefab::fab
