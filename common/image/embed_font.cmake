# SPDX-License-Identifier: GPL-3.0-or-later
# Writes a .cpp that holds the outlines of a font. In: OUT, FILE.
file(READ ${FILE} text)
# A string of a program has a limit; adjacent ones are joined.
string(REPLACE "\n" "\\n\"\n    \"" text "${text}")
file(WRITE ${OUT} "// Made by embed_font.cmake.
#include \"font.hpp\"

namespace telefab {

std::string_view font_outlines() {
  return
    \"${text}\";
}

}  // namespace telefab
")
