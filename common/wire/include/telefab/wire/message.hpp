// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <optional>
#include <telefab/base/digest.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/job/job.hpp>
#include <telefab/job/machine_status.hpp>
#include <telefab/wire/frame.hpp>
#include <variant>

// The messages of both conversations as checked domain values: what from_frame returns keeps the limits below, so no
// reader has to look again. Who says what to whom is in proto/README.md.
namespace telefab {

inline constexpr std::uint32_t kProtocolVersion = 8;
inline constexpr std::size_t kMaxNameBytes = 255;   ///< names of scans, files, machines, people
inline constexpr std::size_t kMaxTextBytes = 4096;  ///< reasons and messages; longer ones are cut
inline constexpr std::size_t kMaxParametersBytes = 16U << 10U;
inline constexpr std::size_t kMaxProfiles = 256;           ///< of machines, of resins and of prints
inline constexpr std::size_t kMaxMachines = kMaxProfiles;  ///< that stand in a fab
inline constexpr std::size_t kMaxJobsListed = 1000;
inline constexpr std::uint64_t kMaxScanBytes = 8ULL << 30U;
inline constexpr std::size_t kMaxBlockBytes = 1U << 20U;  ///< of an upload or a file
inline constexpr std::size_t kMaxChunkBytes = 3U << 20U;

/// Codings of chunks that this version reads, by their numbers (codec/stack_codec.hpp).
inline constexpr std::uint32_t kFirstCoding = 5, kLastCoding = 8;

enum class Side : std::uint8_t { Client = 1, ScanSite = 2, FabSite = 3 };
/// Names one question on one connection; answers carry it back. 0 asks nothing.
enum class RequestId : std::uint64_t {};

struct Hello {
  std::uint32_t protocol_version = kProtocolVersion;
  Side side = Side::Client;
  std::string program;
  std::vector<std::string> machine_toml;  ///< the fab's profiles
  std::string start_policy;               ///< the fab's: "automatic" or "on-approval"
  std::vector<std::string> resin_toml = {};
  std::vector<std::string> print_toml = {};
  bool answers_machines = false;  ///< the fab answers AskMachines of a scan site too
};
struct Fault {
  RequestId request{};
  Error error;
  std::string job;  ///< empty: about the connection
};
struct Ping {};
struct Pong {};

struct AskMachines {
  RequestId request{};
};
struct Machines {
  RequestId request{};
  std::vector<std::string> machine_toml;
  std::string origin;
  std::vector<std::string> resin_toml = {};
  std::vector<std::string> print_toml = {};
  std::vector<MachineStatus> standing = {};  ///< what stands in the fab; none where it is not known
  std::string why_unknown = {};              ///< why it is not, for people
};
struct Submit {
  RequestId request{};
  std::string name;
  std::string machine;
  std::string parameters;
  std::uint64_t size_bytes = 0;
  Digest content;
};
struct UploadReady {
  RequestId request{};
  std::uint64_t offset_bytes = 0;
};
struct UploadBlock {
  RequestId request{};
  std::uint64_t offset_bytes = 0;
  std::vector<std::byte> content;
};
struct AskJobs {
  RequestId request{};
  std::string job;  ///< empty: all
  std::uint32_t most = 100;
  bool watch = false;
  std::string words = {};  ///< this and what follows: as in JobQuery, where all are asked for
  std::vector<JobState> states = {};
  std::uint64_t before = 0;
};
struct Jobs {
  RequestId request{};
  std::vector<Job> jobs;
  std::uint64_t next = 0;  ///< as in JobPage
};
struct Command {
  RequestId request{};
  std::string job;  ///< Cleared: the machine
  JobCommand command = JobCommand::Pause;
  std::string who;
  std::string although;  ///< Approve only: names of what holds the job and is let through, separated by commas
};
struct AskFiles {
  RequestId request{};
  std::string job;
};
struct FileEntry {
  std::string name;
  std::uint64_t size_bytes = 0;
};
struct Files {
  RequestId request{};
  std::vector<FileEntry> files;
};
struct AskFile {
  RequestId request{};
  std::string job;
  std::string name;
};
struct FileBlock {
  RequestId request{};
  std::uint64_t offset_bytes = 0;
  std::uint64_t size_bytes = 0;  ///< of the whole file
  std::vector<std::byte> content;
};

struct Offer {
  std::string job;
  std::string name;
  std::string machine;
  std::string parameters;
  Digest profile;  ///< of the TOML text of the profile it was sliced for
  StackHeader header;
  std::uint32_t coding = 0;
  std::string owner;
  std::vector<std::byte> public_key;
  std::vector<std::byte> signature;
  Digest scan{};                   ///< of the scan file it was cut from; zero: not stated
  double registration_rms_mm = 0;  ///< of the views the scan was put together from, as printed; 0: not stated
  std::uint32_t attempt = 0;       ///< of the fleet to have the job printed, from 1 on; 0: it is no job of a fleet
};
struct OfferAccepted {
  std::string job;
  std::uint32_t next_sequence = 0;
  bool complete = false;
};
/// Why an offered job is put off. Numbers cross the wire: never renumber.
enum class DeferReason : std::uint8_t {
  Busy = 1,          ///< the fab holds as many jobs as it takes from one site
  Full = 2,          ///< its disk has no room for the job now
  StorageFault = 3,  ///< its disk could not be read or written
};
/// "busy", "full", "storage-fault".
[[nodiscard]] std::string_view name_of(DeferReason reason);

/// The answer "later" to an offer, or to a chunk or end that could not be stored; "never" is a Fault.
struct OfferDeferred {
  std::string job;
  DeferReason reason{};
  std::chrono::milliseconds retry_after{};  ///< at most kLongestDeferral
  std::string what;
};
inline constexpr std::chrono::milliseconds kLongestDeferral = std::chrono::hours{1};

struct SendChunk {
  std::string job;
  std::uint32_t sequence = 0;
  LayerIndex first_layer;
  std::uint32_t layer_count = 0;
  std::vector<std::byte> payload;
  Digest chain;
};
struct ChunkStored {
  std::string job;
  std::uint32_t sequence = 0;
};
struct StackEnd {
  std::string job;
  std::uint32_t chunk_count = 0;
  Digest chain;
  Digest stack;
  std::vector<std::byte> signature;
};
struct StackStored {
  std::string job;
};
struct JobChanged {
  Job job;
};

using Message = std::variant<Hello, Fault, Ping, Pong, AskMachines, Machines, Submit, UploadReady, UploadBlock, AskJobs,
                             Jobs, Command, AskFiles, Files, AskFile, FileBlock, Offer, OfferAccepted, SendChunk,
                             ChunkStored, StackEnd, StackStored, JobChanged, OfferDeferred>;

/// A job's name on the wire and in the file system: 1 to 64 of a-z, 0-9 and '-', so it is safe as a folder.
[[nodiscard]] bool is_job_id(std::string_view text);

/// The id under which a fab is offered an attempt of a fleet's job: the job's own for the first one, JOB-aN for attempt
/// N. Every attempt is a job of its own there. `attempt` >= 1.
[[nodiscard]] std::string id_of_attempt(std::string_view fleet_job, std::uint32_t attempt);
/// The fleet's job of an offered id. Nothing: no job of a fleet is offered so in that attempt, or `attempt` is 0.
[[nodiscard]] std::optional<std::string> fleet_job_of(std::string_view offered, std::uint32_t attempt);

/// Never fails for values within the limits above.
[[nodiscard]] Frame to_frame(const Message& message);
/// Fails with ProtocolBroken and names message and field; every limit above holds for what comes back.
[[nodiscard]] Result<Message> from_frame(const Frame& frame);

}  // namespace telefab
