// SPDX-License-Identifier: GPL-3.0-or-later
#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/base/file_md5.hpp>
#include <vector>

namespace telefab {

Result<std::string> md5_of_file(const std::filesystem::path& path) {
  constexpr std::size_t kBlock_bytes = 1U << 20U;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file{std::fopen(path.c_str(), "rbe"), &std::fclose};
  if (!file) return fail_system("read", path, errno);
  const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> sum{EVP_MD_CTX_new(), &EVP_MD_CTX_free};
  bool is_sound = sum && EVP_DigestInit_ex(sum.get(), EVP_md5(), nullptr) == 1;
  std::vector<std::byte> block(kBlock_bytes);
  while (is_sound) {
    errno = 0;
    const std::size_t got = std::fread(block.data(), 1, block.size(), file.get());
    if (got < block.size() && std::ferror(file.get()) != 0) return fail_system("read", path, errno);
    if (got == 0) break;
    is_sound = EVP_DigestUpdate(sum.get(), block.data(), got) == 1;
  }
  std::array<unsigned char, 16> value{};
  if (!is_sound || EVP_DigestFinal_ex(sum.get(), value.data(), nullptr) != 1)
    return fail(ErrorCode::Internal, "the library of checksums does not work");
  std::string hex;
  constexpr char kDigits[] = "0123456789abcdef";
  for (const unsigned char byte : value) {
    hex += kDigits[byte >> 4U];
    hex += kDigits[byte & 15U];
  }
  return hex;
}

}  // namespace telefab
