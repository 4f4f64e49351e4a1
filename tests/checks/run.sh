#!/usr/bin/env bash
# Checks the source: its format, its contract, what clang-tidy says of changed lines, and whether
# changed sources include what they use.
#
#   tests/checks/run.sh [format] [contract] [tidy] [alone]        without names: all of them
#
# Runs each check whatever the others say. Exits with 1 if one fails.
set -euo pipefail
cd "$(dirname "$0")"

[ $# -gt 0 ] || set -- format contract tidy alone
failed=()
for check in "$@"; do
  case "$check" in
    format | contract) program=./$check.sh ;;
    tidy | alone) program=./$check.py ;;
    *) echo "checks: unknown check $check; format, contract, tidy and alone are known" >&2; exit 2 ;;
  esac
  "$program" || failed+=("$check")
done
[ ${#failed[@]} -eq 0 ] || { echo "checks: failed: ${failed[*]}" >&2; exit 1; }
