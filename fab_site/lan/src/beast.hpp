// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
// The one way to Asio and Beast for .cpp files of this folder.
#include <utility>  // boost/asio/awaitable.hpp of Boost 1.74 forgets it
// Boost headers next.
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

namespace telefab::fab {
namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;
using udp = asio::ip::udp;

inline constexpr std::size_t kMostMessageBytes = 1U << 20U;
}  // namespace telefab::fab
