// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <telefab/base/nearest_name.hpp>
#include <telefab/machine/exposure_time.hpp>
#include <telefab/machine/profile_catalogue.hpp>

#include "profile_values.hpp"

namespace telefab {
namespace {

constexpr std::array<std::string_view, 4> kOrigins{"stated", "inherited", "derived", "default"};
constexpr std::string_view kThickness = "layers.thickness_mm";
constexpr std::string_view kExposure = "layers.exposure_s";
constexpr std::string_view kBottomExposure = "layers.bottom_exposure_s";
constexpr std::string_view kVat = "resin.vat_ml";  // the machine's, whatever is in it
constexpr double kMillisecondsPerSecond = 1000;

/// Heights are typed in, not computed.
bool is_same_height(double a_mm, double b_mm) { return std::abs(a_mm - b_mm) < 1e-9; }

int line_of(const ProfilePart& part, const std::string& heading) {
  const auto line = part.headings.find(heading);
  return line == part.headings.end() ? 1 : line->second;
}

tl::unexpected<Error> refuse_part(const ProfilePart& part, const std::string& heading, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("{}, line {}: {}", part.origin, line_of(part, heading), what));
}

Result<void> check_names(const std::vector<ProfilePart>& parts) {
  for (const ProfilePart& part : parts)
    if (part.is_reference)
      return refuse_part(part, "built_in", "built_in is what sites tell each other; inherit from the built-in file");
  for (const ProfilePart& part : parts)
    if (part.is_instance && (part.kind != ProfileKind::Machine || part.inherits.empty()))
      return refuse_part(part, "is_instance", "one machine of a profile inherits from it");
  std::set<std::pair<ProfileKind, std::string_view>> names;
  for (const ProfilePart& part : parts)
    if (!names.emplace(part.kind, part.name).second)
      return refuse_part(part, "name", fmt::format("a second {} is named {}", name_of(part.kind), part.name));
  return {};
}

const ProfilePart* find_in(const std::vector<ProfilePart>& parts, ProfileKind kind, std::string_view name) {
  const auto found = std::ranges::find_if(parts, [&](const auto& p) { return p.kind == kind && p.name == name; });
  return found == parts.end() ? nullptr : &*found;
}

/// Brings along what is inherited from and not there, and what that inherits from.
Result<void> add_parents(std::vector<ProfilePart>& parts, const std::vector<ProfilePart>& parents) {
  for (std::size_t i = 0; i < parts.size(); ++i) {  // grows while it is walked
    const std::string wanted = parts[i].inherits;
    const ProfileKind kind = parts[i].kind;
    if (wanted.empty() || find_in(parts, kind, wanted)) continue;
    const ProfilePart* parent = find_in(parents, kind, wanted);
    if (!parent)
      return refuse_part(parts[i], "inherits",
                         fmt::format("inherits \"{}\", and no {} is named so", wanted, name_of(kind)));
    parts.push_back(*parent);
    parts.back().is_base = true;
  }
  return {};
}

/// All that are built in, by their files.
const std::vector<ProfilePart>& builtin_parts() {
  static const std::vector<ProfilePart> all = [] {
    std::vector<ProfilePart> parts;
    for (const ProfileKind kind : kProfileKinds)
      if (auto of_kind = builtin_profile_parts(kind)) std::ranges::move(*of_kind, std::back_inserter(parts));
    return parts;
  }();
  return all;
}

Result<void> check_rings(const std::vector<ProfilePart>& parts) {
  for (const ProfilePart& part : parts) {
    std::vector<std::string_view> names{part.name};
    for (const ProfilePart* at = &part; !at->inherits.empty();) {
      at = find_in(parts, part.kind, at->inherits);
      const bool is_ring = std::ranges::find(names, at->name) != names.end();
      names.push_back(at->name);
      if (is_ring)
        return refuse_part(part, "inherits", fmt::format("inherits in a ring: {}", fmt::join(names, " <- ")));
    }
  }
  return {};
}

}  // namespace

std::string_view name_of(ValueOrigin origin) { return kOrigins[static_cast<std::size_t>(origin)]; }

/// One profile in the making.
class Composition {
 public:
  explicit Composition(const ProfileCatalogue& catalogue) : catalogue_{catalogue} {
    for (const Key& key : profile_keys())
      composed_.values.push_back({label_of(key), {}, ValueOrigin::Default, {}, false});
  }

  /// Takes all that the chain of a part states, but exposures of another machine or resin.
  void take(const ProfilePart& part) {
    for (const ProfilePart* each : catalogue_.chain_of(part))
      for (std::size_t i = 0; i < profile_keys().size(); ++i) {
        const std::string& key = composed_.values[i].key;
        if (!each->states(key) || (is_exposure(key) && part.kind != ProfileKind::Machine)) continue;
        take_value(i, *each, each == &part);
      }
  }

  /// Nothing of the resin before holds for another; the vat is the machine's.
  void clear_resin() {
    const MachineProfile untouched;
    for (std::size_t i = 0; i < profile_keys().size(); ++i) {
      const Key& key = profile_keys()[i];
      if (key.section != "resin" || composed_.values[i].key == kVat) continue;
      copy_value(key, untouched, composed_.profile);
      composed_.values[i] = {composed_.values[i].key, {}, ValueOrigin::Default, {}, false};
    }
  }

  /// The exposures, once all else is known.
  Result<void> expose(const ProfilePart& machine, const ProfilePart* resin, const ProfilePart* print) {
    // What a machine states is for the resin that it states itself, also where another is loaded later.
    const bool is_own = !resin && is_same_height(machine_thickness_mm_, composed_.profile.layers.thickness_mm);
    for (const std::string_view key : {kExposure, kBottomExposure}) {
      const std::string name{key};
      if (print && is_for(*print, machine, resin) && take_exposure(*print, name)) continue;
      if (resin && take_published(*resin, machine, name)) continue;
      if (is_own && value(name).origin != ValueOrigin::Default) continue;
      if (auto derived = derive(name); !derived) return derived;
    }
    return {};
  }

  /// Before a print is taken: what the machine's exposures are for.
  void keep_machine_thickness() { machine_thickness_mm_ = composed_.profile.layers.thickness_mm; }

  [[nodiscard]] Result<void> check_required(const ProfilePart& machine) const {
    for (std::size_t i = 0; i < profile_keys().size(); ++i) {
      const Key& key = profile_keys()[i];
      const ComposedValue& each = composed_.values[i];
      if (!key.required || each.origin != ValueOrigin::Default || is_exposure(each.key)) continue;
      return refuse_part(machine, "name", fmt::format("{} is missing ({}; {})", each.key, key.reason, range_of(key)));
    }
    return {};
  }

  [[nodiscard]] Result<void> check_fit() const {
    const auto misfit = misfit_of(composed_.profile);
    if (!misfit) return {};
    std::set<std::string_view> files;
    for (const ComposedValue& each : composed_.values)
      if (each.key.starts_with(misfit->section) && !each.file.empty()) files.insert(each.file);
    return fail(ErrorCode::InvalidInput, fmt::format("{}{}: {}", files.size() > 1 ? "profiles " : "profile ",
                                                     fmt::join(files, ", "), misfit->what));
  }

  [[nodiscard]] ComposedProfile finish() && {
    for (std::size_t i = 0; i < profile_keys().size(); ++i) {
      ComposedValue& each = composed_.values[i];
      each.value = value_text(profile_keys()[i], composed_.profile);
      if (each.is_assumed && each.origin != ValueOrigin::Derived) composed_.profile.assumed.push_back(each.key);
    }
    return std::move(composed_);
  }

  /// Of the youngest file that states one.
  void take_price(const ProfilePart& resin) {
    for (const ProfilePart* each : catalogue_.chain_of(resin))
      if (each->price) composed_.price = each->price;
  }

  ComposedProfile& composed() { return composed_; }

 private:
  static bool is_exposure(std::string_view key) { return key == kExposure || key == kBottomExposure; }

  ComposedValue& value(std::string_view key) { return *std::ranges::find(composed_.values, key, &ComposedValue::key); }

  void take_value(std::size_t i, const ProfilePart& part, bool is_own) {
    copy_value(profile_keys()[i], part.values, composed_.profile);
    ComposedValue& each = composed_.values[i];
    each.origin = is_own ? ValueOrigin::Stated : ValueOrigin::Inherited;
    each.file = part.file;
    each.is_assumed = std::ranges::find(part.assumed, each.key) != part.assumed.end();
  }

  [[nodiscard]] std::string inherited_text(const ProfilePart& part, std::string ProfilePart::*field) const {
    std::string text;
    for (const ProfilePart* each : catalogue_.chain_of(part))
      if (!(each->*field).empty()) text = each->*field;
    return text;
  }

  /// Whether `part` is the one named, or inherits from it.
  [[nodiscard]] bool is_a(const ProfilePart& part, std::string_view name) const {
    return std::ranges::any_of(catalogue_.chain_of(part), [&](const auto* each) { return each->name == name; });
  }

  [[nodiscard]] bool is_for(const ProfilePart& print, const ProfilePart& machine, const ProfilePart* resin) const {
    const std::string for_machine = inherited_text(print, &ProfilePart::for_machine);
    const std::string for_resin = inherited_text(print, &ProfilePart::for_resin);
    return (for_machine.empty() || is_a(machine, for_machine)) &&
           (for_resin.empty() || (resin && is_a(*resin, for_resin)));
  }

  bool take_exposure(const ProfilePart& print, const std::string& key) {
    bool is_taken = false;
    for (const ProfilePart* each : catalogue_.chain_of(print))
      if (each->states(key)) {
        take_value(static_cast<std::size_t>(&value(key) - composed_.values.data()), *each, each == &print);
        is_taken = true;
      }
    return is_taken;
  }

  /// The youngest file that publishes one for this machine, or for the nearest that it inherits from.
  bool take_published(const ProfilePart& resin, const ProfilePart& machine, const std::string& key) {
    const auto machines = catalogue_.chain_of(machine);
    const auto resins = catalogue_.chain_of(resin);
    for (auto by = machines.rbegin(); by != machines.rend(); ++by)
      for (auto of = resins.rbegin(); of != resins.rend(); ++of)
        for (const PublishedExposure& each : (*of)->exposures) {
          const double seconds = key == kExposure ? each.exposure_s : each.bottom_exposure_s;
          if (each.machine != (*by)->name || seconds == 0 ||
              !is_same_height(each.thickness_mm, composed_.profile.layers.thickness_mm))
            continue;
          set_seconds(key, seconds);
          value(key) = {key, {}, *of == &resin ? ValueOrigin::Stated : ValueOrigin::Inherited, (*of)->file, false};
          return true;
        }
    return false;
  }

  void set_seconds(std::string_view key, double seconds) {
    auto& layers = composed_.profile.layers;
    (key == kExposure ? layers.exposure_s : layers.bottom_exposure_s) = seconds;
  }

  Result<void> derive(const std::string& key) {
    const MachineProfile& p = composed_.profile;
    double seconds = 0;
    bool is_assumed = false;
    if (key == kExposure) {
      const double dose_mj_per_cm2 =
          p.resin.critical_dose_mj_per_cm2 * std::exp(2 * p.layers.thickness_mm / p.resin.penetration_mm);
      seconds = dose_mj_per_cm2 / p.projection.irradiance_mw_per_cm2;
      for (const std::string_view from :
           {"resin.critical_dose_mj_per_cm2", "resin.penetration_mm", "projection.irradiance_mw_per_cm2"})
        is_assumed = is_assumed || value(from).is_assumed || value(from).origin == ValueOrigin::Default;
    } else {
      seconds = p.layers.exposure_s * p.layers.bottom_factor;
      is_assumed = value(kExposure).is_assumed;
    }
    // To a millisecond: two processors may differ in the last digit of exp, and both sites compare what they find.
    // A board may time light in coarser steps.
    seconds = timed_exposure_s(p, std::round(seconds * kMillisecondsPerSecond) / kMillisecondsPerSecond);
    const Key& row = *find_key("layers", std::string_view{key}.substr(std::string_view{"layers."}.size()));
    const auto& range = std::get<NumberKey>(row.kind);
    if (!(seconds >= range.least && seconds <= range.most))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{}: {} for {} mm layers of {} would be {} s, beyond {}; state it in a print profile, or "
                              "correct Ec, Dp and irradiance",
                              p.name, key, p.layers.thickness_mm, p.resin.name, seconds, range_of(row)));
    set_seconds(key, seconds);
    value(key) = {key, {}, ValueOrigin::Derived, {}, is_assumed};
    return {};
  }

  const ProfileCatalogue& catalogue_;
  ComposedProfile composed_;
  double machine_thickness_mm_ = 0;
};

Result<ProfileCatalogue> ProfileCatalogue::from(std::vector<ProfilePart> parts,
                                                const std::vector<ProfilePart>& parents) {
  if (auto ok = check_names(parts); !ok) return tl::unexpected{ok.error()};
  if (auto ok = add_parents(parts, parents); !ok) return tl::unexpected{ok.error()};
  if (auto ok = check_rings(parts); !ok) return tl::unexpected{ok.error()};
  ProfileCatalogue catalogue{std::move(parts)};
  for (const ProfilePart* machine : catalogue.offered(ProfileKind::Machine)) {
    auto composed = catalogue.compose({machine->name});
    if (!composed) return tl::unexpected{composed.error()};
    catalogue.machines_.push_back(std::move(composed->profile));
  }
  return catalogue;
}

Result<ProfileCatalogue> ProfileCatalogue::from_texts(std::span<const std::string> machines,
                                                      std::span<const std::string> resins,
                                                      std::span<const std::string> prints, std::string_view origin) {
  std::vector<ProfilePart> parts;
  for (const auto& [kind, texts] :
       {std::pair{ProfileKind::Machine, machines}, {ProfileKind::Resin, resins}, {ProfileKind::Print, prints}})
    for (const std::string& text : texts) {
      auto part = profile_part_from_toml(kind, text, origin);
      if (!part) return tl::unexpected{part.error()};
      if (part->is_reference) {
        const ProfilePart* own = find_in(builtin_parts(), kind, part->name);
        if (!own)
          continue;  // of another release; whoever chooses it, or inherits from it, is told that it is not known
        const bool is_base = part->is_base;
        *part = *own;
        part->is_base = is_base;
      }
      parts.push_back(std::move(*part));
    }
  return from(std::move(parts));
}

std::vector<std::string> ProfileCatalogue::texts(ProfileKind kind) const {
  std::vector<std::string> texts;
  for (const ProfilePart& part : parts_) {
    if (part.kind != kind) continue;
    ProfilePart sent = part;
    if (const ProfilePart* own = find_in(builtin_parts(), kind, part.name)) {
      ProfilePart same = *own;
      same.is_base = part.is_base;
      sent.is_reference = to_toml(same) == to_toml(part);
    }
    texts.push_back(to_toml(sent));
  }
  return texts;
}

std::vector<const ProfilePart*> ProfileCatalogue::offered(ProfileKind kind) const {
  std::vector<const ProfilePart*> found;
  for (const ProfilePart& part : parts_)
    if (part.kind == kind && !part.is_base) found.push_back(&part);
  return found;
}

const ProfilePart* ProfileCatalogue::find(ProfileKind kind, std::string_view name) const {
  return find_in(parts_, kind, name);
}

Result<const ProfilePart*> ProfileCatalogue::choose(ProfileKind kind, std::string_view name) const {
  if (const ProfilePart* part = find(kind, name); part && !part->is_base) return part;
  std::vector<std::string> names;
  for (const ProfilePart* each : offered(kind)) names.push_back(each->name);
  return fail(ErrorCode::InvalidInput, fmt::format("no {} named {}; {}", name_of(kind), name,
                                                   names_instead(name, names, fmt::format("`{}s`", name_of(kind)))));
}

std::vector<const ProfilePart*> ProfileCatalogue::chain_of(const ProfilePart& part) const {
  std::vector<const ProfilePart*> chain{&part};
  while (!chain.back()->inherits.empty()) chain.push_back(find(part.kind, chain.back()->inherits));
  std::reverse(chain.begin(), chain.end());
  return chain;
}

Result<ComposedProfile> ProfileCatalogue::compose(const ProfileChoice& choice) const {
  const auto machine = choose(ProfileKind::Machine, choice.machine);
  if (!machine) return tl::unexpected{machine.error()};
  std::string loaded, print_name = choice.print;
  for (const ProfilePart* each : chain_of(**machine)) {
    if (!each->loaded_resin.empty()) loaded = each->loaded_resin;
    if (choice.print.empty() && !each->default_print.empty()) print_name = each->default_print;
  }
  if (!loaded.empty() && !choice.resin.empty() && choice.resin != loaded)
    return fail(ErrorCode::Conflict,
                fmt::format("{} has the resin {} loaded, not {}; load it and state loaded_resin in {}, or choose {}",
                            choice.machine, loaded, choice.resin, (*machine)->file, loaded));
  const std::string resin_name = choice.resin.empty() ? loaded : choice.resin;
  const ProfilePart* resin = nullptr;
  if (!resin_name.empty()) {
    const auto chosen = choose(ProfileKind::Resin, resin_name);
    if (!chosen && choice.resin.empty()) return refuse_part(**machine, "loaded_resin", chosen.error().what);
    if (!chosen) return tl::unexpected{chosen.error()};
    resin = *chosen;
  }
  const ProfilePart* print = nullptr;
  if (!print_name.empty()) {
    const auto chosen = choose(ProfileKind::Print, print_name);
    if (!chosen && choice.print.empty()) return refuse_part(**machine, "default_print", chosen.error().what);
    if (!chosen) return tl::unexpected{chosen.error()};
    print = *chosen;
  }
  Composition making{*this};
  making.composed().profile.name = (*machine)->is_instance ? (*machine)->inherits : (*machine)->name;
  making.composed().profile.description = (*machine)->description;
  making.composed().resin = resin_name;
  making.composed().print = print_name;
  making.take(**machine);
  making.keep_machine_thickness();
  if (resin) {
    making.clear_resin();
    making.composed().profile.resin.name = resin->name;
    making.take(*resin);
  }
  if (resin) making.take_price(*resin);
  if (print) making.take(*print);
  if (auto whole = making.check_required(**machine); !whole) return tl::unexpected{whole.error()};
  if (auto exposed = making.expose(**machine, resin, print); !exposed) return tl::unexpected{exposed.error()};
  if (auto fits = making.check_fit(); !fits) return tl::unexpected{fits.error()};
  return std::move(making).finish();
}

Result<ComposedProfile> ProfileCatalogue::resin(std::string_view name) const {
  const auto part = choose(ProfileKind::Resin, name);
  if (!part) return tl::unexpected{part.error()};
  Composition making{*this};
  making.composed().profile.resin.name = (*part)->name;
  making.composed().resin = (*part)->name;
  making.take(**part);
  making.take_price(**part);
  return std::move(making).finish();
}

Result<ComposedProfile> ProfileCatalogue::print(std::string_view name) const {
  const auto part = choose(ProfileKind::Print, name);
  if (!part) return tl::unexpected{part.error()};
  Composition making{*this};
  making.composed().print = (*part)->name;
  making.take(**part);
  return std::move(making).finish();
}

}  // namespace telefab
