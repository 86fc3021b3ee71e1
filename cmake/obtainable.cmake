# Find out whether tests and FMUs can be built: whether the third-party sources that they
# need are present or can be fetched. The library needs no such sources, so it can be
# configured without network and Python. Without a C++ compiler, tests that need one are
# left out.
set(tse_unity_repository https://github.com/ThrowTheSwitch/Unity.git)
set(tse_fmi2_repository https://github.com/modelica/fmi-standard.git)
string(CONCAT tse_unity_hint "-DFETCHCONTENT_SOURCE_DIR_UNITY=<folder with src/unity.c>, "
  "which scripts/setup.sh puts into .venv/share/unity")
string(CONCAT tse_fmi2_hint "-DFETCHCONTENT_SOURCE_DIR_FMI2=<folder with headers/fmi2Functions.h>, "
  "which scripts/setup.sh puts into .venv/share/fmi2; the headers of FMI 3.0 are in .venv/share/fmi3")

# Set `result` to ON if FetchContent can get the sources `name` (unity or fmi2), else OFF.
function(tse_obtainable name result)
  string(TOUPPER "${name}" upper)
  set(base "${FETCHCONTENT_BASE_DIR}")
  if(NOT base)
    set(base "${PROJECT_BINARY_DIR}/_deps")
  endif()
  file(GLOB there "${base}/${name}-src/*")
  if(FETCHCONTENT_SOURCE_DIR_${upper} OR there)
    set(${result} ON PARENT_SCOPE)
    return()
  endif()
  # With CMake 3.24 or later, tests/CMakeLists.txt can also use an installed Unity
  if(name STREQUAL "unity" AND NOT CMAKE_VERSION VERSION_LESS 3.24)
    find_package(unity QUIET CONFIG)
    if(unity_FOUND)
      set(${result} ON PARENT_SCOPE)
      return()
    endif()
  endif()
  set(${result} OFF PARENT_SCOPE)
  find_program(TSE_GIT git)
  mark_as_advanced(TSE_GIT)
  if(FETCHCONTENT_FULLY_DISCONNECTED OR NOT TSE_GIT)
    return()
  endif()
  execute_process(COMMAND "${CMAKE_COMMAND}" -E env GIT_TERMINAL_PROMPT=0
    "${TSE_GIT}" ls-remote --exit-code "${tse_${name}_repository}" HEAD
    TIMEOUT 20 RESULT_VARIABLE failed OUTPUT_QUIET ERROR_QUIET)
  if(failed STREQUAL "0")
    set(${result} ON PARENT_SCOPE)
  endif()
endfunction()

# Set `result` to ON if the tests can be built, else OFF, and print what is missing. It is
# the default of TSE_BUILD_TESTS.
function(tse_tests_can_be_built result)
  find_package(Python3 3.10 QUIET COMPONENTS Interpreter)
  tse_obtainable(unity unity)
  set(missing "")
  if(NOT Python3_Interpreter_FOUND)
    list(APPEND missing "Python 3.10")
  endif()
  if(NOT unity)
    list(APPEND missing "Unity (${tse_unity_hint})")
  endif()
  if(missing)
    list(JOIN missing ", " missing)
    message(STATUS "tse: the tests are not built, because they need ${missing}; "
      "install it, then add -DTSE_BUILD_TESTS=ON")
    set(${result} OFF PARENT_SCOPE)
  else()
    set(${result} ON PARENT_SCOPE)
  endif()
endfunction()

# Set `result`, the default of TSE_BUILD_FMU, to ON if the FMUs can be built, else OFF.
function(tse_fmus_can_be_built result)
  tse_obtainable(fmi2 fmi2)
  if(NOT fmi2)
    message(STATUS "tse: the FMUs are not built, because they need the FMI 2.0 headers "
      "(${tse_fmi2_hint}); install them, then add -DTSE_BUILD_FMU=ON")
  endif()
  set(${result} ${fmi2} PARENT_SCOPE)
endfunction()
