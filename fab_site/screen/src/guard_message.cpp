// SPDX-License-Identifier: GPL-3.0-or-later
#include "guard_message.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <cerrno>
#include <cstring>

namespace telefab::fab {

namespace {

union FileSpace {
  char bytes[CMSG_SPACE(sizeof(int))];
  cmsghdr align;
};

}  // namespace

template <class Packet>
bool send_packet(int socket, const Packet& packet, int file) {
  Packet copy = packet;
  iovec part{&copy, sizeof copy};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  FileSpace space{};
  if (file >= 0) {
    message.msg_control = space.bytes;
    message.msg_controllen = sizeof space.bytes;
    cmsghdr* head = CMSG_FIRSTHDR(&message);
    head->cmsg_level = SOL_SOCKET;
    head->cmsg_type = SCM_RIGHTS;
    head->cmsg_len = CMSG_LEN(sizeof file);
    std::memcpy(CMSG_DATA(head), &file, sizeof file);
  }
  while (true) {
    const ssize_t n = ::sendmsg(socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT);  // EAGAIN: the other end hangs
    if (n >= 0) return n == static_cast<ssize_t>(sizeof copy);
    if (errno != EINTR) return false;
  }
}

template <class Packet>
Result<std::optional<Packet>> receive_packet(int socket, Nanoseconds patience, OpenFile* file) {
  pollfd waited{socket, POLLIN, 0};
  const auto ms = std::chrono::ceil<std::chrono::milliseconds>(patience).count();
  const int ready = ::poll(&waited, 1, static_cast<int>(ms));
  if (ready <= 0) return std::optional<Packet>{};
  Packet packet;
  iovec part{&packet, sizeof packet};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  FileSpace space{};
  message.msg_control = space.bytes;
  message.msg_controllen = sizeof space.bytes;
  const ssize_t n = ::recvmsg(socket, &message, MSG_CMSG_CLOEXEC | MSG_DONTWAIT);
  if (n < 0 && (errno == EINTR || errno == EAGAIN)) return std::optional<Packet>{};
  if (n <= 0) return fail(ErrorCode::DeviceLost, "screen: the other end of its guard is gone");
  for (cmsghdr* head = CMSG_FIRSTHDR(&message); head != nullptr; head = CMSG_NXTHDR(&message, head)) {
    if (head->cmsg_level != SOL_SOCKET || head->cmsg_type != SCM_RIGHTS) continue;
    int number = -1;
    std::memcpy(&number, CMSG_DATA(head), sizeof number);
    OpenFile got{number};
    if (file != nullptr) *file = std::move(got);
  }
  if (n != static_cast<ssize_t>(sizeof packet))
    return fail(ErrorCode::ProtocolBroken, "screen: its guard is of another version");
  return std::optional<Packet>{packet};
}

template bool send_packet(int, const GuardRequest&, int);
template bool send_packet(int, const GuardReply&, int);
template Result<std::optional<GuardRequest>> receive_packet(int, Nanoseconds, OpenFile*);
template Result<std::optional<GuardReply>> receive_packet(int, Nanoseconds, OpenFile*);

}  // namespace telefab::fab
