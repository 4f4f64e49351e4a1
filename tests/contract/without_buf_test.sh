#!/usr/bin/env bash
# Where npm cannot fetch buf, the check of the contract is skipped, and fails in CI.
set -euo pipefail
cd "$(dirname "$0")/../.."

copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
mkdir -p "$copy/tests/checks/buf" "$copy/bin"
cp tests/checks/contract.sh "$copy/tests/checks"
cp tests/checks/buf/*.json "$copy/tests/checks/buf"
printf '#!/bin/sh\necho "npm error: no network"\nexit 1\n' >"$copy/bin/npm"
chmod +x "$copy/bin/npm"

# expect STATUS [VARIABLE=VALUE]
expect() {
  local status=0 said
  said=$(env PATH="$copy/bin:$PATH" "${@:2}" "$copy/tests/checks/contract.sh" 2>&1) || status=$?
  [ "$status" -eq "$1" ] || { echo "exit status $status, not $1: $said" >&2; exit 1; }
  grep -q "no network" <<<"$said" || { echo "does not say what npm said: $said" >&2; exit 1; }
}
expect 0 MANEUVER_NEEDS_BUF=0
expect 1 MANEUVER_NEEDS_BUF=1
grep -q '^MANEUVER_NEEDS_BUF=1 check source .* contract ' .ci/run || { echo ".ci/run passes without buf" >&2; exit 1; }
