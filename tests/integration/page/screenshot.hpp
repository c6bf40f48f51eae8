// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>
#include <openssl/evp.h>

#include <fstream>

#include "web_driver.hpp"

namespace telefab::test {

/// Keeps what the browser shows as NAME.png in the folder TELEFAB_SCREENSHOTS, to be looked at.
inline void keep_screenshot(Browser& browser, const std::string& name) {
  const std::string base64 = browser.screenshot();
  std::string bytes(base64.size(), '\0');
  const int size =
      EVP_DecodeBlock(reinterpret_cast<unsigned char*>(bytes.data()),
                      reinterpret_cast<const unsigned char*>(base64.data()), static_cast<int>(base64.size()));
  ASSERT_GT(size, 1000);
  const std::filesystem::path folder = std::getenv("TELEFAB_SCREENSHOTS") ? std::getenv("TELEFAB_SCREENSHOTS") : ".";
  std::filesystem::create_directories(folder);
  std::ofstream{folder / (name + ".png"), std::ios::binary}.write(bytes.data(), size);
}

}  // namespace telefab::test
