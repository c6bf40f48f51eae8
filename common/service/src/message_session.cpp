// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/service/message_session.hpp>

namespace telefab {

void MessageSession::begin() {
  connection_->set_events({[self = shared_from_this()](const Frame& frame) { self->on_frame(frame); },
                           [self = shared_from_this()] { self->pump_files(); },
                           [self = shared_from_this()](const Error& why) { self->on_closed(why); }});
}

void MessageSession::on_frame(const Frame& frame) {
  const auto message = from_frame(frame);
  if (!message) return end(message.error());
  on_message(*message);
}

void MessageSession::on_closed(const Error& why) {
  if (why.code == ErrorCode::ProtocolBroken) return end(why);
  forget_all();
}

void MessageSession::end(const Error& why) {
  is_open_ = false;
  service_.note(peer().address, why.what);
  connection_->close(to_frame(Fault{{}, why, {}}));
  forget_all();
}

void MessageSession::forget_all() {
  is_open_ = false;
  downloads_.clear();
  on_end();
}

void MessageSession::send(const Message& message) {
  if (!is_open_) return;
  if (auto sent = connection_->send(to_frame(message)); !sent) end(sent.error());
}

void MessageSession::send_fault(RequestId request, const Error& error, const std::string& job) {
  send(Fault{request, error, job});
}

void MessageSession::refuse_message(std::string_view peer_kind) {
  end({ErrorCode::ProtocolBroken, fmt::format("message-order: a {} does not send this message", peer_kind)});
}

void MessageSession::carry_out(const Command& command) {
  service_.note(command.who, fmt::format("{} {}", name_of(command.command), command.job));
  service_.command(command, [weak = weak_from_this(), request = command.request, id = command.job](Result<Job> job) {
    const auto self = weak.lock();
    if (!self) return;
    if (job)
      self->send(Jobs{request, {std::move(*job)}});
    else
      self->send_fault(request, job.error(), id);
  });
}

void MessageSession::send_list(const AskFiles& question) {
  service_.files(question.job, [weak = weak_from_this(), question](Result<std::vector<FileEntry>> files) {
    const auto self = weak.lock();
    if (!self) return;
    if (files)
      self->send(Files{question.request, std::move(*files)});
    else
      self->send_fault(question.request, files.error(), question.job);
  });
}

void MessageSession::send_file(const AskFile& question) {
  service_.file(question.job, question.name, [weak = weak_from_this(), question](Result<std::filesystem::path> path) {
    const auto self = weak.lock();
    if (!self) return;
    if (!path) return self->send_fault(question.request, path.error(), question.job);
    if (auto added = self->downloads_.add(question.request, *path); !added)
      return self->send_fault(question.request, added.error(), question.job);
    self->pump_files();
  });
}

void MessageSession::pump_files() {
  if (is_open_) downloads_.pump(*connection_, [this](const Message& block) { send(block); });
}

}  // namespace telefab
