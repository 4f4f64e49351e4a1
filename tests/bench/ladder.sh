#!/usr/bin/env bash
# What each part of the model is worth: cross-validates the steps from the paper's model in small to
# the default on the same folds, and prints a table in Markdown.
#
#   tests/bench/ladder.sh DATASET_FOLDER [OTHER_DATASET_FOLDER]   > ladder.md
#
#   ROWS="lanes compact"  only these rows      SEEDS=1,2,3  training seeds (default 1)
#   FOLDS=5               folds                RESULTS=DIR  keeps the parts and the JSON (default: a
#                                              temporary folder); rows that are there are not run again
#
# OTHER_DATASET_FOLDER is measured whole by each fold's model: out of distribution. Two folds run
# side by side, one on each core; a row takes about ten minutes on 285 recordings and two cores.
set -euo pipefail
dataset=${1:?name a dataset folder; see the beginning of this script}
other=${2:-}
seeds=${SEEDS:-1}
folds=${FOLDS:-5}
results=${RESULTS:-$(mktemp -d)}
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
mkdir -p "$results"

declare -A settings=(
  [compact]='{"preset": "compact"}'
  [lanes-metres]='{"preset": "lanes-metres"}'
  [history]='{"preset": "lanes", "model": {"scene_vectors": {"path_width": 0, "agent_width": 0}, "action_geometry": {"pair_width": 0}}}'
  [no-agents]='{"preset": "lanes", "model": {"scene_vectors": {"agent_width": 0}}}'
  [relative]='{"preset": "lanes", "model": {"mean_residual": false}}'
  [gaussian]='{"preset": "lanes", "optimization": {"posterior_huber": 0, "posterior_reconstruction_weight": 0.05}}'
  [no-noise]='{"preset": "lanes", "augmentation": {"sensor_noise": 0}}'
  [sparse]='{"preset": "lanes", "examples": {"training_stride": "0.5s"}}'
  [forty-epochs]='{"preset": "lanes", "optimization": {"joint_epochs": 40}}'
  [printed]='{"preset": "lanes", "optimization": {"responsibilities": "RESPONSIBILITIES_PRINTED"}}'
  [no-decay]='{"preset": "lanes", "optimization": {"weight_decay": 1e-4}}'
  [fifty-actions]='{"preset": "lanes", "model": {"actions": 50}}'
  [lanes]='{"preset": "lanes"}'
)
rows=${ROWS:-compact lanes-metres history no-agents relative gaussian no-noise sparse lanes}

run_row() { # row
  local row=$1 running=0
  echo "${settings[$row]}" >"$results/$row.settings.json"
  for fold in $(seq "$folds"); do
    [ -s "$results/$row.$fold.part" ] && continue
    OMP_NUM_THREADS=1 "$bin/maneuver-trainer" cross-validate --dataset "$dataset" \
      ${other:+--test-dataset "other=$other"} --settings "$results/$row.settings.json" \
      --folds "$folds" --seeds "$seeds" --only-fold "$fold" --part "$results/$row.$fold.part" \
      --threads 1 --progress none >"$results/$row.$fold.log" 2>&1 &
    running=$((running + 1))
    if [ $running -ge 2 ]; then wait -n; running=$((running - 1)); fi
  done
  wait
  "$bin/maneuver-trainer" cross-validate --merge "$results/$row".*.part \
    --output "$results/$row.json" >"$results/$row.txt"
}

for row in $rows; do
  [ -s "$results/$row.json" ] || run_row "$row" >&2
done
python3 - "$results" $rows <<'PYTHON'
import json, sys
results, rows = sys.argv[1], sys.argv[2:]
metrics = ['ade_ratio', 'min_ade_6', 'min_fde_6', 'miss_rate_6', 'nll', 'calibration_error', 'coverage_2sigma', 'ade_medoid_ratio']
reports = {row: json.load(open(f'{results}/{row}.json')) for row in rows}
for number in range(len(next(iter(reports.values()))['sets'])):
    print('\n| row | ' + ' | '.join(metrics) + ' |\n|---' * 1 + '|---' * len(metrics) + '|')
    for row, report in reports.items():
        held = report['sets'][number]
        cells = []
        for metric in metrics:
            e = held['overall']['metrics'].get(metric)
            cells.append(f"{e['value']:.3f} ({e['lower']:.3f} to {e['upper']:.3f})" if e else '')
        print(f"| {row} | " + ' | '.join(cells) + ' |')
    print(f"\n{held.get('name') or 'held-out folds'}: {held['recordings']} recordings in {held['groups']} groups.")
PYTHON
