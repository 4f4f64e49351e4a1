#!/usr/bin/python3
"""Memory and speed of maneuver tag against the size of the recordings: tags datasets that grow, in turns with the engine
alone, and prints a Markdown table. Memory, recordings a CPU second and the share should stay flat.

  tests/bench/tag_memory.py MODEL [--sizes 1000,5000,20000] [--part 0]

The share is what reading and writing leave of the engine's windows a CPU second (tests/bench/tag_engine.cc). Up to
--distinct MB of a dataset are synthesized; a larger one has copies of these shards, so that all its bytes are really on
the disk. --folder keeps the distinct ones from one call to the next. A dataset is removed once it was measured. --part
MB tags about so much of each dataset (--shards); 0: all of it. With --stride 10 a recording has one window of each
target, so that tagging all of a large dataset does not take hours. Needs the targets maneuver and tag_engine.
"""

import argparse
import json
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


def measure(options, dataset, megabytes, work):
    """Tags the dataset, after and before the engine alone. Returns a row of the table."""
    shards = len(data_memory.scenes_of(json.loads((dataset / "dataset.json").read_text())))
    parts = max(1, min(shards, round(megabytes / options.part))) if options.part else 1
    rates = [] if options.stride else [engine(options, dataset)]
    made = work / "tags"
    tag = data_memory.run(options.bin / "maneuver", "--output", "json", "--progress", "none", "tag", dataset, "--model",
                          options.model, "-o", made, "--threads", options.threads, "--shards", f"0/{parts}",
                          *(["--stride", options.stride] if options.stride else []))
    if not options.stride:
        rates.append(engine(options, dataset))
    said = json.loads(tag.printed())
    shutil.rmtree(made)
    windows, recordings = int(said["windows"]), int(said["recordings"])
    return [f"{megabytes:,.0f}", f"1/{parts}", f"{recordings:,}", f"{windows:,}", f"{tag.seconds:.0f}",
            f"{recordings / tag.seconds:.1f}", f"{windows / tag.seconds:,.0f}",
            f"{windows / tag.seconds / statistics.mean(rates):.2f}" if rates else "", f"{tag.peak:.0f}"]


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
    options = parser.parse_args()
    print("| dataset, MB | part | recordings tagged | windows | CPU s | recordings/CPU s | windows/CPU s | share | peak, MB |")
    print("|---:|---:|---:|---:|---:|---:|---:|---:|---:|", flush=True)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        work = pathlib.Path(name)
        distinct = (options.folder or work) / f"town-{options.distinct}"
        if not distinct.exists():
            data_memory.run(options.bin / "maneuver", "--quiet", "synthesize", distinct, "--recordings",
                            options.distinct * 1_000_000 // data_memory.BYTES_EACH)
        for size in map(int, options.sizes.split(",")):
            dataset = work / "town"
            data_memory.repeat(distinct, dataset, size * 1_000_000)
            megabytes = sum(file.stat().st_size for file in dataset.glob("*.tfrecord")) / 1e6
            print("|", " | ".join(measure(options, dataset, megabytes, work)), "|", flush=True)
            shutil.rmtree(dataset)


if __name__ == "__main__":
    main()
