// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>

#include "rows.hpp"

// Protobuf to domain values, one overload a message; every limit of message.hpp is checked.
namespace telefab::wire {

/// The first fault found; empty while all is well.
struct Reading {
  std::optional<std::string> fault;
};

void read(Reading& reading, const v1::Hello& proto, Hello& value);
void read(Reading& reading, const v1::Fault& proto, Fault& value);
void read(Reading& reading, const v1::Ping& proto, Ping& value);
void read(Reading& reading, const v1::Pong& proto, Pong& value);
void read(Reading& reading, const v1::AskMachines& proto, AskMachines& value);
void read(Reading& reading, const v1::Machines& proto, Machines& value);
void read(Reading& reading, const v1::Submit& proto, Submit& value);
void read(Reading& reading, const v1::UploadReady& proto, UploadReady& value);
void read(Reading& reading, const v1::UploadBlock& proto, UploadBlock& value);
void read(Reading& reading, const v1::AskJobs& proto, AskJobs& value);
void read(Reading& reading, const v1::Jobs& proto, Jobs& value);
void read(Reading& reading, const v1::Command& proto, Command& value);
void read(Reading& reading, const v1::AskFiles& proto, AskFiles& value);
void read(Reading& reading, const v1::Files& proto, Files& value);
void read(Reading& reading, const v1::AskFile& proto, AskFile& value);
void read(Reading& reading, const v1::FileBlock& proto, FileBlock& value);
void read(Reading& reading, const v1::Offer& proto, Offer& value);
void read(Reading& reading, const v1::OfferAccepted& proto, OfferAccepted& value);
void read(Reading& reading, const v1::OfferDeferred& proto, OfferDeferred& value);
void read(Reading& reading, const v1::SendChunk& proto, SendChunk& value);
void read(Reading& reading, const v1::ChunkStored& proto, ChunkStored& value);
void read(Reading& reading, const v1::StackEnd& proto, StackEnd& value);
void read(Reading& reading, const v1::StackStored& proto, StackStored& value);
void read(Reading& reading, const v1::JobChanged& proto, JobChanged& value);

}  // namespace telefab::wire
