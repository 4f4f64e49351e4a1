#!/usr/bin/env python3
"""A fleet meets roundabouts for the first time, is told so, learns, and is told no more.

    learning_loop.py BUILD/bin [--small] [--town-seed 1] [--model-seed 1] [--rows FILE]

The model has learned a town without roundabouts. The fleet reports what happened: first in such a town, then in a
district of roundabouts. Prometheus' own tool evaluates the rules of deploy/ on the server's metrics of each day: the
alert for drift must be quiet on the first and fire on the second. The surprising scenes are mined, the model learns
from them and from what the server collected, and the new version is promoted by measurement. On another day in the
district the alert must be quiet. docs/tutorial/learning-loop.md shows the same commands, --small runs them with less.
docs/reports/learning_loop.md has the shift of each day for several seeds, from the files of --rows.
"""

import argparse
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request

RULES = pathlib.Path(__file__).resolve().parents[2] / "deploy/monitoring/prometheus"
DRIFT, CALIBRATION = "ManeuverActionsDrift", "ManeuverCalibrationLost"
SAMPLE = re.compile(r"^(maneuver_outcome_\w+)\{(.*)\} (\S+)$", re.MULTILINE)
# On straight roads alone a day is like any other, whatever its few recordings.
SMALL = {
    "preset": "lanes-metres",
    "model": {"trajectory": {"waypoints": 8, "waypoint_interval": "0.5s"}, "actions": 12, "latent_dimensions": 3},
    "examples": {"max_examples": 2000, "validation_share": 0.25},
    "optimization": {"pretraining_epochs": 30, "mixture_epochs": 80, "joint_epochs": 4, "covariance_epochs": 1},
    "threads": 1}
SMALL_SIZES = {"town": 60, "day": 12, "surprising": 8, "places": ["--layout", "straight_road"]}


class Server:
    """maneuverd on free ports, which collects outcomes."""

    def __init__(self, programs, folder):
        self._programs, self._folder = programs, folder
        (folder / "data").mkdir()
        ports = folder / "ports.json"
        with open(folder / "maneuverd.log", "wb") as log:
            self._process = subprocess.Popen(
                [programs / "maneuverd", "--data-dir", folder / "data", "--listen", "127.0.0.1:0", "--metrics-listen",
                 "127.0.0.1:0", "--port-file", ports, "--outcome-recordings", "512MiB"], stdout=log, stderr=log)
        deadline = time.monotonic() + 120
        while not ports.exists():
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError((folder / "maneuverd.log").read_text())
            time.sleep(0.02)
        addresses = json.loads(ports.read_text())
        self._address, self._metrics = addresses["grpc"], addresses["metrics"]

    def maneuver(self, *arguments):
        """Runs the command in the folder and returns its output. The command must succeed."""
        shown = [str(argument) for argument in arguments]
        print("  $ maneuver", *shown, flush=True)
        done = subprocess.run([self._programs / "maneuver", "--server", self._address, *shown], cwd=self._folder,
                              capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"exit status {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout

    def outcomes(self):
        """The metrics of outcomes: {(name, labels): value}."""
        page = urllib.request.urlopen(f"http://{self._metrics}/metrics", timeout=30).read().decode()
        return {(name, labels): float(value) for name, labels, value in SAMPLE.findall(page)}

    def stop(self):
        self._process.terminate()
        self._process.wait(60)


def alerts_of_day(before, after, version, folder):
    """The alerts of outcomes that fire if each hour counts what was counted between `before` and `after`."""
    series = []
    for (name, labels), value in after.items():
        if f'model_version="{version}"' not in labels or name.endswith(("_bucket", "_sum", "_count")):
            continue
        selector = f'{name}{{job="maneuver", instance="fleet", {labels}}}'
        if name.endswith("_total"):
            each_minute = (value - before.get((name, labels), 0.0)) / 60.0
            series.append({"series": selector, "values": f"0+{each_minute:.9f}x120"})
        else:
            series.append({"series": selector, "values": f"{value:.9f}x120"})
    fired = []
    for alert in (DRIFT, CALIBRATION):
        test = {"rule_files": [str(file) for file in sorted(RULES.glob("*.rules.yml"))], "evaluation_interval": "1m",
                "tests": [{"interval": "1m", "input_series": series,
                           "alert_rule_test": [{"eval_time": "100m", "alertname": alert, "exp_alerts": []}]}]}
        (folder / "day.yml").write_text(json.dumps(test))  # JSON is YAML
        done = subprocess.run(["promtool", "test", "rules", folder / "day.yml"], capture_output=True, text=True)
        said = done.stdout + done.stderr
        if done.returncode != 0 and "got:" not in said:
            raise RuntimeError(said)
        if done.returncode != 0:
            fired.append(alert)
    return fired


def largest_shift(before, after, version):
    """Returns how far the share of an action is from its share in validation, and how far it may be before the alert
    fires: of the action that is nearest to its limit or furthest above it. Returns the number of outcomes too."""
    def counted(name, label):
        sums = {}
        for samples, sign in ((after, 1.0), (before, -1.0)):
            for (each, labels), value in samples.items():
                if each == name and f'model_version="{version}"' in labels:
                    key = re.search(label + r'="([^"]*)"', labels)[1]
                    sums[key] = sums.get(key, 0.0) + sign * value
        return sums

    outcomes = sum(counted("maneuver_outcome_scored_total", "speed").values())
    expected = {re.search(r'action="(\d+)"', labels)[1]: value for (name, labels), value in after.items()
                if name == "maneuver_outcome_expected_action_ratio" and f'model_version="{version}"' in labels}
    shares = counted("maneuver_outcome_action_probability_total", "action")
    shifts = []
    for action, usual in expected.items():
        share = shares[action] / outcomes
        mean = (share + usual) / 2
        shifts.append((abs(share - usual), 0.05 + 3.0 * math.sqrt(mean * (1.0 - mean) / outcomes)))  # as the rule has it
    return *max(shifts, key=lambda each: each[0] / each[1]), outcomes


class Loop:
    """The steps, and what was seen of each."""

    def __init__(self, server, folder, model, town_seed):
        self._server, self._folder, self._model, self._town_seed = server, folder, model, town_seed
        self.days = {}  # name: its shift and the alert's limit
        self._began = time.monotonic()

    def say(self, text):
        print(f"[{time.monotonic() - self._began:5.1f} s] {text}", flush=True)

    def report(self, recordings, version):
        """Reports a day, and returns which alerts fire."""
        before = self._server.outcomes()
        scores = json.loads(self._server.maneuver("outcomes", "report", recordings, "--model", "fleet", "--output",
                                                  "json"))
        after = self._server.outcomes()
        fired = alerts_of_day(before, after, version, self._folder)
        shift, limit, outcomes = largest_shift(before, after, version)
        self.days[recordings] = (shift, limit)
        if outcomes != scores["outcomes"]:
            raise AssertionError(f"the server counts {outcomes} outcomes, the command {scores['outcomes']}")
        self.say(f"{recordings}: {outcomes:.0f} outcomes. The best guess of {version} is {scores['metrics']['fde_1']:.2f} m"
                 f" off at the horizon. The share of one action is {100.0 * shift:.1f} points off its share in validation; the"
                 f" alert allows {100.0 * limit:.1f}. Alerts: {', '.join(fired) or 'none'}.")
        return fired

    def run(self, town, day, surprising, places):
        maneuver = self._server.maneuver
        self.say("Five sets of recordings: two without roundabouts, three with nothing else.")
        roundabouts = ["--layout", "roundabout"]
        for i, (dataset, count, kind) in enumerate((
                ("town", town, places), ("usual-day", day, places), ("first-day", 2 * day, roundabouts),
                ("next-day", day, roundabouts), ("unseen", day, roundabouts))):
            maneuver("synthesize", dataset, "--recordings", count, "--seed", self._town_seed + i, *kind)
        maneuver("dataset", "upload", "town", "town")
        maneuver("dataset", "upload", "unseen", "unseen")

        self.say("The fleet's model learns the town without roundabouts.")
        maneuver("train", "fleet", "--dataset", "town", *self._model)
        if DRIFT in self.report("usual-day", "fleet/1"):
            raise AssertionError("drift on a day like those that were learned")
        maneuver("outcomes", "collect", "usual-outcomes", "--forget")

        self.say("The fleet meets roundabouts for the first time.")
        if DRIFT not in self.report("first-day", "fleet/1"):
            raise AssertionError("no drift among roundabouts")

        self.say("The surprising scenes are mined.")
        collected = json.loads(maneuver("outcomes", "collect", "happened", "--output", "json"))
        maneuver("model", "pull", "fleet/1", "fleet-1")
        maneuver("tag", "first-day", "--model", "fleet-1", "-o", "tags", "--quiet")
        found = json.loads(maneuver("find", "tags", "--surprise", f"top:{surprising}", "--distinct", "--output", "json"))
        maneuver("find", "tags", "--surprise", f"top:{surprising}", "--dataset", "first-day", "--as-dataset", "mined")
        maneuver("dataset", "upload", "mined", "mined")
        surprises = [row["surprise"] for row in found["matches"]]
        self.say(f"{collected['dataset']['recordings']} outcomes are collected. {len(surprises)} scenes are mined; what"
                 f" happened there had a probability of {2.718281828 ** -max(surprises):.1g} to"
                 f" {2.718281828 ** -min(surprises):.1g}.")

        self.say("The model learns from them, and is promoted if it is no worse among roundabouts.")
        maneuver("train", "fleet", "--start-from", "fleet", "--dataset", "happened", "--dataset", "mined=0.25", *self._model,
                 "--promote", "if-no-worse", "--promote-dataset", "unseen")
        serving = json.loads(maneuver("model", "show", "fleet", "--output", "json"))["name"]
        if serving != "models/fleet/versions/2":
            raise AssertionError(f"{serving} serves")
        if DRIFT in self.report("next-day", "fleet/2"):
            raise AssertionError("still drift after learning")
        self.say("The alert is quiet: the loop is closed.")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("--small", action="store_true", help="fewer recordings, a small model: some 30 s of processor time")
    parser.add_argument("--town-seed", type=int, help="of the first set of recordings; the others count on [1; small: 41]")
    parser.add_argument("--model-seed", type=int, help="of the training [1; small: 10]")
    parser.add_argument("--rows", type=pathlib.Path, help="adds the shifts to this file, a Markdown table")
    arguments = parser.parse_args()
    town_seed, model_seed = arguments.town_seed, arguments.model_seed
    if town_seed is None:
        town_seed = 41 if arguments.small else 1
    if model_seed is None:
        model_seed = 10 if arguments.small else 1
    if shutil.which("promtool") is None:
        print("skipped: promtool is not installed (Debian: prometheus)")
        return 77
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        server = Server(arguments.programs.resolve(), folder)
        try:
            if arguments.small:
                (folder / "small.json").write_text(json.dumps({**SMALL, "seed": model_seed}))
                sizes, model = SMALL_SIZES, ["--settings", "small.json"]
            else:
                sizes = {"town": 240, "day": 60, "surprising": 50, "places": ["--without", "roundabout"]}
                model = ["--set", "threads=2", "--set", f"seed={model_seed}"]
            loop = Loop(server, folder, model, town_seed)
            try:
                loop.run(**sizes)
            finally:
                if arguments.rows:
                    cells = [f"{100.0 * shift:.1f} of {100.0 * limit:.1f}" for shift, limit in loop.days.values()]
                    with open(arguments.rows, "a") as rows:
                        print("|", " | ".join([str(town_seed), str(model_seed), *cells]), "|", file=rows)
        finally:
            server.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
