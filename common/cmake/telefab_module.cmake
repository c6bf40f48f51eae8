# SPDX-License-Identifier: GPL-3.0-or-later
# telefab_rooms(): the rooms of this tree, in the order of its modules.txt, which says what each may use.
function(telefab_rooms)
  set(list ${CMAKE_CURRENT_SOURCE_DIR}/modules.txt)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${list})
  file(STRINGS ${list} lines REGEX "^[a-z]")
  get_filename_component(tree ${CMAKE_CURRENT_SOURCE_DIR} NAME)
  string(REGEX REPLACE "_site$" "_" prefix "${tree}")
  if(tree STREQUAL "common")
    set(prefix "")
  endif()
  foreach(line IN LISTS lines)
    string(REGEX MATCH "^([a-z_0-9]+) \\|([^|]*)\\|([^|]*)" parsed "${line}")
    set(room ${CMAKE_MATCH_1})
    set(second ${CMAKE_MATCH_2})
    set(third ${CMAKE_MATCH_3})
    string(REGEX MATCHALL "[a-z_0-9]+" uses "${second}")
    if(NOT tree STREQUAL "common")
      string(REGEX MATCHALL "[a-z_0-9]+" own "${third}")
      list(TRANSFORM own PREPEND "${prefix}")
      list(APPEND uses ${own})
    endif()
    set_property(GLOBAL PROPERTY TELEFAB_USES_${tree}_${room} "${uses}")
    add_subdirectory(${room})
  endforeach()
endfunction()

# Refuses a link to a room that the line in modules.txt does not name.
function(_telefab_may_link owner)
  get_filename_component(room ${CMAKE_CURRENT_SOURCE_DIR} NAME)
  get_filename_component(tree ${CMAKE_CURRENT_SOURCE_DIR} DIRECTORY)
  get_filename_component(tree ${tree} NAME)
  get_property(known GLOBAL PROPERTY TELEFAB_USES_${tree}_${room} SET)
  get_property(uses GLOBAL PROPERTY TELEFAB_USES_${tree}_${room})
  foreach(target IN LISTS ARGN)
    if(known AND target MATCHES "^telefab::(.*)$" AND NOT CMAKE_MATCH_1 IN_LIST uses)
      message(FATAL_ERROR "${owner} links ${target}, which its line in ${tree}/modules.txt does not let it use")
    endif()
  endforeach()
endfunction()

# What most rooms include is compiled once, in the first room, with the definitions of fmt (decision 0005). It is for speed
# only: every file still includes what it uses.
function(_telefab_precompiled target)
  target_compile_definitions(${target} PRIVATE $<TARGET_PROPERTY:fmt::fmt,INTERFACE_COMPILE_DEFINITIONS>)
  if(target STREQUAL "telefab_base")
    target_precompile_headers(${target} PRIVATE <fmt/format.h> <tl/expected.hpp> <algorithm> <array> <cmath> <filesystem>
      <functional> <map> <memory> <optional> <span> <stop_token> <string> <vector>)
  else()
    target_precompile_headers(${target} REUSE_FROM telefab_base)
  endif()
endfunction()

# Options of their own for SOURCES, such as an instruction set: the precompiled headers know nothing of them.
function(telefab_source_options)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "" "SOURCES;OPTIONS")
  set_source_files_properties(${arg_SOURCES} PROPERTIES COMPILE_OPTIONS "${arg_OPTIONS}" SKIP_PRECOMPILE_HEADERS ON)
endfunction()

# telefab_module(NAME SOURCES .. HEADERS .. USES .. HIDES ..)
#   USES   what our public headers mention    HIDES   what only our .cpp files mention
# Sources are relative to the module's folder; public headers lie below include/.
function(telefab_module name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "SOURCES;HEADERS;USES;HIDES")
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "telefab_module(${name}): stray ${arg_UNPARSED_ARGUMENTS}")
  endif()
  _telefab_listing_matches(${name} "src/*.cpp" "${arg_SOURCES}")
  _telefab_listing_matches(${name} "include/*.hpp" "${arg_HEADERS}")
  _telefab_may_link(${name} ${arg_USES} ${arg_HIDES})
  if(arg_SOURCES)
    add_library(telefab_${name} STATIC ${arg_SOURCES})
    target_link_libraries(telefab_${name} PUBLIC ${arg_USES} PRIVATE telefab_flags ${arg_HIDES})
    target_sources(telefab_${name} PUBLIC FILE_SET HEADERS BASE_DIRS include FILES ${arg_HEADERS})
    set_target_properties(telefab_${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
    target_include_directories(telefab_${name} PRIVATE src)
    _telefab_precompiled(telefab_${name})
  else()
    add_library(telefab_${name} INTERFACE)
    target_link_libraries(telefab_${name} INTERFACE ${arg_USES})
    target_sources(telefab_${name} INTERFACE FILE_SET HEADERS BASE_DIRS include FILES ${arg_HEADERS})
    set_target_properties(telefab_${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON)
  endif()
  add_library(telefab::${name} ALIAS telefab_${name})
endfunction()

# telefab_program(NAME COMPONENT package SOURCES .. HIDES ..): an executable NAME in bin/, installed with its package,
# together with the manual page and the completions that it prints about itself.
function(telefab_program name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "COMPONENT" "SOURCES;HIDES")
  _telefab_may_link(${name} ${arg_HIDES})
  string(REPLACE "-" "_" target "program_${name}")
  add_executable(${target} ${arg_SOURCES})
  set_target_properties(${target} PROPERTIES OUTPUT_NAME ${name})
  target_link_libraries(${target} PRIVATE telefab_flags ${arg_HIDES})
  # A hardened library is compiled for any place, a program for any but its own (-fPIC, -fPIE): then they share nothing.
  if(NOT CMAKE_POSITION_INDEPENDENT_CODE)
    _telefab_precompiled(${target})
  endif()
  install(TARGETS ${target} RUNTIME DESTINATION bin COMPONENT ${arg_COMPONENT})
  if(TELEFAB_HARDEN)
    add_custom_command(TARGET ${target} POST_BUILD VERBATIM
      COMMAND ${CMAKE_SOURCE_DIR}/deploy/lib/check-hardening $<TARGET_FILE:${target}> ${CMAKE_SOURCE_DIR})
  endif()
  set(folder ${CMAKE_BINARY_DIR}/manuals)
  file(MAKE_DIRECTORY ${folder})
  # It runs in its own folder, so that no default shows where this checkout happens to lie.
  add_custom_command(
    OUTPUT ${folder}/${name}.1.gz ${folder}/${name}.bash ${folder}/_${name} ${folder}/${name}.fish
    COMMAND $<TARGET_FILE:${target}> manual > ${name}.1
    COMMAND gzip --best --no-name --force ${name}.1
    COMMAND $<TARGET_FILE:${target}> completion bash > ${name}.bash
    COMMAND $<TARGET_FILE:${target}> completion zsh > _${name}
    COMMAND $<TARGET_FILE:${target}> completion fish > ${name}.fish
    DEPENDS ${target} WORKING_DIRECTORY ${folder} VERBATIM COMMENT "Manual page and completions of ${name}")
  add_custom_target(${target}_manual ALL DEPENDS ${folder}/${name}.1.gz)
  install(FILES ${folder}/${name}.1.gz DESTINATION share/man/man1 COMPONENT ${arg_COMPONENT})
  install(FILES ${folder}/${name}.bash DESTINATION share/bash-completion/completions RENAME ${name}
    COMPONENT ${arg_COMPONENT})
  install(FILES ${folder}/_${name} DESTINATION share/zsh/vendor-completions COMPONENT ${arg_COMPONENT})
  install(FILES ${folder}/${name}.fish DESTINATION share/fish/vendor_completions.d COMPONENT ${arg_COMPONENT})
endfunction()

# Sanitizers make a program many times slower; then every test has as many times as long.
set(TELEFAB_PATIENCE 1)
if(TELEFAB_SANITIZE)
  set(TELEFAB_PATIENCE 15)
endif()

# telefab_time_limit(NAME SECONDS): how long the test NAME may take in an ordinary build.
function(telefab_time_limit name seconds)
  math(EXPR limit "${seconds} * ${TELEFAB_PATIENCE}")
  set_tests_properties(${name} PROPERTIES TIMEOUT ${limit})
endfunction()

# telefab_test(KIND NAME SOURCES .. USES ..): one test program a module and kind; KIND becomes the CTest label.
#   TIMEOUT s (default 120), LONG puts it behind the others, ALONE gives it the machine to itself: for what measures
#   real time. Everything else runs side by side.
function(telefab_test kind name)
  cmake_parse_arguments(PARSE_ARGV 2 arg "ALONE;LONG" "TIMEOUT" "SOURCES;USES;ENVIRONMENT")
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "telefab_test(${kind} ${name}): stray ${arg_UNPARSED_ARGUMENTS}")
  endif()
  _telefab_listing_matches(${kind}_${name} "*_test.cpp" "${arg_SOURCES}")
  add_executable(${kind}_${name} ${arg_SOURCES})
  set_target_properties(${kind}_${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  target_link_libraries(${kind}_${name} PRIVATE telefab_flags ${arg_USES} GTest::gmock GTest::gtest_main)
  target_precompile_headers(${kind}_${name} REUSE_FROM telefab_test_headers)
  add_test(NAME ${kind}.${name} COMMAND ${kind}_${name})
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif()
  set(cost 1)
  if(arg_LONG)
    set(cost 0)   # ctest starts costly tests first; ours says: longest last
  endif()
  telefab_time_limit(${kind}.${name} ${arg_TIMEOUT})
  set_tests_properties(${kind}.${name} PROPERTIES LABELS ${kind} COST ${cost} RUN_SERIAL ${arg_ALONE}
    ENVIRONMENT "TELEFAB_BIN=${CMAKE_BINARY_DIR}/bin;TELEFAB_SOURCE=${CMAKE_SOURCE_DIR};${arg_ENVIRONMENT}")
endfunction()

# telefab_fuzzer(NAME SOURCE .. USES .. CORPUS dir): a libFuzzer target where the preset asks for one; in every
# other build the same function replays its corpus as the test fuzz.NAME.
function(telefab_fuzzer name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "SOURCE;CORPUS" "USES")
  add_executable(fuzz_${name} ${arg_SOURCE})
  set_target_properties(fuzz_${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/fuzz)
  target_link_libraries(fuzz_${name} PRIVATE telefab_flags ${arg_USES})
  if(TELEFAB_SANITIZE MATCHES "fuzzer")
    target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
    # What it finds goes to the first folder; the corpus stays as it is.
    set(found ${CMAKE_BINARY_DIR}/fuzz/found/${name})
    file(MAKE_DIRECTORY ${found})
    add_test(NAME fuzz.${name} COMMAND fuzz_${name} -runs=20000 -max_total_time=60 ${found} ${arg_CORPUS})
  else()
    target_sources(fuzz_${name} PRIVATE ${CMAKE_SOURCE_DIR}/tests/fuzz/replay_main.cpp)
    add_test(NAME fuzz.${name} COMMAND fuzz_${name} ${arg_CORPUS})
  endif()
  telefab_time_limit(fuzz.${name} 120)
  set_tests_properties(fuzz.${name} PROPERTIES LABELS fuzz)
  if(TARGET telefab_fuzzers)
    add_dependencies(telefab_fuzzers fuzz_${name})
  endif()
endfunction()

# telefab_seeds(NAME SOURCE .. USES ..): a program that writes seeds of fuzz targets by a function of ours; built by its name
# alone.
function(telefab_seeds name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "SOURCE" "USES")
  add_executable(${name} EXCLUDE_FROM_ALL ${arg_SOURCE} ${CMAKE_SOURCE_DIR}/tests/fuzz/seeds_main.cpp)
  target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR}/tests/fuzz)
  target_link_libraries(${name} PRIVATE telefab_flags ${arg_USES} fmt::fmt)
endfunction()

# A file that lies in the folder but in no list is a test nobody runs: refuse to configure.
function(_telefab_listing_matches owner pattern listed)
  file(GLOB_RECURSE found RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS ${pattern})
  foreach(file IN LISTS found)
    if(NOT file IN_LIST listed)
      message(FATAL_ERROR "${owner}: ${CMAKE_CURRENT_SOURCE_DIR}/${file} is in no list; name it in CMakeLists.txt or delete it")
    endif()
  endforeach()
endfunction()
