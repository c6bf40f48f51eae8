// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string_view>
#include <telefab/fab/device/whole_printer.hpp>

// Numbers of SDCP v3.0.0 (Shenzhen CBD Technology, English edition, June 2024), which the driver and its model share.
namespace telefab::fab::sdcp {

inline constexpr std::string_view kQuestion = "M99999";
inline constexpr std::string_view kSocketPath = "/websocket";
inline constexpr std::string_view kUploadPath = "/uploadFile/upload";
inline constexpr std::size_t kPartBytes = 1U << 20U;

enum Command : std::int64_t {
  kStatus = 0,
  kAttributes = 1,
  kStart = 128,
  kPause = 129,
  kStop = 130,
  kContinue = 131,
  kEndTransfer = 255,
  kTaskDetails = 321,
};
enum MachineStatus : std::int64_t { kIdle = 0, kPrinting = 1, kTransferring = 2, kExposureTest = 3, kSelfTest = 4 };
/// TaskStatus of a task's details.
enum TaskStatus : std::int64_t { kTaskOther = 0, kTaskComplete = 1, kTaskFailed = 2, kTaskStopped = 3 };
enum UploadError : std::int64_t { kOffsetNegative = -1, kOffsetDiffers = -2, kCannotOpen = -3, kUploadFailed = -4 };
enum PushedError : std::int64_t { kMd5Failed = 1, kFormatFailed = 2 };

/// PrintInfo.Status.
[[nodiscard]] TaskState task_state_of(std::int64_t number);
[[nodiscard]] std::int64_t number_of(TaskState state);
/// Ack of commands 128 to 131; 0: none.
[[nodiscard]] PrinterProblem problem_of_ack(std::int64_t ack);
/// PrintInfo.ErrorNumber; 0: none.
[[nodiscard]] PrinterProblem problem_of_error(std::int64_t number);
/// ErrorStatusReason of a task; 0: none.
[[nodiscard]] PrinterProblem problem_of_reason(std::int64_t reason);

}  // namespace telefab::fab::sdcp
