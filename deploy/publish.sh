#!/usr/bin/env bash
# Copies a model version from a data folder to a folder of published models, from
# which replicas take it. The server may run meanwhile.
#
#   deploy/publish.sh DATA_DIR MODEL/VERSION PUBLISHED
#
# It appears in PUBLISHED/MODEL/VERSION in one step, or not at all. A version that
# is already there stays as it is: a number never means another model.
set -euo pipefail

usage() { sed -n '2,8s/^# \{0,1\}//p' "$0"; }
case "${1:-}" in -h|--help) usage; exit 0 ;; esac
[ $# -eq 3 ] || { usage >&2; exit 2; }
source="${1%/}/models/$2"
target="${3%/}/$2"
[[ "$2" =~ ^[a-z][a-z0-9-]*/[1-9][0-9]*$ ]] || { echo "publish: $2 is not a version; name it as town/3" >&2; exit 2; }
[ -f "$source/model.json" ] || { echo "publish: there is no $source" >&2; exit 1; }
same() { cmp -s "$source/weights.safetensors" "$target/weights.safetensors"; }
if [ -e "$target" ]; then
  same || { echo "publish: $target is another model of that number" >&2; exit 1; }
  echo "$target is already there"
  exit 0
fi
mkdir -p "$(dirname "$target")"
unfinished=$(mktemp -d "$(dirname "$target")/.unfinished-XXXXXX")
trap 'rm -rf "$unfinished"' EXIT
chmod 755 "$unfinished"
# What was measured of it stays behind: it is of the server's datasets.
install -m 644 -p "$source/model.json" "$source/weights.safetensors" "$unfinished/"
sync -f "$unfinished"
mv -T "$unfinished" "$target"
trap - EXIT
echo "$target"
