// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/fab/mask/mask.hpp>
#include <vector>

namespace telefab::fab {

/// What a printer that owns its light is; as it was when it was asked last.
struct WholePrinterFacts {
  std::string name;   ///< its owner's name for it
  std::string model;  ///< as its firmware compares it
  std::string firmware;
  std::string id;  ///< of its board; one printer keeps it
  std::string address;
  PixelSize size;                       ///< of its panel; 0 x 0: not stated
  std::vector<std::string> file_kinds;  ///< in upper case: "GOO", "CTB"
  std::optional<std::uint64_t> free_bytes;
  bool takes_files = false;  ///< over this line
  bool takes_orders = false;
};

/// What it does. More than one thing at a time may be true.
struct PrinterActivity {
  bool prints = false;
  bool receives = false;
  bool tests = false;  ///< exposure test, self-test
  [[nodiscard]] bool is_idle() const { return !prints && !receives && !tests; }
};

/// Where a task is. What a printer said last about a task it keeps saying until the next one begins.
enum class TaskState : std::uint8_t {
  None,
  Checking,
  Homing,
  Lowering,
  Exposing,
  Lifting,
  Pausing,
  Paused,
  Stopping,
  Stopped,
  Complete,
  Unknown,  ///< a number that no document names
};
[[nodiscard]] std::string_view name_of(TaskState state);

/// Why a printer refuses or has stopped.
enum class PrinterProblem : std::uint8_t {
  None,
  Busy,
  FileNotFound,
  FileDamaged,  ///< its checksum does not hold
  FileUnreadable,
  WrongResolution,
  WrongFormat,
  WrongModel,
  StorageFull,
  Temperature,
  Resin,        ///< too little, too much, or its feeder
  ForeignBody,  ///< or a model left on the platform
  Levelling,
  Detached,  ///< the part fell off, or warps
  ForceSensor,
  Display,
  Film,
  StorageRemoved,
  Motor,  ///< homing or motion
  Other,
};
/// "wrong-model", ...
[[nodiscard]] std::string_view name_of(PrinterProblem problem);
/// What it means and what to do, for people.
[[nodiscard]] std::string_view advice_on(PrinterProblem problem);

struct PrinterTask {
  std::string id;    ///< made by the printer when it starts; empty: it has had none
  std::string file;  ///< without folders
  TaskState state = TaskState::None;
  std::uint32_t layer = 0;
  std::uint32_t layers = 0;
  std::chrono::milliseconds elapsed{0};
  std::chrono::milliseconds estimated{0};
  PrinterProblem problem = PrinterProblem::None;
};

struct WholePrinterStatus {
  PrinterActivity activity;
  PrinterTask task;  ///< the running one, else the last
};

/// A file for a printer. `read` gives so many bytes from an offset on.
struct PrinterUpload {
  std::string name;  ///< on the printer; no folders
  std::uint64_t bytes = 0;
  std::string md5;  ///< of all of it, lower-case hexadecimal
  std::function<Result<std::vector<std::byte>>(std::uint64_t offset, std::size_t count)> read;
};

struct UploadStep {
  std::uint64_t sent_bytes = 0;
  bool is_done = false;                           ///< and the printer has checked it
  PrinterProblem problem = PrinterProblem::None;  ///< the upload is over and nothing is kept
};

/// A printer that owns light, stage and file; the third role beside Projector and ZStage. Its light is its own: this
/// side can ask it to pause or stop and cannot make it dark. Nothing is switched on by construction, and a print that
/// runs goes on after destruction. Threads: one caller at a time. Every call is bounded in time and connects again
/// where it must.
class WholePrinter {
 public:
  virtual ~WholePrinter() = default;
  WholePrinter(const WholePrinter&) = delete;
  WholePrinter& operator=(const WholePrinter&) = delete;

  /// Asks what it is. Unreachable, DeviceRefused (too many clients), DeviceTimeout, DeviceLost, ProtocolBroken,
  /// NotTrusted (another printer answers there).
  [[nodiscard]] virtual Result<WholePrinterFacts> facts() = 0;
  /// Asks what it does. Fails as facts().
  [[nodiscard]] virtual Result<WholePrinterStatus> status() = 0;
  /// What it remembers of a task of its own: file, state (Complete, Stopped or Unknown), layer, problem. Nothing: it
  /// does not know it. Fails as facts().
  [[nodiscard]] virtual Result<std::optional<PrinterTask>> task(std::string_view id) = 0;
  /// Begins to send a file; one that was begun before is given up.
  [[nodiscard]] virtual Result<void> begin_upload(const PrinterUpload& file) = 0;
  /// Sends the next part, or waits a moment for the printer's check. After an error the upload is over: begin again.
  /// Fails as facts(), and as the file's read; Conflict: none was begun.
  [[nodiscard]] virtual Result<UploadStep> send_part() = 0;
  /// Gives an upload up; nothing where there is none.
  [[nodiscard]] virtual Result<void> end_upload() = 0;
  /// Asks it to start a file. None: it said yes. DeviceTimeout, DeviceLost: nobody knows whether it starts. Any other
  /// error: the question was never asked.
  [[nodiscard]] virtual Result<PrinterProblem> start(std::string_view file) = 0;
  /// Ask the same of the print under way; None: it said yes.
  [[nodiscard]] virtual Result<PrinterProblem> pause() = 0;
  [[nodiscard]] virtual Result<PrinterProblem> resume() = 0;
  [[nodiscard]] virtual Result<PrinterProblem> stop() = 0;

 protected:
  WholePrinter() = default;
};

}  // namespace telefab::fab
