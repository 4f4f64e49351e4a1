#!/usr/bin/env bash
# Builds both images by the Dockerfile and runs them, without a daemon: by buildah with chroot
# isolation. Says how large they are; ends with 0 if they do what they should.
#
#   deploy/container/check.sh [--base FOLDER] [--packages FOLDER] [--maneuver PROGRAM] [-- OPTIONS]
#
# --base      a plain Debian 12, as debootstrap makes it, in place of the image debian:bookworm-slim
# --packages  .deb files that are there already, in place of building them as the Dockerfile says
# --maneuver  the command, to have the image with the trainer learn a little; not done without
#
# OPTIONS     of "buildah build", such as a volume for the cache of compiled objects
#
# Wants root, buildah and, for the network that both sides see, iproute2. Not part of the tests:
# building takes long, and all of LibTorch is installed.
set -euo pipefail
cd "$(dirname "$0")/../.."

base=
packages=
maneuver=
usage() { sed -n '2,16s/^# \{0,1\}//p' "$0"; }
while [ $# -gt 0 ]; do
  case "$1" in
    --base) base=$(cd "${2:?--base needs a folder}" && pwd); shift ;;
    --packages) packages=$(cd "${2:?--packages needs a folder}" && pwd); shift ;;
    --maneuver) maneuver=$(realpath "${2:?--maneuver needs a program}"); shift ;;
    --) shift; break ;;
    -h|--help) usage; exit 0 ;;
    *) echo "check: unknown option $1; see --help" >&2; exit 2 ;;
  esac
  shift
done
version=$(sed -n 's/^project(maneuver VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)

step() { printf '\n\033[1m== %s\033[0m (%d s)\n' "$*" "$SECONDS"; }
wrong() { echo "WRONG: $*" >&2; exit 1; }
work=$(mktemp -d "${TMPDIR:-/tmp}/maneuver-container.XXXXXX")
containers=()
network=
leave() {
  local status=$?
  [ -z "$network" ] || kill "$network" 2>/dev/null || true
  for container in "${containers[@]}"; do buildah rm "$container" >/dev/null || true; done
  rm -rf "$work"
  exit "$status"
}
trap leave EXIT

options=(--isolation chroot --layers --file deploy/container/Dockerfile --ignorefile deploy/container/Dockerfile.dockerignore)
if [ -n "$base" ]; then
  step "The base, without what the slim images leave out"
  container=$(buildah from scratch)
  containers+=("$container")
  folder=$(buildah mount "$container")
  cp -a "$base/." "$folder"
  rm -rf "$folder"/var/lib/apt/lists/* "$folder"/var/cache/apt/*.bin "$folder"/var/cache/apt/archives/*.deb \
    "$folder"/usr/share/{doc,info,locale,man}/* "$folder"/packages
  buildah umount "$container" >/dev/null
  buildah config --cmd bash "$container"
  buildah commit --quiet "$container" localhost/maneuver-base >/dev/null
  options+=(--build-arg BASE=localhost/maneuver-base)
fi
options+=("$@")
[ -z "$packages" ] || options+=(--build-context "packages=$packages")

size() { buildah inspect --type image --format '{{.FromImageID}}' "$1" | xargs -I{} sh -c "buildah images --format '{{.ID}} {{.Size}}' --no-trunc | grep {} | head -n 1 | cut -d' ' -f2-"; }
for target in maneuverd maneuverd-trainer; do
  step "Image maneuver/$target:$version"
  buildah build "${options[@]}" --target "$target" --tag "maneuver/$target:$version" . >"$work/$target.log" 2>&1 ||
    { tail -n 30 "$work/$target.log" >&2; wrong "the image $target"; }
  echo "size: $(size "maneuver/$target:$version")"
done
[ -z "$base" ] || echo "of that the base: $(size localhost/maneuver-base)"

step "What an image says of itself"
of_image() { buildah inspect --type image --format "$1" "maneuver/maneuverd:$version"; }
[ "$(of_image '{{.OCIv1.Config.User}}')" = 8470:8470 ] || wrong "user"
[ "$(of_image '{{.OCIv1.Config.Entrypoint}}')" = "[maneuverd]" ] || wrong "entrypoint"
of_image 'user {{.OCIv1.Config.User}}, runs {{.OCIv1.Config.Entrypoint}}, ports {{.OCIv1.Config.ExposedPorts}}, volumes {{.OCIv1.Config.Volumes}}'

# A network of its own, where the images' ports are free.
unshare --net sleep infinity &
network=$!
sleep 0.5
in_network() { nsenter --target "$network" --net "$@"; }
in_network ip link set lo up
run() { # run CONTAINER COMMAND... as the image says, with no capability
  local container=$1
  shift
  in_network buildah run --isolation chroot --cap-drop all "$container" -- "$@"
}
wait_until() { for _ in $(seq 300); do "$@" >/dev/null 2>&1 && return; sleep 0.2; done; wrong "never: $*"; }

for target in maneuverd maneuverd-trainer; do
  step "$target runs"
  container=$(buildah from "maneuver/$target:$version")
  containers+=("$container")
  [ "$(run "$container" id -u)" = 8470 ] || wrong "another user: $(run "$container" id -u)"
  ! run "$container" touch /etc/maneuver/probe 2>/dev/null || wrong "it may write its configuration"
  run "$container" touch /var/lib/maneuver/probe || wrong "it may not write its state"
  ! run "$container" maneuverd health 2>/dev/null || wrong "healthy before it runs"
  # Its end is its own: SIGTERM goes to the server, whose number it says.
  run "$container" sh -c 'echo $$ >/var/lib/maneuver/pid; exec maneuverd' >"$work/$target.out" 2>&1 &
  server=$!
  wait_until run "$container" maneuverd health
  echo "maneuverd health: $(run "$container" maneuverd health)"
  ! run "$container" maneuverd health maneuver.v1.PredictionService 2>/dev/null || wrong "ready without a model"
  if [ "$target" = maneuverd-trainer ] && [ -n "$maneuver" ]; then
    in_network "$maneuver" synthesize "$work/town" --recordings 60 --seed 1 >/dev/null
    in_network "$maneuver" dataset upload "$work/town" town >/dev/null
    in_network "$maneuver" train town --dataset town --settings deploy/packages/small_training.json >"$work/train.log" 2>&1 ||
      { tail "$work/train.log" >&2; wrong "training"; }
    run "$container" maneuverd health maneuver.v1.PredictionService || wrong "not ready with a model"
    in_network "$maneuver" model list
  fi
  run "$container" sh -c 'kill -TERM $(cat /var/lib/maneuver/pid)'
  wait "$server" || { cat "$work/$target.out" >&2; wrong "the server ended with $?"; }
  echo "SIGTERM: it ended by itself, with 0"
done
step "Both images do what they should"
