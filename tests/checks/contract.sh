#!/usr/bin/env bash
# Checks proto/ by buf.yaml: its style, and that nothing breaks for callers of the last landed
# contract (landed.sh). buf comes from npm in the version that buf/package-lock.json pins; where npm
# cannot fetch it, or git has no landed commit, says so and skips that part. With MANEUVER_NEEDS_BUF=1,
# as in CI, fails where npm cannot fetch it.
set -euo pipefail
cd "$(dirname "$0")/../.."

folder=tests/checks/buf
buf=$folder/node_modules/@bufbuild/buf-linux-x64/bin/buf
pinned=$(grep -oE '"@bufbuild/buf-linux-x64": "[^"]+"' $folder/package.json | cut -d'"' -f4)
is_here() { [ "$("$buf" --version 2>/dev/null || true)" = "$pinned" ]; }
log=build/checks/npm.log
mkdir -p build/checks
if ! is_here; then
  (cd $folder && timeout 120 npm ci --no-audit --no-fund --ignore-scripts) >$log 2>&1 || true
  if ! is_here; then
    echo "contract: SKIPPED: npm could not fetch buf $pinned:" >&2
    grep -v '^npm warn' $log | head -n 3 >&2 || true
    exit "${MANEUVER_NEEDS_BUF:-0}"
  fi
fi

failed=0
"$buf" lint || { failed=1; echo "contract: buf.yaml names the rules that proto/ breaks above" >&2; }
if landed=$(tests/checks/landed.sh); then
  before=$(mktemp -d)
  trap 'rm -rf "$before"' EXIT
  git archive "$landed" proto buf.yaml | tar xf - -C "$before"
  if ! "$buf" breaking --against "$before"; then
    failed=1
    echo "contract: the lines above break callers of the contract of ${landed:0:12}; add instead of changing" >&2
  fi
else
  echo "contract: SKIPPED: the comparison with the last landed contract" >&2
fi
[ $failed -eq 0 ] || exit 1
echo "contract: style is kept${landed:+, and callers of ${landed:0:12} are served}"
