// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/service/client_session.hpp>

namespace telefab {
namespace {

Result<Hello> check(const Frame& frame, const net::Peer& peer) {
  if (frame.type != FrameType::Hello)
    return fail(ErrorCode::ProtocolBroken, "handshake: the first message is not a hello");
  auto message = from_frame(frame);
  if (!message) return tl::unexpected{message.error()};
  Hello hello = std::get<Hello>(std::move(*message));
  if (hello.protocol_version != kProtocolVersion)
    return fail(
        ErrorCode::ProtocolBroken,
        fmt::format("protocol-version: this side speaks version {}, the other one {}; bring both to the same release",
                    kProtocolVersion, hello.protocol_version));
  if (hello.side == Side::FabSite)
    return fail(ErrorCode::ProtocolBroken, "handshake: a fab site does not call; scan sites and clients call it");
  if (peer.role) {
    const bool is_client_role = *peer.role == net::Role::Operator || *peer.role == net::Role::ReadOnly;
    if ((hello.side == Side::Client && !is_client_role) ||
        (hello.side == Side::ScanSite && *peer.role != net::Role::ScanSite))
      return fail(ErrorCode::NotTrusted, fmt::format("wrong-role: the certificate of \"{}\" is that of a {}", peer.name,
                                                     net::name_of(*peer.role)));
  }
  return hello;
}

}  // namespace

void handshake(net::Loop&, const net::ConnectionPtr& connection, Hello own, std::function<void(const Hello&)> on_ready,
               std::function<void(const Error&)> refused) {
  // The events belong to the connection, so they may hold it only weakly.
  const std::weak_ptr<net::Connection> weak = connection;
  net::ConnectionEvents events;
  events.frame = [weak, own = std::move(own), on_ready = std::move(on_ready), refused](const Frame& frame) {
    const auto strong = weak.lock();
    if (!strong) return;
    const auto hello = check(frame, strong->peer());
    if (!hello) {
      strong->close(to_frame(Fault{{}, hello.error(), {}}));
      return refused(hello.error());
    }
    strong->set_ready();
    if (auto sent = strong->send(to_frame(own)); !sent) {
      strong->close({});
      return refused(sent.error());
    }
    on_ready(*hello);
  };
  events.closed = [weak, refused](const Error& why) {
    if (const auto strong = weak.lock(); strong && why.code == ErrorCode::ProtocolBroken)
      strong->close(to_frame(Fault{{}, why, {}}));
    refused(why);
  };
  connection->start(std::move(events));
}

}  // namespace telefab
