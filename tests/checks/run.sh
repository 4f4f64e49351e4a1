#!/usr/bin/env bash
# Checks the source: its format, its contract, and what clang-tidy says of changed lines.
#
#   tests/checks/run.sh [format] [contract] [tidy]        without names: all three
#
# Runs each check whatever the others say. Exits with 1 if one fails.
set -euo pipefail
cd "$(dirname "$0")"

[ $# -gt 0 ] || set -- format contract tidy
failed=()
for check in "$@"; do
  case "$check" in
    format | contract) program=./$check.sh ;;
    tidy) program=./tidy.py ;;
    *) echo "checks: unknown check $check; format, contract and tidy are known" >&2; exit 2 ;;
  esac
  "$program" || failed+=("$check")
done
[ ${#failed[@]} -eq 0 ] || { echo "checks: failed: ${failed[*]}" >&2; exit 1; }
