// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {

std::string to_json(const SupportReport& report) {
  constexpr std::size_t kListed = 1000;
  nlohmann::ordered_json root;
  root["passes"] = report.passes();
  root["layers"] = report.layers;
  for (int kind = 1; kind <= 6; ++kind) {
    const auto k = static_cast<Finding::Kind>(kind);
    root["counts"][std::string{name_of(k)}] = report.count(k);
  }
  root["findings"] = nlohmann::ordered_json::array();
  const auto rounded = [](double v) { return std::round(v * 1e6) / 1e6; };
  for (std::size_t i = 0; i < report.findings.size() && i < kListed; ++i) {
    const Finding& f = report.findings[i];
    root["findings"].push_back({{"kind", name_of(f.kind)},
                                {"holds_the_job", holds_the_job(f.kind)},
                                {"layer", f.layer.count()},
                                {"last_layer", f.last.count()},
                                {"x_mm", rounded(f.place.x_mm)},
                                {"y_mm", rounded(f.place.y_mm)},
                                {"size_mm2", rounded(f.size_mm2)}});
  }
  return json_text(root, 1) + "\n";
}

}  // namespace telefab::fab
