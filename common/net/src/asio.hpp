// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
// The one way to Asio, for .cpp files and private headers of common/net.
#include <utility>  // boost/asio/awaitable.hpp of Boost 1.74 forgets it
// Boost headers next.
#include <boost/asio/bind_executor.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
