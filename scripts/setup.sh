#!/usr/bin/env bash
# Install in this checkout what the other scripts need: the Python environment .venv with
# the command `tselab`, Unity for the C tests, the FMI headers, and the shared library
# that tselab calls. Needs no root. A second call is fast if nothing has changed.
#
#   scripts/setup.sh [EXTRA ...]
#     clients     further programs that import FMUs, for the tests
#     platforms   a compiler that builds FMUs for all platforms
#     logs        readers of MF4, bus logs, ROS, MAT 7.3
#     openpilot   reader of the logs of openpilot
#     docs        tools to build the site (scripts/dev/docs.sh) and to test it
#     release     tools of scripts/dev/release.sh
#     machines    compilers and emulators of other machines (scripts/dev/platforms.py,
#                 scripts/dev/budgets.py)
#     proof       tools of scripts/dev/proof.sh
#
# An extra of pyproject.toml that cannot be installed is skipped. The tools of machines
# and proof are packages of the operating system. They are installed if the script runs as
# root and apt-get exists; otherwise their names are printed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$@" >&2; exit 1; }
# Install the Python package as a link to this checkout, without the library, which is
# built at the end of this script. Arguments: extras as in pip install.
install_checkout() {
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-build-isolation \
    --config-settings wheel.cmake=false --editable "$@" || return 1
  # The .pth file has the path of the package and an import hook. Remove the hook: it
  # would take precedence over PYTHONPATH, with which tests use a different copy of the
  # package.
  sed -i.bak '/^import /d' .venv/lib/python*/site-packages/_editable*_tse.pth \
    && rm -f .venv/lib/python*/site-packages/_editable*_tse.pth.bak
}
hash_file() {                                     # print the SHA-256 of a file
  "$python" -c 'import hashlib, sys; print(hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest())' "$1"
}

# ---- a C compiler, CMake 3.21, Python 3.10

compiler=
for c in ${CC:+"$CC"} cc gcc clang; do
  if command -v "${c%% *}" >/dev/null; then compiler=$c; break; fi
done
[ -n "$compiler" ] || fail "no C compiler found (looked for cc, gcc, clang)." \
  "Install one, for example the package gcc, or set the variable CC to its name."

command -v cmake >/dev/null \
  || fail "cmake not found: version 3.21 or later is needed, for example from the package cmake."
cmake_version=$(cmake --version | sed -n '1s/[^0-9]*\([0-9]*\.[0-9]*\).*/\1/p')
[ "${cmake_version%%.*}" -gt 3 ] \
  || { [ "${cmake_version%%.*}" -eq 3 ] && [ "${cmake_version#*.}" -ge 21 ]; } \
  || fail "cmake $cmake_version is too old: version 3.21 or later is needed."

python=
for p in ${PYTHON:+"$PYTHON"} python3 python3.14 python3.13 python3.12 python3.11 python3.10 python; do
  if "$p" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then python=$p; break; fi
done
[ -n "$python" ] \
  || fail "no Python 3.10 or later found ($(python3 --version 2>/dev/null || echo "there is no python3"))." \
  "Install one, or set the variable PYTHON to its name."

# ---- .venv with tselab

# The environment is made again if one of these inputs changes. The path of the checkout
# is an input, because a moved environment still refers to the old path.
wanted="$root $("$python" -c 'import sys; print(sys.version)')"
wanted+=" $(hash_file pyproject.toml) $(hash_file scripts/lock.txt)"
if [ "$(cat .venv/tse-setup 2>/dev/null)" != "$wanted" ] || ! [ -x .venv/bin/tselab ]; then
  say "Python environment .venv"
  rm -rf .venv
  if "$python" -c 'import ensurepip' 2>/dev/null; then
    "$python" -m venv .venv
  elif "$python" -m virtualenv --version >/dev/null 2>&1; then
    "$python" -m virtualenv -q .venv
  else
    fail "$("$python" --version) cannot make virtual environments: its module ensurepip is missing." \
      "Install it (Debian and Ubuntu: the package python3-venv) or the Python package virtualenv," \
      "or set the variable PYTHON to a different Python."
  fi
  say "Python packages (about a minute)"
  # Install the versions of scripts/lock.txt, and check their hashes. If the registry has
  # no files of these versions for this Python or machine, install the newest versions,
  # except in continuous integration.
  locked=0
  scripts/dev/locked.sh .venv/bin/python scripts/lock.txt 2>.venv/tse-lock.log || locked=$?
  if [ $locked -eq 3 ] && [ -z "${CI:-}" ]; then
    say "installing the newest versions, not those of scripts/lock.txt: $(tail -n 1 .venv/tse-lock.log)"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check "scikit-build-core>=0.11" \
      || fail "pip could not install scikit-build-core."
  elif [ $locked -ne 0 ]; then
    fail "$(cat .venv/tse-lock.log)" \
      "Nothing of scripts/lock.txt was installed without its hash; run scripts/setup.sh again."
  fi
  install_checkout ".[dev]" || fail "pip could not install the packages that pyproject.toml names."
  printf '%s' "$wanted" >.venv/tse-setup
fi

# ---- Unity 2.7.0, which is in the source package pytest-unity; its SHA-256 is checked

unity=.venv/share/unity
if ! [ -f $unity/src/unity.c ]; then
  say "Unity, the C test framework"
  mkdir -p .venv/share
  scratch=$(mktemp -d .venv/share/unity.XXXXXX)
  trap 'rm -rf "$root/$scratch"' EXIT
  archive=pytest_unity-0.1.0.tar.gz
  hash=cd3ceb4aeb4f7866f935957f91874999d8ae13ff014684464ade0b7071e28298
  echo "pytest-unity==0.1.0 --hash=sha256:$hash" >"$scratch/pin.txt"
  .venv/bin/python -m pip download --quiet --disable-pip-version-check --require-hashes --no-deps \
    --no-binary pytest-unity --dest "$scratch" --requirement "$scratch/pin.txt" \
    || fail "pip could not download pytest-unity 0.1.0, or its sha256 differs."
  tar -xzf "$scratch/$archive" -C "$scratch"
  mv "$scratch/${archive%.tar.gz}/vendor/unity" $unity
  rm -rf "$scratch"
fi

# ---- headers of FMI 2.0.1 and 3.0.2, which are in the Python package
# fmu-manipulation-toolbox; their SHA-256 is checked

# copy_fmi_headers VERSION NAME:SHA256 ...
# Copy the headers NAME to .venv/share/fmiVERSION/headers.
copy_fmi_headers() {
  local folder=.venv/share/fmi$1/headers package pinned header
  shift
  for pinned in "$@"; do [ -f "$folder/${pinned%%:*}" ] || break; done
  [ -f "$folder/${pinned%%:*}" ] && return 0
  scratch=$(mktemp -d .venv/share/fmi.XXXXXX)
  trap 'rm -rf "$root/$scratch"' EXIT
  package=$(.venv/bin/python -c 'import importlib.util as u
print(u.find_spec("fmu_manipulation_toolbox").submodule_search_locations[0])')
  for pinned in "$@"; do
    header=$package/resources/fmi/${pinned%%:*}
    [ -f "$header" ] && [ "$(hash_file "$header")" = "${pinned##*:}" ] \
      || fail "${pinned%%:*} is missing in the package fmu-manipulation-toolbox, or its sha256 differs."
    cp "$header" "$scratch/"
  done
  mkdir -p "${folder%/*}"
  rm -rf "$folder"
  mv "$scratch" "$folder"
  chmod 755 "$folder"
}
copy_fmi_headers 2 fmi2FunctionTypes.h:756da446057a5a6dec47a5938e099ba3a9b1882326672b393c6f7dd8571e3456 \
  fmi2Functions.h:5315e320046c976b3977bc14eb7e2cb58711fa296e4bdf88ddd2c9c82e2a9958 \
  fmi2TypesPlatform.h:50a180641623f47f2e48fc445707549ce4ec2e27358e2451a2dad5b6dfc55287
copy_fmi_headers 3 fmi3FunctionTypes.h:d247d1c5fbf58e32379f1d38e7f73990709e0501fc4a9b3901ce3f9638503a0f \
  fmi3Functions.h:038358fb0209c3547fe8c6f03b80582960c93ce0a7d342b0d9348c8ce6137784 \
  fmi3PlatformTypes.h:1aa81efddeb84b0d9425f9226969525bd034cb63848c086b6696655179500616

# ---- extras

# Install clang 19 or later (MC/DC), cppcheck (MISRA) and frama-c.
install_proof_tools() {
  local packages=() version clang=
  for version in 19 20 21 22; do
    if command -v "clang-$version" >/dev/null && command -v "llvm-profdata-$version" >/dev/null; then
      clang=$version
    fi
  done
  [ -n "$clang" ] || packages+=(clang-19 llvm-19 libclang-rt-19-dev)
  command -v cppcheck >/dev/null || packages+=(cppcheck)
  command -v frama-c >/dev/null || packages+=(frama-c-base)
  [ ${#packages[@]} -gt 0 ] || return 0
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    say "packages of the system: ${packages[*]}"
    for package in "${packages[@]}"; do           # one by one, because a system may lack some of them
      apt-get install -y --no-install-recommends "$package" >.venv/tse-extra.log 2>&1 \
        || say "not installed: $package (does apt-get update help?)"
    done
  else
    say "not installed, so their tests are skipped: ${packages[*]}"
  fi
}

# Install compilers and emulators. The list has pairs command:package of Debian and
# Ubuntu. A test whose command is missing is skipped.
install_machines() {
  local missing=() packages=() pair
  for pair in clang:clang wasm-ld:lld tcc:tcc node:nodejs qemu-aarch64:qemu-user \
      qemu-system-arm:qemu-system-arm \
      arm-none-eabi-gcc:gcc-arm-none-eabi i686-linux-gnu-gcc:gcc-i686-linux-gnu \
      aarch64-linux-gnu-gcc:gcc-aarch64-linux-gnu arm-linux-gnueabihf-gcc:gcc-arm-linux-gnueabihf \
      riscv64-linux-gnu-gcc:gcc-riscv64-linux-gnu s390x-linux-gnu-gcc:gcc-s390x-linux-gnu \
      powerpc64-linux-gnu-gcc:gcc-powerpc64-linux-gnu mips-linux-gnu-gcc:gcc-mips-linux-gnu \
      sparc64-linux-gnu-gcc:gcc-sparc64-linux-gnu; do
    command -v "${pair%%:*}" >/dev/null || { missing+=("${pair%%:*}"); packages+=("${pair#*:}"); }
  done
  # The C library is only recommended by the package of the compiler, so it must be named.
  case " ${packages[*]} " in *" gcc-arm-none-eabi "*) packages+=(libnewlib-arm-none-eabi) ;; esac
  [ "${#missing[@]}" -gt 0 ] || return 0
  if command -v apt-get >/dev/null && [ "$(id -u)" -eq 0 ]; then
    say "compilers and emulators: ${missing[*]}"
    { DEBIAN_FRONTEND=noninteractive apt-get update -qq \
      && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${packages[@]}"; } \
      >"$root/.venv/tse-extra.log" 2>&1 && return 0
  fi
  say "not installed, so their tests are skipped: ${missing[*]}; Debian and Ubuntu packages: ${packages[*]}"
}

for extra in "$@"; do
  if [ "$extra" = proof ]; then install_proof_tools; continue; fi
  if [ "$extra" = machines ]; then install_machines; continue; fi
  [ -f ".venv/tse-extra-$extra" ] && continue
  say "Python packages for $extra"
  if [ "$extra" = release ]; then                 # fixed versions, so that a release can be repeated
    scripts/dev/locked.sh .venv/bin/python scripts/lock-release.txt 2>.venv/tse-lock.log \
      || fail "$(cat .venv/tse-lock.log)" "A release needs the hashes of scripts/lock-release.txt."
  fi
  if install_checkout ".[$extra]" >"$root/.venv/tse-extra.log" 2>&1; then
    mv .venv/tse-extra.log ".venv/tse-extra-$extra"
  else
    say "$extra is not installed: pip failed: $(tail -n 1 .venv/tse-extra.log)"
  fi
done

# ---- the library that tselab calls

made_in=$(sed -n 's/^CMAKE_HOME_DIRECTORY:INTERNAL=//p' build/lab/CMakeCache.txt 2>/dev/null || true)
if [ "$made_in" != "$root" ]; then
  rm -rf build/lab                                # it does not exist, or is of a different checkout
fi
if ! [ -f build/lab/CMakeCache.txt ] && [ -z "${CMAKE_GENERATOR:-}" ] && command -v ninja >/dev/null; then
  export CMAKE_GENERATOR=Ninja
fi
quietly() {                                       # print the output of a command only if it fails
  local text
  text=$("$@" 2>&1) || { printf '%s\n' "$text" >&2; return 1; }
}
say "library for tselab"
quietly cmake --preset lab || fail "cmake could not configure the library."
quietly cmake --build --preset lab --parallel || fail "the library does not compile."
mkdir -p scripts/tse/library/lib
for suffix in so dylib; do
  built=build/lab/src/libtse.$suffix
  if [ -e $built ] && ! cmp -s $built scripts/tse/library/lib/libtse.$suffix; then
    # replace the file by mv, so that a running tselab keeps the old file
    cp -L $built scripts/tse/library/lib/libtse.$suffix.new
    mv -f scripts/tse/library/lib/libtse.$suffix.new scripts/tse/library/lib/libtse.$suffix
  fi
done
say "ready: .venv/bin/tselab"
