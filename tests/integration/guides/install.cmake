# SPDX-License-Identifier: GPL-3.0-or-later
# Puts what the packages hold below ROOT, as they would: in BUILD, ROOT.
file(REMOVE_RECURSE ${ROOT})
set(ENV{DESTDIR} ${ROOT})
foreach(component client scan-site fab-site)
  execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix /usr --component ${component} --strip
    RESULT_VARIABLE code OUTPUT_QUIET)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "the package of ${component} cannot be installed below ${ROOT}")
  endif()
endforeach()
