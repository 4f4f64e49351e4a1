#!/usr/bin/env bash
# Checks that C++ and protobuf files are formatted by .clang-format, and that scripts can be started by
# their names, as the pages do. With --fix, mends both.
#
#   tests/checks/format.sh [--fix]
set -euo pipefail
cd "$(dirname "$0")/../.."

case "${1:-}" in
  '') action=(--dry-run --Werror --ferror-limit=3) ;;
  --fix) action=(-i) ;;
  *) echo "format: unknown option $1; only --fix is known" >&2; exit 2 ;;
esac
# Versions format differently, and Debian 12 has this one.
version=$(clang-format --version | grep -oE 'version [0-9]+' || true)
[ "$version" = "version 14" ] || { echo "format: clang-format 14 is needed, not ${version:-none}" >&2; exit 1; }

mapfile -t files < <(git ls-files --cached --others --exclude-standard '*.cc' '*.h' '*.proto' | while read -r file; do
  [ ! -f "$file" ] || echo "$file"
done)
[ ${#files[@]} -gt 0 ] || { echo "format: git lists no files here" >&2; exit 1; }
if ! printf '%s\0' "${files[@]}" | xargs -0 -P "$(nproc)" -n 64 clang-format "${action[@]}"; then
  echo "format: run tests/checks/format.sh --fix" >&2
  exit 1
fi
mapfile -t scripts < <(git ls-files -z | xargs -0 awk 'FNR == 1 { if (/^#!/) print FILENAME; nextfile }' 2>/dev/null)
for script in "${scripts[@]}"; do
  [ ! -x "$script" ] || continue
  [ "${1:-}" != --fix ] || { chmod +x "$script"; continue; }
  echo "format: $script is a script that cannot be started: chmod +x" >&2
  failed=1
done
[ -z "${failed:-}" ] || exit 1
echo "format: ${#files[@]} files are formatted, and ${#scripts[@]} scripts can be started"
