// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_client.hpp"

#include <fmt/format.h>
#include <telefab/base/version.hpp>

namespace telefab::client {
namespace {

constexpr auto kSlice = std::chrono::milliseconds{20};
constexpr std::size_t kQueueAheadBytes = 4U << 20U;

/// What a site refuses is no file of this machine: a name it does not know was the caller's, and what it does not
/// permit is a matter of certificates and roles.
ErrorCode code_here(ErrorCode at_site) {
  if (at_site == ErrorCode::NotFound) return ErrorCode::InvalidInput;
  if (at_site == ErrorCode::NotPermitted) return ErrorCode::NotTrusted;
  return at_site;
}

}  // namespace

template <class Ready>
bool SiteClient::run_until(Nanoseconds within, const Ready& ready) {
  const SystemClock clock;
  const Nanoseconds deadline = clock.now() + within;
  while (!ready()) {
    if (stop_.stop_requested() || clock.now() > deadline) return false;
    loop_.run_for(kSlice);
  }
  return true;
}

Result<std::unique_ptr<SiteClient>> SiteClient::connect(const SiteAddress& address, std::stop_token stop) {
  std::unique_ptr<SiteClient> client{new SiteClient{std::move(stop), address.answer_within}};
  if (auto opened = client->open(address); !opened) return tl::unexpected{opened.error()};
  return client;
}

SiteClient::~SiteClient() {
  if (!connection_) return;
  connection_->close({});
  loop_.run_for(std::chrono::milliseconds{1});
}

Result<void> SiteClient::open(const SiteAddress& address) {
  std::optional<Result<net::ConnectionPtr>> made;
  net::ConnectOptions options{address.endpoint, address.trust, {}, {}, address.connect_within};
  options.expected_name = address.expected_name;
  // A scan that is being sliced may keep the site's answer; its pings tell that it lives.
  options.limits.idle_after = std::chrono::seconds{120};
  net::connect_to(loop_, options, [&](Result<net::ConnectionPtr> outcome) {
    made = std::move(outcome);
    loop_.stop();
  });
  if (!run_until(address.connect_within * 2, [&] { return made.has_value(); }))
    return stop_.stop_requested()
               ? fail(ErrorCode::Cancelled, "cancelled")
               : fail(ErrorCode::Unreachable, fmt::format("no answer from {}", net::to_text(address.endpoint)));
  if (!*made) return tl::unexpected{made->error()};
  connection_ = std::move(**made);
  // Any operator has a certificate of the same authority; a site is something else.
  if (const auto role = connection_->peer().role; role && *role != net::Role::ScanSite && *role != net::Role::FabSite) {
    auto refused = fail(ErrorCode::NotTrusted,
                        fmt::format("{} shows the certificate of \"{}\", a {}, not of a site",
                                    net::to_text(address.endpoint), connection_->peer().name, net::name_of(*role)));
    std::exchange(connection_, {})->close({});
    return refused;
  }
  connection_->start({[this](Frame frame) {
                        received_.push_back(std::move(frame));
                        loop_.stop();
                      },
                      [this] { loop_.stop(); },
                      [this](const Error& why) {
                        lost_ = why;
                        loop_.stop();
                      }});
  auto hello = ask<Hello>(Hello{kProtocolVersion, Side::Client, fmt::format("telefab {}", kVersion), {}, {}});
  if (!hello) return fail_in(net::to_text(address.endpoint), hello.error());
  if (hello->protocol_version != kProtocolVersion)
    return fail(ErrorCode::ProtocolBroken,
                fmt::format("{} speaks protocol version {}, this program {}", net::to_text(address.endpoint),
                            hello->protocol_version, kProtocolVersion));
  connection_->set_ready();
  return {};
}

Result<void> SiteClient::send(const Message& message) {
  if (!lost_) {
    if (auto sent = connection_->send(to_frame(message)); !sent && !lost_) return sent;
    (void)run_until(answer_within_, [&] { return lost_ || connection_->queued_bytes() < kQueueAheadBytes; });
  }
  if (stop_.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled");
  // A fault that explains the loss may have been received before it; receive() tells.
  return {};
}

Result<Message> SiteClient::receive(Nanoseconds within) {
  auto received = receive_within(within);
  if (!received) return tl::unexpected{received.error()};
  if (!*received) return fail(ErrorCode::Unreachable, "the site did not answer in time");
  return std::move(**received);
}

Result<std::optional<Message>> SiteClient::receive_within(Nanoseconds within) {
  if (!run_until(within, [&] { return lost_ || !received_.empty(); })) {
    if (stop_.stop_requested()) return fail(ErrorCode::Cancelled, "cancelled");
    return std::optional<Message>{};
  }
  if (received_.empty()) return tl::unexpected{*lost_};
  const Frame frame = std::move(received_.front());
  received_.pop_front();
  auto message = from_frame(frame);
  if (!message) return tl::unexpected{message.error()};
  if (const auto* fault = std::get_if<Fault>(&*message)) {
    return fail(code_here(fault->error.code), fault->error.what);
  }
  return std::optional{std::move(*message)};
}

}  // namespace telefab::client
