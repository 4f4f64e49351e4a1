#!/usr/bin/env bash
# What each part of the model is worth: cross-validates the paper's models, and the default without
# one part after the other, on the same folds, and prints a table in Markdown.
#
#   tests/bench/ladder.sh DATASET_FOLDER...   > ladder.md
#
#   ROWS="lanes compact"  only these rows      SEEDS=1,2,3  training seeds (default 1)
#   FOLDS=5               folds                RESULTS=DIR  keeps the parts and the JSON (default: a
#                                              temporary folder); folds that are there are not run again
#   OTHER=FOLDER          a dataset that each fold's model is measured on as a whole: out of distribution
#
# Each core runs one fold at a time. A row takes about a quarter of an hour of one core on 285
# recordings; `paper` takes hours, so it runs only if ROWS names it.
set -euo pipefail
: "${1:?name dataset folders; see the beginning of this script}"
other=${OTHER:-}
seeds=${SEEDS:-1}
folds=${FOLDS:-5}
results=${RESULTS:-$(mktemp -d)}
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
mkdir -p "$results"

declare -A settings=(
  [paper]='{"preset": "paper"}'
  [literal]='{"preset": "literal"}'
  [compact]='{"preset": "compact"}'
  [lanes-metres]='{"preset": "lanes-metres"}'
  [absolute]='{"preset": "lanes", "model": {"reference": "TRAJECTORY_REFERENCE_NONE"}, "optimization": {"mixture_placement": "MIXTURE_PLACEMENT_VELOCITY_CLUSTERS"}}'
  [no-geometry]='{"preset": "lanes", "model": {"action_geometry": {"pair_width": 0}}}'
  [table-covariance]='{"preset": "lanes", "optimization": {"decoder_covariance": "DECODER_COVARIANCE_LEARNED"}}'
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
rows=${ROWS:-literal compact lanes-metres absolute history no-agents no-geometry relative gaussian
  table-covariance no-noise sparse printed no-decay lanes}

# Folds of all rows share the cores, so that none is idle at the end of a row.
run_fold() { # option... row fold
  local row=${*: -2:1} fold=${*: -1}
  OMP_NUM_THREADS=1 "$bin/maneuver-trainer" cross-validate "${@:1:$#-2}" \
    --settings "$results/$row.settings.json" --folds "$folds" --seeds "$seeds" --only-fold "$fold" \
    --part "$results/$row.$fold.part" --threads 1 --progress none >"$results/$row.$fold.log" 2>&1 &&
    return
  echo "ladder: fold $fold of $row failed; see $results/$row.$fold.log" >&2
  return 255  # xargs starts no more
}
export bin results seeds folds
export -f run_fold
for row in $rows; do
  [ -s "$results/$row.json" ] && continue
  echo "${settings[$row]}" >"$results/$row.settings.json"
  for fold in $(seq "$folds"); do
    [ -s "$results/$row.$fold.part" ] || echo "$row $fold"
  done
done | xargs -r -P "$(nproc)" -L 1 bash -c 'run_fold "$@"' run --dataset "$@" ${other:+--test-dataset "other=$other"}
for row in $rows; do
  [ -s "$results/$row.json" ] || "$bin/maneuver-trainer" cross-validate --merge "$results/$row".*.part \
    --output "$results/$row.json" >"$results/$row.txt"
done
python3 - "$results" $rows <<'PYTHON'
import json, sys
results, rows = sys.argv[1], sys.argv[2:]
accuracy = ['ade_ratio', 'ade_medoid_ratio', 'min_ade_6', 'min_fde_6', 'miss_rate_6', 'nll', 'calibration_error', 'coverage_2sigma', 'mean_sigma_ratio']
meaning = ['effective_actions', 'action_perplexity', 'mutual_information', 'nmi_kinematic', 'nmi_relative', 'class_information_kinematic',
           'class_information_relative', 'named_share_relative', 'named_share_motion']
reports = {row: json.load(open(f'{results}/{row}.json')) for row in rows}

def table(number, metrics, where, low, high):
    print('\n| row | ' + ' | '.join(metrics) + ' |\n|---' + '|---' * len(metrics) + '|')
    for row, report in reports.items():
        found = where(report['sets'][number])
        cells = [found.get(metric) for metric in metrics]
        cells = [f"{c['value']:.3f} ({c[low]:.3f} to {c[high]:.3f})" if c else '' for c in cells]
        print(f'| {row} | ' + ' | '.join(cells) + ' |')

for number, held in enumerate(next(iter(reports.values()))['sets']):
    print(f"\n{held.get('name') or 'Held-out folds'}: {held['recordings']} recordings in {held['groups']} groups.")
    print('Means with 95 % intervals over the groups:')
    table(number, accuracy, lambda s: s['overall']['metrics'], 'lower', 'upper')
    print('\nWhat the actions mean, with the smallest and the largest of the models:')
    table(number, meaning, lambda s: s['set_metrics'], 'smallest', 'largest')
PYTHON
