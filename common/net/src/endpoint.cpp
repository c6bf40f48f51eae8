// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <charconv>
#include <telefab/net/endpoint.hpp>

#include "asio.hpp"

namespace telefab::net {

Result<Endpoint> endpoint_from_text(std::string_view text) {
  const auto refuse = [&](std::string_view why) {
    return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not a HOST:PORT: {}", text, why));
  };
  if (text.find("://") != std::string_view::npos)
    return refuse("it is the address of a page; leave out all but host and port");
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) return refuse("the port is missing");
  std::string_view host = text.substr(0, colon);
  const std::string_view port = text.substr(colon + 1);
  if (host.size() >= 2 && host.front() == '[' && host.back() == ']')
    host = host.substr(1, host.size() - 2);
  else if (host.find(':') != std::string_view::npos)
    return refuse("an IPv6 address stands in brackets, as in [::1]:7420");
  if (host.empty()) return refuse("the host is missing");
  Endpoint endpoint{std::string{host}, 0};
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), endpoint.port);
  if (port.empty() || error != std::errc{} || end != port.data() + port.size())
    return refuse("the port is a number from 0 to 65535");
  return endpoint;
}

std::string to_text(const Endpoint& endpoint) {
  const bool is_v6 = endpoint.host.find(':') != std::string::npos;
  return is_v6 ? fmt::format("[{}]:{}", endpoint.host, endpoint.port)
               : fmt::format("{}:{}", endpoint.host, endpoint.port);
}

bool is_loopback(const Endpoint& endpoint) {
  if (endpoint.host == "localhost") return true;
  boost::system::error_code error;
  const auto address = boost::asio::ip::make_address(endpoint.host, error);
  return !error && address.is_loopback();
}

}  // namespace telefab::net
