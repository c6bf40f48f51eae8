// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/v1/client.pb.h>
#include <telefab/v1/fab.pb.h>

#include <telefab/wire/message.hpp>

namespace telefab::wire {

/// Which Protobuf message and frame type belong to a domain message.
template <class Value>
struct RowOf;

template <FrameType kType, class ProtoMessage>
struct Row {
  using Proto = ProtoMessage;
  static constexpr FrameType type = kType;
};

template <>
struct RowOf<Hello> : Row<FrameType::Hello, v1::Hello> {};
template <>
struct RowOf<Fault> : Row<FrameType::Fault, v1::Fault> {};
template <>
struct RowOf<Ping> : Row<FrameType::Ping, v1::Ping> {};
template <>
struct RowOf<Pong> : Row<FrameType::Pong, v1::Pong> {};
template <>
struct RowOf<AskMachines> : Row<FrameType::AskMachines, v1::AskMachines> {};
template <>
struct RowOf<Machines> : Row<FrameType::Machines, v1::Machines> {};
template <>
struct RowOf<Submit> : Row<FrameType::Submit, v1::Submit> {};
template <>
struct RowOf<UploadReady> : Row<FrameType::UploadReady, v1::UploadReady> {};
template <>
struct RowOf<UploadBlock> : Row<FrameType::UploadBlock, v1::UploadBlock> {};
template <>
struct RowOf<AskJobs> : Row<FrameType::AskJobs, v1::AskJobs> {};
template <>
struct RowOf<Jobs> : Row<FrameType::Jobs, v1::Jobs> {};
template <>
struct RowOf<Command> : Row<FrameType::Command, v1::Command> {};
template <>
struct RowOf<AskFiles> : Row<FrameType::AskFiles, v1::AskFiles> {};
template <>
struct RowOf<Files> : Row<FrameType::Files, v1::Files> {};
template <>
struct RowOf<AskFile> : Row<FrameType::AskFile, v1::AskFile> {};
template <>
struct RowOf<FileBlock> : Row<FrameType::FileBlock, v1::FileBlock> {};
template <>
struct RowOf<Offer> : Row<FrameType::Offer, v1::Offer> {};
template <>
struct RowOf<OfferAccepted> : Row<FrameType::OfferAccepted, v1::OfferAccepted> {};
template <>
struct RowOf<SendChunk> : Row<FrameType::SendChunk, v1::SendChunk> {};
template <>
struct RowOf<ChunkStored> : Row<FrameType::ChunkStored, v1::ChunkStored> {};
template <>
struct RowOf<StackEnd> : Row<FrameType::StackEnd, v1::StackEnd> {};
template <>
struct RowOf<StackStored> : Row<FrameType::StackStored, v1::StackStored> {};
template <>
struct RowOf<JobChanged> : Row<FrameType::JobChanged, v1::JobChanged> {};
template <>
struct RowOf<OfferDeferred> : Row<FrameType::OfferDeferred, v1::OfferDeferred> {};

}  // namespace telefab::wire
