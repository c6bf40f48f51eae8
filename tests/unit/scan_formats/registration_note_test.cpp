// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/scan/formats/registration_note.hpp>
#include <telefab/scan/formats/write_cloud.hpp>

namespace telefab::scan {
namespace {

std::vector<std::byte> ply_with(std::string_view comment) {
  PointCloud cloud;
  cloud.points = {Eigen::Vector3f{1, 2, 3}};
  return write_ply(cloud, {}, comment);
}

TEST(RegistrationNote, ComesBackFromTheHeaderOfTheCloud) {
  EXPECT_DOUBLE_EQ(registration_rms_of(ply_with(registration_note(24, 0.0123))).value_or(-1), 0.0123);
}

TEST(RegistrationNote, IsMissingWhereNobodyRegistered) {
  EXPECT_FALSE(registration_rms_of(ply_with("a scan")));
  EXPECT_FALSE(registration_rms_of({}));
  EXPECT_FALSE(registration_rms_of(std::as_bytes(std::span{std::string_view{"1 2 3\n"}})));
  EXPECT_FALSE(registration_rms_of(ply_with("3 range images registered by telefab-scan, rms nan")));
  EXPECT_FALSE(registration_rms_of(ply_with("3 range images registered by telefab-scan, rms -1")));
  EXPECT_FALSE(registration_rms_of(ply_with("3 range images registered by telefab-scan, rms ")));
}

}  // namespace
}  // namespace telefab::scan
