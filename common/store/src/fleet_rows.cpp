// SPDX-License-Identifier: GPL-3.0-or-later
#include "fleet_rows.hpp"

namespace telefab {

fleet::Machine machine_of(const SqlRow& row) {
  Columns c{row};
  fleet::Machine m;
  m.name = c.text(), m.fab = c.text(), m.profile = c.text(), m.light = c.text(), m.resin = c.text();
  m.width_mm = c.real(), m.depth_mm = c.real(), m.height_mm = c.real(), m.pixel_mm = c.real();
  m.calibrated_unix_ms = c.number();
  m.readiness = static_cast<fleet::Readiness>(c.number());
  m.is_draining = c.number() != 0;
  m.seen_unix_ms = c.number();
  return m;
}

fleet::Job job_of(const SqlRow& row) {
  Columns c{row};
  fleet::Job j;
  j.id = c.text(), j.name = c.text(), j.owner = c.text(), j.site = c.text();
  j.needs.machine = c.text(), j.needs.light = c.text(), j.needs.resin = c.text();
  j.needs.width_mm = c.real(), j.needs.depth_mm = c.real(), j.needs.height_mm = c.real();
  j.needs.pixel_mm = c.real();
  j.needs.calibrated_within_ms = c.number();
  j.priority = static_cast<int>(c.number());
  j.deadline_unix_ms = c.number();
  if (j.deadline_unix_ms == kNever) j.deadline_unix_ms = 0;
  j.stack_key = c.text();
  j.place = static_cast<std::uint64_t>(c.number());
  j.state = static_cast<fleet::State>(c.number());
  j.attempt = static_cast<std::uint32_t>(c.number());
  j.machine = c.text(), j.message = c.text();
  j.until_unix_ms = c.number();
  return j;
}

}  // namespace telefab
