// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <memory>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/whole_printer.hpp>
#include <telefab/fab/lan/printer_server.hpp>
#include <vector>

namespace telefab::fab {

/// What a simulated SDCP printer does wrong. "Once": at one interaction; else until repair().
enum class SdcpFault : std::uint8_t {
  None,
  WrongModel,
  WrongResolution,
  WrongFormat,  ///< it takes CTB files alone
  FullStorage,
  CutUpload,       ///< hangs up on parts
  LostOffset,      ///< once: forgets its place in the upload
  BadChecksum,     ///< once: the file arrives damaged
  LostSocket,      ///< once: hangs up instead of doing what it is asked
  LostAnswer,      ///< once: does it, and hangs up instead of answering
  NoAnswer,        ///< once: does it, and keeps silent
  Busy,            ///< somebody prints at its panel
  Silent,          ///< does nothing and answers nothing
  OtherTask,       ///< once: somebody stops the print at the panel and starts another one
  TooManyClients,  ///< hangs up and lets nobody in
  Reboots,         ///< once: forgets its task and hangs up
};
inline constexpr std::size_t kSdcpFaults = 16;
/// "none", "wrong-model", ...
[[nodiscard]] std::string_view name_of(SdcpFault fault);
/// Nothing: no fault has that name.
[[nodiscard]] std::optional<SdcpFault> sdcp_fault_from_name(std::string_view name);

/// When a fault begins to act, where that is not a number of interactions.
enum class SdcpMoment : std::uint8_t {
  Upload,  ///< with the first part of a file
  Start,   ///< with the question to start a print
  Watch,   ///< with the first question while it prints
};

struct SdcpModelOptions {
  std::string name = "simulated printer";
  std::string model = "ELEGOO Saturn 3 Ultra";
  std::string id = "000000000001d354";
  PixelSize size{11520, 5120};
  std::uint64_t storage_bytes = 4ULL << 30U;
  Nanoseconds layer_time = std::chrono::seconds{5};
  std::size_t most_clients = 4;
};

/// A strict printer after the protocol's document: it keeps silent on what the document does not allow and remembers it
/// (violations), refuses what a real one refuses, checks sums, offsets, resolution, format and model of GOO files, and
/// prints by the clock. Light is counted: layers of each task.
class SdcpModel final : public PrinterPeer {
 public:
  SdcpModel(SdcpModelOptions options, Clock& clock);
  ~SdcpModel() override;

  /// From the n-th interaction on (messages, parts of uploads and connections, counted from 0).
  void inject(SdcpFault fault, std::size_t at);
  void inject_when(SdcpFault fault, SdcpMoment moment);
  /// Ends a fault that lasts; somebody's print at the panel is over.
  void repair();

  [[nodiscard]] std::size_t interactions() const;
  /// How often a print of that file was begun.
  [[nodiscard]] std::size_t starts_of(const std::string& file) const;
  /// Of all files.
  [[nodiscard]] std::size_t starts() const;
  /// Layers exposed for that file, over all of its prints.
  [[nodiscard]] std::size_t layers_of(const std::string& file);
  /// Bytes of a stored file; empty: there is none.
  [[nodiscard]] const std::string& stored(const std::string& file) const;
  [[nodiscard]] const std::vector<std::string>& violations() const;

  [[nodiscard]] std::optional<std::string> on_datagram(std::string_view text) override;
  [[nodiscard]] bool lets_in(std::size_t clients) override;
  [[nodiscard]] PeerAnswer on_message(std::string_view text) override;
  [[nodiscard]] std::optional<HttpReply> on_post(std::string_view path, std::string_view content_type,
                                                 std::string_view body) override;
  [[nodiscard]] std::vector<std::string> pushed() override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// A network in which that printer is the only one, without sockets; waiting passes time on the clock. Both must
/// outlive it.
[[nodiscard]] std::unique_ptr<PrinterNetwork> model_network(PrinterPeer& peer, Clock& clock);

}  // namespace telefab::fab
