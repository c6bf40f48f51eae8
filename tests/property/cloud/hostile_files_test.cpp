// SPDX-License-Identifier: GPL-3.0-or-later
#include "hostile_files.hpp"

#include <gtest/gtest.h>
#include <algorithm>
#include <set>
#include <telefab/scan/cloud/clean.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {
namespace {

using test::HostileFile;

const std::vector<HostileFile>& files() {
  static const std::vector<HostileFile> all = test::hostile_files();
  return all;
}

/// Says where and what, in words that may be printed on any terminal and put into any JSON.
void expect_clear(const Error& error, const std::string& where) {
  EXPECT_GT(error.what.size(), where.size() + 15) << error.what;
  EXPECT_LT(error.what.size(), 600U) << error.what;
  EXPECT_TRUE(std::all_of(error.what.begin(), error.what.end(), [](char c) { return c >= ' ' && c <= '~'; }))
      << error.what;
  EXPECT_NE(error.code, ErrorCode::Internal) << error.what;
}

class HostileFiles : public testing::TestWithParam<std::size_t> {
 protected:
  const HostileFile& file = files()[GetParam()];
  std::span<const std::byte> bytes = std::as_bytes(std::span{file.bytes});
};

TEST_P(HostileFiles, AreReadRightOrRefusedInClearWords) {
  const auto cloud = read_cloud(bytes, file.name, {}, {});
  if (cloud) {
    ASSERT_TRUE(file.points) << cloud->size() << " points were read";
    EXPECT_EQ(cloud->size(), *file.points);
    return;
  }
  EXPECT_FALSE(file.points) << cloud.error().what;
  expect_clear(cloud.error(), file.name);
  EXPECT_NE(cloud.error().what.find(file.name), std::string::npos) << cloud.error().what;
  EXPECT_NE(cloud.error().what.find(file.says), std::string::npos) << cloud.error().what;
}

TEST_P(HostileFiles, EndInLayersOrInAClearErrorAllTheWay) {
  SliceRequest request;
  request.machine.name = "bench";
  request.machine.platform = {60, 40, 50};
  request.machine.projection.pixel_pitch_mm = 0.5;
  request.machine.layers.thickness_mm = 1;
  request.placement.fit = true;
  const auto report =
      slice_scan(bytes, file.name, request, [](const StackHeader&, Layer&&) { return Result<void>{}; }, {}, {});
  if (!report) expect_clear(report.error(), "");
  const auto cloud = read_cloud(bytes, file.name, {}, {});
  if (!cloud) return;
  for (const CleanOptions& options : {CleanOptions::careful(), CleanOptions::strong()})
    if (const auto cleaned = clean_cloud(*cloud, options, {}); !cleaned) expect_clear(cleaned.error(), "");
}

INSTANTIATE_TEST_SUITE_P(All, HostileFiles, testing::Range(std::size_t{0}, files().size()),
                         [](const testing::TestParamInfo<std::size_t>& tried) {
                           std::string name = files()[tried.param].name;
                           std::replace_if(
                               name.begin(), name.end(), [](char c) { return !std::isalnum(c); }, '_');
                           return name;
                         });

TEST(HostileCorpus, HasAHundredFilesOfDifferentNames) {
  std::set<std::string> names;
  for (const HostileFile& f : files()) names.insert(f.name);
  EXPECT_EQ(names.size(), files().size());
  EXPECT_GE(files().size(), 100U);
}

}  // namespace
}  // namespace telefab::scan
