# SPDX-License-Identifier: GPL-3.0-or-later
# One INTERFACE target carries every compiler flag of ours.
#   -ffp-contract=off  same input, same bytes on machines with and without fused multiply-add
#   -fno-math-errno    lets the compiler vectorise sqrt; nobody here reads errno after mathematics
add_library(telefab_flags INTERFACE)
target_compile_options(telefab_flags INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wnon-virtual-dtor -Woverloaded-virtual -Wno-missing-field-initializers
  -ffp-contract=off -fno-math-errno
  $<$<BOOL:${TELEFAB_WERROR}>:-Werror>)

set(CMAKE_CXX_FLAGS_RELEASE "-O2 -DNDEBUG")

if(TELEFAB_SANITIZE)
  string(REPLACE "fuzzer" "fuzzer-no-link" sanitize_objects "${TELEFAB_SANITIZE}")
  string(REPLACE "fuzzer," "" sanitize_link "${TELEFAB_SANITIZE}")
  # The whole program must agree, so these are directory-wide on purpose.
  add_compile_options(-fsanitize=${sanitize_objects} -fno-omit-frame-pointer -fno-sanitize-recover=undefined)
  add_link_options(-fsanitize=${sanitize_link})
endif()

# What `dpkg-buildflags` of hardening=+all gives, and the control flow of the processor's own (CET). Same input, same bytes
# still: none of it touches arithmetic.
if(TELEFAB_HARDEN)
  include(CheckPIESupported)
  check_pie_supported()
  set(CMAKE_POSITION_INDEPENDENT_CODE ON)
  add_compile_options(-fstack-protector-strong -fstack-clash-protection -Wformat -Werror=format-security
    -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=2 -ffile-prefix-map=${CMAKE_SOURCE_DIR}=.)
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    add_compile_options(-fcf-protection)
  endif()
  add_link_options(-Wl,-z,relro -Wl,-z,now -Wl,-z,noexecstack)
endif()
