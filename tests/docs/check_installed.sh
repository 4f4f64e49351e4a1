#!/usr/bin/env bash
# Installs the pages as the package maneuverd has them, and checks every link of theirs.
#
#   tests/docs/check_installed.sh BUILD
set -euo pipefail
build=$(cd "${1:?the build folder}" && pwd)
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d "${TMPDIR:-/tmp}/maneuver-docs-test.XXXXXX")
trap 'rm -rf "$work"' EXIT
cmake -DCMAKE_INSTALL_COMPONENT=server "-DCMAKE_INSTALL_PREFIX=$work/usr" \
  -P "$build/deploy/packages/cmake_install.cmake" >/dev/null
"$here/check_pages.py" --installed "$work/usr/share/doc/maneuverd"
