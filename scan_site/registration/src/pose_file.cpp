// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/registration/pose_file.hpp>

#include <fmt/format.h>
#include <array>
#include <charconv>
#include <cmath>

namespace telefab::scan {
namespace {

std::string_view take_word(std::string_view& line) {
  const std::size_t from = std::min(line.find_first_not_of(" \t\r"), line.size());
  const std::size_t to = std::min(line.find_first_of(" \t\r", from), line.size());
  const std::string_view word = line.substr(from, to - from);
  line.remove_prefix(to);
  return word;
}

}  // namespace

Result<std::vector<NamedPose>> read_pose_file(std::string_view text) {
  std::vector<NamedPose> poses;
  for (std::size_t number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::string_view key = take_word(line);
    if (key != "bmesh") continue;
    NamedPose named{std::string{take_word(line)}, RigidMotion::Identity()};
    std::array<double, 7> v{};
    for (double& value : v) {
      const std::string_view word = take_word(line);
      const auto [stop, fault] = std::from_chars(word.data(), word.data() + word.size(), value);
      if (fault != std::errc{} || stop != word.data() + word.size() || !std::isfinite(value))
        return fail(ErrorCode::InvalidInput,
                    fmt::format("pose file, line {}: bmesh FILE and 7 numbers expected", number));
    }
    const Eigen::Quaterniond turn{v[6], -v[3], -v[4], -v[5]};
    if (named.file.empty() || !(turn.norm() > 1e-6))
      return fail(ErrorCode::InvalidInput, fmt::format("pose file, line {}: no rotation", number));
    named.pose.linear() = turn.normalized().toRotationMatrix();
    named.pose.translation() = Vec3{v[0], v[1], v[2]};
    poses.push_back(std::move(named));
  }
  if (poses.empty()) return fail(ErrorCode::InvalidInput, "pose file: no bmesh line");
  return poses;
}

std::string to_pose_file(std::span<const NamedPose> poses) {
  std::string text;
  for (const NamedPose& named : poses) {
    const Eigen::Quaterniond q{named.pose.rotation()};
    const Vec3 t = named.pose.translation();
    text += fmt::format("bmesh {} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g} {:.9g}\n", named.file, t.x(), t.y(), t.z(),
                        -q.x(), -q.y(), -q.z(), q.w());
  }
  return text;
}

}  // namespace telefab::scan
