#!/usr/bin/env bash
# From nothing to two answered questions on a fresh Debian 12: installs the
# packages, builds, starts a server, makes a town, uploads it, trains a model
# through the Train RPC, asks both questions about scenes that the model has
# never seen, and draws the answers.
#
#   deploy/quickstart.sh [--keep-running] [--recordings N] [--data-dir DIR] [--preset NAME]
#
# --preset paper learns the paper's own model in place of the default, which takes about 20 minutes;
# docs/explanation/model.md has the others.
# Run again, it builds only what changed and uses the town and the model that
# are already there; --fresh starts over.
set -euo pipefail
caller=$PWD
cd "$(dirname "$0")/.."

keep_running=false
fresh=false
recordings=240
work="$PWD/build/quickstart"
preset=lanes
usage() { sed -n '2,14s/^# \{0,1\}//p' "$0"; }
while [ $# -gt 0 ]; do
  case "$1" in
    --keep-running) keep_running=true ;;
    --fresh) fresh=true ;;
    --recordings) recordings=${2:?--recordings needs a number}; shift ;;
    --data-dir) work=$(cd "$caller" && realpath -m -- "${2:?--data-dir needs a folder}"); shift ;;
    --preset) preset=${2:?--preset needs a name}; shift ;;
    -h|--help) usage; exit 0 ;;
    *) echo "quickstart: unknown option $1; see --help" >&2; exit 2 ;;
  esac
  shift
done

started=$SECONDS
step() { printf '\n\033[1m== %s\033[0m (%d s)\n' "$*" $((SECONDS - started)); }

step "Packages"
deploy/install-deps.sh

step "Build"
log="$PWD/build/quickstart-build.log"
mkdir -p build
if ! { cmake --preset release && cmake --build --preset release --target maneuverd maneuver maneuver-trainer; } >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  echo "quickstart: the build failed; all of it is in build/quickstart-build.log" >&2
  exit 1
fi
bin="$PWD/build/release/bin"
export PATH="$bin:$PATH"

# What it made itself: the folder may have other things in it.
$fresh && rm -rf "$work"/{data,town,unseen,unseen.json,scenes,pictures,ports.json,maneuverd.out,maneuverd.log}
mkdir -p "$work/pictures" "$work/scenes"

step "Server"
# Port 0: any free port. The server writes the ones it got into a file.
rm -f "$work/ports.json"
# A session of its own: Ctrl-C is for this script, which then stops the server.
trap 'exit 130' INT
trap 'exit 143' TERM
setsid maneuverd --data-dir "$work/data" --listen 127.0.0.1:0 --metrics-listen 127.0.0.1:0 \
  --port-file "$work/ports.json" >"$work/maneuverd.out" 2>"$work/maneuverd.log" &
server=$!
stop_server() {
  if kill -0 "$server" 2>/dev/null; then
    kill -TERM "$server"
    wait "$server" && echo "The server stopped cleanly." || echo "The server ended with status $?." >&2
  fi
}
trap stop_server EXIT
for _ in $(seq 300); do
  [ -s "$work/ports.json" ] && break
  kill -0 "$server" 2>/dev/null || { cat "$work/maneuverd.log" >&2; exit 1; }
  sleep 0.1
done
[ -s "$work/ports.json" ] || { echo "quickstart: the server did not start; see $work/maneuverd.log" >&2; exit 1; }
address=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' "$work/ports.json")
metrics=$(sed -n 's/.*"metrics": *"\([^"]*\)".*/\1/p' "$work/ports.json")
export MANEUVER_SERVER="$address"
echo "maneuverd listens on $address, metrics on http://$metrics/metrics"

step "A town to learn from, and scenes that the model will not see"
[ -f "$work/town/dataset.json" ] || maneuver synthesize "$work/town" --recordings "$recordings" --seed 1
[ -f "$work/unseen/dataset.json" ] || maneuver synthesize "$work/unseen" --recordings 40 --seed 2
for name in town unseen; do
  maneuver dataset show "$name" >/dev/null 2>&1 || maneuver dataset upload "$work/$name" "$name"
done

step "Training through the Train RPC"
# A training that an earlier run left, since it was interrupted, goes on.
left=$(maneuver job list --state pending --state running --output json | grep -o '"jobs/[^"]*"' | head -n 1 | tr -d '"' || true)
if maneuver model show town >/dev/null 2>&1; then
  echo "models/town is already there; --fresh trains it again."
elif [ -n "$left" ]; then
  maneuver job watch "$left"
else
  # Fewer epochs and examples than the preset's, to be done in two minutes. All of the town drives on
  # the right: left and right are not to be swapped.
  shorter=(--epochs 8 --set optimization.mixture_epochs=60)
  case "$preset" in
    lanes*) shorter+=(--set optimization.covariance_epochs=3) ;;
    *) shorter=(--epochs 5 --set optimization.mixture_epochs=60 --set optimization.posterior_epochs=1) ;;
  esac
  maneuver train town --dataset town --preset "$preset" --set examples.max_examples=6000 \
    --set augmentation.mirror=false "${shorter[@]}"
fi

step "How good is it on unseen scenes?"
maneuver evaluate town --dataset unseen

step "The action set"
maneuver model actions town --plot "$work/pictures/actions.png"

step "Both questions, about unseen scenes"
maneuver scenario list "$work/unseen" --output json >"$work/unseen.json"
mapfile -t scenes < <(grep -o '"scenario_\?[iI]d": *"[^"]*"' "$work/unseen.json" | cut -d'"' -f4 | head -n 3)
for scene in "${scenes[@]}"; do
  maneuver scenario extract "$work/unseen" "$scene" --out "$work/scenes/$scene.json"
done
first="$work/scenes/${scenes[0]}.json"
echo "What is the probability of each action here?"
maneuver probability "$first"
echo "What would the likely ones look like here?"
maneuver distribution "$first"
for scene in "${scenes[@]}"; do
  maneuver predict "$work/scenes/$scene.json" --plot "$work/pictures/$scene.png" >/dev/null
done

step "Done"
echo "Pictures:"
for scene in "${scenes[@]}"; do echo "  $work/pictures/$scene.png"; done
echo "  $work/pictures/actions.png"
if $keep_running; then
  trap - EXIT
  echo "The server keeps running at $address (process $server). Try:"
  echo "  export MANEUVER_SERVER=$address PATH=$bin:\$PATH; maneuver model list"
  echo "  curl http://$metrics/metrics"
  echo "and stop it with: kill $server"
fi
