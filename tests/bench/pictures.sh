#!/usr/bin/env bash
# Draws what models have learned, so that one can look at it: the actions of each model, and the same
# scenes as each model predicts them.
#
#   tests/bench/pictures.sh DATASET_FOLDER OUTPUT_FOLDER MODEL_FOLDER...
#
#   SCENES=20     that many recordings, evenly spread over the dataset (default 20)
#   BIN=FOLDER    where maneuverd and maneuver are (default: build/release/bin)
#
# Writes OUTPUT_FOLDER/NAME/actions.png and OUTPUT_FOLDER/NAME/scene-N.png for each model, where NAME
# is the name of its folder, and the figures beside them as text. scene-N is the same scene for all
# models, line N of OUTPUT_FOLDER/scenes.txt. Use recordings that the models did not learn from.
set -euo pipefail

[ $# -ge 3 ] || { sed -n '2,12s/^# \{0,1\}//p' "$0" >&2; exit 2; }
dataset=$1 output=$2
shift 2
scenes=${SCENES:-20}
bin=${BIN:-$(dirname "$0")/../../build/release/bin}

work=$(mktemp -d)
server=
finish() {
  [ -z "$server" ] || { kill "$server" && wait "$server"; } 2>/dev/null || true
  rm -rf "$work"
}
trap finish EXIT

names=()
mkdir -p "$work/data/models" "$work/scenes" "$output"
for folder in "$@"; do
  name=$(basename "$folder")
  [ ! -e "$work/data/models/$name" ] || { echo "pictures: two models are called $name" >&2; exit 2; }
  mkdir "$work/data/models/$name"
  cp -r "$folder" "$work/data/models/$name/1"
  names+=("$name")
done

"$bin/maneuverd" --data-dir "$work/data" --listen 127.0.0.1:0 --metrics-listen 127.0.0.1:0 \
  --port-file "$work/ports.json" >"$work/maneuverd.log" 2>&1 &
server=$!
for _ in $(seq 600); do
  [ ! -s "$work/ports.json" ] || break
  kill -0 "$server" 2>/dev/null || { cat "$work/maneuverd.log" >&2; exit 1; }
  sleep 0.1
done
[ -s "$work/ports.json" ] || { echo "pictures: the server did not start" >&2; exit 1; }
MANEUVER_SERVER=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' "$work/ports.json")
export MANEUVER_SERVER

# Evenly spread: neighbours in a dataset are often of the same drive.
"$bin/maneuver" scenario list "$dataset" --most 0 --output json |
  grep -o '"scenario_\?[iI]d": *"[^"]*"' | cut -d'"' -f4 |
  awk -v wanted="$scenes" '{ id[NR] = $0 }
    END { n = wanted < NR ? wanted : NR; for (i = 0; i < n; ++i) print id[int((i + 0.5) * NR / n) + 1] }' \
  >"$output/scenes.txt"
number=0
while read -r id; do
  number=$((number + 1))
  "$bin/maneuver" scenario extract "$dataset" "$id" --out "$work/scenes/$number.json"
done <"$output/scenes.txt"

for name in "${names[@]}"; do
  mkdir -p "$output/$name"
  "$bin/maneuver" model actions "$name/1" --plot "$output/$name/actions.png" >"$output/$name/actions.txt"
  for i in $(seq "$number"); do
    "$bin/maneuver" predict "$work/scenes/$i.json" --model "$name/1" --paths \
      --plot "$output/$name/scene-$i.png" >"$output/$name/scene-$i.txt"
  done
done
echo "The pictures are in $output: $(printf '%s ' "${names[@]}")"
