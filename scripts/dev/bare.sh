#!/usr/bin/env bash
# Run the two commands of README, scripts/demo.sh and scripts/test.sh, as a new user does:
# on a Debian 12 that has a C compiler, CMake and Python, and nothing else. A script that
# forgets to install a tool fails here. On a developer's machine it would not fail,
# because the tool is there already.
#
#   scripts/dev/bare.sh [COMMAND ...]
#       run these commands instead
#
# Tests the last commit. Needs root: mmdebstrap installs the system in a folder, and
# chroot enters it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
release=bookworm
packages=ca-certificates,gcc,libc6-dev,make,cmake,python3,python3-venv

fail() { printf 'bare: %s\n' "$@" >&2; exit 1; }
[ "$(id -u)" -eq 0 ] || fail "this script must run as root, because it calls chroot"
for tool in mmdebstrap unshare chroot git; do
  command -v "$tool" >/dev/null \
    || fail "$tool is missing (Debian and Ubuntu: packages mmdebstrap, util-linux, coreutils, git)"
done

root=$(mktemp -d)
trap 'rm -rf --one-file-system "$root"' EXIT
chmod 755 "$root"
echo "bare: Debian $release with ${packages//,/, }"
mmdebstrap --quiet --variant=minbase --include="$packages" "$release" "$root" \
  || fail "mmdebstrap could not install the system"
mkdir "$root/tse"
# export the files of the commit: the new system has no git
git archive HEAD | tar -x -C "$root/tse"

# Copy the settings for network and package registries, and nothing else of this machine.
for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
  if [ -f "$file" ]; then cp -L "$file" "$root$file"; fi
done
network=()
for name in http_proxy https_proxy no_proxy HTTP_PROXY HTTPS_PROXY NO_PROXY \
    PIP_INDEX_URL PIP_CERT SSL_CERT_FILE; do
  if [ -n "${!name:-}" ]; then network+=("$name=${!name}"); fi
done

[ "$#" -gt 0 ] || set -- scripts/demo.sh scripts/test.sh
for command in "$@"; do
  echo "bare: $command"
  unshare --mount --pid --fork --kill-child bash -c '
    root=$1 command=$2
    shift 2
    mount -t proc proc "$root/proc" && mount --rbind /dev "$root/dev" || exit 1
    exec chroot "$root" /usr/bin/env -i HOME=/root PATH=/usr/local/bin:/usr/bin:/bin LANG=C.UTF-8 "$@" \
      bash -c "cd /tse && $command"
  ' bare "$root" "$command" ${network[@]+"${network[@]}"} || fail "failed: $command"
done
echo "bare: passed"
