// SPDX-License-Identifier: GPL-3.0-or-later
#include "fleet_sqlite.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "sqlite_file.hpp"

namespace telefab {
namespace {

constexpr int kApplicationId = 0x54464c54;  // "TFLT"
constexpr Nanoseconds kLookEvery = std::chrono::milliseconds{50};

class FleetSqlite final : public FleetSql {
 public:
  FleetSqlite(SqliteFile file, const Clock& clock) : file_{std::move(file)}, clock_{clock} {}

  Result<std::vector<SqlRow>> run(const std::string& text, std::vector<SqlValue> values) override {
    Statement statement = file_.prepare(text);
    for (const SqlValue& value : values) std::visit([&](const auto& v) { statement.bind(v); }, value);
    std::vector<SqlRow> rows;
    while (true) {
      auto row = statement.step();
      if (!row) return tl::unexpected{row.error()};
      if (!*row) return rows;
      SqlRow& columns = rows.emplace_back();
      for (int c = 0; c < statement.columns(); ++c) columns.push_back(statement.text());
    }
  }
  // At once for writing: two that read first could not both go on.
  Result<void> begin() override { return file_.run("BEGIN IMMEDIATE"); }
  Result<void> commit() override { return file_.run("COMMIT"); }
  void roll_back() override { (void)file_.run("ROLLBACK"); }  // the first error is the one to tell

  /// Changes of others; a file says no more than that there was one.
  Result<bool> wait(Nanoseconds longest) override {
    SystemClock clock;
    const Nanoseconds until = clock.now() + longest;
    while (true) {
      const auto version = file_.number_of("PRAGMA data_version");
      if (!version) return tl::unexpected{version.error()};
      const bool is_changed = seen_ != 0 && *version != seen_;
      seen_ = *version;
      if (is_changed) return true;
      const Nanoseconds left = until - clock.now();
      if (left <= Nanoseconds{0}) return false;
      clock.sleep_for(std::min(left, kLookEvery));
    }
  }

  std::string now() const override {
    return std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(clock_.wall()).count());
  }
  std::string_view skipping_locked() const override { return ""; }  // whoever writes has the file
  Result<void> be_alone() override { return {}; }
  std::string_view numbered() const override { return "INTEGER PRIMARY KEY AUTOINCREMENT"; }

  Result<std::int64_t> version() override {
    const auto application = file_.number_of("PRAGMA application_id");
    if (!application) return tl::unexpected{application.error()};
    const auto tables = file_.number_of("SELECT COUNT(*) FROM sqlite_master");
    if (!tables) return tl::unexpected{tables.error()};
    if (*application == 0 && *tables == 0) {
      if (auto marked = file_.run(fmt::format("PRAGMA application_id = {}", kApplicationId)); !marked)
        return tl::unexpected{marked.error()};
      return 0;
    }
    if (*application != kApplicationId)
      return fail(ErrorCode::InvalidInput, fmt::format("{} belongs to another program; name another file", name()));
    if (*tables == 0) return 0;
    if (auto sound = file_.check(); !sound) return tl::unexpected{sound.error()};
    return file_.number_of("SELECT version FROM fleet_version");
  }
  std::string name() const override { return fmt::format("the fleet's file {}", file_.path().string()); }

 private:
  SqliteFile file_;
  const Clock& clock_;
  std::int64_t seen_ = 0;
};

}  // namespace

Result<std::unique_ptr<FleetSql>> open_fleet_sqlite(const std::filesystem::path& path, const Clock& clock) {
  auto file = SqliteFile::open(path, "fleet's file");
  if (!file) return tl::unexpected{file.error()};
  if (auto set = file->run("PRAGMA foreign_keys = ON"); !set) return tl::unexpected{set.error()};
  return std::make_unique<FleetSqlite>(std::move(*file), clock);
}

}  // namespace telefab
