#!/usr/bin/python3
"""Memory and speed against the size of a dataset: makes datasets of the synthetic town that grow, and indexes them,
shows them, trains on them and evaluates on a sample of them. Prints a Markdown table and draws it. With data that do not
fit in --data-memory, memory and examples a second should stay flat.

  tests/bench/data_memory.py [--sizes 100,300,1000] [--draw FOLDER]

Speeds are by processor time, so other programs of the machine disturb them little. Up to --distinct MB of a dataset are
made; a larger one has copies of these shards, so that all its bytes are really on the disk. --folder keeps the distinct
shards from one call to the next. A dataset is removed once it was measured. Most recordings are held out, so that the
first training, which counts the examples of the others, need not read all: that takes 16 seconds a gigabyte. Showing a
dataset reads all of it, in 18 seconds a gigabyte; --most-to-show leaves that out for larger ones. --rows keeps the
figures of each dataset in a file and draws those of earlier calls too.

Two options measure more programs:

  --upload               uploads each dataset to a server. One that is larger than --distinct is left out, because a
                         server takes no recording twice.
  --match FIRST SECOND   matches the actions of two models on all recordings of each dataset. Models that predict 18 s
                         ahead have few examples in a recording of 20 s, and so do not take long.
"""

import argparse
import hashlib
import json
import math
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile
import time

BYTES_EACH = 169_000  # of a recording of 20 s
SAMPLE = 16  # recordings to evaluate on
COLUMNS = ["MB", "recordings", "index: peak, MB", "index: CPU s", "show: peak, MB", "show: CPU s",
           "count and train: peak, MB", "count and train: CPU s", "train: peak, MB", "train: CPU s", "examples/CPU s",
           "waiting for data", "evaluate a sample: peak, MB", "start from a model: peak, MB", "with baselines: peak, MB",
           "upload, command: peak, MB", "upload, server: peak, MB", "match actions: peak, MB", "match actions: CPU s"]


class Program:
    """A program: its peak memory in MB and its processor time in seconds, once it has ended.

    The peak is at least this program's own memory, so it must stay small.
    """

    def __init__(self, *command):
        self.command = command
        self.output = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen([str(word) for word in command], stdout=self.output)

    def end(self):
        """Waits for its end. Returns itself."""
        _, status, usage = os.wait4(self.process.pid, 0)
        self.process.returncode = os.waitstatus_to_exitcode(status)
        if status != 0:
            raise RuntimeError(f"{self.command}: exit status {self.process.returncode}")
        self.peak = usage.ru_maxrss / 1024
        self.seconds = usage.ru_utime + usage.ru_stime
        print(f"{self.peak:.1f} MB, {self.seconds:.1f} CPU s:", *self.command, file=sys.stderr, flush=True)
        return self

    def printed(self):
        """Returns what it printed, and forgets it."""
        with self.output:
            self.output.seek(0)
            return self.output.read()


def run(*command):
    return Program(*command).end()


def scenes_of(manifest):
    return [shard for shard in manifest["shards"] if shard["content"] == "SHARD_CONTENT_SCENARIOS"]


def write_manifest(folder, manifest, shards):
    manifest = dict(manifest, shards=shards, recordings=str(sum(int(shard["records"]) for shard in shards)))
    manifest.pop("content_sha256", None)
    (folder / "dataset.json").write_text(json.dumps(manifest))


def repeat(source, target, size):
    """Makes a dataset of `size` bytes that has the shards of another one again and again."""
    manifest = json.loads((source / "dataset.json").read_text())
    scenes = scenes_of(manifest)
    target.mkdir()
    shards, total = [], 0
    while total < size:
        shard = dict(scenes[len(shards) % len(scenes)], file=f"r{len(shards):05}.tfrecord")
        shutil.copy(source / scenes[len(shards) % len(scenes)]["file"], target / shard["file"])
        total += int(shard["size_bytes"])
        shards.append(shard)
    write_manifest(target, manifest, shards)


def sample(source, target):
    """Makes a dataset of the first recordings of another one."""
    manifest = json.loads((source / "dataset.json").read_text())
    content = b""
    with open(source / scenes_of(manifest)[0]["file"], "rb") as shard:
        for _ in range(SAMPLE):  # TFRecords: length, CRC, payload, CRC
            header = shard.read(12)
            content += header + shard.read(struct.unpack_from("<Q", header)[0] + 4)
    target.mkdir()
    (target / "sample.tfrecord").write_bytes(content)
    write_manifest(target, manifest, [dict(scenes_of(manifest)[0], file="sample.tfrecord", size_bytes=str(len(content)),
                                           records=str(SAMPLE), sha256=hashlib.sha256(content).hexdigest())])


def upload(options, data, work):
    """Uploads a dataset to a server of its own. Returns the command and the server."""
    ports = work / "ports.json"
    server = Program(options.bin / "maneuverd", "--data-dir", work / "server", "--listen", "127.0.0.1:0",
                     "--metrics-listen", "none", "--port-file", ports)
    try:
        while not ports.exists():
            if server.process.poll() is not None:
                raise RuntimeError("the server ended")
            time.sleep(0.05)
        address = json.loads(ports.read_text())["grpc"]
        command = run(options.bin / "maneuver", "--server", address, "dataset", "upload", data, "town")
    finally:
        server.process.terminate()
    server.end()
    shutil.rmtree(work / "server")
    ports.unlink()
    return command, server


def measure(options, data, work):
    """Returns the row of a dataset."""
    for file in [*data.glob(".examples-*"), *data.glob(".*.index")]:
        file.unlink()
    maneuver, trainer = options.bin / "maneuver", options.bin / "maneuver-trainer"
    memory = ("--data-memory", options.data_memory, "--threads", options.threads)
    index = run(maneuver, "dataset", "index", data)

    def train(name, *more):
        return run(trainer, "train", "--settings", work / "settings.json", "--dataset", data, "--output", work / name,
                   *memory, "--progress", "json", *more)

    first = train("first")  # counts the examples too
    again = train("again")
    warm = train("warm", "--start-from", work / "again")
    baselines = train("baselines", "--baselines")
    reports = [json.loads(line) for line in again.printed().splitlines()]
    waiting = [report["waiting_fraction"] for report in reports if "waiting_fraction" in report]
    sample(data, work / "sample")
    evaluation = run(trainer, "evaluate", "--model", work / "again", "--dataset", work / "sample", *memory,
                     "--progress", "none")
    for name in ("first", "again", "warm", "baselines", "sample"):
        shutil.rmtree(work / name)
    manifest = json.loads((data / "dataset.json").read_text())
    size = sum(int(shard["size_bytes"]) for shard in manifest["shards"]) / 1e6
    show = run(maneuver, "dataset", "show", f"{data}/") if size < 1.2 * options.most_to_show else None
    uploaded = upload(options, data, work) if options.upload and size < 1.2 * options.distinct else (None, None)
    match = run(trainer, "match-actions", *options.match, "--dataset", data, *memory) if options.match else None
    return dict(zip(COLUMNS, [size, int(manifest["recordings"]), index.peak, index.seconds,
                              *((show.peak, show.seconds) if show else (None, None)),
                              first.peak, first.seconds, again.peak, again.seconds,
                              options.epochs * options.examples / again.seconds,
                              f"{100 * waiting[-1]:.1f} %" if waiting else None, evaluation.peak,
                              warm.peak, baselines.peak, *(program and program.peak for program in uploaded),
                              *((match.peak, match.seconds) if match else (None, None))]))


def draw(file, title, rows, columns):
    """Draws columns over the size of the dataset, which is logarithmic, as an SVG picture."""
    width, height, left, right, top, bottom = 720, 340, 60, 190, 40, 50
    most = 1.15 * max(row[column] or 0.0 for row in rows for column in columns)
    sizes = [math.log(row["MB"]) for row in rows]

    def x(size):
        share = (math.log(size) - min(sizes)) / max(max(sizes) - min(sizes), 1e-9)
        return left + share * (width - left - right)

    def y(value):
        return height - bottom - value / most * (height - top - bottom)

    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
             f'font-size="12"><rect width="100%" height="100%" fill="white"/><text x="{left}" y="20" '
             f'font-size="14">{title}</text>']
    for i in range(6):
        value = most * i / 5
        parts.append(f'<path d="M{left} {y(value):.1f}H{width - right}" stroke="#ddd"/><text x="{left - 6}" '
                     f'y="{y(value) + 4:.1f}" text-anchor="end">{value:.0f}</text>')
    for row in rows:
        parts.append(f'<text x="{x(row["MB"]):.1f}" y="{height - bottom + 18}" text-anchor="middle">'
                     f'{row["MB"]:.0f}</text>')
    parts.append(f'<text x="{(left + width - right) / 2}" y="{height - 10}" text-anchor="middle">'
                 'dataset, MB on disk</text>')
    ends = []
    columns = [column for column in columns if any(row[column] is not None for row in rows)]
    for column, color in zip(columns, ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#8c564b", "#e377c2",
                                       "#7f7f7f", "#bcbd22", "#17becf")):
        measured = [row for row in rows if row[column] is not None]
        points = " ".join(f"{x(row['MB']):.1f},{y(row[column]):.1f}" for row in measured)
        label = y(measured[-1][column]) + 4
        while any(abs(label - other) < 13 for other in ends):
            label -= 1
        ends.append(label)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>'
                     f'<text x="{x(measured[-1]["MB"]) + 8:.1f}" y="{label:.1f}" fill="{color}">{column}</text>')
    file.write_text("\n".join(parts) + "</svg>\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="10,20,40", help="MB, separated by commas; empty: draw --rows alone")
    parser.add_argument("--data-memory", default="64MB")
    parser.add_argument("--examples", type=int, default=4000, help="of each epoch")
    parser.add_argument("--epochs", type=int, default=2, help="of the joint phase")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--preset", default="lanes")
    parser.add_argument("--held-out", type=float, default=0.8, help="share of the recordings")
    parser.add_argument("--most-to-show", type=int, default=5000, help="MB")
    parser.add_argument("--distinct", type=int, default=1000, help="MB")
    parser.add_argument("--folder", type=pathlib.Path, help="of the distinct shards")
    parser.add_argument("--upload", action="store_true")
    parser.add_argument("--match", nargs=2, type=pathlib.Path, metavar=("FIRST", "SECOND"))
    parser.add_argument("--rows", type=pathlib.Path, help="file of figures; may exist")
    parser.add_argument("--draw", type=pathlib.Path, help="folder for the pictures")
    parser.add_argument("--bin", type=pathlib.Path, default=pathlib.Path("build/release/bin"))
    options = parser.parse_args()
    rows = []
    if options.rows and options.rows.exists():
        rows = [json.loads(line) for line in options.rows.read_text().splitlines()]
    with tempfile.TemporaryDirectory(prefix="maneuver-data-memory.", dir=options.folder) as name:
        work = pathlib.Path(name)
        (work / "settings.json").write_text(json.dumps({
            "preset": options.preset,
            "examples": {"max_examples": str(options.examples), "validation_share": options.held_out},
            "optimization": {"pretraining_epochs": 2, "mixture_epochs": 1, "joint_epochs": options.epochs}}))
        print(f"--data-memory {options.data_memory}, {options.threads} threads, preset {options.preset}, "
              f"{options.epochs} epochs of {options.examples} examples\n")
        for size in [int(size) for size in options.sizes.split(",") if size]:
            made = min(size, options.distinct)
            town = (options.folder or work) / f"town-{made}"
            if not town.exists():
                run(options.bin / "maneuver", "synthesize", town, "--threads", options.threads, "--recordings",
                    made * 1_000_000 // BYTES_EACH)
            data = town if size == made else work / "repeated"
            if size > made:
                repeat(town, data, size * 1_000_000)
            rows.append(measure(options, data, work))
            if options.rows:
                with open(options.rows, "a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
            if data != town:
                shutil.rmtree(data)
    rows.sort(key=lambda row: row["MB"])
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---:|" * len(COLUMNS))
    for row in rows:
        print("| " + " | ".join(f"{value:.0f}" if isinstance(value, (int, float)) else value or "" for value in row.values())
              + " |")
    if options.draw:
        draw(options.draw / "data_memory.svg", "Peak memory, MB", rows, [c for c in COLUMNS if "peak" in c])
        draw(options.draw / "data_speed.svg", "Examples a second of processor time", rows, ["examples/CPU s"])


if __name__ == "__main__":
    sys.exit(main())
