# An overlay port that brings its sources along: vcpkg install tse --overlay-ports=<this folder>
# Number format and capacities: VCPKG_CMAKE_CONFIGURE_OPTIONS of a triplet, for example -DTSE_REAL=float. They are no features: of
# these vcpkg adds up what several programs ask for, and a library has one number format.
vcpkg_cmake_configure(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/source" OPTIONS -DTSE_BUILD_TESTS=OFF -DTSE_BUILD_FMU=OFF)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH lib/cmake/tse)
vcpkg_fixup_pkgconfig()
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/debug/include")
vcpkg_install_copyright(FILE_LIST "${CMAKE_CURRENT_LIST_DIR}/source/LICENSE" "${CMAKE_CURRENT_LIST_DIR}/source/NOTICE")
