// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// One prepared statement; binds in order, steps, reads columns in order.
class Statement {
 public:
  /// `what`: whose file it is, for messages.
  Statement(sqlite3* database, const std::string& text, std::string_view what);
  Statement& bind(std::string_view text);
  Statement& bind(std::int64_t number);
  Statement& bind(double number);
  /// True for a row, false for the end. Fails: StorageFailed, NotTrusted (the file is damaged), Conflict (a key).
  [[nodiscard]] Result<bool> step();
  [[nodiscard]] int columns() const { return sqlite3_column_count(statement_.get()); }
  [[nodiscard]] std::string text();
  [[nodiscard]] std::int64_t number() { return sqlite3_column_int64(statement_.get(), read_++); }
  [[nodiscard]] double real() { return sqlite3_column_double(statement_.get(), read_++); }

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  sqlite3* database_;
  std::string_view what_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int code_ = SQLITE_OK;
  int bound_ = 0;
  int read_ = 0;
};

/// One SQLite file with a write-ahead log, every change fsynced. Threads: as SQLite's serialized mode; what belongs
/// together is its owner's to guard.
class SqliteFile {
 public:
  /// Makes the file where there is none. `what`: for messages; must outlive it ("job store").
  [[nodiscard]] static Result<SqliteFile> open(std::filesystem::path path, std::string_view what);

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] Statement prepare(const std::string& text) const { return {database_.get(), text, what_}; }
  /// Statements without results.
  [[nodiscard]] Result<void> run(const std::string& text) const;
  [[nodiscard]] Result<void> execute(Statement statement) const;
  /// The first column of the first row, which is a number; 0: there is none.
  [[nodiscard]] Result<std::int64_t> number_of(const std::string& question) const;
  /// A copy under another name, whole or not at all.
  [[nodiscard]] Result<void> copy_to(const std::filesystem::path& copy) const;
  /// NotTrusted: it is damaged.
  [[nodiscard]] Result<void> check() const;

 private:
  struct Close {
    void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
  };
  SqliteFile(std::filesystem::path path, std::string_view what) : path_{std::move(path)}, what_{what} {}
  std::filesystem::path path_;
  std::string_view what_;
  std::unique_ptr<sqlite3, Close> database_;
};

}  // namespace telefab
