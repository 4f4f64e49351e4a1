#!/usr/bin/python3
"""Memory and speed of maneuver tag against the size of the recordings: tags datasets that grow, in turns with the
engine alone, and prints a Markdown table. Memory, recordings a CPU second and the share should stay flat.

  tests/bench/tag_memory.py MODEL [--sizes 1000,5000,20000] [--part 0]

The share is what reading and writing leave of the engine's windows a CPU second (tests/bench/tag_engine.cc). Up to
--distinct MB of a dataset are synthesized; a larger one has copies of these shards, so that all its bytes are really
on the disk. --folder keeps the distinct ones from one call to the next. A dataset is removed once it was measured.
--part MB tags about so much of each dataset (--shards); 0: all of it. With --stride 10 a recording has one window of
each target, so that tagging all of a large dataset does not take hours. Needs the targets maneuver and tag_engine.

--rounds N keeps all datasets, tags each N times in turns, the first once more at the end, and adds two columns: the
median of recordings a CPU second by that of the first dataset just before and just after, and its range. Each run
begins with its dataset out of the page cache.
"""

import argparse
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import tempfile

import data_memory


def engine(options, dataset):
    """Returns the engine's windows a CPU second."""
    done = subprocess.run([options.bin / "tag_engine", options.model, dataset, str(options.threads), "10"], check=True,
                          capture_output=True, text=True)
    return float(done.stdout.split()[1])


def forget(dataset):
    """Takes the files of a dataset out of the page cache."""
    for path in dataset.iterdir():
        with open(path, "rb") as file:
            os.fsync(file.fileno())
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def tag(options, dataset, parts, work):
    """Tags the dataset. Returns what the command said, its processor time in seconds and its peak in MB."""
    forget(dataset)
    made = work / "tags"
    run = data_memory.run(options.bin / "maneuver", "--output", "json", "--progress", "none", "tag", dataset, "--model",
                          options.model, "-o", made, "--threads", options.threads, "--shards", f"0/{parts}",
                          *(["--stride", options.stride] if options.stride else []))
    shutil.rmtree(made)
    return json.loads(run.printed()), run.seconds, run.peak


def parts_of(options, dataset, megabytes):
    """Returns how many parts --part makes of the dataset."""
    shards = len(data_memory.scenes_of(json.loads((dataset / "dataset.json").read_text())))
    return max(1, min(shards, round(megabytes / options.part))) if options.part else 1


def measure(options, dataset, megabytes, work):
    """Tags the dataset, after and before the engine alone. Returns a row of the table."""
    parts = parts_of(options, dataset, megabytes)
    rates = [] if options.stride else [engine(options, dataset)]
    said, seconds, peak = tag(options, dataset, parts, work)
    if not options.stride:
        rates.append(engine(options, dataset))
    share = f"{int(said['windows']) / seconds / statistics.mean(rates):.2f}" if rates else ""
    return row(megabytes, parts, said, seconds, share, peak)


def row(megabytes, parts, said, seconds, share, peak):
    windows, recordings = int(said["windows"]), int(said["recordings"])
    return [f"{megabytes:,.0f}", f"1/{parts}", f"{recordings:,}", f"{windows:,}", f"{seconds:.0f}",
            f"{recordings / seconds:.1f}", f"{windows / seconds:,.0f}", share, f"{peak:.0f}"]


def in_turns(options, datasets, work):
    """Tags all datasets in turns. Returns a row for each.

    datasets: of each its folder and its megabytes
    """
    runs = [[] for _ in datasets]
    for turn in range(options.rounds + 1):
        for index, (dataset, megabytes) in enumerate(datasets if turn < options.rounds else datasets[:1]):
            runs[index].append(tag(options, dataset, parts_of(options, dataset, megabytes), work))
    rates = [[int(said["recordings"]) / seconds for said, seconds, _ in of_one] for of_one in runs]
    rows = []
    for index, (dataset, megabytes) in enumerate(datasets):
        middle = sorted(runs[index], key=lambda run: run[1])[len(runs[index]) // 2]
        ratios = [2 * rates[index][turn] / (rates[0][turn] + rates[0][turn + 1]) for turn in range(options.rounds)]
        turns = [f"{statistics.median(ratios):.3f}", f"{min(ratios):.3f} to {max(ratios):.3f}"] if index else ["", ""]
        rows.append(row(megabytes, parts_of(options, dataset, megabytes), middle[0], middle[1], "",
                        max(peak for _, _, peak in runs[index])) + turns)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("build/release/bin"))
    parser.add_argument("--sizes", default="1000,5000,20000", help="MB")
    parser.add_argument("--distinct", type=int, default=1000, help="MB")
    parser.add_argument("--part", type=int, default=0, help="MB of each dataset to tag; 0: all")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--folder", type=pathlib.Path, help="default: a temporary folder")
    parser.add_argument("--stride", help="seconds between two windows, as of maneuver tag; leaves out the share")
    parser.add_argument("--rounds", type=int, help="tag the datasets so often, in turns; leaves out the share")
    options = parser.parse_args()
    columns = ["dataset, MB", "part", "recordings tagged", "windows", "CPU s", "recordings/CPU s", "windows/CPU s",
               "share", "peak, MB"] + (["by the first", "range"] if options.rounds else [])
    print("|", " | ".join(columns), "|")
    print("|" + "---:|" * len(columns), flush=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        work = pathlib.Path(name)
        distinct = (options.folder or work) / f"town-{options.distinct}"
        if not distinct.exists():
            data_memory.run(options.bin / "maneuver", "--quiet", "synthesize", distinct, "--recordings",
                            options.distinct * 1_000_000 // data_memory.BYTES_EACH)
        datasets = []
        for size in map(int, options.sizes.split(",")):
            dataset = work / f"dataset-{size}"
            data_memory.repeat(distinct, dataset, size * 1_000_000)
            megabytes = sum(file.stat().st_size for file in dataset.glob("*.tfrecord")) / 1e6
            if options.rounds:
                datasets.append((dataset, megabytes))
                continue
            print("|", " | ".join(measure(options, dataset, megabytes, work)), "|", flush=True)
            shutil.rmtree(dataset)
        for line in in_turns(options, datasets, work) if datasets else []:
            print("|", " | ".join(line), "|", flush=True)


if __name__ == "__main__":
    main()
