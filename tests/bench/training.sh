#!/usr/bin/env bash
# The trainer's joint phase beside the same networks in PyTorch's eager mode, in turn in one run, as a
# Markdown table; and the share of its steps' time in which the trainer waited for rasters.
#
#   tests/bench/training.sh MODEL_FOLDER DATASET_FOLDER
#
# Both start from the model. THREADS ("1 2", as far as there are cores): for each, both get as many
# threads and as many cores. The trainer draws its rasters on them; PyTorch has them in memory (see
# peers/pytorch_training.py). ROUNDS (3) of turns of SECONDS_EACH (10); PYTHON (/usr/bin/python3), BIN
# (build/release/bin). For each turn the trainer reads the dataset once more.
set -euo pipefail
case "${1:---help}" in
  -h|--help) sed -n '2,11s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
dataset=$2
here=$(cd "$(dirname "$0")" && pwd)
BIN=$(cd "${BIN:-$here/../../build/release/bin}" && pwd)
export BIN

echo "| threads on cores | maneuver-trainer, examples/s | PyTorch, examples/s | maneuver-trainer / PyTorch (least to most) | maneuver-trainer, processor ms an example | PyTorch, processor ms an example | waited for rasters |"
echo "|---|---:|---:|---:|---:|---:|---:|"
for threads in ${THREADS:-1 2}; do
  [ "$threads" -le "$(nproc)" ] || continue
  THREADS=$threads taskset -c "0-$((threads - 1))" \
    "${PYTHON:-/usr/bin/python3}" "$here/peers/pytorch_training.py" "$model" "$dataset"
done
