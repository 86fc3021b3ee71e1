"""tse for Conan 2: `conan create .`, then self.requires("tse/@VERSION@"), find_package(tse), tse::tse, #include "tse/tse.h"."""

from conan import ConanFile
from conan.tools.cmake import CMake, CMakeToolchain, cmake_layout
from conan.tools.files import copy, rmdir


class Tse(ConanFile):
    name = "tse"
    version = "@VERSION@"
    description = "@SENTENCE@"
    license = "Apache-2.0"
    url = "@URL@"
    package_type = "library"
    settings = "os", "arch", "compiler", "build_type"
    options = {  # noqa: RUF012 - Conan reads them from the class
        "shared": [True, False],
        "fPIC": [True, False],
        "real": ["double", "float", "fixed"],
        "max_particles": ["ANY"],
        "latency_rows": ["ANY"],
        "effects": [True, False],
    }
    default_options = {  # noqa: RUF012
        "shared": False,
        "fPIC": True,
        "real": "double",
        "max_particles": 512,
        "latency_rows": 32,
        "effects": True,
    }
    exports_sources = "CMakeLists.txt", "cmake/*", "include/*", "src/*", "LICENSE", "NOTICE"
    implements = ["auto_shared_fpic"]  # noqa: RUF012
    languages = "C"

    def layout(self):
        cmake_layout(self)

    def generate(self):
        toolchain = CMakeToolchain(self)
        toolchain.cache_variables["TSE_REAL"] = str(self.options.real)
        toolchain.cache_variables["TSE_MAX_PARTICLES"] = str(self.options.max_particles)
        toolchain.cache_variables["TSE_LATENCY_ROWS"] = str(self.options.latency_rows)
        toolchain.cache_variables["TSE_EFFECTS"] = bool(self.options.effects)
        toolchain.cache_variables["TSE_BUILD_TESTS"] = False
        toolchain.cache_variables["TSE_BUILD_FMU"] = False
        toolchain.generate()

    def build(self):
        cmake = CMake(self)
        cmake.configure()
        cmake.build()

    def package(self):
        for name in ("LICENSE", "NOTICE"):
            copy(self, name, self.source_folder, f"{self.package_folder}/licenses")
        CMake(self).install()
        rmdir(self, f"{self.package_folder}/lib/cmake")  # Conan writes its own
        rmdir(self, f"{self.package_folder}/lib/pkgconfig")

    def package_info(self):
        self.cpp_info.libs = ["tse"]
        # they change the layout of the structs, so whoever links tse compiles with them, too: src/CMakeLists.txt
        self.cpp_info.defines = [
            f"TSE_REAL_{str(self.options.real).upper()}=1",
            f"TSE_MAX_PARTICLES={self.options.max_particles}",
        ]
        if not self.options.effects:
            self.cpp_info.defines.append("TSE_NO_EFFECTS=1")
        if int(str(self.options.latency_rows)) != 32:
            self.cpp_info.defines.append(f"TSE_LATENCY_ROWS={self.options.latency_rows}")
        if self.settings.os in ("Linux", "FreeBSD"):
            self.cpp_info.system_libs = ["m"]
