// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/digest.hpp>
#include <telefab/base/result.hpp>
#include <telefab/machine/machine_words.hpp>
#include <vector>

namespace telefab {

struct PixelSize {
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
  friend bool operator==(const PixelSize&, const PixelSize&) = default;
};

/// A printer with its resin and the way it prints, as both sites see it: read from one TOML file, or composed of
/// several (profile_catalogue.hpp). Every key carries its unit, has a range, and an unknown key is an error. The table
/// in profile_keys.cpp owns names, ranges and reasons; `describe_keys()` prints it.
struct MachineProfile {
  std::string name;         ///< e.g. "machine-a"; [a-z0-9-]+
  std::string description;  ///< one line for people
  /// Keys, as "resin.penetration_mm", whose values nobody has published or measured; in the order of the table. No part
  /// of any digest.
  std::vector<std::string> assumed;

  struct Platform {
    double width_mm = 0;        ///< along x, the mask's columns
    double depth_mm = 0;        ///< along y, the mask's rows
    double z_travel_mm = 0;     ///< tallest part with its base
    double most_peel_mm2 = 0;   ///< largest layer that its lift can pull off the vat; 0: not stated
    double least_layer_mm = 0;  ///< thinnest layer; 0: not stated
    double most_layer_mm = 0;   ///< thickest layer; 0: not stated
    friend bool operator==(const Platform&, const Platform&) = default;
  } platform;

  struct Projection {
    double pixel_pitch_mm = 0;  ///< on the vat; pixels = floor(platform / pitch)
    OpticsTurn orientation = OpticsTurn::Normal;
    MirrorControllers controllers = MirrorControllers::Auto;
    double spread_px = 0.5;  ///< sigma of one pixel's Gaussian light spot
    double gamma = 1.0;      ///< H(grey) = (grey / 255)^gamma, unless there is a curve
    /// H at equally spaced greys from 0 to 255, straight between them: 2 to 256 numbers that never fall, the first 0,
    /// the last 1. Empty: gamma holds. Black's own light is `leak`, not here.
    std::vector<double> curve;
    double leak = 0.0;  ///< share of full irradiance that a black pixel leaks
    /// Irradiance over the mask as share of irradiance_mw_per_cm2, rows of equal length from the back of the platform
    /// to its front, as a mask shows them. Number (r, c) holds at the middle of cell (r, c) of as many equal cells;
    /// bilinear between, constant beyond the outer middles. Empty: 1 everywhere.
    std::vector<std::vector<double>> field;
    double irradiance_mw_per_cm2 = 0;  ///< of a white area on the vat where the field is 1
    std::uint32_t width_px = 0;        ///< as the maker states them, and as mask_size() finds them; 0: not stated
    std::uint32_t height_px = 0;
    friend bool operator==(const Projection&, const Projection&) = default;
  } projection;

  struct Layers {
    double thickness_mm = 0;
    double exposure_s = 0;           ///< of a normal layer
    std::uint32_t bottom_count = 4;  ///< layers on the platform with the longer exposure
    double bottom_exposure_s = 0;
    double bottom_factor = 8;            ///< bottom_exposure_s over exposure_s where the former is derived
    std::uint32_t transition_count = 0;  ///< layers behind them whose exposure falls evenly to the normal one
    double light_share = 1;              ///< of full irradiance, at which layers are exposed; (0, 1]
    double bottom_light_share = 0;       ///< of the bottom layers; 0: as light_share
    friend bool operator==(const Layers&, const Layers&) = default;
  } layers;

  struct Resin {
    std::string name = "assumed";
    double critical_dose_mj_per_cm2 = 10;  ///< Ec
    double penetration_mm = 0.1;           ///< Dp
    /// Intervals that hold Ec and Dp with 95 % confidence, as a calibration found them; 0: nobody measured.
    double critical_dose_least_mj_per_cm2 = 0, critical_dose_most_mj_per_cm2 = 0;
    double penetration_least_mm = 0, penetration_most_mm = 0;
    double calibration_correlation = 0;  ///< [-1, 1]; of the errors of Dp and ln Ec: one fit found both
    double vat_ml = 0;                   ///< resin that the vat holds; 0: not stated
    double green_strength_mpa = 0;       ///< of printed resin before it is washed and cured; 0: not stated
    double green_modulus_mpa = 0;        ///< in bending, likewise; 0: not stated
    std::string maker;
    double viscosity_mpa_s = 0;   ///< at 25 degrees; 0: not stated
    double density_g_per_ml = 0;  ///< of the liquid; 0: not stated
    /// What the maker prints it at; 0: not stated.
    double temperature_least_celsius = 0, temperature_most_celsius = 0;
    /// What a printed, washed and cured part lacks of its drawn length along each axis; below 0: it has grown. Frame of
    /// the platform.
    double shrink_x_percent = 0, shrink_y_percent = 0, shrink_z_percent = 0;
    double hole_growth_mm = 0;  ///< to be added to the radius of a hole: upright holes come out smaller by so much
    friend bool operator==(const Resin&, const Resin&) = default;
  } resin;

  struct Supports {
    /// Overhang per layer that holds itself, for a small attached region; 0: by bending, see self_support_reach_mm().
    double self_support_mm = 0;
    /// Added per sqrt(attached area): reach = min(most, self_support_mm * (1 + growth * sqrt(A / mm2))).
    double self_support_growth_per_mm = 0.5;
    double self_support_most_mm = 2.0;  ///< no attached region holds an overhang beyond this in one layer
    double anchor_distance_mm = 3.0;    ///< every point to be supported lies within this of an anchor
    double tip_radius_mm = 0.2;
    double pin_radius_mm = 0.5;
    double foot_radius_mm = 1.0;
    double clearance_mm = 0.4;    ///< between supports and part except at tips and feet
    double brace_pitch_mm = 8.0;  ///< vertical distance of slanted struts
    double slenderness = 25.0;    ///< free pin length over diameter at most
    double base_thickness_mm = 0.6;
    double stand_area_share = 0.03;  ///< a first layer of at least this share of the largest stands on the platform
    double lift_off_mm = 3.5;        ///< the part starts this far above the platform when it needs a base
    double safety = 2.0;             ///< strength over the stress that a plan may ask for
    double fresh_share = 0.5;        ///< (0, 1]; strength of a tip some seconds after its exposure, of green strength
    /// kappa of the bending of one layer's overhang: its strength as share of a full section as thick as the layer; 0:
    /// computed from dose and depth.
    double overhang_share = 0;
    double medium_tip_radius_mm = 0;  ///< 0: 1.5 times the light tip's, which tip_radius_mm is
    double heavy_tip_radius_mm = 0;   ///< 0: twice the light tip's
    double tip_depth_mm = 0;          ///< how far tips go into the part; 0: by their radius
    double arm_degrees = 40;          ///< most lean of a pin's upper end, from upright
    double density = 1;               ///< so many times the anchors that would do
    PinGround ground = PinGround::Anywhere;
    RaftKind raft = RaftKind::Auto;
    double raft_margin_mm = 2;     ///< of one plate, beyond the feet
    double raft_lip_degrees = 30;  ///< its lower edge recedes by so much from upright, for a scraper; 0: upright
    friend bool operator==(const Supports&, const Supports&) = default;
  } supports;

  /// What some layers do in another way than the rest; 0: as the rest. Meanings as in Motion.
  struct Stroke {
    double lift_mm = 0;
    double lift_speed_mm_per_s = 0;
    double peel_mm = 0;
    double peel_speed_mm_per_s = 0;
    double lower_speed_mm_per_s = 0;
    double approach_mm = 0;
    double approach_speed_mm_per_s = 0;
    double settle_s = 0;
    double wait_after_exposure_s = 0;
    double wait_after_lift_s = 0;
    double tilt_s = 0;
    friend bool operator==(const Stroke&, const Stroke&) = default;
  };

  struct Motion {
    double lift_mm = 5.0;  ///< up by this after each exposure, then down again
    double lift_speed_mm_per_s = 2.0;
    double lower_speed_mm_per_s = 3.0;
    double settle_s = 0.5;               ///< resin comes to rest, lowered and before the light
    double pull_kpa = 0;                 ///< of the film on the layer just exposed, over its area; 0: not stated
    double pull_size_mm = 0;             ///< area over perimeter of a layer on which the pull is doubled; 0: it is not
    double pull_speed_mm_per_s = 0;      ///< at which the film comes off with that pull; 0: at any
    double pull_speed_power = 0;         ///< the pull grows with the speed to this power
    double vacuum_kpa = 0;               ///< in a hollow that the film closes, when it is lifted; 0: not stated
    double push_kpa = 0;                 ///< sideways, any direction: of a blade, a dip, a tilt
    double peel_mm = 0;                  ///< first part of the lift, in which the film comes off; 0: none
    double peel_speed_mm_per_s = 0;      ///< of that part; stated where there is one
    double approach_mm = 0;              ///< last part of the lowering, in which resin is pressed out; 0: none
    double approach_speed_mm_per_s = 0;  ///< of that part; stated where there is one
    double wait_after_exposure_s = 0;    ///< dark and at rest before the lift
    double wait_after_lift_s = 0;        ///< on top of the lift: resin flows back
    double tilt_s = 0;                   ///< the vat tips down and up again before the lift; 0: it does not tip
    double acceleration_mm_per_s2 = 0;   ///< of the axis, for estimates; 0: not stated, taken as at once
    double homing_speed_mm_per_s = 0;    ///< for estimates and deadlines; 0: not stated
    double most_speed_mm_per_s = 0;      ///< no speed of the stage is above; 0: not stated
    double large_area_mm2 = 0;           ///< a layer that lights more moves as `large`; 0: none does
    Stroke large;                        ///< of layers above large_area_mm2
    Stroke bottom;                       ///< of the bottom layers; goes before `large`
    friend bool operator==(const Motion&, const Motion&) = default;
    /// A value of `bottom`, where the layer is one and it is stated; else of `large` likewise; else of all layers.
    [[nodiscard]] Stroke stroke_of(bool is_bottom, bool is_large) const;
  } motion;

  struct Devices {
    ProjectorKind projector = ProjectorKind::Virtual;
    StageKind stage = StageKind::Virtual;
    LightSwitch light = LightSwitch::Projector;
    double speed_up = 1.0;                             ///< virtual devices only: simulated seconds per real second
    std::uint32_t led_current = 0;                     ///< dlpc900: 0..255, never sent above
    LedColour led_colour = LedColour::Blue;            ///< dlpc900
    LedPolarity led_polarity = LedPolarity::Unstated;  ///< dlpc900: it is not lit before this is stated
    LedOff led_off = LedOff::Enable;                   ///< dlpc900
    /// dlpc900 with LedOff::EnableAndCurrent, screen whose lamp is always on
    LedCutoff led_cutoff = LedCutoff::None;
    Thermometer thermometer = Thermometer::None;  ///< marlin
    double hottest_celsius = 0;                   ///< resin above this stops the print; 0: no limit
    double coldest_celsius = 0;                   ///< resin below this stops the print; 0: no limit
    double allowed_slowdown = 1.1;  ///< real projectors: a job whose uploads stretch it beyond this is refused
    std::string projector_serial;   ///< USB serial number of the light engine; empty: the only one found
    std::string stage_serial;       ///< USB serial number of the stage's tty; empty: the only one found
    PrinterKind printer = PrinterKind::None;  ///< a whole printer: projector and stage are not used then
    std::string printer_address;              ///< IP address or host name; empty: found by its broadcast
    std::string printer_id;                   ///< sdcp: its MainboardID; empty: whichever answers
    friend bool operator==(const Devices&, const Devices&) = default;
  } devices;

  /// The screen that shows the masks, where the projector is one.
  struct Screen {
    std::string connector;        ///< "HDMI-A-1"; beginning with '/': a framebuffer or a plain file
    std::string edid;             ///< who it must be, as `telefab-fab probe` prints it; "none": it gives no EDID
    std::uint32_t width_px = 0;   ///< words of its mode across
    std::uint32_t height_px = 0;  ///< rows of its mode
    double refresh_hz = 0;        ///< 0: a framebuffer, which states none
    ScreenTurn rotation = ScreenTurn::None;
    PixelPacking packing = PixelPacking::Grey;
    std::uint32_t latency_frames = 3;  ///< from the flip that is confirmed to a picture that stands
    friend bool operator==(const Screen&, const Screen&) = default;
  } screen;

  /// The light that the board of the stage switches, where it does.
  struct Light {
    LightCommand command = LightCommand::Spindle;
    std::uint32_t number = 0;         ///< of the fan or the pin
    double power = 1;                 ///< (0, 1]; of the board's full PWM: what is full light
    std::uint32_t steps = 1;          ///< equal steps from dark to full; 1: it is not dimmed
    std::uint32_t packet_bytes = 32;  ///< that its adapter carries whole: 32 of a CH340, 64 of CDC and FTDI
    friend bool operator==(const Light&, const Light&) = default;
  } light;

  /// The file that the printer takes, where it takes one.
  struct File {
    PrinterFile kind = PrinterFile::None;
    std::string model;                    ///< of the printer, as its firmware compares it; empty: not stated
    std::string variant;                  ///< sl1: printerVariant; empty: "default"
    FadeReader fade = FadeReader::Slafw;  ///< sl1
    double most_exposure_error = 0.05;    ///< share; a file in which a layer is off by more is held
    friend bool operator==(const File&, const File&) = default;
  } file;

  friend bool operator==(const MachineProfile&, const MachineProfile&) = default;

  /// As stated, or assumed: 20 kPa.
  [[nodiscard]] double pull_of_film_kpa() const;
  /// Under the opening of a hollow that the film closes. As stated, or assumed: 2.5 times the pull.
  [[nodiscard]] double vacuum_of_hollow_kpa() const;
  /// Pull on a layer that lights so much, over the pull as stated: by the speed with which it comes off the film.
  [[nodiscard]] double pull_share_of_layer(std::uint32_t print_layer, double lit_mm2) const;
  /// Weight of a layer of the part over the pull of the film on as much area.
  [[nodiscard]] double weight_share() const;
  /// In bending; as stated, or assumed: 160 MPa.
  [[nodiscard]] double modulus_of_green_mpa() const;
  /// Stress over pull that this resin bears on this machine: strength of a fresh tip / (safety * pull). What a plan may
  /// ask for at most. A strength that is not stated is assumed: 10 MPa.
  [[nodiscard]] double carried_demand() const;
  /// How far one layer may reach beyond what it is attached to. As stated: least * (1 + growth * sqrt(attached area)),
  /// at most the stated most. By bending, where none is stated: a strip cured once, pulled on its face by the film, t *
  /// sqrt(kappa * carried_demand() / 3), whatever it is attached to.
  [[nodiscard]] double self_support_reach_mm(double attached_mm2) const;
  /// kappa of that, as stated or computed: what the section bears in bending, strength rising with dose, over what a
  /// full section as thick as the layer bears.
  [[nodiscard]] double overhang_share() const;
  /// Whether a calibration says how well Ec and Dp are known.
  [[nodiscard]] bool states_calibration_band() const;
  /// Whether `key`, as "motion.pull_kpa", is among the assumed ones.
  [[nodiscard]] bool is_assumed(std::string_view key) const;
  /// Whether pull and strength are stated and not assumed, so that a print may be held against them.
  [[nodiscard]] bool states_what_carries() const;
  /// floor(platform / pitch), at least one pixel either way.
  [[nodiscard]] PixelSize mask_size() const;
  /// In multiples of what the light is timed; 0: to a microsecond. GRBL dwells in steps of 50 ms.
  [[nodiscard]] double exposure_step_s() const;
  /// Of a layer of the print in seconds at its own light: bottom, in transition (to the nearest step) or normal.
  [[nodiscard]] double exposure_of_layer_s(std::uint32_t print_layer) const;
  /// Of full irradiance, of a layer of the print.
  [[nodiscard]] double light_share_of_layer(std::uint32_t print_layer) const;
  /// The same doses by exposures at full light: what computes doses goes by it. Of itself, itself.
  [[nodiscard]] MachineProfile at_full_light() const;
  /// Along x, y and z of the platform: what is drawn so many times as long has the right length once it has shrunk.
  [[nodiscard]] std::array<double, 3> drawn_scale() const;
  /// As stated, or assumed: 20 mm/s of a virtual stage, 2 mm/s of a real one.
  [[nodiscard]] double homing_mm_per_s() const;
  /// Largest of any layer.
  [[nodiscard]] double highest_lift_mm() const;
  /// Chord tolerance of the slicer: a tenth of the pixel pitch (paper 3.2.4).
  [[nodiscard]] double chord_tolerance_mm() const { return projection.pixel_pitch_mm / 10; }
};

/// Irradiance of a pixel of each grey level as share of full irradiance: leak + (1 - leak) H(grey); the last is 1.
[[nodiscard]] std::array<double, 256> tone_of(const MachineProfile::Projection& projection);

/// The field at a place of the mask: across 0 (left) to 1 (right), down 0 (back) to 1 (front). 1 without a field.
[[nodiscard]] double field_at(const MachineProfile::Projection& projection, double across, double down);

/// Fails with InvalidInput: `origin` (a path, for the message), line, key, what is wrong and the legal range.
[[nodiscard]] Result<MachineProfile> machine_profile_from_toml(std::string_view text, std::string_view origin);

/// The same profile as TOML with every key, but for those that came later and still hold their default: what an older
/// version wrote or digested stays the same text. from_toml(to_toml(p)) == p.
[[nodiscard]] std::string to_toml(const MachineProfile& profile);

/// The profile as both sites compare it, over its TOML text: what the virtual devices do is the fab's own matter, and
/// what is assumed changes nothing of a print.
[[nodiscard]] Digest digest_of_profile(MachineProfile profile);

/// One line a key: name, range, reason. For documentation and `--help`.
[[nodiscard]] std::string describe_keys();

/// The profile of that name; InvalidInput lists the names there are.
[[nodiscard]] Result<MachineProfile> find_machine(const std::vector<MachineProfile>& machines, std::string_view name);

}  // namespace telefab
