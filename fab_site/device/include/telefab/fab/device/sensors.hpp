// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/base/result.hpp>

namespace telefab::fab {

struct SensorReading {
  bool interlock_open = false;          ///< the cover is open: no light, no motion
  std::optional<double> resin_celsius;  ///< where the machine has a thermometer
};

/// What a machine can feel beside its two devices. Optional: a machine without one has no Sensors.
class Sensors {
 public:
  virtual ~Sensors() = default;
  Sensors(const Sensors&) = delete;
  Sensors& operator=(const Sensors&) = delete;
  [[nodiscard]] virtual Result<SensorReading> read() = 0;

 protected:
  Sensors() = default;
};

/// Says what it was told to say.
class VirtualSensors final : public Sensors {
 public:
  [[nodiscard]] Result<SensorReading> read() override { return reading; }
  SensorReading reading;
};

}  // namespace telefab::fab
