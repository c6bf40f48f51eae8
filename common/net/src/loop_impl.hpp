// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/net/loop.hpp>

#include "asio.hpp"

namespace telefab::net {

struct Loop::Impl {
  boost::asio::io_context context{1};
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> guard{context.get_executor()};
};

}  // namespace telefab::net
