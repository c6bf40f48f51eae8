// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/staging/joined_views.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/registration_note.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/registration/doubled_sheets.hpp>
#include <telefab/scan/registration/join_scans.hpp>
#include <telefab/scan/registration/merge_views.hpp>
#include <telefab/scan/staging/view_file.hpp>

namespace telefab::scan {
namespace {

struct Views {
  std::vector<RangeImage> images;
  std::vector<ScanGroup> groups;  ///< one a file
  std::optional<double> unit_mm;  ///< as all files state it
};

Result<void> add_views(const ViewFile& from, Views& views, const std::string& first, std::stop_token stop) {
  auto file = read_scan_file(from.bytes, from.name, {}, stop);
  if (!file) return tl::unexpected{file.error()};
  if (views.images.empty()) views.unit_mm = file->cloud.unit_mm;
  if (views.unit_mm != file->cloud.unit_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} and {} do not state the same unit: they cannot be joined here", from.name, first));
  const std::size_t begin = views.images.size();
  auto added = views_of(std::move(*file), from.name, GridlessCloud::View, stop);
  if (!added) return tl::unexpected{added.error()};
  std::ranges::move(*added, std::back_inserter(views.images));
  views.groups.push_back({from.name, begin, views.images.size() - begin, 0});
  return {};
}

}  // namespace

Result<JoinedFile> joined_views(const std::vector<ViewFile>& files, const ProgressSink& progress,
                                std::stop_token stop) {
  if (files.size() < 2) return fail(ErrorCode::InvalidInput, "two views or more are joined, not one");
  Views views;
  for (const ViewFile& file : files)
    if (auto added = add_views(file, views, files.front().name, stop); !added) return tl::unexpected{added.error()};
  JoinScansOptions options;
  options.join.max_rms = most_rms_of(views.images);
  auto joined = join_scans(views.images, views.groups, options, progress, stop);
  if (!joined) return tl::unexpected{joined.error()};
  Registration& registration = joined->joined.registration;
  const auto sheets = reconcile_doubled_sheets(views.images, registration.poses, stop);
  if (!sheets) return tl::unexpected{sheets.error()};
  auto merged = merge_views(views.images, registration.poses, MergeOptions{.sheets = &*sheets}, stop);
  if (!merged) return tl::unexpected{merged.error()};
  const double unit_mm = views.unit_mm.value_or(1);
  PointCloud cloud = scaled(std::move(merged->cloud), unit_mm);
  nlohmann::ordered_json facts{{"views", views.images.size()},
                               {"points", cloud.size()},
                               {"rms", registration.rms * unit_mm},
                               {"notes", joined->notes}};
  for (const DoubledPair& d : sheets->pairs) facts["notes"].push_back(sentence_of(d, views.images));
  return JoinedFile{write_ply(cloud, {}, registration_note(views.images.size(), registration.rms * unit_mm)),
                    json_text(facts)};
}

}  // namespace telefab::scan
