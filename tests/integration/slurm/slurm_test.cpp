// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <unistd.h>

#include <telefab/base/file.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/test/toy.hpp>

// deploy/slurm as somebody runs it on a cluster: here one of a single computer, in namespaces of its own.
namespace telefab::test {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

constexpr int kWorkers = 4;

std::string text_of(const fs::path& file) {
  const auto bytes = read_file(file, 1U << 30U);
  EXPECT_TRUE(bytes) << bytes.error().what;
  return bytes ? std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()} : std::string{};
}

class InParts : public testing::Test {
 protected:
  InParts() {
    fs::create_directories(folder_ / "machines");
    std::ofstream{folder_ / "machines/toy.toml"} << kToyProfile;
    write_torus(scan_, 200, 100);
  }
  [[nodiscard]] Words slice() const {
    return {scan_.string(), "--machine", "toy",        "--machines", (folder_ / "machines").string(),
            "--height-mm",  "3",         "--layer-mm", "0.02"};
  }
  void expect_the_stack_of_one_process(const fs::path& stack) const {
    Words words{program_, "slice", "--out", (folder_ / "one.tfc").string()};
    const Words more = slice();
    words.insert(words.end(), more.begin(), more.end());
    const Outcome alone = run(words);
    ASSERT_EQ(alone.code, 0) << alone.errors;
    EXPECT_EQ(text_of(stack), text_of(folder_ / "one.tfc"));
  }
  [[nodiscard]] static Words with(Words words, const Words& more) {
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }

  ScratchFolder scratch_;
  const fs::path folder_ = scratch_.path(), scan_ = folder_ / "torus.xyz", parts_ = folder_ / "parts",
                 stack_ = folder_ / "together.tfc";
  const fs::path source_ = ::getenv("TELEFAB_SOURCE"), here_ = source_ / "tests/integration/slurm",
                 slice_in_parts_ = source_ / "deploy/slurm/slice-in-parts";
  const std::string program_ = std::string{::getenv("TELEFAB_BIN")} + "/telefab-scan";
};

TEST_F(InParts, OnOneComputerMakesTheStackOfOneProcess) {
  const Words asked = with({"/usr/bin/env", "TELEFAB_SCAN=" + program_, slice_in_parts_.string(), "--workers", "3",
                            "--parts", parts_.string(), "--out", stack_.string(), "--local", "--"},
                           slice());
  const Outcome cut = run(asked);
  ASSERT_EQ(cut.code, 0) << cut.errors;
  expect_the_stack_of_one_process(stack_);
  const Outcome again = run(asked);
  EXPECT_EQ(again.code, 0) << again.errors;
  for (const int i : {1, 2, 3})
    EXPECT_THAT(again.output, testing::HasSubstr(fmt::format("part {} of 3 was cut before", i)));
}

TEST_F(InParts, MakesOnceOfTheWholeStackWhatIsAskedOfSlice) {
  const fs::path report = folder_ / "report.json", contours = folder_ / "contours.jsonl";
  const auto asked = [&](const Words& more) {
    return run(with(with({"/usr/bin/env", "TELEFAB_SCAN=" + program_, slice_in_parts_.string(), "--workers", "3",
                          "--parts", parts_.string(), "--out", stack_.string(), "--local", "--"},
                         slice()),
                    more));
  };
  const Outcome cut = asked({"--report", report.string(), "--contours=" + contours.string(), "--require-certified"});
  const Outcome alone =
      run(with({program_, "slice", "--contours", (folder_ / "one.jsonl").string(), "--report",
                (folder_ / "one.json").string(), "--require-certified", "--out", (folder_ / "stack.tfc").string()},
               slice()));
  EXPECT_EQ(cut.code, alone.code) << cut.errors;
  EXPECT_EQ(text_of(contours), text_of(folder_ / "one.jsonl"));
  const auto layers_cut = [](const std::string& text) {
    const auto at = text.find("\"layers_cut\"");
    return text.substr(at, text.find(',', at) - at);
  };
  EXPECT_EQ(layers_cut(text_of(report)), layers_cut(text_of(folder_ / "one.json"))) << "of all layers, not of a share";
  const Outcome printed = asked({"--json"});
  EXPECT_EQ(printed.code, 0) << printed.errors;
  EXPECT_EQ(printed.output.front(), '{') << "the report alone";
  EXPECT_EQ(layers_cut(printed.output), layers_cut(text_of(report)));
}

TEST_F(InParts, SaysWhatIsWrongWithItsWords) {
  const Words asked_for{"--workers", "2", "--parts", "p", "--out", "o.tfc", "--", "x.ply"};
  for (const auto& [words, sentence] :
       {std::pair{Words{"--parts", "p", "--out", "o.tfc", "--", "x.ply"}, "--workers needs a number above 0"},
        std::pair{Words{"--workers", "2", "--out", "o.tfc", "--", "x.ply"}, "--parts names the folder"},
        std::pair{Words{"--workers", "2", "--parts", "p", "--out", "o.tfc"}, "behind -- come the scan"},
        std::pair{Words{"x.ply"}, "x.ply is not an option, and -- comes before the scan"},
        std::pair{with(asked_for, {"--out", "b.tfc"}), "--out stands before --"},
        std::pair{with(asked_for, {"--layers", "0:9"}), "--layers is what --workers and --parts"},
        std::pair{with(asked_for, {"--threads=2"}), "--threads is what --cpus states"},
        std::pair{with(asked_for, {"--report"}), "--report needs a file"},
        std::pair{with(asked_for, {"--json"}), "take --report FILE"}}) {
    const Outcome refused = run(with({slice_in_parts_.string()}, words));
    EXPECT_EQ(refused.code, 1);
    EXPECT_THAT(refused.errors, testing::HasSubstr(sentence));
  }
}

TEST_F(InParts, UnderSlurmMakesTheSameStackThoughAWorkerAndTheControllerAreKilled) {
  for (const char* needed : {"slurmctld", "slurmd", "sbatch", "munged", "unshare", "ip"})
    if (run({"/bin/sh", "-c", fmt::format("PATH=$PATH:/usr/sbin:/sbin command -v {}", needed)}).code != 0)
      GTEST_SKIP() << needed << " is not installed: apt install slurmctld slurmd slurm-client munge iproute2";
  if (::geteuid() != 0 ||
      run({"/usr/bin/unshare", "--net", "--pid", "--fork", "--mount-proc", "--uts", "true"}).code != 0)
    GTEST_SKIP() << "a cluster in namespaces of its own needs root, and a kernel that lets it make them";
  const fs::path died = folder_ / "died";
  const Outcome ran =
      run(with({"/usr/bin/env", "PATH=" + std::string{::getenv("PATH")} + ":/usr/sbin:/sbin",
                "TELEFAB_SCAN=" + (here_ / "dies_once").string(), "REAL_SCAN=" + program_, "DIED=" + died.string(),
                "GO=" + (folder_ / "go").string(), "SLICE_IN_PARTS=" + slice_in_parts_.string(),
                (here_ / "cluster").string(), (folder_ / "cluster").string(), (here_ / "scenario").string(),
                std::to_string(kWorkers), parts_.string(), stack_.string()},
               slice()));
  ASSERT_EQ(ran.code, 0) << ran.output << ran.errors;
  EXPECT_EQ(text_of(died / "code"), "137\n") << "the worker was through before it was killed";
  EXPECT_THAT(text_of(parts_ / "slice-2.log"), testing::HasSubstr("worker 2 of 4: attempt 1 ended by signal 9"));
  expect_the_stack_of_one_process(stack_);
}

}  // namespace
}  // namespace telefab::test
