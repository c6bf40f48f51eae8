// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <telefab/net/trust.hpp>

#include "asio.hpp"

namespace telefab::net {

using Tls = boost::asio::ssl::stream<boost::asio::ip::tcp::socket>;

struct Trust::Impl {
  TlsFiles files;
  std::shared_ptr<boost::asio::ssl::context> context;
  std::array<std::filesystem::file_time_type, 4> read_at{};
};

}  // namespace telefab::net
