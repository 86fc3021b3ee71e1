# What the commands of Zephyr, ESP-IDF and vcpkg do to a package of tse, as far as it uses them: for tests where these are not installed.
#   zephyr, esp-idf   included by CMakeLists.txt beside this file, which builds a program with the package
#   vcpkg             cmake -D... -P standins.cmake, which runs the portfile. Given: PORT WORK
function(zephyr_library_named name)
  add_library(${name} STATIC)
  set(ZEPHYR_CURRENT_LIBRARY ${name} PARENT_SCOPE)
  target_link_libraries(${name} PUBLIC whole_build m)      # both come with a C library
  target_link_libraries(app PRIVATE ${name})
endfunction()

function(zephyr_library_sources)
  target_sources(${ZEPHYR_CURRENT_LIBRARY} PRIVATE ${ARGN})
endfunction()

function(zephyr_include_directories)
  target_include_directories(whole_build INTERFACE ${ARGN})
endfunction()

function(zephyr_compile_definitions)
  target_compile_definitions(whole_build INTERFACE ${ARGN})
endfunction()

macro(idf_component_register)
  cmake_parse_arguments(component "" "" "SRCS;INCLUDE_DIRS" ${ARGN})
  set(COMPONENT_LIB component_tse)
  add_library(${COMPONENT_LIB} STATIC ${component_SRCS})
  target_include_directories(${COMPONENT_LIB} PUBLIC ${component_INCLUDE_DIRS})
  target_link_libraries(${COMPONENT_LIB} PUBLIC m)
  target_link_libraries(app PRIVATE ${COMPONENT_LIB})
endmacro()

if(NOT CMAKE_SCRIPT_MODE_FILE)
  return()
endif()

set(CURRENT_PACKAGES_DIR "${WORK}/packages")

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE text ERROR_VARIABLE text)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN}: failed (${result})\n${text}")
  endif()
endfunction()

function(vcpkg_cmake_configure)
  cmake_parse_arguments(PARSE_ARGV 0 it "" "SOURCE_PATH" "OPTIONS")
  run("${CMAKE_COMMAND}" -S "${it_SOURCE_PATH}" -B "${WORK}/build" ${it_OPTIONS} -DFETCHCONTENT_FULLY_DISCONNECTED=ON
    -DCMAKE_BUILD_TYPE=Debug -DCMAKE_INSTALL_LIBDIR=lib "-DCMAKE_INSTALL_PREFIX=${CURRENT_PACKAGES_DIR}")
endfunction()

function(vcpkg_cmake_install)
  run("${CMAKE_COMMAND}" --build "${WORK}/build" --target install)
endfunction()

function(vcpkg_cmake_config_fixup)     # tseConfig.cmake belongs into share/tse, where its tools look for it
  cmake_parse_arguments(PARSE_ARGV 0 it "" "CONFIG_PATH" "")
  if(NOT EXISTS "${CURRENT_PACKAGES_DIR}/${it_CONFIG_PATH}/tseConfig.cmake")
    message(FATAL_ERROR "there is no tseConfig.cmake in ${it_CONFIG_PATH}")
  endif()
endfunction()

function(vcpkg_fixup_pkgconfig)
  if(NOT EXISTS "${CURRENT_PACKAGES_DIR}/lib/pkgconfig/tse.pc")
    message(FATAL_ERROR "there is no tse.pc")
  endif()
endfunction()

function(vcpkg_install_copyright)
  cmake_parse_arguments(PARSE_ARGV 0 it "" "" "FILE_LIST")
  file(COPY ${it_FILE_LIST} DESTINATION "${CURRENT_PACKAGES_DIR}/share/tse")
endfunction()

include("${PORT}/portfile.cmake")
