// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <telefab/test/digest_client.hpp>
#include <telefab/web/digest_login.hpp>

// "METHOD TARGET\nPARAMETERS", once for a head and twice whole; @n stands for a nonce of the page's. Whoever is let in
// has shown what user, password, method, address and nonce make together, and is let in once.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  static const VirtualClock kClock;
  DigestLogin login{"0123456789abcdef", kClock};
  const std::string nonce = test::DigestClient::nonce_of(login.challenges(false).at(0));
  std::string all{reinterpret_cast<const char*>(data), size};
  if (const auto at = all.find("@n"); at != std::string::npos) all.replace(at, 2, nonce);
  const std::size_t line = std::min(all.find('\n'), all.size());
  const std::size_t space = std::min(all.find(' '), line);
  WebRequest request;
  request.method = all.substr(0, space);
  request.target = all.substr(std::min(space + 1, line), line - std::min(space + 1, line));
  const std::string parameters = all.substr(std::min(line + 1, all.size()));
  const auto shown = digest_answer_from(parameters);
  if (!shown) return shown.error().what.empty() ? std::abort(), 0 : 0;
  // What the fuzzer cannot hash itself is hashed for it, by the client's own half.
  DigestAnswer answer = *shown;
  const test::DigestClient client{"ada", "secret", "Telefab", answer.algorithm == "MD5" ? "MD5" : "SHA-256"};
  if (answer.response == "right") {
    const std::string a1 = client.hash("ada:Telefab:secret"), a2 = client.hash(request.method + ":" + answer.uri);
    answer.response = client.hash(a1 + ":" + answer.nonce + ":" + answer.count + ":" + answer.cnonce + ":auth:" + a2);
  }
  const DigestKeys keys = digest_keys_of("ada", "secret"), others = digest_keys_of("ada", "other");
  request.is_whole = false;
  const auto head = login.judge(request, answer, &keys);
  request.is_whole = true;
  const auto whole = login.judge(request, answer, &keys);
  if (head != whole) std::abort();
  if (whole == DigestLogin::Verdict::Right &&
      (shown->response != "right" || answer.nonce != nonce || answer.uri != request.target || answer.qop != "auth"))
    std::abort();
  if (login.judge(request, answer, &keys) == DigestLogin::Verdict::Right) std::abort();
  if (login.judge(request, answer, &others) != DigestLogin::Verdict::Wrong ||
      login.judge(request, answer, nullptr) != DigestLogin::Verdict::Wrong)
    std::abort();
  return 0;
}
