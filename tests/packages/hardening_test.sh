#!/usr/bin/env bash
# Looks at how programs were built: with what keeps a fault from becoming an intrusion.
#
#   tests/packages/hardening_test.sh PROGRAM...
set -euo pipefail
[ $# -gt 0 ] || { echo "usage: hardening_test.sh PROGRAM..." >&2; exit 2; }

failed=0
lacks() { echo "WRONG: $program lacks $1" >&2; failed=1; }
for program in "$@"; do
  grep -q 'Type: *DYN' <<<"$(readelf --wide --file-header "$program")" || lacks "PIE"
  grep -q 'FLAGS_1.*NOW' <<<"$(readelf --wide --dynamic "$program")" || lacks "BIND_NOW"
  headers=$(readelf --wide --program-headers "$program")
  grep -q GNU_RELRO <<<"$headers" || lacks "RELRO"
  grep -q 'GNU_STACK.* RW ' <<<"$headers" || lacks "a stack that is not executable"
  symbols=$(readelf --wide --dyn-syms "$program")
  grep -q __stack_chk_fail <<<"$symbols" || lacks "the stack protector"
  grep -Eq '__(mem|str|sn?printf|vsn?printf|read|recv|poll)[a-z]*_chk' <<<"$symbols" ||
    lacks "_FORTIFY_SOURCE"
  # endbr64, the landing pad of an indirect branch: one a function, where the compiler was asked for them.
  pads=$(LC_ALL=C grep --text --only-matching --perl-regexp '\xf3\x0f\x1e\xfa' "$program" | wc -l)
  [ "$pads" -ge 1000 ] || lacks "CET ($pads landing pads)"
done
[ $failed -eq 0 ] && echo "$# programs are hardened."
exit $failed
