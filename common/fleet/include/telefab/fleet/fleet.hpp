// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

// Machines of several fabs and the jobs that wait for one of them. Plain values: who keeps them is FleetQueue's matter.
namespace telefab::fleet {

/// A fab of the fleet, as it announces itself.
struct Fab {
  std::string name;         ///< 1 to 64 of a-z, 0-9 and -
  std::string address;      ///< HOST:PORT at which scan sites bring layers
  std::string certificate;  ///< name that its certificate vouches for; empty: the host of the address
  std::string catalogue;    ///< its profiles, for scan sites: JSON as the wire's Machines has them
  friend bool operator==(const Fab&, const Fab&) = default;
};

/// What a machine is at, as far as new jobs go. Numbers go to the database: never renumber.
enum class Readiness : std::uint8_t {
  Free = 1,
  Busy = 2,      ///< prints, or holds a print that waits for somebody
  Occupied = 3,  ///< a part is on its platform
  Trouble = 4,   ///< at fault, or not found
};

/// A machine of the fleet. What its fab says of it, and whether an administrator takes it out of service.
struct Machine {
  std::string name;     ///< of its own in the whole fleet: 1 to 64 of a-z, 0-9 and -
  std::string fab;      ///< where it stands
  std::string profile;  ///< its class
  std::string light;    ///< digest of the light it prints with, hexadecimal: what is cut for one of it is for all
  std::string resin;    ///< loaded
  double width_mm = 0, depth_mm = 0, height_mm = 0;  ///< of the largest part
  double pixel_mm = 0;
  std::int64_t calibrated_unix_ms = 0;  ///< 0: never
  Readiness readiness = Readiness::Free;
  bool is_draining = false;       ///< gets no new job
  std::int64_t seen_unix_ms = 0;  ///< when its fab announced it last, by the clock of the queue
  friend bool operator==(const Machine&, const Machine&) = default;
};

/// What a job asks of its machine.
struct Needs {
  std::string machine;                               ///< one by name, or any of a class; empty: any
  std::string light;                                 ///< that it was cut for; empty: not cut yet
  std::string resin;                                 ///< empty: any
  double width_mm = 0, depth_mm = 0, height_mm = 0;  ///< of the part
  double pixel_mm = 0;                               ///< at most; 0: any
  std::int64_t calibrated_within_ms = 0;             ///< the machine was, before now; 0: need not be
  friend bool operator==(const Needs&, const Needs&) = default;
};

/// Where a job of the fleet is. Numbers go to the database: never renumber.
enum class State : std::uint8_t {
  Waiting = 1,  ///< for a machine
  Claimed = 2,  ///< a fab has it for one of its machines, and nothing of it is lit
  Bound = 3,    ///< a layer is lit, or may be: it is that machine's, whatever becomes of it
  Asking = 4,   ///< bound, and its fab is not heard of any more: somebody decides
  Done = 5,
  Failed = 6,
  Cancelled = 7,
};
/// "waiting", "claimed", "bound", "asking", "done", "failed", "cancelled".
[[nodiscard]] std::string_view name_of(State state);
/// Those of a job that is not at its end.
inline constexpr std::array kOpenStates{State::Waiting, State::Claimed, State::Bound, State::Asking};
/// Done, Failed and Cancelled.
[[nodiscard]] bool is_final(State state);

struct NewJob {
  std::string id;    ///< as the scan site's job: 1 to 60 of a-z, 0-9 and -
  std::string name;  ///< file name of the scan
  std::string owner;
  std::string site;  ///< scan site that brings its layers
  Needs needs;
  int priority = 0;                   ///< larger ones first
  std::int64_t deadline_unix_ms = 0;  ///< 0: none; of one priority the nearest first, those without one last
  std::uint32_t copies = 1;           ///< 1 to 1000; each is a job of its own: ID, ID-c2, ID-c3
  std::string stack_key;              ///< of what is printed: the same key, the same layers
};

struct Job {
  std::string id;
  std::string name;
  std::string owner;
  std::string site;
  Needs needs;
  int priority = 0;
  std::int64_t deadline_unix_ms = 0;
  std::string stack_key;
  std::uint64_t place = 0;  ///< in the order of submission
  State state = State::Waiting;
  std::uint32_t attempt = 0;       ///< grows with each claim; 0: none yet
  std::string machine;             ///< that has it, or had it last; empty: none yet
  std::string message;             ///< for people; may be empty
  std::int64_t until_unix_ms = 0;  ///< when its lease ends unless renewed; Claimed and Bound only
  friend bool operator==(const Job&, const Job&) = default;
};

/// A machine has a job for a while; whoever shows its attempt and no other may go on with it.
struct Lease {
  std::string job;
  std::string machine;
  std::uint32_t attempt = 0;
  std::int64_t left_ms = 0;  ///< from when it was given or renewed
  bool is_bound = false;
};

/// Something that happened to a job or a machine, for whoever watches.
struct Event {
  std::uint64_t number = 0;  ///< rises by one an event of the fleet
  std::int64_t unix_ms = 0;
  std::string job;  ///< empty: of a machine
  std::string machine;
  std::string text;
};

// ---- placing -------------------------------------------------------------------------------------------------------

/// Why a job does not go on a machine now; of several the first.
enum class WhyNot : std::uint8_t {
  Fits,          ///< nothing is against it
  Ended,         ///< the job is at its end
  HasMachine,    ///< the job has a machine
  OtherMachine,  ///< it asks for another
  OtherLight,    ///< it was cut for other light
  OtherResin,
  TooLarge,  ///< the part, for the machine
  CoarserPixel,
  CalibratedTooLongAgo,
  Draining,
  NotSeen,        ///< its fab was not heard of for kNotSeen_ms
  NotFree,        ///< busy, occupied or in trouble
  LaterInOrder,   ///< another job comes before it
  GoesElsewhere,  ///< another machine takes it
};
inline constexpr std::int64_t kNotSeen_ms = 60'000;
/// Whether the machine's fab was heard of within that.
[[nodiscard]] bool is_seen(const Machine& machine, std::int64_t now_unix_ms);

/// What is against one job on one machine, whatever the others are.
[[nodiscard]] WhyNot why_not(const Job& job, const Machine& machine, std::int64_t now_unix_ms);
/// Whether job `a` is served before `b`: priority, deadline, place.
[[nodiscard]] bool is_before(const Job& a, const Job& b);

struct Placed {
  std::string job;
  std::string machine;
  friend bool operator==(const Placed&, const Placed&) = default;
};
/// What the free machines would claim, each in the order of its name the first job that fits it: a dry run.
[[nodiscard]] std::vector<Placed> place(const std::vector<Job>& jobs, std::vector<Machine> machines,
                                        std::int64_t now_unix_ms);

/// What keeps a job off each of the machines, in their order, with the others as they are: as place() has it. Fits only
/// of the machine that takes it now. `jobs`: all that wait, in any order.
[[nodiscard]] std::vector<WhyNot> why_nots(const Job& job, const std::vector<Job>& jobs,
                                           const std::vector<Machine>& machines, std::int64_t now_unix_ms);

}  // namespace telefab::fleet
