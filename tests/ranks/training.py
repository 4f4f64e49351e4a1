"""What the tests of ranks share: a small training, its weights, and a server that runs it as a job."""

import hashlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import time

SETTINGS = {
    "preset": "compact",
    "model": {
        "raster": {"height": 32, "width": 32, "meters_per_pixel": 2, "history_frames": 2, "frame_interval": "0.5s"},
        "backbone": {"convolutions": [{"channels": 8, "stride": 2}, {"channels": 16, "stride": 2}], "features": 32},
        "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
        "actions": 6,
        "latent_dimensions": 3,
        "action_predictor": {"hidden": [32]},
        "trajectory_encoder": {"hidden": [32]},
        "decoder": {"hidden": [32]},
        "scenario_encoder": {"hidden": [32]},
    },
    "examples": {"max_examples": 320},
    "optimization": {"pretraining_epochs": 2, "mixture_epochs": 1, "joint_epochs": 4, "posterior_epochs": 1,
                     "batch_size": 32},
    "seed": 7,
    "threads": 1,
}


class Training:
    """A dataset and settings in `folder`, to be learned from any number of times."""

    def __init__(self, folder, maneuver, trainer):
        self.folder = pathlib.Path(folder)
        self.trainer = str(trainer)
        self.settings = self.folder / "settings.json"
        self.settings.write_text(json.dumps(SETTINGS))
        subprocess.run([maneuver, "synthesize", self.folder / "town", "--recordings", "16"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def arguments(self, name, *more):
        """The trainer's, for a run that writes the model `name` and its checkpoints."""
        return [self.trainer, "train", "--settings", str(self.settings), "--dataset", str(self.folder / "town"),
                "--output", str(self.folder / name), "--checkpoints", str(self.folder / f"{name}.checkpoints"),
                "--checkpoint-steps", "3", "--progress", "json",
                *(() if "--rank-timeout" in more else ("--rank-timeout", "2")), *more]

    def start(self, name, *more, environment=None, before=()):
        return subprocess.Popen([*before, *self.arguments(name, *more)], text=True, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, env=environment,
                                start_new_session=True)

    def learn(self, name, *more):
        """Learns to the end and returns the reports of its progress."""
        with self.start(name, *more) as process:
            lines, errors = process.communicate(timeout=300)
        assert process.returncode == 0, f"exit status {process.returncode}\n{errors}"
        return [json.loads(line) for line in lines.splitlines()]

    def weights(self, name):
        return hashlib.sha256((self.folder / name / "weights.safetensors").read_bytes()).hexdigest()

    def serve(self, *flags):
        """Starts a server that has the dataset."""
        os.environ["PROGRAMS"] = str(pathlib.Path(self.trainer).parent)
        sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "python"))
        from server import Server  # pylint: disable=import-outside-toplevel

        server = Server("--checkpoint-steps", "3", *flags)
        server.maneuver("dataset", "upload", self.folder / "town", "town")
        return server

    def serve_with_impatient_ranks(self, *flags):
        """Starts a server that has the dataset. The ranks of its jobs wait five seconds for one that is frozen.

        A job may lose ranks without end: those of a busy machine may be slower than that. A server starts its trainers
        at the lowest priority, at which they starve on a busy machine; run by root, these take the usual one.
        """
        launcher = self.folder / "launch.sh"
        launcher.write_text('ranks=$1; shift\n'
                            'if [ "$(id -u)" = 0 ]; then chrt --other --pid 0 $$ && renice -n 0 -p $$ >&2; fi\n'
                            'exec "$@" --ranks "$ranks" --rank-timeout 5\n')
        return self.serve("--trainer-command", f"sh {launcher} {{ranks}}", "--job-attempts", "1000", *flags)

    def start_job(self, server, model, ranks, *more):
        """Starts a job that learns version 1 of `model`. Returns its name."""
        return server.maneuver("train", model, "--dataset", "town", "--settings", self.settings, "--ranks", ranks,
                               "--detach", *more).strip()

    def weights_of_version(self, server, model):
        return self.weights(server.folder / "data" / "models" / model / "1")


def wait_for_phase(process, phase, epoch=1):
    """Reads the progress of a process until it is there."""
    for line in process.stdout:
        report = json.loads(line)
        if report["phase"] == phase and report.get("epoch", 0) >= epoch:
            return
    raise AssertionError(f"it ended before {phase}: {process.stderr.read()}")


def wait_for_phase_of_job(server, job, phase, epoch=1):
    """Watches a job of a server until it is there. Returns whether it came there before its end."""
    with server.start_maneuver("--progress", "json", "job", "watch", job) as watch:
        for line in watch.stderr:
            report = json.loads(line).get("progress", {})
            if report.get("phase") == phase and report["epoch"] >= epoch:
                watch.kill()
                return True
    return False


def children_of(pid):
    return [int(child) for child in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def descendants_of(pid):
    """Processes that a process, one of its threads or one of those processes has started."""
    found = []
    try:
        for thread in pathlib.Path(f"/proc/{pid}/task").iterdir():
            found += [int(child) for child in (thread / "children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        pass  # it has ended meanwhile
    return found + [each for child in found for each in descendants_of(child)]


def rank_of(pid):
    """The rank that a process is; None if it is none, or has ended."""
    try:
        variables = pathlib.Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except (FileNotFoundError, ProcessLookupError):
        return None
    return next((int(v.split(b"=")[1]) for v in variables if v.startswith(b"RANK=")), None)


def is_gone(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def wait_until_gone(pids, patience_s=60):
    """A process closes its pipes some time before it is gone."""
    give_up = time.monotonic() + patience_s
    while not all(is_gone(pid) for pid in pids):
        assert time.monotonic() < give_up, f"still there: {[pid for pid in pids if not is_gone(pid)]}"
        time.sleep(0.01)


def end(process, number=signal.SIGKILL):
    if process.poll() is None:
        process.send_signal(number)
    process.communicate(timeout=60)
