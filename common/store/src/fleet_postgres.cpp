// SPDX-License-Identifier: GPL-3.0-or-later
#include "fleet_postgres.hpp"

#include <fmt/format.h>
#include <libpq-fe.h>

#include <algorithm>
#include <optional>
#include <pqxx/pqxx>
#include <telefab/base/text.hpp>
#include <utility>

namespace telefab {
namespace {

constexpr const char* kChannel = "telefab_fleet";

/// What a name of a database says of where it is, for messages: without user and parameters.
std::string place_of(const std::string& uri) {
  std::string_view rest = uri;
  if (const auto scheme = rest.find("://"); scheme != std::string_view::npos) rest.remove_prefix(scheme + 3);
  rest = rest.substr(0, rest.find('?'));
  if (const auto at = rest.rfind('@'); at != std::string_view::npos) rest.remove_prefix(at + 1);
  return std::string{rest};
}

/// Whether a name has a password in it, however it is written there. InvalidInput: libpq cannot read the name.
Result<bool> has_password(const std::string& uri) {
  char* reason = nullptr;
  const std::unique_ptr<PQconninfoOption, decltype(&PQconninfoFree)> options{PQconninfoParse(uri.c_str(), &reason),
                                                                             &PQconninfoFree};
  const std::unique_ptr<char, decltype(&PQfreemem)> text{reason, &PQfreemem};
  if (!options)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the name of the fleet's database: {}", to_printable(text ? text.get() : "out of memory")));
  for (const PQconninfoOption* each = options.get(); each->keyword != nullptr; ++each)
    if (std::string_view{each->keyword} == "password" && each->val != nullptr) return true;
  return false;
}

/// `?` as PostgreSQL numbers values. Statements of the queue have no question mark elsewhere.
std::string numbered_values(const std::string& text) {
  std::string out;
  int number = 0;
  for (const char c : text)
    if (c == '?')
      out += '$' + std::to_string(++number);
    else
      out += c;
  return out;
}

std::string text_of(const SqlValue& value) {
  if (const auto* number = std::get_if<std::int64_t>(&value)) return std::to_string(*number);
  if (const auto* real = std::get_if<double>(&value)) return fmt::format("{}", *real);
  return std::get<std::string>(value);
}

class Changes final : public pqxx::notification_receiver {
 public:
  explicit Changes(pqxx::connection& connection) : pqxx::notification_receiver{connection, kChannel} {}
  void operator()(const std::string&, int) override { is_changed_ = true; }
  [[nodiscard]] bool take() { return std::exchange(is_changed_, false); }

 private:
  bool is_changed_ = false;
};

class FleetPostgres final : public FleetSql {
 public:
  explicit FleetPostgres(std::string uri) : uri_{std::move(uri)} {}

  Result<std::vector<SqlRow>> run(const std::string& text, std::vector<SqlValue> values) override {
    return guarded([&]() -> Result<std::vector<SqlRow>> {
      if (!work_) return fail(ErrorCode::Internal, "a statement outside of a transaction");
      // Whoever waits waits for events: to be told of every renewal would keep all sites awake.
      is_changed_ = is_changed_ || text.starts_with("INSERT INTO fleet_event");
      std::vector<std::string> texts;
      for (const SqlValue& value : values) texts.push_back(text_of(value));
      const pqxx::result found =
          work_->exec_params(numbered_values(text), pqxx::prepare::make_dynamic_params(texts.begin(), texts.end()));
      std::vector<SqlRow> rows;
      for (const auto& row : found) {
        SqlRow& columns = rows.emplace_back();
        for (const auto& field : row) columns.emplace_back(field.is_null() ? "" : field.c_str());
      }
      return rows;
    });
  }
  Result<void> begin() override {
    return guarded([&]() -> Result<void> {
      if (!connection_) {
        connection_.emplace(uri_);
        quiet_ = std::make_unique<pqxx::quiet_errorhandler>(*connection_);
        changes_ = std::make_unique<Changes>(*connection_);
      }
      work_.emplace(*connection_);
      is_changed_ = false;
      return {};
    });
  }
  Result<void> commit() override {
    return guarded([&]() -> Result<void> {
      if (is_changed_) work_->exec(fmt::format("NOTIFY {}", kChannel));
      work_->commit();
      work_.reset();
      return {};
    });
  }
  void roll_back() override {
    try {
      work_.reset();
    } catch (const std::exception&) {  // the first error is the one to tell
      let_go();
    }
  }
  Result<bool> wait(Nanoseconds longest) override {
    if (!connection_) {
      if (auto there = begin(); !there) return tl::unexpected{there.error()};
      roll_back();
    }
    return guarded([&]() -> Result<bool> {
      const auto micros = std::chrono::duration_cast<std::chrono::microseconds>(longest).count();
      if (!changes_->take()) connection_->await_notification(micros / 1'000'000, micros % 1'000'000);
      return changes_->take();
    });
  }

  std::string now() const override { return "(extract(epoch FROM clock_timestamp()) * 1000)::bigint"; }
  std::string_view skipping_locked() const override { return " FOR UPDATE OF j SKIP LOCKED"; }
  Result<void> be_alone() override {
    constexpr std::int64_t kAlone = 0x54464556;  // "TFEV"
    const auto locked = run("SELECT pg_advisory_xact_lock(?)", {kAlone});
    if (!locked) return tl::unexpected{locked.error()};
    return {};
  }
  std::string_view numbered() const override { return "BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY"; }
  Result<std::int64_t> version() override {
    const auto table = run("SELECT COUNT(*) FROM pg_catalog.pg_class WHERE oid = to_regclass('fleet_version')", {});
    if (!table) return tl::unexpected{table.error()};
    if (table->front().front() == "0") return 0;
    const auto version = run("SELECT version FROM fleet_version", {});
    if (!version) return tl::unexpected{version.error()};
    return version->empty() ? 0 : std::stoll(version->front().front());
  }
  std::string name() const override { return fmt::format("the fleet's database {}", place_of(uri_)); }

 private:
  /// What libpqxx throws, as an error. A connection that broke is let go, and made again by the next begin().
  template <class Work>
  auto guarded(const Work& work) -> decltype(work()) {
    const auto away = [&](const char* what) {
      let_go();
      return fail(ErrorCode::Unreachable, fmt::format("{} does not answer: {}", name(), first_line(what)));
    };
    try {
      return work();
    } catch (const pqxx::broken_connection& error) {
      return away(error.what());
    } catch (const pqxx::unique_violation& error) {
      return fail(ErrorCode::Conflict, fmt::format("{}: {}", name(), first_line(error.what())));
    } catch (const pqxx::insufficient_privilege& error) {
      return fail(ErrorCode::NotPermitted, fmt::format("{}: {}", name(), first_line(error.what())));
    } catch (const pqxx::sql_error& error) {
      // The server goes down, or is not yet up: classes 57 and 08 of SQLSTATE.
      const std::string state = error.sqlstate();
      if (state.starts_with("57") || state.starts_with("08")) return away(error.what());
      // A deadlock, or something that is referred to went or came meanwhile: 40 and foreign_key_violation.
      if (state.starts_with("40") || state == "23503") return fail(kGaveWay, first_line(error.what()));
      return fail(ErrorCode::StorageFailed, fmt::format("{}: {} ({})", name(), first_line(error.what()), state));
    } catch (const std::exception& error) {
      if (connection_ && connection_->is_open())
        return fail(ErrorCode::StorageFailed, fmt::format("{}: {}", name(), first_line(error.what())));
      return away(error.what());
    }
  }
  static std::string first_line(std::string_view text) { return std::string{text.substr(0, text.find('\n'))}; }
  void let_go() {
    try {
      work_.reset();
      changes_.reset();
      quiet_.reset();
      connection_.reset();
    } catch (const std::exception&) {  // it is gone all the same
    }
  }

  std::string uri_;
  std::optional<pqxx::connection> connection_;
  /// What the server says of itself comes back as errors; nothing else writes to the program's standard error.
  std::unique_ptr<pqxx::quiet_errorhandler> quiet_;
  std::unique_ptr<Changes> changes_;
  std::optional<pqxx::work> work_;
  bool is_changed_ = false;  ///< by the transaction under way
};

}  // namespace

Result<std::unique_ptr<FleetSql>> open_fleet_postgres(const std::string& uri) {
  const auto has = has_password(uri);
  if (!has) return tl::unexpected{has.error()};
  if (*has)
    return fail(
        ErrorCode::InvalidInput,
        "the name of the fleet's database holds a password, which everybody on this computer could read; put it "
        "into ~/.pgpass, a file named by PGPASSFILE, or a service file");
  return std::make_unique<FleetPostgres>(uri);
}

}  // namespace telefab
