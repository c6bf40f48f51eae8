// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include <telefab/base/exit_code.hpp>
#include <telefab/base/file.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/toy.hpp>

// `telefab-scan slice --part I/N --parts FOLDER` and `merge`, as somebody runs them on many computers.
namespace telefab::test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

class Parts : public testing::Test {
 protected:
  Parts() {
    fs::create_directories(folder_ / "machines");
    std::ofstream{folder_ / "machines/toy.toml"} << kToyProfile;
    write_torus(scan_, 120, 60);
  }

  [[nodiscard]] Words slice(Words more, const std::string& height = "3") const {
    Words words{
        program_,      "slice", scan_.string(), "--machine", "toy", "--machines", (folder_ / "machines").string(),
        "--height-mm", height,  "--layer-mm",   "0.02"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  [[nodiscard]] Words worker(int index, int count, Words more = {}) const {
    more.insert(more.end(), {"--part", fmt::format("{}/{}", index, count), "--parts", parts_.string()});
    return slice(std::move(more));
  }
  [[nodiscard]] Outcome merge(Words more) const {
    more.insert(more.begin(), {program_, "merge", parts_.string()});
    return run(more);
  }
  [[nodiscard]] std::string bytes_of(const fs::path& file) const {
    const auto bytes = read_file(file, 1U << 30U);
    EXPECT_TRUE(bytes) << bytes.error().what;
    return bytes ? std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()} : std::string{};
  }
  [[nodiscard]] std::size_t files() const {
    return fs::exists(parts_)
               ? static_cast<std::size_t>(std::distance(fs::directory_iterator{parts_}, fs::directory_iterator{}))
               : 0;
  }
  /// What merge of all parts makes is what one process makes.
  void expect_whole() const {
    const fs::path one = folder_ / "one.tfc", together = folder_ / "together.tfc";
    const Outcome alone = run(slice({"--out", one.string(), "--force", "--json"}));
    ASSERT_EQ(alone.code, 0) << alone.errors;
    const Outcome merged = merge({"--out", together.string(), "--force", "--json"});
    ASSERT_EQ(merged.code, 0) << merged.errors;
    EXPECT_EQ(bytes_of(together), bytes_of(one));
    auto report = nlohmann::json::parse(merged.output), wanted = nlohmann::json::parse(alone.output);
    report.erase("seconds");
    wanted.erase("seconds");
    EXPECT_EQ(report, wanted);
    EXPECT_GT(wanted["layers_cut"].get<int>(), 100);
  }

  ScratchFolder scratch_;
  const fs::path folder_ = scratch_.path(), scan_ = folder_ / "torus.xyz", parts_ = folder_ / "parts";
  const std::string program_ = std::string{::getenv("TELEFAB_BIN")} + "/telefab-scan";
};

TEST_F(Parts, OfThreeWorkersMakeTheStackOfOneProcess) {
  for (const int i : {2, 3, 1}) {
    const Outcome cut = run(worker(i, 3));
    EXPECT_EQ(cut.code, 0) << cut.errors;
  }
  expect_whole();
}

TEST_F(Parts, AreNotCutTwiceAndSayTheSameTheSecondTime) {
  const fs::path lines = folder_ / "lines.jsonl", again = folder_ / "again.jsonl";
  const Outcome first = run(worker(2, 3, {"--json", "--contours", lines.string()}));
  ASSERT_EQ(first.code, 0) << first.errors;
  auto cut = nlohmann::json::parse(first.output);
  EXPECT_EQ(cut["part"]["which"], "part 2 of 3");
  EXPECT_FALSE(cut["part"]["was_there"].get<bool>());
  struct stat before {
  }, after{};
  const std::string file = cut["part"]["file"];
  ASSERT_EQ(::stat(file.c_str(), &before), 0);
  const Outcome second = run(worker(2, 3, {"--json", "--contours", again.string()}));
  ASSERT_EQ(second.code, 0) << second.errors;
  auto found = nlohmann::json::parse(second.output);
  EXPECT_TRUE(found["part"]["was_there"].get<bool>());
  ASSERT_EQ(::stat(file.c_str(), &after), 0);
  EXPECT_EQ(after.st_ino, before.st_ino) << "the file was written again";
  EXPECT_EQ(bytes_of(again), bytes_of(lines));
  for (auto* report : {&cut, &found}) {
    report->erase("seconds");
    (*report)["part"].erase("was_there");
  }
  EXPECT_EQ(found, cut);
  const Outcome people = run(worker(2, 3));
  EXPECT_THAT(people.output, testing::HasSubstr("part 2 of 3 was cut before, and nothing was cut again: " + file));
}

TEST_F(Parts, OfAWorkerThatWasKilledAreWholeOrNotThere) {
  using namespace std::chrono_literals;
  int kills = 0;
  for (const auto pause : {5ms, 40ms, 80ms, 120ms, 160ms, 200ms, 250ms, 300ms}) {
    fs::remove_all(parts_);
    Process killed{worker(1, 2)};
    std::this_thread::sleep_for(pause);
    killed.send_signal(SIGKILL);
    if (killed.finish() == -SIGKILL) ++kills;
    // What it left is no part, or a whole one.
    const Outcome next = run(worker(1, 2, {"--json"}));
    ASSERT_EQ(next.code, 0) << next.errors;
    EXPECT_EQ(next.errors.find("damaged"), std::string::npos) << next.errors;
  }
  EXPECT_GT(kills, 0) << "every worker was through before it was killed";
  EXPECT_EQ(run(worker(2, 2)).code, 0);
  expect_whole();
}

TEST_F(Parts, OfTwoWorkersAtTheSamePartAreOne) {
  Process one{worker(1, 2)}, other{worker(1, 2)};
  EXPECT_EQ(one.finish(), 0) << one.errors();
  EXPECT_EQ(other.finish(), 0) << other.errors();
  EXPECT_EQ(files(), 1U);
  EXPECT_EQ(run(worker(2, 2)).code, 0);
  expect_whole();
}

TEST_F(Parts, ThatAreDamagedAreNamedByMergeAndCutAgain) {
  ASSERT_EQ(run(worker(1, 2)).code, 0);
  ASSERT_EQ(run(worker(2, 2)).code, 0);
  const fs::path file = fs::directory_iterator { parts_ } -> path();
  {
    std::fstream part{file, std::ios::in | std::ios::out | std::ios::binary};
    part.seekp(1000);
    part.put('\x5a').put('\x5a').put('\x5a');
  }
  const Outcome refused = merge({"--out", (folder_ / "x.tfc").string()});
  EXPECT_EQ(refused.code, static_cast<int>(ExitCode::NotTrusted));
  EXPECT_THAT(refused.errors, testing::HasSubstr(file.filename().string() + ": this part is damaged"));
  EXPECT_FALSE(fs::exists(folder_ / "x.tfc"));
  for (const int i : {1, 2}) {
    const Outcome again = run(worker(i, 2));
    EXPECT_EQ(again.code, 0) << again.errors;
  }
  expect_whole();
}

TEST_F(Parts, ThatAreMissingOrForeignAreRefusedByName) {
  ASSERT_EQ(run(worker(1, 3)).code, 0);
  ASSERT_EQ(run(worker(3, 3)).code, 0);
  const Outcome missing = merge({"--out", (folder_ / "x.tfc").string()});
  EXPECT_EQ(missing.code, static_cast<int>(ExitCode::Refused));
  EXPECT_THAT(missing.errors, testing::HasSubstr("part 2 of 3: layers 50 to 99"));
  ASSERT_EQ(run(slice({"--part", "2/3", "--parts", parts_.string()}, "4")).code, 0);
  const Outcome foreign = merge({"--out", (folder_ / "x.tfc").string()});
  EXPECT_EQ(foreign.code, static_cast<int>(ExitCode::Refused));
  EXPECT_THAT(foreign.errors, testing::HasSubstr("are parts of different slicings"));
  EXPECT_FALSE(fs::exists(folder_ / "x.tfc"));
}

TEST_F(Parts, OfRangesOfLayersMakeAStackToo) {
  for (const char* layers : {"0:9", "100:149", "10:99"})
    ASSERT_EQ(run(slice({"--layers", layers, "--parts", parts_.string()})).code, 0) << layers;
  expect_whole();
}

TEST_F(Parts, AreNoStackForTheWorker) {
  const Outcome refused = run(worker(1, 2, {"--out", (folder_ / "x.tfc").string()}));
  EXPECT_EQ(refused.code, static_cast<int>(ExitCode::Refused));
  EXPECT_THAT(refused.errors, testing::HasSubstr("telefab-scan merge makes it of parts"));
  EXPECT_EQ(files(), 0U);
}

}  // namespace
}  // namespace telefab::test
