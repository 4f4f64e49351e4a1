#!/usr/bin/python3
"""Compares the time left that a training tells with the time that it then takes, for the quickstart's training.

  tests/bench/time_left.py [--bin FOLDER] [--ways plain,if-no-worse,baselines] [--data FOLDER] [--every SHARE]

Trains through the Train RPC of a server of its own: plain, then with --promote if-no-worse, which also measures two
versions. Every report of progress states when it was made, so the time that is really left is known to the millisecond
once the job has ended. Prints told / real over the run, and the reports after a tenth of the time that are more than 25 %
and half a second off. Let nothing else run meanwhile: time left is by the clock. --data keeps the datasets from one call
to the next.
"""

import argparse
import contextlib
import datetime
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import time

# As deploy/quickstart.sh trains it.
TRAINING = ["town", "--dataset", "town", "--preset", "lanes", "--set", "examples.max_examples=6000", "--set",
            "augmentation.mirror=false", "--epochs", "8", "--set", "optimization.mixture_epochs=60", "--set",
            "optimization.covariance_epochs=3"]
IF_NO_WORSE = ["--promote", "if-no-worse", "--promote-dataset", "unseen"]
WAYS = {"plain": [], "if-no-worse": IF_NO_WORSE, "baselines": ["--set", "baselines=true"]}
TOLERANCE = 0.25
UNNOTICED = 0.5  # seconds: nobody waits for less


def seconds_of(timestamp):
    return datetime.datetime.fromisoformat(timestamp.replace("Z", "+00:00")).timestamp()


class Server:
    def __init__(self, folder, programs):
        self.programs = programs
        ports = folder / "ports.json"
        with open(folder / "maneuverd.log", "w") as log:
            self.process = subprocess.Popen([programs / "maneuverd", "--data-dir", folder / "data", "--listen",
                                             "127.0.0.1:0", "--metrics-listen", "127.0.0.1:0", "--port-file", ports],
                                            stdout=log, stderr=log)
        while not ports.exists() or not ports.read_text():
            if self.process.poll() is not None:
                raise RuntimeError((folder / "maneuverd.log").read_text())
            time.sleep(0.1)
        self.environment = dict(os.environ, MANEUVER_SERVER=json.loads(ports.read_text())["grpc"])

    def run(self, *command):
        """Runs the command `maneuver`. Returns what it printed: the result and its messages."""
        done = subprocess.run([self.programs / "maneuver", *command], env=self.environment, text=True,
                              capture_output=True)
        if done.returncode != 0:
            raise RuntimeError(f"{command}: {done.stderr}")
        return done.stdout, done.stderr

    def stop(self):
        self.process.send_signal(signal.SIGTERM)
        self.process.wait()


def train(server, more):
    """Trains. Returns the reports of progress, and when the job began and ended."""
    _, messages = server.run("train", *TRAINING, *more, "--progress", "json")
    reports = [json.loads(line)["progress"] for line in messages.splitlines() if line.startswith('{"progress"')]
    jobs = json.loads(server.run("job", "list", "--output", "json")[0])["jobs"]
    job = max(jobs, key=lambda each: each["startTime"])
    return reports, seconds_of(job["startTime"]), seconds_of(job["endTime"])


def show(way, reports, begin, end, every):
    whole = end - begin
    print(f"\n{way}: {whole:.1f} s\n\n| passed | phase | told, s | real, s | told / real |\n|---:|---|---:|---:|---:|")
    next_row, off, ratios = 0.1, [], []
    for report in reports:
        at = seconds_of(report["time"])
        passed, real = (at - begin) / whole, end - at
        if passed < 0.1 or real <= 0 or report["fraction"] == 1:  # a job that has ended tells none
            continue
        told = float(report["timeLeft"].rstrip("s")) if report.get("timeLeft") else None
        ratio = told / real if told is not None else None
        row = (f"| {100 * passed:.0f} % | {report['phase']} | {told:.1f} | {real:.1f} | {ratio:.2f} |"
               if told is not None else f"| {100 * passed:.0f} % | {report['phase']} | | {real:.1f} | |")
        if passed >= next_row or report is reports[-1]:
            print(row)
            next_row = passed + every
        if ratio is not None:
            ratios.append(ratio)
        if ratio is None or abs(told - real) > max(TOLERANCE * real, UNNOTICED):
            off.append(row)
    print(f"\n{len(ratios)} reports after a tenth of the time: told / real from {min(ratios):.2f} to {max(ratios):.2f}; "
          f"{len(off)} more than {100 * TOLERANCE:.0f} % and {UNNOTICED} s off, or without a time left.")
    if off:
        print("\n" + "\n".join(off))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default="build/release/bin")
    parser.add_argument("--ways", default="plain,if-no-worse", help=", ".join(WAYS))
    parser.add_argument("--data", type=pathlib.Path, help="folder that keeps the datasets")
    parser.add_argument("--every", type=float, default=0.05, help="share of the time between two rows")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="maneuver-time-left.") as name, contextlib.ExitStack() as stack:
        folder = pathlib.Path(name)
        data = arguments.data or folder
        data.mkdir(parents=True, exist_ok=True)
        server = Server(folder, arguments.bin.resolve())
        stack.callback(server.stop)
        for dataset, recordings, seed in (("town", "240", "1"), ("unseen", "40", "2")):
            if not (data / dataset / "dataset.json").exists():
                server.run("synthesize", data / dataset, "--recordings", recordings, "--seed", seed)
            server.run("dataset", "upload", data / dataset, dataset)
        for number, way in enumerate(arguments.ways.split(",")):
            if number == 0 and way == "if-no-worse":  # a version must serve
                train(server, [])
            show(way, *train(server, WAYS[way]), arguments.every)
        print(f"\nLoad of the machine at the end: {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
