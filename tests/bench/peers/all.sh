#!/usr/bin/env bash
# Every peer whose needs are installed, as Markdown: see README.md.
#
#   tests/bench/peers/all.sh MODEL_FOLDER [DATASET_FOLDER]
#
# ONNX Runtime evaluates ResNet-50 as well, with random weights: its speed does not depend on them.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-/usr/bin/python3}
bin=${BIN:-$here/../../../build/release/bin}
reads_raster() { grep -q '"raster"' "$1/model.json"; }
has_modules() { "$python" -c "import $1" 2>/dev/null; }
# block TITLE COMMAND...: what the command prints.
block() {
  printf '### %s\n\n```\n' "$1"
  shift
  "$@"
  printf '```\n\n'
}

if (cd "$here" && node -e 'require.resolve("onnxruntime-node")' 2>/dev/null); then
  block "ONNX Runtime" node "$here/onnxruntime.cjs" "$@"
  block "ONNX Runtime, the engine in f32 as well" env F32=1 node "$here/onnxruntime.cjs" "$@"
  reads_raster "$1" || printf '%s\n\n' \
    "The engine skips lane paths and agents that are not there, so one recording says little ([speed.md](speed.md#beside-onnx-runtime) has 15)."
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  "$bin/maneuver-bench" --model resnet50 --write-model "$work/resnet50" >&2
  block "ONNX Runtime, ResNet-50" env ROUNDS=8 node "$here/onnxruntime.cjs" "$work/resnet50" "${@:2}"
  block "ONNX Runtime, ResNet-50, the engine in f32 as well" \
    env ROUNDS=8 F32=1 node "$here/onnxruntime.cjs" "$work/resnet50" "${@:2}"
else
  printf 'ONNX Runtime is not installed here.\n\n'
fi
if ! reads_raster "$1"; then
  printf 'PyTorch alone is compared on models with a raster only.\n\n'
elif has_modules "torch, numpy"; then
  block "PyTorch" "$python" "$here/pytorch.py" "$@"
else
  printf 'PyTorch is not installed here.\n\n'
fi
if [ $# -ge 2 ] && reads_raster "$1" && has_modules "torch, numpy"; then
  printf '### Training\n\n'
  "$here/../training.sh" "$@"
  printf '\n'
fi
modules="torch, numpy, grpc, google.protobuf"
if reads_raster "$1"; then modules+=", cv2"; fi
if has_modules "$modules"; then
  printf '### A server in Python\n\n'
  "$here/server.sh" "$@"
else
  printf 'What the server in Python needs is not installed here.\n'
fi
