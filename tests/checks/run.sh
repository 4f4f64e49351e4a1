#!/usr/bin/env bash
# Checks the source: its format, contract, locks, borders and walls, what clang-tidy says of changed
# lines, and whether changed sources compile by themselves.
#
#   tests/checks/run.sh [format] [contract] [locks] [borders] [walls] [tidy] [alone]   without names: all
#
# Runs each check whatever the others say. Exits with 1 if one fails.
set -euo pipefail
cd "$(dirname "$0")"

[ $# -gt 0 ] || set -- format contract locks borders walls tidy alone
failed=()
for check in "$@"; do
  case "$check" in
    format | contract | borders) program=./$check.sh ;;
    locks | walls | tidy | alone) program=./$check.py ;;
    *) echo "checks: unknown check $check; format, contract, locks, borders, walls, tidy and alone are known" >&2; exit 2 ;;
  esac
  "$program" || failed+=("$check")
done
[ ${#failed[@]} -eq 0 ] || { echo "checks: failed: ${failed[*]}" >&2; exit 1; }
