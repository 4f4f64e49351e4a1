"""maneuverd on a free port of loopback, for tests."""

import json
import os
import pathlib
import subprocess
import tempfile
import time

PROGRAMS = pathlib.Path(os.environ.get("PROGRAMS", "build/release/bin"))
PATIENCE = 120  # seconds that something has to start

# Trains in seconds.
TINY = {
    "preset": "compact",
    "model": {
        "raster": {"height": 48, "width": 48, "meters_per_pixel": 2, "history_frames": 3,
                   "frame_interval": "0.5s"},
        "backbone": {"convolutions": [{"channels": 16, "stride": 2}, {"channels": 24, "stride": 2}],
                     "features": 48},
        "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
        "actions": 12,
        "latent_dimensions": 3,
        "action_predictor": {"hidden": [48, 48]},
        "trajectory_encoder": {"hidden": [48, 48]},
        "decoder": {"hidden": [48, 48]},
        "scenario_encoder": {"hidden": [32, 32]}},
    "optimization": {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1,
                     "posterior_epochs": 1},
    "examples": {"max_examples": 300},
    "threads": 1}


class Server:
    """A maneuverd over a temporary folder, until close()."""

    def __init__(self, *flags, listen="127.0.0.1:0"):
        self._temporary = tempfile.TemporaryDirectory(prefix="maneuver-python-")
        self.folder = pathlib.Path(self._temporary.name)
        self._flags = flags
        self._process = None
        self.address = listen
        self.start()

    def start(self):
        """Starts it, on the port that it had."""
        ports = self.folder / "ports.json"
        ports.unlink(missing_ok=True)
        with open(self.folder / "maneuverd.log", "ab") as log:
            self._process = subprocess.Popen(
                [PROGRAMS / "maneuverd", "--data-dir", self.folder / "data", "--listen",
                 self.address, "--metrics-listen", "none", "--port-file", ports, *self._flags],
                stdout=log, stderr=log, env={**os.environ, "OMP_NUM_THREADS": "1"})
        deadline = time.monotonic() + PATIENCE
        while not ports.exists():
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError((self.folder / "maneuverd.log").read_text())
            time.sleep(0.02)
        self.address = json.loads(ports.read_text())["grpc"]

    @property
    def pid(self):
        return self._process.pid

    def kill(self):
        """SIGKILL, and waits until it is gone."""
        self._process.kill()
        self._process.wait()

    def maneuver(self, *arguments):
        """Runs the command line; it has to succeed. Returns what it printed."""
        return subprocess.run(self._command(arguments), check=True, stdout=subprocess.PIPE,
                              text=True, cwd=self.folder).stdout

    def start_maneuver(self, *arguments):
        """Starts the command line. Returns its process, with a pipe for each of its outputs."""
        return subprocess.Popen(self._command(arguments), stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True, cwd=self.folder)

    def _command(self, arguments):
        return [PROGRAMS / "maneuver", "--server", self.address, *map(str, arguments)]

    def close(self):
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait()
        self._temporary.cleanup()


def lift_jobs(server):
    """Until this process of a server ends, takes its jobs out of the idle class, in which they starve beside other programs.

    Needs root; without it, they stay there.
    """
    while server.poll() is None:
        try:
            jobs = [job for children in pathlib.Path(f"/proc/{server.pid}/task").glob("*/children")
                    for job in children.read_text().split()]
            for thread in (int(task.name) for job in jobs for task in pathlib.Path(f"/proc/{job}/task").iterdir()):
                os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
                if os.geteuid() == 0:
                    os.setpriority(os.PRIO_PROCESS, thread, 0)
        except (FileNotFoundError, ProcessLookupError):
            pass  # it ended meanwhile
        except PermissionError:
            return
        time.sleep(0.2)


_trained = []  # the server, once there is one


def trained_server():
    """Returns a server whose only model, models/tiny, serves; the same one for all tests.

    Its datasets/town has 24 recordings, and models/tiny was learned from them.
    """
    if not _trained:
        import atexit

        import maneuver

        server = Server()
        atexit.register(server.close)
        server.maneuver("synthesize", "town", "--recordings", 24, "--seed", 1)
        with maneuver.Client(server.address) as client:
            server.uploads, server.events = [], []
            client.upload_dataset(server.folder / "town", "datasets/town",
                                  on_progress=server.uploads.append)
            job = client.train("models/tiny", ["datasets/town"], TINY)
            server.job = client.wait_for_job(job, server.events.append)
        _trained.append(server)
    return _trained[0]
