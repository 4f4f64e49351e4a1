#!/usr/bin/env bash
# What each part of the model is worth: cross-validates the paper's models, and the default without
# one part after the other, on the same folds, and prints a table in Markdown.
#
#   tests/bench/ladder.sh DATASET_FOLDER...   > ladder.md
#
#   ROWS="lanes compact"  only these rows      SEEDS=1,2,3  training seeds of all rows (default 1, but
#                                              2 for `literal` and 1,2,3 for `lanes-metres`)
#   FOLDS=5               folds                RESULTS=DIR  keeps the parts and the JSON (default: a
#                                              temporary folder); folds that are there are not run again
#   OTHER=FOLDER          a dataset that each fold's model is measured on as a whole: out of distribution
#
# Each core runs one fold at a time. A row takes about a quarter of an hour of one core on 285
# recordings. These rows run only if ROWS names them: `paper` takes four hours of a core, `resnet50-64`
# eight, `resnet50` days; `eighteen-actions`, `forty-actions`, `more-decay` and `wider` are choices
# that were made on one fold; `drop-history` shortens histories; `inputs-1` and `inputs-2` read scenes by earlier
# versions of the rules.
set -euo pipefail
: "${1:?name dataset folders; see the beginning of this script}"
other=${OTHER:-}
folds=${FOLDS:-5}
results=${RESULTS:-$(mktemp -d)}
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
mkdir -p "$results"

declare -A settings=(
  [paper]='{"preset": "paper"}'
  [resnet50]='{"preset": "resnet50"}'
  [resnet50-64]='{"preset": "resnet50", "model": {"raster": {"height": 64, "width": 64, "meters_per_pixel": 1.6}}, "examples": {"max_examples": 12000}}'
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
  [printed]='{"preset": "lanes", "optimization": {"responsibilities": "RESPONSIBILITIES_PRINTED"}}'
  [no-decay]='{"preset": "lanes", "optimization": {"weight_decay": 1e-4}}'
  [eighteen-actions]='{"preset": "lanes", "model": {"actions": 18}}'
  [forty-actions]='{"preset": "lanes", "model": {"actions": 40}}'
  [fifty-actions]='{"preset": "lanes", "model": {"actions": 50}}'
  [more-decay]='{"preset": "lanes", "optimization": {"weight_decay": 0.3}}'
  [wider]='{"preset": "lanes", "model": {"scene_vectors": {"features": 384, "path_width": 128, "agent_width": 96}, "action_geometry": {"pair_width": 48}}}'
  [constant-velocity]='{"preset": "lanes", "model": {"reference": "TRAJECTORY_REFERENCE_CONSTANT_VELOCITY"}}'
  [small-decoder]='{"preset": "lanes", "model": {"decoder": {"hidden": [64, 64, 64]}}}'
  [dropout]='{"preset": "lanes", "optimization": {"dropout": 0.35, "geometry_dropout": 0.2}}'
  [reconstruction]='{"preset": "lanes", "optimization": {"posterior_reconstruction_weight": 0.6}}'
  [metres-decay]='{"preset": "lanes-metres", "optimization": {"weight_decay": 0.1}}'
  [drop-history]='{"preset": "lanes", "augmentation": {"drop_history": 0.2}}'
  [inputs-1]='{"preset": "lanes", "model": {"inputs_version": 1}}'
  [inputs-2]='{"preset": "lanes", "model": {"inputs_version": 2}}'
  [lanes]='{"preset": "lanes"}'
)
# With seed 1 the loss of `literal` becomes infinite in one of five folds.
declare -A row_seeds=([literal]=2 [lanes-metres]='1,2,3')
rows=${ROWS:-literal compact lanes-metres absolute history no-agents no-geometry relative gaussian
  table-covariance no-noise sparse printed no-decay fifty-actions constant-velocity small-decoder
  dropout reconstruction metres-decay lanes}

# Folds of all rows share the cores, so that none is idle at the end of a row.
run_fold() { # option... row fold seeds
  local row=${*: -3:1} fold=${*: -2:1} seeds=${*: -1}
  OMP_NUM_THREADS=1 "$bin/maneuver-trainer" cross-validate "${@:1:$#-3}" \
    --settings "$results/$row.settings.json" --folds "$folds" --seeds "$seeds" --only-fold "$fold" \
    --part "$results/$row.$fold.part" --threads 1 --progress none >"$results/$row.$fold.log" 2>&1 &&
    return
  echo "ladder: fold $fold of $row failed, so its row is left out: $(tail -n 1 "$results/$row.$fold.log")" >&2
}
export bin results folds
export -f run_fold

# What RESULTS has of a row must be of the same run: other seeds, folds or data are another figure.
for row in $rows; do
  [ -n "${settings[$row]:-}" ] || { echo "ladder: there is no row $row; there are ${!settings[*]}" >&2; exit 2; }
  run="seeds ${SEEDS:-${row_seeds[$row]:-1}}, $folds folds of $*${other:+, also measured on $other}, settings ${settings[$row]}"
  if [ -e "$results/$row.run" ] && [ "$(<"$results/$row.run")" != "$run" ]; then
    echo "ladder: $results has $row with $(<"$results/$row.run"); to run it with $run, name another folder as RESULTS" >&2
    exit 2
  fi
  echo "$run" >"$results/$row.run"
  echo "${settings[$row]}" >"$results/$row.settings.json"
done
for row in $rows; do
  [ -s "$results/$row.json" ] && continue
  for fold in $(seq "$folds"); do
    [ -s "$results/$row.$fold.part" ] || echo "$row $fold ${SEEDS:-${row_seeds[$row]:-1}}"
  done
done | xargs -r -P "$(nproc)" -L 1 bash -c 'run_fold "$@"' run --dataset "$@" ${other:+--test-dataset "other=$other"}
whole=()
for row in $rows; do
  parts=("$results/$row".*.part)
  [ ${#parts[@]} -eq "$folds" ] || continue
  [ -s "$results/$row.json" ] || "$bin/maneuver-trainer" cross-validate --merge "${parts[@]}" \
    --output "$results/$row.json" >"$results/$row.txt"
  whole+=("$row")
done
[ ${#whole[@]} -gt 0 ] || exit 1
python3 - "$results" "${whole[@]}" <<'PYTHON'
import json, sys
results, rows = sys.argv[1], sys.argv[2:]
reports = {row: json.load(open(f'{results}/{row}.json')) for row in rows}

def number(value):
    return f'{value:.3f}'.replace('0.', '.', 1) if abs(value) < 1 else f'{value:.2f}'

def percent(value):
    return f'{100 * value:.1f} %'

ACCURACY = [('ADE₁ / CV', 'ade_ratio', number), ('medoid / CV', 'ade_medoid_ratio', number), ('minADE₆, m', 'min_ade_6', number),
            ('minFDE₆, m', 'min_fde_6', number), ('missed at 2 m', 'miss_rate_6', percent), ('−ln p', 'nll', number),
            ('ECE', 'calibration_error', number), ('within 2 σ', 'coverage_2sigma', percent), ('narrowing', 'mean_sigma_ratio', number)]
MEANING = [('effective', 'effective_actions', number), ('exp H', 'action_perplexity', number), ('I(y;s)', 'mutual_information', number),
           ('NMI kinematic', 'nmi_kinematic', number), ('NMI relative', 'nmi_relative', number),
           ('class information, kinematic', 'class_information_kinematic', number),
           ('the same, relative', 'class_information_relative', number), ('in actions of purity .7', 'named_share_relative', percent),
           ('the same, by change of motion', 'named_share_motion', percent)]

def table(columns, found, low, high):
    """found: the metrics of a row, each with a value and two limits; those of the first column are printed."""
    print('\n| | ' + ' | '.join(name for name, _, _ in columns) + ' |\n|---' + '|---' * len(columns) + '|')
    for row in rows:
        cells = []
        for i, (_, metric, text) in enumerate(columns):
            cell = found(row).get(metric)
            limits = f' ({text(cell[low])} to {text(cell[high])})' if cell and low in cell and (i == 0 or high == 'largest') else ''
            cells.append(text(cell['value']) + limits if cell else '')
        print(f'| `{row}` | ' + ' | '.join(cells) + ' |')

def strata(k, dimension, metric):
    """A metric of the strata of a dimension that have 50 examples, of each row, without intervals."""
    names = {stratum['name']: stratum['examples'] for stratum in reports[rows[0]]['sets'][k]['strata']
             if stratum['dimension'] == dimension and int(stratum['examples']) >= 50}
    print('\n| | ' + ' | '.join(f"{name.replace('_', ' ').replace('>=', '≥ ')} ({count})" for name, count in names.items())
          + ' |\n|---' + '|---' * len(names) + '|')
    for row in rows:
        values = {stratum['name']: stratum['metrics'][metric]['value'] for stratum in reports[row]['sets'][k]['strata']
                  if stratum['dimension'] == dimension}
        print(f'| `{row}` | ' + ' | '.join(number(values[name]) if name in values else '' for name in names) + ' |')

for k, held in enumerate(reports[rows[0]]['sets']):
    print(f"\n## {held.get('name') or 'Held-out folds'}\n\n{held['recordings']} recordings in {held['groups']} groups. "
          'Brackets are 95 % intervals over the groups.')
    table(ACCURACY, lambda row: reports[row]['sets'][k]['overall']['metrics'], 'lower', 'upper')
    print('\nADE₁ / CV by speed, with the number of examples:')
    strata(k, 'speed', 'ade_ratio')
    print('\nminFDE₆ by what the target did, m:')
    strata(k, 'class', 'min_fde_6')
    print('\nWhat the actions mean, with the smallest and the largest of the models:')
    table(MEANING, lambda row: reports[row]['sets'][k]['set_metrics'], 'smallest', 'largest')
PYTHON
[ ${#whole[@]} -eq "$(wc -w <<<"$rows")" ]  # the status says whether all rows are there
