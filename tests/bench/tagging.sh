#!/usr/bin/env bash
# Speed and memory of maneuver tag, and the speed of maneuver find: prints Markdown.
#
#   tests/bench/tagging.sh MODEL [MEGABYTES...]          (default: 20 40 80)
#
# For each size it makes a dataset of the synthetic town, and measures in turns, ROUNDS (3) times: the engine alone, in one
# process with everything in memory (tests/bench/tag_engine.cc), and the whole command. The share is what reading and
# writing leave of the engine's speed; by CPU time it depends less on what else runs. Then it measures maneuver find on
# rows of random numbers.
#
# THREADS (one for each core); ROUNDS (3); ROWS (10000000) of maneuver find; SECONDS_EACH (10) of the engine; BIN
# (build/release/bin); FOLDER keeps the datasets from one call to the next (default: a temporary folder).
# Needs the targets maneuver, tag_engine and make_tags.
set -euo pipefail
case "${1:-}" in
  -h | --help | "") sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
shift
[ $# -gt 0 ] || set -- 20 40 80
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
threads=${THREADS:-$(nproc)}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=${FOLDER:-$work}
bytes_each=175000  # of a recording of 20 s

# Prints the median of the lines of a file.
median() { sort -g "$1" | awk '{ line[NR] = $1 } END { print line[int((NR + 1) / 2)] }'; }

echo "$threads threads"
echo
echo "| dataset, MB | windows | engine alone, windows/s | maneuver tag, windows/s | share | by CPU time, share | peak, MB |"
echo "|---:|---:|---:|---:|---:|---:|---:|"
for megabytes in "$@"; do
  town=$folder/town-$megabytes
  [ -d "$town" ] || "$bin/maneuver" --quiet synthesize "$town" --recordings $((megabytes * 1000000 / bytes_each)) >/dev/null
  "$bin/maneuver" dataset index "$town" >/dev/null
  rm -f "$work"/engine* "$work"/tag* "$work"/peak
  for _ in $(seq "${ROUNDS:-3}"); do
    "$bin/tag_engine" "$model" "$town" "$threads" "${SECONDS_EACH:-10}" >"$work/rates"
    cut -d' ' -f1 "$work/rates" >>"$work/engine"
    cut -d' ' -f2 "$work/rates" >>"$work/engine_cpu"
    rm -rf "$work/made"
    /usr/bin/time -f '%M %U %S' -o "$work/effort" "$bin/maneuver" --output json --progress none tag "$town" \
      --model "$model" -o "$work/made" --threads "$threads" >"$work/summary"
    windows=$(sed -n 's/.*"windows": *\([0-9]*\).*/\1/p' "$work/summary")
    sed -n 's/.*"windowsPerSecond": *\([0-9.e+]*\).*/\1/p' "$work/summary" >>"$work/tag"
    awk -v windows="$windows" '{ print windows / ($2 + $3) }' "$work/effort" >>"$work/tag_cpu"
    awk '{ print $1 / 1024 }' "$work/effort" >>"$work/peak"
  done
  printf '| %d | %d | %.0f | %.0f | %.2f | %.2f | %.0f |\n' "$(du -sm --apparent-size "$town" | cut -f1)" "$windows" \
    "$(median "$work/engine")" "$(median "$work/tag")" \
    "$(awk -v a="$(median "$work/tag")" -v b="$(median "$work/engine")" 'BEGIN { print a / b }')" \
    "$(awk -v a="$(median "$work/tag_cpu")" -v b="$(median "$work/engine_cpu")" 'BEGIN { print a / b }')" \
    "$(median "$work/peak")"
done

rows=${ROWS:-10000000}
[ "$rows" -gt 0 ] || exit 0
made=$folder/made-$rows
[ -d "$made" ] || "$bin/make_tags" "$made" "$rows"
echo
echo "maneuver find, $rows rows, $(du -sm "$made" | cut -f1) MB in all; median of 5"
echo
echo "| question | s | CPU s |"
echo "|---|---:|---:|"
# $1: what it is; the rest: options
ask() {
  local name=$1
  shift
  rm -f "$work/seconds"
  for _ in 1 2 3 4 5; do
    /usr/bin/time -f '%e %U %S' -a -o "$work/seconds" "$bin/maneuver" --quiet find "$made" --threads "$threads" "$@" >/dev/null
  done
  awk '{ print $2 + $3 }' "$work/seconds" >"$work/cpu"
  cut -d' ' -f1 "$work/seconds" >"$work/clock"
  echo "| $name | $(median "$work/clock") | $(median "$work/cpu") |"
}
ask "one action, probability, speed" --action "action 7" --min-probability 0.8 --speed 5..12
ask "a place" --near 100,200,50
ask "followed by another" --action "action 7" --followed-by "action 3" --within 3
ask "beside another target" --action "action 7" --answered-by "action 3" --distance 5000 --side behind
ask "the 50 most surprising" --surprise top:50
ask "counts by action" --by action
