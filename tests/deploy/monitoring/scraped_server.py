"""maneuverd as an operator runs it, TLS and tokens and all, and a Prometheus that scrapes it."""

import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
COMPOSE = REPOSITORY / "deploy/compose"
RULES = REPOSITORY / "deploy/monitoring/prometheus"
PATIENCE = 120  # seconds that something has to start

# Trains in seconds.
TINY = {
    "preset": "compact",
    "model": {
        "raster": {"height": 48, "width": 48, "meters_per_pixel": 2, "history_frames": 3, "frame_interval": "0.5s"},
        "backbone": {"convolutions": [{"channels": 16, "stride": 2}, {"channels": 24, "stride": 2}], "features": 48},
        "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
        "actions": 12,
        "latent_dimensions": 3,
        "action_predictor": {"hidden": [96, 96]},
        "trajectory_encoder": {"hidden": [96, 96]},
        "decoder": {"hidden": [96, 96]},
        "scenario_encoder": {"hidden": [32, 32]}},
    "optimization": {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1, "posterior_epochs": 1},
    "examples": {"max_examples": 300},
    "threads": 1}


def wait_for(what, done, process=None):
    deadline = time.monotonic() + PATIENCE
    while not done():
        if process is not None and process.poll() is not None:
            raise RuntimeError(f"{what}: the process ended with {process.returncode}")
        if time.monotonic() > deadline:
            raise RuntimeError(f"{what}: not within {PATIENCE} s")
        time.sleep(0.05)


def replaced(text, old, new):
    """`text` with `old` replaced; it has to be there once."""
    if text.count(old) != 1:
        raise RuntimeError(f"expected {old!r} once, but it is there {text.count(old)} times")
    return text.replace(old, new)


def _free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _end(process):
    if process is None or process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(30)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Server:
    """A maneuverd in `folder`, with a certificate of its own and models/town of two versions, neither of which serves;
    models: their folders. The town that they were learned from is in `folder`/town. Without `models`, tiny ones are learned."""

    def __init__(self, programs, folder, flags, models=(), recordings=24):
        self._programs, self.folder = pathlib.Path(programs), folder
        self._make_certificate()
        self.operator = self._make_token("operator", "predict,train,admin")
        self.planner = self._make_token("planner", "predict")
        (folder / "tiny.json").write_text(json.dumps(TINY))
        self.run("maneuver", "synthesize", folder / "town", "--recordings", recordings)
        for version, model in enumerate(models or map(self._learn, (1, 2)), 1):
            shutil.copytree(model, folder / "data/models/town" / str(version))
        ports = folder / "ports.json"
        with open(folder / "maneuverd.log", "wb") as log:
            self._process = subprocess.Popen(
                [self._programs / "maneuverd", "--data-dir", folder / "data", "--listen", "127.0.0.1:0",
                 "--metrics-listen", "127.0.0.1:0", "--port-file", ports, "--tls-certificate", folder / "server.crt",
                 "--tls-key", folder / "server.key", "--tokens", folder / "tokens", *flags],
                stdout=log, stderr=log)
        wait_for("maneuverd", ports.exists, self._process)
        addresses = json.loads(ports.read_text())
        self.address, self.metrics = addresses["grpc"], addresses["metrics"]

    def _make_certificate(self):
        subprocess.run(
            ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "90",
             "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
             "-keyout", self.folder / "server.key", "-out", self.folder / "server.crt"],
            check=True, capture_output=True)
        os.chmod(self.folder / "server.key", 0o600)

    def run(self, program, *arguments, environment=None):
        """Any of the programs; it has to succeed."""
        return subprocess.run([self._programs / program, *map(str, arguments)], check=True, capture_output=True, text=True,
                              env={**os.environ, **(environment or {})})

    def _learn(self, seed):
        """Beside the server: its own jobs give way to whatever else the machine does."""
        settings = self.folder / f"settings{seed}.json"
        settings.write_text(json.dumps(TINY | {"seed": seed}))
        self.run("maneuver-trainer", "train", "--settings", settings, "--dataset", self.folder / "town",
                  "--output", self.folder / f"model{seed}", "--progress", "none")
        return self.folder / f"model{seed}"

    def _make_token(self, name, roles):
        made = self.run("maneuverd", "token", "create", "--name", name, "--roles", roles, "--tokens", self.folder / "tokens")
        return made.stdout.strip()

    def _command(self, arguments, token):
        environment = {**os.environ, "MANEUVER_SERVER": self.address, "MANEUVER_TOKEN": token or self.operator,
                       "MANEUVER_TLS_CA": str(self.folder / "server.crt")}
        return [self._programs / "maneuver", *map(str, arguments)], environment

    def maneuver(self, *arguments, token=None, fails=False):
        """The command's output; it has to succeed or, with `fails`, to fail."""
        command, environment = self._command(arguments, token)
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
        if (done.returncode != 0) != fails:
            raise RuntimeError(f"maneuver {arguments}: {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout

    def start_maneuver(self, *arguments):
        """The command, while it runs."""
        command, environment = self._command(arguments, None)
        return subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def train(self, *arguments):
        """Starts a job on the dataset `town` and tells its name."""
        started = self.maneuver("train", "town", "--dataset", "town", "--settings", self.folder / "tiny.json", "--detach",
                                *arguments)
        return re.search(r"jobs/\w+", started)[0]

    def stop(self):
        _end(self._process)


class Prometheus:
    """Debian's, with the configuration and the rules that deploy/ has, but for addresses and intervals."""

    @staticmethod
    def is_installed():
        return shutil.which("prometheus") is not None

    def __init__(self, folder, metrics_address, interval="1s"):
        configuration = (COMPOSE / "prometheus.yml").read_text()
        configuration = replaced(configuration, "maneuverd:9470", f'"{metrics_address}"')
        configuration = replaced(configuration, "scrape_interval: 15s", f"scrape_interval: {interval}")
        configuration = replaced(configuration, "evaluation_interval: 15s", f"evaluation_interval: {interval}")
        configuration = replaced(configuration, "/etc/prometheus/rules", str(RULES))
        (folder / "prometheus.yml").write_text(configuration)
        self.address = f"127.0.0.1:{_free_port()}"
        with open(folder / "prometheus.log", "wb") as log:
            self._process = subprocess.Popen(
                ["prometheus", f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/series",
                 f"--web.listen-address={self.address}"], stdout=log, stderr=log)
        wait_for("prometheus", self._is_ready, self._process)
        self.start = time.time()

    def _is_ready(self):
        try:
            return urllib.request.urlopen(f"http://{self.address}/-/ready", timeout=5).status == 200
        except OSError:
            return False

    def get(self, path, **arguments):
        """What the API says; an error of it is raised with its words."""
        url = f"http://{self.address}/api/v1/{path}?{urllib.parse.urlencode(arguments, doseq=True)}"
        try:
            with urllib.request.urlopen(url, timeout=30) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(json.load(error)["error"]) from None

    def now(self, expr):
        """[(labels, value)] at this moment."""
        return [(each["metric"], float(each["value"][1])) for each in self.get("query", query=expr)["result"]]

    def course(self, expr, end=None, step=1):
        """[(labels, [(time, value)])] from the start until the end, or now."""
        series = self.get("query_range", query=expr, start=self.start, end=end or time.time(), step=step)["result"]
        return [(each["metric"], [(at, float(value)) for at, value in each["values"]]) for each in series]

    def stop(self):
        _end(self._process)
