#!/usr/bin/python3
"""Compares the trainers of two builds: both learn the joint phase of the same settings, in turns.

  tests/bench/training_turns.py --trainer PROGRAM --before PROGRAM --dataset FOLDER [--presets lanes,compact] [--rounds N]

Prints the examples of a second of processor time: the medians of both, and the median, the least and the most of the
ratios, turn by turn. Other programs of the machine disturb processor time less than the clock. Defaults that differ
between the builds must be set: --set weight_decay=1e-4 does so for both.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile

from ranks import processor_seconds


def examples_a_second(trainer, settings, dataset, output):
    """Learns the first joint epoch. Returns the examples of a second of processor time."""
    batch = json.loads(settings.read_text())["optimization"]["batch_size"]
    process = subprocess.Popen([trainer, "train", "--settings", settings, "--dataset", dataset, "--output", output,
                                "--progress", "json"], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    steps, seconds = [], []
    for line in process.stdout:
        report = json.loads(line)
        if report["phase"] != "joint":
            continue
        if "epoch_report" in report:
            break  # validation is over then
        if int(report.get("step", 0)) > 0:
            steps.append(int(report["step"]))
            seconds.append(processor_seconds([process.pid]))
    process.terminate()
    _, errors = process.communicate()
    if len(steps) < 2 or steps[-1] == steps[0]:
        raise RuntimeError(f"too few steps: {errors}")
    return (steps[-1] - steps[0]) * batch / (seconds[-1] - seconds[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trainer", type=pathlib.Path, required=True)
    parser.add_argument("--before", type=pathlib.Path, required=True)
    parser.add_argument("--dataset", type=pathlib.Path, required=True)
    parser.add_argument("--presets", default="lanes,compact")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=VALUE", help="of optimization")
    parser.add_argument("--examples", type=int, default=12000, help="of the epoch")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    print("| preset | this build, examples/CPU s | before | this build / before (least to most) |\n|---|---:|---:|---:|")
    with tempfile.TemporaryDirectory(prefix="maneuver-training-turns.") as name:
        folder = pathlib.Path(name)
        for preset in options.presets.split(","):
            optimization = {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1, "placements": 1,
                            "batch_size": 64}
            for setting in options.set:
                field, value = setting.split("=", 1)
                optimization[field] = value
            settings = folder / f"{preset}.json"
            settings.write_text(json.dumps({"preset": preset, "threads": 1, "optimization": optimization,
                                            "examples": {"max_examples": options.examples}}))
            ours, theirs = [], []
            for number in range(options.rounds):
                for trainer, speeds in ((options.trainer, ours), (options.before, theirs)):
                    output = folder / f"{preset}-{number}-{len(ours)}"
                    speeds.append(examples_a_second(trainer, settings, options.dataset, output))
            ratios = [a / b for a, b in zip(ours, theirs)]
            print(f"| {preset} | {statistics.median(ours):.0f} | {statistics.median(theirs):.0f} "
                  f"| {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f}) |", flush=True)


if __name__ == "__main__":
    main()
