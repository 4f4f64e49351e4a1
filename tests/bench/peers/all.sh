#!/usr/bin/env bash
# Every peer whose needs are installed, as Markdown: see README.md.
#
#   tests/bench/peers/all.sh MODEL_FOLDER [DATASET_FOLDER]
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,4s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-/usr/bin/python3}
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
else
  printf 'ONNX Runtime is not installed here.\n\n'
fi
if has_modules "torch, numpy"; then
  block "PyTorch" "$python" "$here/pytorch.py" "$@"
else
  printf 'PyTorch is not installed here.\n\n'
fi
if [ $# -ge 2 ] && has_modules "torch, numpy"; then
  printf '### Training\n\n'
  "$here/../training.sh" "$@"
  printf '\n'
fi
if has_modules "torch, numpy, cv2, grpc, google.protobuf"; then
  printf '### A server in Python\n\n'
  "$here/server.sh" "$@"
else
  printf 'What the server in Python needs is not installed here.\n'
fi
