// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/signature.hpp>

#include "print_record_json.hpp"

namespace telefab::fab {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::string_view kFormat = "telefab-as-built-1";
constexpr double kHeightTolerance_mm = 0.005;

Json record_json(const PrintRecord& r) {
  Json layers = Json::array();
  for (const LayerRecord& l : r.layers) layers.push_back(layer_to_json(l));
  Json provenance = Json::object();
  for (const auto& [key, value] : r.provenance) provenance[key] = value;
  Json json{{"format", kFormat},
            {"job", r.job},
            {"machine", r.machine},
            {"plan_sha256", to_hex(r.plan)},
            {"outcome", name_of(r.outcome)},
            {"next_layer", r.next.count()},
            {"maybe_exposed", r.maybe_exposed},
            {"cause_code", static_cast<int>(r.cause.code)},
            {"cause", r.cause.what},
            {"runs", r.runs},
            {"projector", r.projector},
            {"stage", r.stage},
            {"provenance", std::move(provenance)},
            {"layers", std::move(layers)}};
  if (!r.orders.empty()) {
    Json orders = Json::array();
    for (const OrderRecord& o : r.orders) {
      Json order{{"word", o.word}, {"by", o.by}, {"wall_ns", o.wall.count()}};
      if (!o.why.empty()) order["why"] = o.why;
      orders.push_back(std::move(order));
    }
    json["orders"] = std::move(orders);
  }
  if (!r.gaps.empty()) json["journal_gaps"] = r.gaps;
  if (r.attempt > 0) json["attempt"] = r.attempt;
  if (r.withheld != FenceRefusal::None) json["withheld"] = name_of(r.withheld);
  return json;
}

Digest digest_from_json(const nlohmann::ordered_json& j) {
  const auto digest = digest_from_hex(j.get<std::string>());
  if (!digest) throw nlohmann::ordered_json::other_error::create(501, digest.error().what, nullptr);
  return *digest;
}

JournalStep note_from(const nlohmann::ordered_json& j) {
  const auto text = j.get<std::string>();
  for (const JournalStep step : {JournalStep::Exposed, JournalStep::Passed, JournalStep::DecidedTreatAsExposed})
    if (name_of(step) == text) return step;
  throw nlohmann::ordered_json::other_error::create(501, "unknown note " + text, nullptr);
}

FenceRefusal refusal_from(const nlohmann::ordered_json& j) {
  const auto text = j.get<std::string>();
  for (const FenceRefusal each : {FenceRefusal::Superseded, FenceRefusal::LeaseEnded, FenceRefusal::Unanswered})
    if (name_of(each) == text) return each;
  throw nlohmann::ordered_json::other_error::create(501, "unknown refusal " + text, nullptr);
}

PrintRecord record_from(const nlohmann::ordered_json& j) {
  if (j.at("format") != kFormat) throw nlohmann::ordered_json::other_error::create(501, "unknown format", nullptr);
  PrintRecord r;
  r.job = j.at("job").get<std::string>();
  r.machine = j.at("machine").get<std::string>();
  r.plan = digest_from_json(j.at("plan_sha256"));
  const auto outcome = j.at("outcome").get<std::string>();
  const auto known = {PrintOutcome::Done, PrintOutcome::Cancelled, PrintOutcome::Faulted};
  const auto found = std::find_if(known.begin(), known.end(), [&](PrintOutcome o) { return name_of(o) == outcome; });
  if (found == known.end()) throw nlohmann::ordered_json::other_error::create(501, "unknown outcome", nullptr);
  r.outcome = *found;
  r.next = LayerIndex{whole_number<std::uint32_t>(j.at("next_layer"))};
  r.maybe_exposed = j.at("maybe_exposed").get<bool>();
  r.cause = {static_cast<ErrorCode>(whole_number<int>(j.at("cause_code"))), j.at("cause").get<std::string>()};
  r.runs = whole_number<std::uint32_t>(j.at("runs"));
  r.projector = j.at("projector").get<std::string>();
  r.stage = j.at("stage").get<std::string>();
  for (const auto& [key, value] : j.at("provenance").items()) r.provenance[key] = value.get<std::string>();
  for (const auto& l : j.at("layers")) r.layers.push_back(layer_from_json(l));
  if (j.contains("orders"))
    for (const auto& o : j.at("orders"))
      r.orders.push_back({o.at("word").get<std::string>(), o.at("by").get<std::string>(), o.value("why", ""),
                          Nanoseconds{whole_number<std::int64_t>(o.at("wall_ns"))}});
  if (j.contains("attempt")) r.attempt = whole_number<std::uint32_t>(j.at("attempt"));
  if (j.contains("withheld")) r.withheld = refusal_from(j.at("withheld"));
  if (j.contains("journal_gaps")) r.gaps = j.at("journal_gaps").get<std::vector<std::string>>();
  return r;
}

tl::unexpected<Error> no_record(const std::exception& e) {
  return fail(ErrorCode::InvalidInput, std::string{"the as-built record is not as expected: "} + e.what());
}

}  // namespace

std::string_view name_of(FenceRefusal refusal) {
  static constexpr std::string_view names[] = {"none", "superseded", "lease-ended", "unanswered"};
  static_assert(std::size(names) == static_cast<std::size_t>(FenceRefusal::Unanswered) + 1);
  return names[static_cast<std::size_t>(refusal)];
}

std::string_view name_of(PrintOutcome outcome) {
  static constexpr std::string_view names[] = {"done", "cancelled", "faulted"};
  return names[static_cast<std::size_t>(outcome)];
}

Json layer_to_json(const LayerRecord& l) {
  Json j{{"layer", l.index.count()},
         {"z_mm", l.z_mm},
         {"planned_us", l.planned.count()},
         {"measured_us", l.measured.count()},
         {"started_wall_ns", l.started_wall.count()},
         {"retries", l.retries},
         {"parts", l.parts},
         {"mask_sha256", to_hex(l.mask)},
         {"note", name_of(l.note)}};
  if (!l.decided.empty()) j["decided"] = l.decided;
  if (l.resin_celsius) j["resin_celsius"] = *l.resin_celsius;
  return j;
}

LayerRecord layer_from_json(const nlohmann::ordered_json& j) {
  LayerRecord l;
  l.index = LayerIndex{whole_number<std::uint32_t>(j.at("layer"))};
  l.z_mm = j.at("z_mm").get<double>();
  l.planned = Microseconds{whole_number<std::int64_t>(j.at("planned_us"))};
  l.measured = Microseconds{whole_number<std::int64_t>(j.at("measured_us"))};
  l.started_wall = Nanoseconds{whole_number<std::int64_t>(j.at("started_wall_ns"))};
  l.retries = whole_number<std::uint32_t>(j.at("retries"));
  l.parts = whole_number<std::uint32_t>(j.at("parts"));
  l.mask = digest_from_json(j.at("mask_sha256"));
  l.note = note_from(j.at("note"));
  l.decided = j.value("decided", "");
  if (j.contains("resin_celsius")) l.resin_celsius = j.at("resin_celsius").get<double>();
  return l;
}

std::string to_json(const PrintRecord& record) { return json_text(record_json(record), 1) + "\n"; }

Result<PrintRecord> print_record_from_json(std::string_view text) {
  try {
    return record_from(parsed_json(text));
  } catch (const nlohmann::ordered_json::exception& e) {
    return no_record(e);
  }
}

std::vector<std::string> compare(const PrintRecord& record, const PrintPlan& plan) {
  std::vector<std::string> findings;
  if (record.plan != plan_digest(plan)) findings.emplace_back("the record belongs to another plan");
  for (const std::string& gap : record.gaps) findings.push_back("the print's journal: " + gap);
  if (record.outcome != PrintOutcome::Done)
    findings.push_back(fmt::format("the print ended {} at layer {}", name_of(record.outcome), record.next.count()));
  if (record.layers.size() != plan.layers.size())
    findings.push_back(fmt::format("{} layers were made, {} were planned", record.layers.size(), plan.layers.size()));
  for (std::size_t i = 0; i < std::min(record.layers.size(), plan.layers.size()); ++i) {
    const LayerRecord& made = record.layers[i];
    const PlannedLayer& want = plan.layers[i];
    const auto add_finding = [&](std::string_view what) { findings.push_back(fmt::format("layer {}: {}", i, what)); };
    if (made.index.count() != i) {
      add_finding(i > 0 && made.index == record.layers[i - 1].index
                      ? fmt::format("layer {} was made a second time in its place", made.index.count())
                      : fmt::format("layer {} was made in its place", made.index.count()));
      break;
    }
    if (made.planned != want.exposure) add_finding("its exposure is not the planned one");
    if (want.exposure.count() == 0 || made.note == JournalStep::DecidedTreatAsExposed) continue;
    if (made.mask != want.mask) add_finding("another mask was shown");
    if (std::abs(made.z_mm - want.z_mm) > kHeightTolerance_mm)
      add_finding(fmt::format("made at {} mm, planned at {} mm", made.z_mm, want.z_mm));
    if (made.measured < want.exposure - want.exposure / 100 - Microseconds{17000})
      add_finding(fmt::format("lit for {} us, planned {} us", made.measured.count(), want.exposure.count()));
  }
  return findings;
}

namespace {

Result<std::string> sealed(const Json& body, std::string_view private_key_pem) {
  const std::string text = json_text(body);
  Json sealed{{"record", body}, {"sha256", to_hex(digest_of(std::as_bytes(std::span{text})))}};
  if (!private_key_pem.empty()) {
    const auto signature = sign_ed25519(private_key_pem, text);
    if (!signature) return fail_in("signing the as-built record", signature.error());
    sealed["ed25519"] = signature->signature_hex;
    sealed["public_key"] = signature->public_key_hex;
  }
  return json_text(sealed, 1) + "\n";
}

}  // namespace

Result<std::string> seal(const PrintRecord& record, std::string_view private_key_pem) {
  return sealed(record_json(record), private_key_pem);
}

Result<std::string> seal_json(std::string_view record, std::string_view private_key_pem) {
  try {
    return sealed(parsed_json(record), private_key_pem);
  } catch (const nlohmann::ordered_json::exception& e) {
    return no_record(e);
  }
}

Result<UnsealedJson> unseal_json(std::string_view sealed, std::string_view public_key_pem) {
  try {
    const Json j = parsed_json(sealed);
    UnsealedJson found{json_text(j.at("record")), {}};
    if (to_hex(digest_of(std::as_bytes(std::span{found.record}))) != j.at("sha256").get<std::string>())
      return fail(ErrorCode::NotTrusted, "the as-built record was changed after it was sealed: its hash does not hold");
    if (j.contains("ed25519")) {
      const Signature signature{j.at("ed25519").get<std::string>(), j.at("public_key").get<std::string>()};
      if (const auto ok = verify_ed25519(signature, found.record, public_key_pem); !ok)
        return fail_in("as-built record", ok.error());
      found.signed_by = signature.public_key_hex;
    } else if (!public_key_pem.empty()) {
      return fail(ErrorCode::NotTrusted, "the as-built record is not signed, and a key to check it with was given");
    }
    return found;
  } catch (const nlohmann::ordered_json::exception& e) {
    return no_record(e);
  }
}

Result<Unsealed> unseal(std::string_view sealed, std::string_view public_key_pem) {
  auto found = unseal_json(sealed, public_key_pem);
  if (!found) return tl::unexpected{found.error()};
  auto record = print_record_from_json(found->record);
  if (!record) return tl::unexpected{record.error()};
  return Unsealed{std::move(*record), std::move(found->signed_by)};
}

}  // namespace telefab::fab
