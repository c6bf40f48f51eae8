// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include "loop_impl.hpp"

namespace telefab::net {
namespace {

const SystemClock kSystemClock;

}  // namespace

Loop::Impl::~Impl() {
  // What waits may hold the last of a connection, whose own waits end with it.
  const auto left = std::exchange(waits, {});
}

Loop::Impl::WaitId Loop::Impl::wait(Nanoseconds after, std::function<void()> work) {
  const WaitId id{clock.now() + std::max(after, Nanoseconds{0}), ++last_wait};
  const bool is_next = waits.empty() || id < waits.begin()->first;
  waits.emplace(id, std::move(work));
  if (is_next) set_alarm();
  return id;
}

void Loop::Impl::forget(const WaitId& id) {
  const auto found = waits.find(id);
  if (found == waits.end()) return;
  const auto work = std::move(found->second);  // goes after the map is whole again
  waits.erase(found);
}

void Loop::Impl::call_due() {
  while (!waits.empty() && waits.begin()->first.first <= clock.now()) {
    const auto work = std::move(waits.begin()->second);
    waits.erase(waits.begin());
    work();
  }
  set_alarm();
}

void Loop::Impl::set_alarm() {
  if (is_passing || waits.empty()) return;
  alarm.expires_after(std::max(waits.begin()->first.first - clock.now(), Nanoseconds{0}));
  alarm.async_wait([this](const boost::system::error_code& error) {
    if (!error) call_due();
  });
}

Loop::Loop() : Loop{kSystemClock} {}
Loop::Loop(const Clock& clock) : impl_{std::make_unique<Impl>(clock)} {}
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

bool Loop::pass(VirtualClock& clock, Nanoseconds duration) {
  const Nanoseconds end = clock.now() + duration;
  impl_->context.restart();
  impl_->is_passing = true;
  bool is_over = false;
  while (!is_over) {
    while (impl_->context.poll() > 0) {
    }
    if (impl_->context.stopped()) break;
    const auto next = impl_->waits.begin();
    is_over = next == impl_->waits.end() || next->first.first > end;
    clock.advance(std::max((is_over ? end : next->first.first) - clock.now(), Nanoseconds{0}));
    if (!is_over) impl_->call_due();
  }
  impl_->is_passing = false;
  impl_->set_alarm();
  return !is_over;
}

void Loop::stop() { impl_->context.stop(); }

void Loop::post(std::function<void()> work) { boost::asio::post(impl_->context, std::move(work)); }

void Loop::after(Nanoseconds duration, std::function<void()> work) {
  boost::asio::dispatch(impl_->context,
                        [this, duration, work = std::move(work)]() mutable { impl_->wait(duration, std::move(work)); });
}

}  // namespace telefab::net
