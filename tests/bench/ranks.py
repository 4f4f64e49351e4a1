#!/usr/bin/python3
"""Measures learning by several ranks on one machine: examples a second of the joint phase, and how ranks spend it.

  tests/bench/ranks.py --maneuver PROGRAM --trainer PROGRAM [--presets lanes,compact,paper,resnet50] [--rounds N]

For each preset these take turns, N rounds: one process with one thread, one with two threads, both with whole batches;
one rank with one thread, one rank with two threads, and two ranks with one thread each, which learn from micro-batches.
Prints the median of the rounds, and the share of the ranks' time that went into waiting and exchanging gradients.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile

WAYS = {"1 process, 1 thread": (0, 1), "1 process, 2 threads": (0, 2), "1 rank, 1 thread": (1, 1),
        "1 rank, 2 threads": (1, 2), "2 ranks, 1 thread each": (2, 1)}
# Enough steps for a mean; batches of 64 or 128.
EXAMPLES = {"lanes": 8192, "compact": 2048, "paper": 512, "resnet50": 128}


def learn(arguments, folder, preset, ranks, threads, number):
    settings = folder / "settings.json"
    settings.write_text(json.dumps({
        "preset": preset, "threads": threads, "examples": {"max_examples": EXAMPLES[preset]},
        "optimization": {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1, "posterior_epochs": 0,
                         "covariance_epochs": 0, "placements": 1}}))
    command = [arguments.trainer, "train", "--settings", settings, "--dataset", folder / "town",
               "--output", folder / f"model{number}", "--progress", "json", "--ranks", str(ranks)]
    process = subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    joint = None
    for line in process.stdout:
        report = json.loads(line)
        if report["phase"] == "joint" and "epoch_report" in report:
            # Validation is over; calibration and the rest are not of interest.
            break
        if report["phase"] == "joint" and report.get("examples_per_second"):
            joint = report
    process.terminate()
    _, errors = process.communicate()
    if joint is None:
        raise RuntimeError(errors)
    return joint


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuver", required=True)
    parser.add_argument("--trainer", required=True)
    parser.add_argument("--presets", default="lanes,compact,paper,resnet50")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="maneuver-ranks.") as name:
        folder = pathlib.Path(name)
        subprocess.run([arguments.maneuver, "synthesize", folder / "town", "--recordings", "60"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        print("| preset | way | examples/s | slowest rank's step, ms | waiting and exchanging |\n|---|---|---|---|---|")
        number = 0
        for preset in arguments.presets.split(","):
            reports = {way: [] for way in WAYS}
            for _ in range(arguments.rounds):
                for way, (ranks, threads) in WAYS.items():
                    number += 1
                    reports[way].append(learn(arguments, folder, preset, ranks, threads, number))
            for way, of_way in reports.items():
                speed = statistics.median(r["examples_per_second"] for r in of_way)
                step = statistics.median(1e3 * r.get("slowest_rank_step_seconds", 0.0) for r in of_way)
                shares = [s for r in of_way for s in r.get("rank_waiting_fractions", [])]
                waiting = f"{100 * min(shares):.1f} to {100 * max(shares):.1f} %" if shares else ""
                print(f"| {preset} | {way} | {speed:.1f} | {step:.1f} | {waiting} |" if step else
                      f"| {preset} | {way} | {speed:.1f} | | |", flush=True)
        print(f"\nLoad of the machine at the end: {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
