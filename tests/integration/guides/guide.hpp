// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace telefab::test {

/// The commands of a page of deploy/docs as one script of bash, in their order: every line that is indented by four
/// blanks, but for blocks behind a comment `<!-- not run: WHY -->`. Where the page has `<!-- filled in: FILE -->` the
/// script calls fill_in FILE, which fills a table as somebody would who has measured. Behind a command that goes on in
/// the background the script waits until its port answers.
[[nodiscard]] std::string script_of(std::string_view page);

/// Writes a figure of some thousand bare points, 30 mm high, in metres as phones do.
void write_figure(const std::filesystem::path& file);

}  // namespace telefab::test
