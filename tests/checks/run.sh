#!/usr/bin/env bash
# Checks the source: its format, contract, locks and borders, and what clang-tidy says of changed lines.
#
#   tests/checks/run.sh [format] [contract] [locks] [borders] [tidy]        without names: all of them
#
# Runs each check whatever the others say. Exits with 1 if one fails.
set -euo pipefail
cd "$(dirname "$0")"

[ $# -gt 0 ] || set -- format contract locks borders tidy
failed=()
for check in "$@"; do
  case "$check" in
    format | contract | borders) program=./$check.sh ;;
    locks) program=./locks.py ;;
    tidy) program=./tidy.py ;;
    *) echo "checks: unknown check $check; format, contract, locks, borders and tidy are known" >&2; exit 2 ;;
  esac
  "$program" || failed+=("$check")
done
[ ${#failed[@]} -eq 0 ] || { echo "checks: failed: ${failed[*]}" >&2; exit 1; }
