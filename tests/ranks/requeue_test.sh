#!/usr/bin/env bash
# deploy/slurm/train.sbatch after its ranks ended: when it requeues its job, and its status when it gives up. In place of
# Slurm are two scripts.
set -euo pipefail
cd "$(dirname "$0")/../.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
printf '#!/bin/sh\nexit "$STATUS"\n' >"$work/srun"
printf '#!/bin/sh\necho "$@" >"%s/asked"\n' "$work" >"$work/scontrol"
chmod +x "$work"/srun "$work"/scontrol
export PATH="$work:$PATH" MASTER_ADDR=here SLURM_JOB_ID=7

# ends STATUS_OF_SRUN EXPECTED_STATUS EXPECTED_WORDS [VARIABLE=VALUE...]
ends() {
  local status=0
  rm -f "$work/asked"
  env STATUS="$1" "${@:4}" bash deploy/slurm/train.sbatch settings.json model checkpoints data 2>"$work/said" || status=$?
  [ "$status" = "$2" ] && { [ -z "$3" ] || grep -q "$3" "$work/said"; } && return
  echo "FAILED: srun ended with $1, ${*:4}: status $status, expected $2 and \"$3\"; it said:" >&2
  cat "$work/said" >&2
  exit 1
}
ends 83 0 requeued
grep -qx "requeue 7" "$work/asked"
ends 83 83 "given up" MANEUVER_MOST_RESTARTS=0
ends 83 83 "after 2 restarts; given up" MANEUVER_MOST_RESTARTS=2 SLURM_RESTART_COUNT=2
[ ! -e "$work/asked" ]
ends 1 1 ""
echo "train.sbatch requeues its job, and gives up with the trainer's status"
