#!/usr/bin/python3
"""Measures learning by several ranks on one machine: speed of the joint phase, and how ranks spend it.

  tests/bench/ranks.py --maneuver PROGRAM --trainer PROGRAM [--presets lanes,compact,paper,resnet50] [--rounds N]

For each preset these take turns, N rounds: one process with one thread, one with two threads, both with whole batches;
one rank with one thread, one rank with two threads, and two ranks with one thread each, which learn from micro-batches.
Prints medians over the rounds: examples a second; processor time for an example, summed over the ranks, which other
programs of the machine disturb less; and the share of the ranks' time that went into waiting and exchanging gradients.
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
BATCH = 64
STEPS = {"lanes": 128, "compact": 64, "paper": 12, "resnet50": 3}


def processor_seconds(pids):
    """Returns what processes have used so far."""
    ticks = 0
    for pid in pids:
        fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def learn(arguments, folder, preset, ranks, threads, number):
    """Learns one joint epoch. Returns its last report, with the processor time of an example added."""
    settings = folder / "settings.json"
    settings.write_text(json.dumps({
        "preset": preset, "threads": threads, "examples": {"max_examples": BATCH * STEPS[preset]},
        "optimization": {"batch_size": BATCH, "pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1,
                         "posterior_epochs": 0, "covariance_epochs": 0, "placements": 1}}))
    command = [arguments.trainer, "train", "--settings", settings, "--dataset", folder / "town",
               "--output", folder / f"model{number}", "--progress", "json", "--ranks", str(ranks)]
    process = subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    reports = []
    for line in process.stdout:
        report = json.loads(line)
        if report["phase"] != "joint" and reports:
            break
        if report["phase"] == "joint" and report.get("examples_per_second"):
            children = pathlib.Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            report["processor_seconds"] = processor_seconds(children or [process.pid])
            reports.append(report)
        if report["phase"] == "joint" and "epoch_report" in report:
            break  # calibration and the rest are not of interest
    process.terminate()
    _, errors = process.communicate()
    # Validation is over when the epoch's report comes.
    reports = [report for report in reports if "epoch_report" not in report]
    if len(reports) < 2:
        raise RuntimeError(errors)
    steps = int(reports[-1]["step"]) - int(reports[0]["step"])
    used = reports[-1]["processor_seconds"] - reports[0]["processor_seconds"]
    return dict(reports[-1], processor_seconds_of_example=used / (steps * BATCH))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuver", required=True)
    parser.add_argument("--trainer", required=True)
    parser.add_argument("--presets", default="lanes,compact,paper,resnet50")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="maneuver-ranks.") as name:
        folder = pathlib.Path(name)
        subprocess.run([arguments.maneuver, "synthesize", folder / "town", "--recordings", "20"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        print("| preset | way | examples/s | CPU ms for an example | slowest rank's step, ms | waiting and exchanging |\n"
              "|---|---|---:|---:|---:|---:|", flush=True)
        number = 0
        for preset in arguments.presets.split(","):
            reports = {way: [] for way in WAYS}
            for _ in range(arguments.rounds):
                for way, (ranks, threads) in WAYS.items():
                    number += 1
                    reports[way].append(learn(arguments, folder, preset, ranks, threads, number))
            for way, of_way in reports.items():
                speed = statistics.median(r["examples_per_second"] for r in of_way)
                used = statistics.median(1e3 * r["processor_seconds_of_example"] for r in of_way)
                step = statistics.median(1e3 * r.get("slowest_rank_step_seconds", 0.0) for r in of_way)
                shares = [s for r in of_way for s in r.get("rank_waiting_fractions", [])]
                waiting = f"{100 * min(shares):.1f} to {100 * max(shares):.1f} %" if shares else ""
                print(f"| {preset} | {way} | {speed:.1f} | {used:.2f} | {step:.1f} | {waiting} |" if step else
                      f"| {preset} | {way} | {speed:.1f} | {used:.2f} | | |", flush=True)
        print(f"\nLoad of the machine at the end: {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
