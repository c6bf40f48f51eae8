// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <optional>
#include <string>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/print/light_fence.hpp>
#include <telefab/fab/print/print_machine.hpp>

namespace telefab::fab {

/// How one layer was really made. Wall times are nanoseconds since 1970-01-01T00:00:00Z.
struct LayerRecord {
  LayerIndex index;
  double z_mm = 0;             ///< where the stage said it was
  Microseconds planned{0};     ///< zero: passed without light
  Microseconds measured{0};    ///< between the device's start and its end, up to one poll longer than it was
  Nanoseconds started_wall{};  ///< light on
  std::uint32_t retries = 0;   ///< commands repeated for it
  std::uint32_t parts = 1;     ///< exposures it was split into
  Digest mask;                 ///< of the grey bytes that were loaded
  JournalStep note = JournalStep::Exposed;  ///< or Passed, or DecidedTreatAsExposed (no measurement)
  std::optional<double> resin_celsius;
  /// Where the layer was perhaps exposed before a crash: what was decided and by whom, "exposed: NAME" or "again:
  /// NAME", NAME an operator or "policy"; one after the other, separated by "; ". Empty: it never was.
  std::string decided;
  friend bool operator==(const LayerRecord&, const LayerRecord&) = default;
};

/// A word of an operator, or of the site's policy, about the print.
struct OrderRecord {
  std::string word;  ///< "approved", "pause-asked", "resumed", "cancel-asked", "set-aside"
  std::string by;
  std::string why;  ///< what was said to it, such as why a held job was let through; may be empty
  Nanoseconds wall{};
  friend bool operator==(const OrderRecord&, const OrderRecord&) = default;
};

enum class PrintOutcome : std::uint8_t { Done, Cancelled, Faulted };
[[nodiscard]] std::string_view name_of(PrintOutcome outcome);

/// The as-built record of a job, over all its runs.
struct PrintRecord {
  std::string job;
  std::string machine;
  Digest plan;
  PrintOutcome outcome = PrintOutcome::Faulted;
  LayerIndex next;             ///< first layer not exposed
  bool maybe_exposed = false;  ///< Faulted only: `next` was perhaps exposed
  Error cause;                 ///< Faulted only
  std::uint32_t runs = 1;      ///< starts of the print, resumptions included
  std::string projector;       ///< its facts().name
  std::string stage;
  std::map<std::string, std::string> provenance;  ///< what the daemon knows: digests of scan and contours, transform...
  std::vector<LayerRecord> layers;                ///< in order of exposure
  std::vector<OrderRecord> orders;                ///< in order
  std::vector<std::string> gaps;                  ///< where the print's journal does not cover it
  std::uint32_t attempt = 0;                      ///< of the fleet's job; 0: it is no job of a fleet
  FenceRefusal withheld = FenceRefusal::None;     ///< Faulted only: why its next layer had no leave to be lit
  friend bool operator==(const PrintRecord&, const PrintRecord&) = default;
};

/// Canonical JSON: same record, same bytes.
[[nodiscard]] std::string to_json(const PrintRecord& record);
[[nodiscard]] Result<PrintRecord> print_record_from_json(std::string_view text);

/// What is wrong with a finished record against the plan it claims: every layer of the plan made exactly once and in
/// order, at its Z, with its mask, for its time, by a journal without gaps. Empty: nothing. One line a finding.
[[nodiscard]] std::vector<std::string> compare(const PrintRecord& record, const PrintPlan& plan);

/// The record sealed: {"record":..., "sha256":..., "ed25519":...,"public_key":...}; the signature only with a key.
/// `private_key_pem`: an Ed25519 key as `openssl genpkey -algorithm ed25519` writes it; empty: hash only.
[[nodiscard]] Result<std::string> seal(const PrintRecord& record, std::string_view private_key_pem);
struct Unsealed {
  PrintRecord record;
  std::string signed_by;  ///< Ed25519 public key in hexadecimal; empty: by nobody, so anybody could have written it
};
/// Any other record, a JSON object, sealed likewise.
[[nodiscard]] Result<std::string> seal_json(std::string_view record, std::string_view private_key_pem);
struct UnsealedJson {
  std::string record;     ///< canonical
  std::string signed_by;  ///< as Unsealed
};
/// The text of a sealed record of any kind. Fails as unseal().
[[nodiscard]] Result<UnsealedJson> unseal_json(std::string_view sealed, std::string_view public_key_pem);
/// The record of a sealed text. NotTrusted when hash or signature does not hold, or when `public_key_pem` is given and
/// the seal was made with another key or none. InvalidInput where it is no sealed record.
[[nodiscard]] Result<Unsealed> unseal(std::string_view sealed, std::string_view public_key_pem);

}  // namespace telefab::fab
