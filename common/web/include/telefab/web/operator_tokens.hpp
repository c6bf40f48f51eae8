// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/web/digest_login.hpp>
#include <telefab/web/visitor.hpp>
#include <vector>

namespace telefab {

/// A token that one operator signs in with at a page, as the file of them keeps it: salted and hashed, so that who
/// reads the file cannot sign in: but for those that also log in by HTTP digest, whose keys open that to who has them.
/// 128 random bits need no slower hash.
struct OperatorToken {
  std::string name;  ///< letters, digits, "-", "_" and "."; stands in the audit log
  Access may = Access::Operators;
  std::string salt;  ///< hexadecimal
  Digest digest;     ///< of salt and token
  std::int64_t made_unix_s = 0;
  std::optional<DigestKeys> digest_login = {};  ///< the token is also the password of the user `name`; none: it is not
  friend bool operator==(const OperatorToken&, const OperatorToken&) = default;
};

/// In the order they were made. NotFound: no such file; NotTrusted: others may read or change it; InvalidInput:
/// damaged.
[[nodiscard]] Result<std::vector<OperatorToken>> read_operator_tokens(const std::filesystem::path& file);

/// Whether a token also opens by HTTP digest login.
enum class DigestUse : std::uint8_t { No, Yes };

/// Makes a token, which is given back and nowhere else; the file where there is none. Conflict: the name has one;
/// InvalidInput: name; else as read_operator_tokens and write_secret.
[[nodiscard]] Result<std::string> add_operator_token(const std::filesystem::path& file, const std::string& name,
                                                     Access may, Nanoseconds wall, DigestUse use = DigestUse::No);
/// The file stays where it was the last: with it, nobody comes in without a token. NotFound: the name has none.
[[nodiscard]] Result<void> revoke_operator_token(const std::filesystem::path& file, const std::string& name);

/// Whose token this is; null: nobody's. As long whichever it is, and whether it is one or not.
[[nodiscard]] const OperatorToken* owner_of(std::span<const OperatorToken> tokens, std::string_view token);

/// 128 random bits in hexadecimal, from the system. Internal: it has none.
[[nodiscard]] Result<std::string> random_token();

}  // namespace telefab
