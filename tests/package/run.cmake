# Test `consumer` of ctest: install tse, then build and run the programs of this folder with
# it. With EVERY_WAY, also build tse within a different project, in two ways.
#
# Given: TSE_SOURCE TSE_BUILD WORK GENERATOR MAKE_PROGRAM CONFIG C_COMPILER CXX_COMPILER
# C_FLAGS CXX_FLAGS EVERY_WAY SHARED REAL MAX_PARTICLES VERSION
cmake_minimum_required(VERSION 3.21)

function(run what)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE text ERROR_VARIABLE text)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${what}: failed (${result})\n${text}")
  endif()
  set(output "${text}" PARENT_SCOPE)
endfunction()

set(configure "${CMAKE_COMMAND}" -G "${GENERATOR}" "-DCMAKE_MAKE_PROGRAM=${MAKE_PROGRAM}" "-DCMAKE_BUILD_TYPE=${CONFIG}"
  "-DCMAKE_C_COMPILER=${C_COMPILER}" "-DCMAKE_C_FLAGS=${C_FLAGS}"
  "-DBUILD_SHARED_LIBS=${SHARED}" "-DTSE_REAL=${REAL}" "-DTSE_MAX_PARTICLES=${MAX_PARTICLES}")

set(programs minimal)
if(CXX_COMPILER)
  list(APPEND programs cxx)
  list(APPEND configure -DTSE_WITH_CXX=ON "-DCMAKE_CXX_COMPILER=${CXX_COMPILER}" "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}")
else()
  message("cxx: skipped, no C++ compiler is installed")
endif()

function(consume from)
  set(dir "${WORK}/${from}")
  run("configure, ${from}" ${configure} -S "${CMAKE_CURRENT_LIST_DIR}" -B "${dir}" -DTSE_FROM=${from} ${ARGN})
  run("build, ${from}" "${CMAKE_COMMAND}" --build "${dir}" --config "${CONFIG}")
  foreach(program IN LISTS programs)
    find_program(path_${from}_${program} ${program} PATHS "${dir}" "${dir}/${CONFIG}" NO_DEFAULT_PATH REQUIRED)
    run("${program}, ${from}" "${path_${from}_${program}}")
    message("${from}: ${output}")
  endforeach()
endfunction()

file(REMOVE_RECURSE "${WORK}")
# Rename the folder of the installation: no installed file may contain its path.
run("install" "${CMAKE_COMMAND}" --install "${TSE_BUILD}" --config "${CONFIG}" --prefix "${WORK}/staged")
file(RENAME "${WORK}/staged" "${WORK}/prefix")

consume(package "-DCMAKE_PREFIX_PATH=${WORK}/prefix" "-DTSE_VERSION=${VERSION}")
if(EVERY_WAY)
  consume(subdirectory "-DTSE_SOURCE=${TSE_SOURCE}")
  consume(fetch "-DTSE_SOURCE=${TSE_SOURCE}")
endif()

execute_process(COMMAND ${configure} -S "${CMAKE_CURRENT_LIST_DIR}" -B "${WORK}/newer" -DTSE_FROM=package
  "-DCMAKE_PREFIX_PATH=${WORK}/prefix" -DTSE_VERSION=99.0 RESULT_VARIABLE result OUTPUT_QUIET ERROR_QUIET)
if(result EQUAL 0)
  message(FATAL_ERROR "find_package(tse 99.0) accepted version ${VERSION}")
endif()

# ---- without CMake

find_program(pkg_config NAMES pkg-config pkgconf)
if(NOT pkg_config)
  message("pkg-config: skipped, it is not installed")
elseif(MSVC OR CMAKE_HOST_WIN32)
  message("pkg-config: skipped on this platform")
else()
  file(GLOB_RECURSE pc "${WORK}/prefix/*/tse.pc")
  get_filename_component(pc_dir "${pc}" DIRECTORY)
  set(ENV{PKG_CONFIG_PATH} "${pc_dir}")
  set(ENV{LD_LIBRARY_PATH} "${pc_dir}/..")         # folder of the shared library, for the program
  run("pkg-config --modversion" "${pkg_config}" --modversion tse)
  string(STRIP "${output}" output)
  if(NOT output STREQUAL VERSION)
    message(FATAL_ERROR "tse.pc has version ${output}, but the library has version ${VERSION}")
  endif()
  run("pkg-config" "${pkg_config}" --cflags --libs tse)
  separate_arguments(flags UNIX_COMMAND "${output}")
  separate_arguments(c_flags UNIX_COMMAND "${C_FLAGS}")
  run("compile, pkg-config" "${C_COMPILER}" ${c_flags} -std=c99 "${CMAKE_CURRENT_LIST_DIR}/minimal.c" ${flags} -lm -o "${WORK}/minimal")
  run("minimal, pkg-config" "${WORK}/minimal")
  message("pkg-config: ${output}")

  # A program that was compiled for a different scalar type must not link.
  if(REAL STREQUAL "double")
    list(TRANSFORM flags REPLACE "TSE_REAL_DOUBLE" "TSE_REAL_FLOAT")
    execute_process(COMMAND "${C_COMPILER}" ${c_flags} -std=c99 "${CMAKE_CURRENT_LIST_DIR}/minimal.c" ${flags} -lm -o "${WORK}/mixed"
      RESULT_VARIABLE result ERROR_VARIABLE text)
    if(result EQUAL 0 OR NOT text MATCHES "tse_step_f32")
      message(FATAL_ERROR "a float program linked with a double library\n${text}")
    endif()
  endif()
endif()
