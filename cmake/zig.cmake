# CMake toolchain: the C compiler of the Python package ziglang, which contains the C
# libraries of many systems.
#
#   cmake -DCMAKE_TOOLCHAIN_FILE=cmake/zig.cmake -DTSE_ZIG=<the program zig>
#         -DTSE_ZIG_TARGET=x86_64-windows-gnu ...
#
# Targets of zig: <processor>-<linux|windows|macos>[.version]-<abi>[.version].
# scripts/dev/release.py has a list.
if(NOT TSE_ZIG OR NOT TSE_ZIG_TARGET)
  message(FATAL_ERROR "cmake/zig.cmake needs TSE_ZIG, the program, and TSE_ZIG_TARGET, as zig names its targets")
endif()
set(CMAKE_TRY_COMPILE_PLATFORM_VARIABLES TSE_ZIG TSE_ZIG_TARGET)
string(REGEX MATCH "^[^-]+" CMAKE_SYSTEM_PROCESSOR "${TSE_ZIG_TARGET}")
if(TSE_ZIG_TARGET MATCHES "-windows")
  set(CMAKE_SYSTEM_NAME Windows)
  set(CMAKE_RC_COMPILER "${TSE_ZIG}" CACHE FILEPATH "")         # asked for on Windows; there are no resources
elseif(TSE_ZIG_TARGET MATCHES "-macos")
  set(CMAKE_SYSTEM_NAME Darwin)
else()
  set(CMAKE_SYSTEM_NAME Linux)
endif()
set(CMAKE_C_COMPILER "${TSE_ZIG}" cc -target "${TSE_ZIG_TARGET}")
# "zig ar" and "zig ranlib" are two words, and CMake wants programs of one
set(CMAKE_AR "${TSE_ZIG}" CACHE FILEPATH "")
set(CMAKE_RANLIB "${TSE_ZIG}" CACHE FILEPATH "")
set(CMAKE_C_ARCHIVE_CREATE "<CMAKE_AR> ar qcD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_APPEND "<CMAKE_AR> ar qD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_FINISH "<CMAKE_RANLIB> ranlib <TARGET>")
set(CMAKE_SHARED_LINKER_FLAGS_INIT "-s")
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
