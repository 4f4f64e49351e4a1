#!/usr/bin/python3
"""Compares the stages of an answer in several builds of maneuver-bench, which take turns.

  MANEUVER_REAL_DATA=FOLDER tests/bench/stage_turns.py NAME=PROGRAM NAME=PROGRAM ... [--rounds N] [--filter REGEX]

Prints the median of each program's processor time, and for each program but the first the median of its ratios to the
first, turn by turn, with their middle half. A ratio compares neighbours in time, so a busy machine disturbs it less.
Names of stages are those of --benchmark_list_tests; a program that lacks one is left out of its row.
"""

import argparse
import json
import statistics
import subprocess


def times(program, pattern, seconds):
    """Returns the processor time of each stage, microseconds."""
    run = subprocess.run([program, f"--benchmark_filter={pattern}", f"--benchmark_min_time={seconds}",
                          "--benchmark_format=json"], check=True, text=True, stdout=subprocess.PIPE,
                         stderr=subprocess.DEVNULL)
    found = {}
    for each in json.loads(run.stdout)["benchmarks"]:
        if not each.get("error_occurred"):
            found[each["name"]] = each["cpu_time"]
    return found


def ratio_text(ratios):
    """Returns the median and the middle half."""
    if len(ratios) < 2:
        return f"{ratios[0]:.3f}"
    low, middle, high = statistics.quantiles(ratios, n=4, method="inclusive")
    return f"{middle:.3f} ({low:.3f} to {high:.3f})"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="+", metavar="NAME=PROGRAM")
    parser.add_argument("--rounds", type=int, default=26)
    parser.add_argument("--filter", default="^stages/")
    parser.add_argument("--seconds", type=float, default=0.02, help="of each measurement, at least")
    options = parser.parse_args()
    programs = dict(each.split("=", 1) for each in options.programs)
    first, *others = programs
    rounds = [{name: times(program, options.filter, options.seconds) for name, program in programs.items()}
              for _ in range(options.rounds)]
    print("| stage | " + " | ".join([f"{name}, us" for name in programs] + [f"{name} / {first}" for name in others]) +
          " |\n|---|" + "---:|" * (2 * len(programs) - 1))
    for stage in rounds[0][first]:
        cells = []
        for name in programs:
            series = [each[name][stage] for each in rounds if stage in each[name]]
            cells.append(f"{statistics.median(series):.1f}" if series else "")
        for name in others:
            ratios = [each[name][stage] / each[first][stage] for each in rounds if stage in each[name]]
            cells.append(ratio_text(ratios) if ratios else "")
        print(f"| {stage} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
