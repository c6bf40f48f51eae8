// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/fab/print/machine_queue.hpp>

namespace telefab::fab {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::size_t kA = 0, kB = 1, kC = 2;

MachineQueue three(bool needs_clearing = false) {
  return MachineQueue{{{"a", needs_clearing}, {"b", needs_clearing}, {"c", needs_clearing}}};
}
/// Waits and gets its machine.
std::vector<Assignment> given(MachineQueue& queue, const std::string& job, const std::vector<std::size_t>& fits) {
  queue.add(job, fits);
  return queue.assign();
}

TEST(MachineQueue, GivesTheFirstFreeMachineInTheOrderOfTheList) {
  MachineQueue queue = three();
  EXPECT_THAT(given(queue, "j1", {kC, kA, kB}), ElementsAre(Assignment{"j1", kA}));
  EXPECT_THAT(given(queue, "j2", {kC, kA, kB}), ElementsAre(Assignment{"j2", kB}));
  EXPECT_THAT(given(queue, "j3", {kA}), IsEmpty());
  EXPECT_EQ(queue.wait_of("j3"), (Wait{WaitReason::Busy, kA}));
  EXPECT_EQ(queue.standing(kA), MachineStanding::Printing);
  EXPECT_EQ(queue.standing(kC), MachineStanding::Idle);
}

TEST(MachineQueue, ServesJobsInTheOrderTheyCameAndLetsNoneHoldUpAnother) {
  MachineQueue queue = three();
  EXPECT_THAT(given(queue, "j1", {kA}), ElementsAre(Assignment{"j1", kA}));
  queue.add("j2", {kA});
  queue.add("j3", {kA, kB});
  queue.add("j4", {kA, kB});
  EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j3", kB})) << "j2 waits for a";
  queue.end("j1");
  EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j2", kA}));
  queue.end("j3");
  EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j4", kB}));
}

TEST(MachineQueue, KeepsAPrintThatBeganOnItsMachineAndEverythingElseOffIt) {
  MachineQueue queue = three();
  (void)given(queue, "j1", {kA, kB});
  queue.begin("j1", kA);
  queue.release("j1", MachineTrouble::None);
  EXPECT_EQ(queue.standing(kA), MachineStanding::Paused);
  EXPECT_EQ(queue.job_of(kA), "j1");
  EXPECT_THAT(given(queue, "j2", {kA}), IsEmpty());
  EXPECT_EQ(queue.wait_of("j2"), (Wait{WaitReason::Held, kA}));
  EXPECT_THAT(given(queue, "j1", {kA, kB}), ElementsAre(Assignment{"j1", kA})) << "not on b, which is free too";
  queue.end("j1");
  EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j2", kA}));
}

TEST(MachineQueue, GivesAJobOfWhichNothingWasMadeToAnyMachine) {
  MachineQueue queue = three();
  (void)given(queue, "j1", {kA, kB});
  queue.begin("j1", kA);
  queue.release("j1", MachineTrouble::Lost);
  queue.forget_begun("j1");
  EXPECT_EQ(queue.standing(kA), MachineStanding::Offline);
  EXPECT_THAT(given(queue, "j1", {kA, kB}), ElementsAre(Assignment{"j1", kB}));
}

TEST(MachineQueue, LeavesAMachineInTroubleAloneUntilTheJobItCameFromEndsOrAnOperatorWantsItTried) {
  for (const MachineTrouble trouble : {MachineTrouble::Fault, MachineTrouble::Lost}) {
    MachineQueue queue = three();
    (void)given(queue, "j1", {kA});
    queue.release("j1", trouble);
    EXPECT_THAT(given(queue, "j2", {kA}), IsEmpty());
    EXPECT_EQ(queue.wait_of("j2"), (Wait{WaitReason::Trouble, kA}));
    queue.add("j1", {kA}, InTrouble::Tries);
    EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j1", kA}))
        << "resumed; j2 waits before it, and goes on waiting";
    queue.release("j1", trouble);
    queue.end("j1");
    EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j2", kA}));
    queue.release("j2", trouble);
    queue.add("j2", {kA});
    queue.forget_trouble(kA);
    EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j2", kA}));
  }
}

TEST(MachineQueue, KeepsOtherJobsOffAPlatformWithAPartOnItWhereSomebodyMustClearIt) {
  MachineQueue queue = three(true);
  (void)given(queue, "j1", {kA});
  queue.set_part(kA, "j1");
  queue.end("j1");
  EXPECT_EQ(queue.standing(kA), MachineStanding::Occupied);
  EXPECT_EQ(queue.job_of(kA), "j1");
  EXPECT_THAT(given(queue, "j2", {kA}), IsEmpty());
  EXPECT_EQ(queue.wait_of("j2"), (Wait{WaitReason::Platform, kA}));
  queue.set_part(kA, std::nullopt);
  EXPECT_THAT(queue.assign(), ElementsAre(Assignment{"j2", kA}));
  MachineQueue automatic = three(false);
  automatic.set_part(kA, "j1");
  EXPECT_EQ(automatic.standing(kA), MachineStanding::Idle);
  EXPECT_THAT(given(automatic, "j2", {kA}), ElementsAre(Assignment{"j2", kA}));
}

TEST(MachineQueue, TellsThePauseOfAPrintAtItsMachine) {
  MachineQueue queue = three();
  (void)given(queue, "j1", {kB});
  queue.set_paused("j1", true);
  EXPECT_EQ(queue.standing(kB), MachineStanding::Paused);
  queue.set_paused("j1", false);
  EXPECT_EQ(queue.standing(kB), MachineStanding::Printing);
  queue.set_paused("nobody", true);
  EXPECT_EQ(queue.standing(kB), MachineStanding::Printing);
}

TEST(MachineQueue, SaysWhyAJobWaitsByWhatWouldEndItSoonest) {
  MachineQueue queue = three(true);
  queue.set_part(kA, "old");
  (void)given(queue, "j1", {kB});
  queue.add("j2", {kA, kB, kC});
  queue.add("j3", {});
  EXPECT_EQ(queue.wait_of("j2"), (Wait{WaitReason::Busy, kC})) << "free";
  (void)given(queue, "j4", {kC});
  EXPECT_EQ(queue.machine_of("j2"), kC);
  EXPECT_EQ(queue.wait_of("j4"), (Wait{WaitReason::Busy, kC}));
  EXPECT_EQ(queue.wait_of("j3"), (Wait{WaitReason::NoMachine, std::nullopt}));
  EXPECT_EQ(queue.wait_of("nobody"), std::nullopt);
  queue.drop("j3");
  EXPECT_FALSE(queue.waits("j3"));
  EXPECT_EQ(queue.waiting_for(kC), 1U);
}

TEST(MachineQueue, IsToldOnceOfAJobThatIsAtItsMachineAlready) {
  MachineQueue queue = three();
  (void)given(queue, "j1", {kA});
  EXPECT_THAT(given(queue, "j1", {kB}), IsEmpty());
  EXPECT_EQ(queue.machine_of("j1"), kA);
}

}  // namespace
}  // namespace telefab::fab
