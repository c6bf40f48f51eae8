// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace telefab {

/// Numbers for Prometheus, gathered again for every answer: nothing is kept twice.
class Gauges {
 public:
  using Labels = std::map<std::string, std::string>;
  /// A family appears with its first sample, in the order of the first samples.
  void add(const std::string& name, const std::string& help, const Labels& labels, double value);
  /// In the text format 0.0.4.
  [[nodiscard]] std::string text() const;
  static constexpr const char* kContentType = "text/plain; version=0.0.4; charset=utf-8";

 private:
  struct Family {
    std::string name;
    std::string help;
    std::vector<std::pair<Labels, double>> samples;
  };
  std::vector<Family> families_;
};

}  // namespace telefab
