#!/usr/bin/env python3
"""Compares the servers of two builds, each with the embedded store: the same calls, in turns.

  tests/bench/server_turns.py --programs FOLDER --before FOLDER --model FOLDER [--rounds N] [--seconds N]

FOLDER has maneuverd and maneuver; the model must be one that both can load. The command of --programs asks both servers,
one after the other. Prints the medians of the server's processor time for a call, of the answers a second and of the p99,
and the median, the least and the most of the ratios, turn by turn.
"""

import argparse
import json
import pathlib
import shutil
import statistics
import subprocess
import tempfile
import time

from ranks import processor_seconds

FIGURES = {"processor time of a call, µs": "cpu", "answers a second": "rate", "p99, ms": "p99"}


class Server:
    """maneuverd on a free port, with one model in its data folder."""

    def __init__(self, programs, model, folder):
        shutil.copytree(model, folder / "data/models/small/1")
        ports = folder / "ports.json"
        with open(folder / "log", "wb") as log:
            self._process = subprocess.Popen(
                [programs / "maneuverd", "--data-dir", folder / "data", "--listen", "127.0.0.1:0", "--metrics-listen",
                 "127.0.0.1:0", "--port-file", ports], stdout=log, stderr=log)
        while not ports.exists():
            if self._process.poll() is not None:
                raise RuntimeError((folder / "log").read_text())
            time.sleep(0.02)
        self._address = json.loads(ports.read_text())["grpc"]
        subprocess.run([programs / "maneuver", "--server", self._address, "model", "promote", "small/1"], check=True,
                       stdout=subprocess.DEVNULL)

    def measure(self, command, seconds, output):
        before = processor_seconds([self._process.pid])
        subprocess.run([command, "--server", self._address, "--progress", "none", "load", "--concurrency", "8", "--warm-up",
                        "1", "--duration", str(seconds), "--json", output], check=True, stdout=subprocess.DEVNULL)
        spent = processor_seconds([self._process.pid]) - before
        run = json.loads(output.read_text())["steps"][0]
        rate = run["answered_per_second"]
        return {"cpu": 1e6 * spent / (rate * (seconds + 1)), "rate": rate, "p99": run["latency_ms"]["p99"]}

    def stop(self):
        self._process.terminate()
        self._process.wait(60)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", type=pathlib.Path, required=True)
    parser.add_argument("--before", type=pathlib.Path, required=True)
    parser.add_argument("--model", type=pathlib.Path, required=True)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=int, default=4)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        builds = {"now": options.programs, "before": options.before}
        servers = {}
        try:
            for build, programs in builds.items():
                (folder / build).mkdir()
                servers[build] = Server(programs.resolve(), options.model, folder / build)
            turns = {build: [] for build in builds}
            for i in range(options.rounds):
                for build in sorted(builds, reverse=i % 2 == 1):
                    turns[build].append(servers[build].measure(options.programs.resolve() / "maneuver", options.seconds,
                                                               folder / "load.json"))
        finally:
            for server in servers.values():
                server.stop()
    print("| | this build | before | this build / before (least to most) |\n|---|---:|---:|---:|")
    for title, figure in FIGURES.items():
        now, before = ([turn[figure] for turn in turns[build]] for build in ("now", "before"))
        ratios = [a / b for a, b in zip(now, before)]
        print(f"| {title} | {statistics.median(now):,.2f} | {statistics.median(before):,.2f} |"
              f" {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f}) |")


if __name__ == "__main__":
    main()
