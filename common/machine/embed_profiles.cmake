# SPDX-License-Identifier: GPL-3.0-or-later
# Writes a .cpp that holds the machine profiles. In: OUT, FILES (paths, a;b;c).
set(rows "")
set(count 0)
foreach(file IN LISTS FILES)
  file(READ ${file} text)
  get_filename_component(name ${file} NAME)
  string(APPEND rows "    {\"${name}\", R\"profile(${text})profile\"},\n")
  math(EXPR count "${count} + 1")
endforeach()
file(WRITE ${OUT} "// Made by embed_profiles.cmake.
#include <array>

#include \"builtin_profiles.hpp\"

namespace telefab {
namespace {

constexpr std::array<std::pair<std::string_view, std::string_view>, ${count}> kTexts{{
${rows}}};

}  // namespace

std::span<const std::pair<std::string_view, std::string_view>> builtin_profile_texts() { return kTexts; }

}  // namespace telefab
")
