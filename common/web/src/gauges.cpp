// SPDX-License-Identifier: GPL-3.0-or-later
#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <telefab/web/gauges.hpp>

namespace telefab {

void Gauges::add(const std::string& name, const std::string& help, const Labels& labels, double value) {
  auto family = std::find_if(families_.begin(), families_.end(), [&](const Family& f) { return f.name == name; });
  if (family == families_.end()) family = families_.insert(families_.end(), {name, help, {}});
  family->samples.emplace_back(labels, value);
}

std::string Gauges::text() const {
  std::vector<prometheus::MetricFamily> out;
  for (const Family& family : families_) {
    prometheus::MetricFamily each{family.name, family.help, prometheus::MetricType::Gauge, {}};
    for (const auto& [labels, value] : family.samples) {
      prometheus::ClientMetric sample;
      for (const auto& [label, text] : labels) sample.label.push_back({label, text});
      sample.gauge.value = value;
      each.metric.push_back(std::move(sample));
    }
    out.push_back(std::move(each));
  }
  return prometheus::TextSerializer{}.Serialize(out);
}

}  // namespace telefab
