// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace telefab::fab {

// Which waiting job goes on which machine of the fab, and nothing else decides. Pure: what it is told is all it knows.

/// What is wrong with a machine since its last print.
enum class MachineTrouble : std::uint8_t {
  None,
  Fault,  ///< the print broke off
  Lost,   ///< its devices were not found
};

/// What a machine is at, for people and for whoever looks at one machine alone.
enum class MachineStanding : std::uint8_t {
  Idle,
  Occupied,  ///< a part is on its platform, and somebody must say that it was taken off
  Printing,  ///< a job is on it, or about to be
  Paused,    ///< a print that began on it waits for an operator
  Fault,     ///< as Paused, after a fault
  Offline,   ///< its devices were not found when it was tried last, or are out of reach just now
};

/// Why a job waits, from what would end it soonest to what nothing but a change of the fab ends.
enum class WaitReason : std::uint8_t {
  Busy,       ///< a machine prints another job
  Platform,   ///< a machine is free but for the part on its platform
  Held,       ///< a machine holds a print that waits for an operator
  Trouble,    ///< a machine is at fault or offline
  NoMachine,  ///< no machine fits
};

/// Whether a job also takes a machine that is in trouble, where all that fit it are.
enum class InTrouble : std::uint8_t {
  Waits,
  Tries,  ///< an operator wants it tried
};

/// A machine of the fab as the queue knows it.
struct QueuedMachine {
  std::string name;
  bool needs_clearing = false;  ///< a part on its platform keeps other jobs off it
};

/// A job goes on a machine now.
struct Assignment {
  std::string job;
  std::size_t machine = 0;
  friend bool operator==(const Assignment&, const Assignment&) = default;
};

/// Why a job waits, and the first of its machines of which that is so.
struct Wait {
  WaitReason reason = WaitReason::NoMachine;
  std::optional<std::size_t> machine;  ///< none: NoMachine
  friend bool operator==(const Wait&, const Wait&) = default;
};

/// The jobs of a fab that may print, and its machines. Jobs are served in the order in which they came; a job gets the
/// first machine, in the order of the fab's list, that fits it and is free. A machine in trouble is left alone until
/// the job it came from has ended, or an operator wants it tried. A print that has begun goes on where it began, and
/// nothing else goes there before it has ended. Invariant: a machine has at most one job, a job is at one machine or
/// waits, and never both; a part is made on one machine alone.
class MachineQueue {
 public:
  explicit MachineQueue(std::vector<QueuedMachine> machines);

  [[nodiscard]] const std::vector<QueuedMachine>& machines() const { return machines_; }
  [[nodiscard]] std::optional<std::size_t> find(std::string_view machine) const;

  /// The job may print: it waits for one of the machines that fit, given by their places in any order. One that waits
  /// already keeps its place, with these machines; one that is at a machine stays there. Of one that has begun only the
  /// machine where it began counts.
  void add(const std::string& job, const std::vector<std::size_t>& fits, InTrouble in_trouble = InTrouble::Waits);
  /// The job no longer waits. What it has begun stays where it is.
  void drop(const std::string& job);

  /// Every job that gets a machine now, in order; each is at its machine from then on.
  [[nodiscard]] std::vector<Assignment> assign();

  /// A part of the job is made, or perhaps made, on that machine: nothing else goes there before the job has ended.
  /// Also of a print that began before the fab was started. A job that began elsewhere is not moved.
  void begin(const std::string& job, std::size_t machine);
  /// Nothing of the job was made after all: any machine that fits may have it.
  void forget_begun(const std::string& job);
  /// The job at the machine has stopped there, and may come again. `trouble`: of the machine.
  void release(const std::string& job, MachineTrouble trouble);
  /// The job is at its end: it neither waits nor holds a machine. Its part may still be on the platform.
  void end(const std::string& job);
  /// The print at its machine waits for an operator, or goes on.
  void set_paused(const std::string& job, bool is_paused);
  /// The print at its machine goes on there, out of reach, or is seen again.
  void set_lost(const std::string& job, bool is_lost);
  /// A machine that no job is at was not found, or is there again.
  void set_found(std::size_t machine, bool is_found);
  /// Whose part is on the platform of a machine; none: it is empty.
  void set_part(std::size_t machine, std::optional<std::string> job);
  /// Somebody has looked after the machine.
  void forget_trouble(std::size_t machine);

  [[nodiscard]] MachineStanding standing(std::size_t machine) const;
  /// The job at the machine; else one that began there and waits; else the one whose part is on its platform.
  [[nodiscard]] std::optional<std::string> job_of(std::size_t machine) const;
  [[nodiscard]] std::optional<std::string> part_on(std::size_t machine) const { return states_[machine].part; }
  /// The machine that the job is at.
  [[nodiscard]] std::optional<std::size_t> machine_of(const std::string& job) const;
  /// Where the job has begun.
  [[nodiscard]] std::optional<std::size_t> begun_on(const std::string& job) const;
  [[nodiscard]] bool waits(const std::string& job) const;
  /// In the order in which they are served.
  [[nodiscard]] std::vector<std::string> waiting() const;
  /// Jobs that wait and that the machine could print.
  [[nodiscard]] std::size_t waiting_for(std::size_t machine) const;
  /// Why a job that waits does. Nothing: it does not wait.
  [[nodiscard]] std::optional<Wait> wait_of(const std::string& job) const;

 private:
  struct State {
    std::optional<std::string> job;   ///< at it
    bool is_paused = false;           ///< that job
    bool is_lost = false;             ///< the line to it
    std::set<std::string> begun;      ///< jobs that have begun on it and are not at their end
    std::optional<std::string> part;  ///< on its platform
    MachineTrouble trouble = MachineTrouble::None;
    std::string troubled_by;  ///< the job that met it
  };
  struct Waiting {
    std::string job;
    std::set<std::size_t> fits;
    InTrouble in_trouble = InTrouble::Waits;
  };
  /// What keeps a job off a machine; nothing: it is free for it.
  [[nodiscard]] std::optional<WaitReason> obstacle(const std::string& job, std::size_t machine) const;
  [[nodiscard]] std::optional<std::size_t> choose(const Waiting& waiting) const;
  [[nodiscard]] std::vector<std::size_t> places_of(const Waiting& waiting) const;

  std::vector<QueuedMachine> machines_;
  std::vector<State> states_;  ///< by machine
  std::vector<Waiting> waiting_;
};

}  // namespace telefab::fab
