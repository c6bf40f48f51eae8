# SPDX-License-Identifier: GPL-3.0-or-later
# Writes a .cpp that holds the profiles. In: OUT, FILES (paths, a;b;c), the last folder of each its kind.
set(rows "")
set(count 0)
foreach(file IN LISTS FILES)
  file(READ ${file} text)
  get_filename_component(name ${file} NAME)
  get_filename_component(folder ${file} DIRECTORY)
  get_filename_component(folder ${folder} NAME)
  string(APPEND rows "    {\"${folder}\", \"${name}\", R\"profile(${text})profile\"},\n")
  math(EXPR count "${count} + 1")
endforeach()
file(WRITE ${OUT} "// Made by embed_profiles.cmake.
#include <array>

#include \"builtin_profiles.hpp\"

namespace telefab {
namespace {

constexpr std::array<BuiltinProfile, ${count}> kTexts{{
${rows}}};

}  // namespace

std::span<const BuiltinProfile> builtin_profile_texts() { return kTexts; }

}  // namespace telefab
")
