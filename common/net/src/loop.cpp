// SPDX-License-Identifier: GPL-3.0-or-later
#include "loop_impl.hpp"

namespace telefab::net {

Loop::Loop() : impl_{std::make_unique<Impl>()} {}
Loop::~Loop() = default;

void Loop::run() {
  impl_->context.restart();
  impl_->context.run();
}

bool Loop::run_for(Nanoseconds duration) {
  impl_->context.restart();
  impl_->context.run_for(duration);
  return impl_->context.stopped();
}

void Loop::stop() { impl_->context.stop(); }

void Loop::post(std::function<void()> work) { boost::asio::post(impl_->context, std::move(work)); }

void Loop::after(Nanoseconds duration, std::function<void()> work) {
  auto timer = std::make_shared<boost::asio::steady_timer>(impl_->context, duration);
  timer->async_wait([timer, work = std::move(work)](const boost::system::error_code& error) {
    if (!error) work();
  });
}

}  // namespace telefab::net
