#!/usr/bin/python3
"""The programs of two builds work together: the command of each against the server of the other, and each server over the
data folder of the other.

    tests/compatibility/two_builds.py --old FOLDER --new build/release/bin

FOLDER has maneuverd, maneuver and maneuver-trainer of an earlier release, for example of a package, or of an earlier
commit that was built beside this one. Names a violation and ends with status 1; 0 if all is well.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.append(str(REPOSITORY / "tests" / "python"))
from server import TINY  # noqa: E402

PATIENCE_S = 600
# A model of the default preset that learns in seconds.
LANES = {"preset": "lanes", "model": {"actions": 12}, "examples": {"max_examples": 60}, "seed": 1, "threads": 1,
         "optimization": {"pretraining_epochs": 3, "mixture_epochs": 2, "joint_epochs": 1, "covariance_epochs": 1}}


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


class Server:
    def __init__(self, programs, data):
        self.programs = programs
        ports = data.with_suffix(".ports")
        ports.unlink(missing_ok=True)
        self.log = data.with_suffix(".log")
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                [programs / "maneuverd", "--data-dir", data, "--listen", "127.0.0.1:0", "--metrics-listen", "none",
                 "--port-file", ports], stdout=log, stderr=log)
        give_up = time.monotonic() + PATIENCE_S
        while not ports.exists():
            check(self.process.poll() is None and time.monotonic() < give_up, self.log.read_text())
            time.sleep(0.05)
        self.address = json.loads(ports.read_text())["grpc"]

    def ask(self, programs, *arguments):
        return subprocess.run([programs / "maneuver", "--server", self.address, "--output", "json", *map(str, arguments)],
                              capture_output=True, text=True, timeout=PATIENCE_S)

    def maneuver(self, programs, *arguments):
        done = self.ask(programs, *arguments)
        check(done.returncode == 0, f"{programs}/maneuver {arguments} against {self.programs}: {done.stdout}{done.stderr}")
        return done.stdout

    def stop(self):
        self.process.terminate()
        check(self.process.wait(PATIENCE_S) == 0, f"{self.programs}/maneuverd ends: {self.log.read_text()[-2000:]}")


def numbers(answer):
    """The numbers of an answer, in order and with all their digits, so that they are the same if and only if their bits
    are: what both builds say, whatever fields one of them adds around it."""
    return re.findall(r'"(?:probabilities|x|y|[xy][XY]|covariance\w+|latent\w+)":\s*\[([^\]]*)\]', answer.replace("\n", " "))


def work(server, programs, folder, name, settings_by_model, transfers):
    """What a user does from day to day, by the command of one build. Learns a model of each of the settings, and also
    transfers one if both builds can. Returns the answers to the scene, by model."""
    maneuver = lambda *arguments: server.maneuver(programs, *arguments)  # noqa: E731
    maneuver("dataset", "upload", folder / "town", name)
    check(name in maneuver("dataset", "list"), "an uploaded dataset is listed")
    maneuver("dataset", "show", name)
    settings = folder / "settings.json"
    models = {name + suffix: content for suffix, content in settings_by_model.items()}
    for model, content in models.items():
        settings.write_text(json.dumps(content))
        maneuver("train", model, "--dataset", name, "--settings", settings, "--promote", "always")
    maneuver("evaluate", name, "--dataset", name)
    check(f"models/{name}/versions/1" in maneuver("model", "list"), "a learned version is listed")
    maneuver("model", "promote", f"{name}/1", "--alias", "candidate")
    maneuver("model", "label", f"{name}/1", "0", "slow left")
    maneuver("model", "actions", name)
    if transfers:
        maneuver("model", "pull", f"{name}/1", folder / f"{name}-1")
        maneuver("model", "push", folder / f"{name}-1", f"{name}-again")
    job = json.loads(maneuver("train", name, "--dataset", name, "--settings", settings, "--set",
                              "optimization.joint_epochs=5000", "--detach"))["name"]
    maneuver("job", "cancel", job)
    check(job in maneuver("job", "list"), "a cancelled job is listed")
    maneuver("health")
    return {model: maneuver("predict", folder / "scene.json", "--model", model, "--min-probability", "0")
            for model in models}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", type=pathlib.Path, required=True, help="folder of the programs of an earlier build")
    parser.add_argument("--new", type=pathlib.Path, default=REPOSITORY / "build" / "release" / "bin")
    parser.add_argument("--raster-only", action="store_true", help="the earlier build is from before the preset lanes")
    options = parser.parse_args()
    old, new = options.old.resolve(), options.new.resolve()
    # By what follows the model's name. The cancelled job has the last ones.
    settings = {"": TINY} if options.raster_only else {"-lanes": LANES, "": TINY}
    model_help = subprocess.run([old / "maneuver", "model", "--help"], check=True, capture_output=True, text=True).stdout
    transfers = re.search(r"^ +pull ", model_help, re.MULTILINE) is not None
    if not transfers:
        print("left out, since the earlier build does not know them: model pull and model push")
    with tempfile.TemporaryDirectory(prefix="maneuver-compatibility-") as name:
        folder = pathlib.Path(name)
        subprocess.run([old / "maneuver", "synthesize", folder / "town", "--recordings", "12"], check=True,
                       stdout=subprocess.DEVNULL)
        listed = subprocess.run([old / "maneuver", "--output", "json", "scenario", "list", folder / "town"], check=True,
                                capture_output=True, text=True).stdout
        subprocess.run([old / "maneuver", "scenario", "extract", folder / "town", re.search('"(town-[^"]*)"', listed)[1],
                        "--out", folder / "scene.json"], check=True, stdout=subprocess.DEVNULL)
        ask = ("predict", folder / "scene.json", "--min-probability", "0", "--model")
        answers = {}

        server = Server(old, folder / "data")
        answers |= work(server, new, folder, "newclient", settings, transfers)
        answers |= work(server, old, folder, "oldpair", settings, transfers)
        server.stop()
        print("the new command works with the old server")

        server = Server(new, folder / "data")
        for model, answer in answers.items():
            check(len(numbers(answer)) > 20, f"an answer has probabilities and trajectories: {answer[:300]}")
            check(numbers(server.maneuver(new, *ask, model)) == numbers(answer), f"{model} answers the same bits in the new server")
        jobs = server.maneuver(new, "job", "list")
        check(jobs.count("JOB_STATE_SUCCEEDED") == 2 * (len(settings) + 1) and jobs.count("JOB_STATE_CANCELLED") == 2, f"all jobs are there: {jobs}")
        check("slow left" in server.maneuver(new, "model", "actions", "oldpair"), "labels are there")
        check("newclient" in server.maneuver(new, "dataset", "list"), "datasets are there")
        print("the new server serves the data folder of the old one")
        work(server, old, folder, "oldclient", settings, transfers)
        server.stop()
        print("the old command works with the new server")

        # Going back: the old server says why it cannot, or serves what the new one wrote.
        back = subprocess.Popen([old / "maneuverd", "--data-dir", folder / "data", "--listen", "127.0.0.1:0",
                                 "--metrics-listen", "none", "--port-file", folder / "back.ports"], stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, text=True)
        give_up = time.monotonic() + PATIENCE_S
        while back.poll() is None and not (folder / "back.ports").exists() and time.monotonic() < give_up:
            time.sleep(0.05)
        serves = back.poll() is None
        back.terminate()
        said = back.communicate(timeout=PATIENCE_S)[0]
        check(serves or "schema" in said, f"the old server refuses the new folder without a reason: {said}")
        print("the old server serves the new folder" if serves else f"the old server refuses the new folder: {said.strip()}")


if __name__ == "__main__":
    main()
