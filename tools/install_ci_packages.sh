#!/usr/bin/env bash
# Debian packages for the tests of GenICam cameras, where apt and root are at hand.
# Never fails: without them those tests skip and say what is missing.
set -uo pipefail
cd "$(dirname "$0")/.."
python="${1:-.venv/bin/python}"
packages=(aravis-tools gir1.2-aravis-0.8 libaravis-0.8-0
          libgirepository1.0-dev libcairo2-dev pkg-config gcc libc6-dev)

without() { echo "GenICam tests will skip: $1"; exit 0; }

missing=()
if ! command -v dpkg-query >/dev/null; then without "this is not a Debian system"; fi
for package in "${packages[@]}"; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
if ((${#missing[@]})); then
    [ "$(id -u)" = 0 ] || without "not root, and missing: ${missing[*]}"
    export DEBIAN_FRONTEND=noninteractive
    # The package lists may be there already; fetching them again is slow.
    install=(timeout 300 apt-get install -qq -y --no-install-recommends "${missing[@]}")
    "${install[@]}" >/dev/null 2>&1 ||
        { timeout 120 apt-get update -qq >/dev/null 2>&1 && "${install[@]}" >/dev/null 2>&1; } ||
        without "apt-get could not install ${missing[*]}"
fi
"$python" -c 'import gi; gi.require_version("Aravis", "0.8")' 2>/dev/null ||
    timeout 300 "$python" -m pip install --quiet 'PyGObject<3.51' >/dev/null 2>&1 ||
    without "PyGObject<3.51 could not be built for $python"
echo "GenICam tests: Aravis is installed"
