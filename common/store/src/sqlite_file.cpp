// SPDX-License-Identifier: GPL-3.0-or-later
#include "sqlite_file.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <telefab/base/file.hpp>
#include <utility>

namespace telefab {
namespace {

/// A file that is read, and is not what was written.
ErrorCode code_of(int sqlite_code) {
  return (sqlite_code & 0xff) == SQLITE_CORRUPT || (sqlite_code & 0xff) == SQLITE_NOTADB ? ErrorCode::NotTrusted
                                                                                         : ErrorCode::StorageFailed;
}

}  // namespace

Statement::Statement(sqlite3* database, const std::string& text, std::string_view what)
    : database_{database}, what_{what} {
  sqlite3_stmt* raw = nullptr;
  code_ = sqlite3_prepare_v2(database, text.c_str(), -1, &raw, nullptr);
  statement_.reset(raw);
}

Statement& Statement::bind(std::string_view text) {
  // A null pointer would bind NULL, not the empty text.
  if (code_ == SQLITE_OK)
    code_ = sqlite3_bind_text64(statement_.get(), ++bound_, text.data() ? text.data() : "", text.size(),
                                SQLITE_TRANSIENT, SQLITE_UTF8);
  return *this;
}

Statement& Statement::bind(std::int64_t number) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_int64(statement_.get(), ++bound_, number);
  return *this;
}

Statement& Statement::bind(double number) {
  if (code_ == SQLITE_OK) code_ = sqlite3_bind_double(statement_.get(), ++bound_, number);
  return *this;
}

Result<bool> Statement::step() {
  if (code_ == SQLITE_OK) code_ = sqlite3_step(statement_.get());
  const int code = std::exchange(code_, SQLITE_OK);
  read_ = 0;
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  const char* const path = sqlite3_db_filename(database_, "main");
  // SQLite calls a full disk an I/O error where it has no room for its own side files; what the system said last it
  // keeps over answers that have nothing to do with it.
  const int kind = code & 0xff;
  const bool is_of_system = kind == SQLITE_IOERR || kind == SQLITE_CANTOPEN;
  if (kind == SQLITE_FULL || (is_of_system && sqlite3_system_errno(database_) == ENOSPC))
    return fail_system("write", path, ENOSPC);
  if (kind == SQLITE_CONSTRAINT)
    return fail(ErrorCode::Conflict, fmt::format("{} {}: {}", what_, path, sqlite3_errmsg(database_)));
  return fail(code_of(code), fmt::format("{} {}: {}", what_, path, sqlite3_errmsg(database_)));
}

std::string Statement::text() {
  const auto* bytes = sqlite3_column_text(statement_.get(), read_);
  const int size = sqlite3_column_bytes(statement_.get(), read_++);
  return bytes ? std::string{reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size)} : std::string{};
}

Result<SqliteFile> SqliteFile::open(std::filesystem::path path, std::string_view what) {
  SqliteFile file{std::move(path), what};
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(file.path_.c_str(), &raw,
                                   SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_FULLMUTEX, nullptr);
  file.database_.reset(raw);
  if (code != SQLITE_OK)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot open {} {}: {}", what, file.path_.string(), sqlite3_errstr(code)));
  sqlite3_busy_timeout(raw, 5000);
  for (const char* setting : {"PRAGMA journal_mode = WAL", "PRAGMA synchronous = FULL"})
    if (auto done = file.run(setting); !done) return tl::unexpected{done.error()};
  return file;
}

Result<void> SqliteFile::run(const std::string& text) const {
  char* reason = nullptr;
  const int code = sqlite3_exec(database_.get(), text.c_str(), nullptr, nullptr, &reason);
  if (code == SQLITE_OK) return {};
  auto error = fail(code_of(code), fmt::format("{} {}: {}", what_, path_.string(), reason ? reason : "unknown"));
  sqlite3_free(reason);
  return error;
}

Result<void> SqliteFile::execute(Statement statement) const {
  if (auto stepped = statement.step(); !stepped) return tl::unexpected{stepped.error()};
  return {};
}

Result<std::int64_t> SqliteFile::number_of(const std::string& question) const {
  Statement query = prepare(question);
  auto row = query.step();
  if (!row) return tl::unexpected{row.error()};
  return *row ? query.number() : 0;
}

Result<void> SqliteFile::copy_to(const std::filesystem::path& copy) const {
  const auto temporary = make_temporary_beside(copy);
  if (!temporary) return tl::unexpected{temporary.error()};
  Statement vacuum = prepare("VACUUM INTO ?");  // into an empty file it may
  if (auto done = execute(std::move(vacuum.bind(temporary->string()))); !done) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove(*temporary, ignored);
    return done;
  }
  if (auto placed = put_in_place(*temporary, copy); !placed) return placed;
  std::error_code error;  // who may read the file may read its copy, and nobody else
  std::filesystem::permissions(copy, std::filesystem::status(path_, error).permissions(), error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot set the permissions of {}: {}", copy.string(), error.message()));
  return {};
}

Result<void> SqliteFile::check() const {
  Statement query = prepare("PRAGMA quick_check(1)");
  auto row = query.step();
  if (!row) return tl::unexpected{row.error()};
  const std::string found = *row ? query.text() : "it says nothing";
  if (found == "ok") return {};
  return fail(ErrorCode::NotTrusted, fmt::format("{} {} is damaged: {}", what_, path_.string(), found));
}

}  // namespace telefab
