// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "rows.hpp"

// Domain values to Protobuf, one overload a message.
namespace telefab::wire {

void write(const Hello& value, v1::Hello& proto);
void write(const Fault& value, v1::Fault& proto);
void write(const Ping& value, v1::Ping& proto);
void write(const Pong& value, v1::Pong& proto);
void write(const AskMachines& value, v1::AskMachines& proto);
void write(const Machines& value, v1::Machines& proto);
void write(const Submit& value, v1::Submit& proto);
void write(const UploadReady& value, v1::UploadReady& proto);
void write(const UploadBlock& value, v1::UploadBlock& proto);
void write(const AskJobs& value, v1::AskJobs& proto);
void write(const Jobs& value, v1::Jobs& proto);
void write(const Command& value, v1::Command& proto);
void write(const AskFiles& value, v1::AskFiles& proto);
void write(const Files& value, v1::Files& proto);
void write(const AskFile& value, v1::AskFile& proto);
void write(const FileBlock& value, v1::FileBlock& proto);
void write(const Offer& value, v1::Offer& proto);
void write(const OfferAccepted& value, v1::OfferAccepted& proto);
void write(const OfferDeferred& value, v1::OfferDeferred& proto);
void write(const SendChunk& value, v1::SendChunk& proto);
void write(const ChunkStored& value, v1::ChunkStored& proto);
void write(const StackEnd& value, v1::StackEnd& proto);
void write(const StackStored& value, v1::StackStored& proto);
void write(const JobChanged& value, v1::JobChanged& proto);

}  // namespace telefab::wire
