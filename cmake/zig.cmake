# Toolchain file of CMake for the C compiler of zig. The Python package ziglang has it,
# with the C libraries of many systems.
#
#   cmake -DCMAKE_TOOLCHAIN_FILE=cmake/zig.cmake -DTSE_ZIG=<path of the program zig>
#         -DTSE_ZIG_TARGET=x86_64-windows-gnu ...
#
# Form of a target: <processor>-<linux|windows|macos>[.version]-<abi>[.version].
# scripts/dev/release.py has a list of targets.
if(NOT TSE_ZIG OR NOT TSE_ZIG_TARGET)
  message(FATAL_ERROR "cmake/zig.cmake needs -DTSE_ZIG=<path of the program zig> "
    "and -DTSE_ZIG_TARGET=<target, such as x86_64-windows-gnu>")
endif()
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES TSE_ZIG TSE_ZIG_TARGET)
string(REGEX MATCH "^[^-]+" CMAKE_SYSTEM_PROCESSOR "${TSE_ZIG_TARGET}")
if(TSE_ZIG_TARGET MATCHES "-windows")
  set(CMAKE_SYSTEM_NAME Windows)
  # CMake requires a resource compiler for Windows, but there are no resources to compile
  set(CMAKE_RC_COMPILER "${TSE_ZIG}" CACHE FILEPATH "")
elseif(TSE_ZIG_TARGET MATCHES "-macos")
  set(CMAKE_SYSTEM_NAME Darwin)
else()
  set(CMAKE_SYSTEM_NAME Linux)
endif()
set(CMAKE_C_COMPILER "${TSE_ZIG}" cc -target "${TSE_ZIG_TARGET}")
# CMake expects a program for ar and for ranlib. Here each is zig with a first argument,
# which the rules below add.
set(CMAKE_AR "${TSE_ZIG}" CACHE FILEPATH "")
set(CMAKE_RANLIB "${TSE_ZIG}" CACHE FILEPATH "")
set(CMAKE_C_ARCHIVE_CREATE "<CMAKE_AR> ar qcD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_APPEND "<CMAKE_AR> ar qD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_FINISH "<CMAKE_RANLIB> ranlib <TARGET>")
set(CMAKE_SHARED_LINKER_FLAGS_INIT "-s")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
