#!/usr/bin/python3
"""A data folder is backed up while its server predicts, changes aliases and learns, and restored on an empty machine.

There another server answers the same bits, has the same aliases and datasets, and the job that was running
goes on to the same weights. A back-up that was changed by one byte is not restored.

Needs rsync and sqlite3.
"""

import argparse
import hashlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time

DEPLOY = pathlib.Path(__file__).resolve().parent.parent.parent / "deploy"
PATIENCE_S = 240
SETTINGS = {
    "preset": "compact",
    "model": {
        "raster": {"height": 48, "width": 48, "meters_per_pixel": 2, "history_frames": 3, "frame_interval": "0.5s"},
        "backbone": {"convolutions": [{"channels": 16, "stride": 2}, {"channels": 24, "stride": 2},
                                      {"channels": 24, "stride": 2}], "features": 64},
        "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
        "actions": 12,
        "latent_dimensions": 3,
        "action_predictor": {"hidden": [48, 48]},
        "trajectory_encoder": {"hidden": [48, 48]},
        "decoder": {"hidden": [48, 48]},
        "scenario_encoder": {"hidden": [32, 32]},
    },
    "optimization": {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1, "posterior_epochs": 1},
    "examples": {"max_examples": 4000},
    "seed": 7,
    "threads": 1,
}


def wait_for(condition, what):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > give_up:
            raise RuntimeError(f"{what}: not within {PATIENCE_S} s")
        time.sleep(0.02)


class Server:
    def __init__(self, options, data):
        self.data = data
        self._maneuver = options.maneuver
        ports = data.with_suffix(".ports")
        with open(data.with_suffix(".log"), "ab") as log:
            self.process = subprocess.Popen(
                [options.maneuverd, "--data-dir", data, "--listen", "127.0.0.1:0", "--metrics-listen", "none",
                 "--port-file", ports, "--checkpoint-interval", "0.1"], stdout=log, stderr=log)
        wait_for(ports.exists, "the server listens")
        self.address = json.loads(ports.read_text())["grpc"]

    def maneuver(self, *arguments):
        done = subprocess.run([self._maneuver, "--server", self.address, "--output", "json", *map(str, arguments)],
                              capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"maneuver {arguments}: {done.stderr}")
        return done.stdout

    def job(self, name):
        return json.loads(self.maneuver("job", "show", name))

    def runs(self, name):
        return self.job(name)["state"] == "JOB_STATE_RUNNING"

    def answers(self, scenes):
        return [self.maneuver("predict", scene, "--model", "small", "--min-probability", "0") for scene in scenes]

    def stop(self):
        self.process.terminate()
        self.process.wait(PATIENCE_S)


class Busy:
    """Somebody who predicts, and points an alias now to this version, now to that."""

    def __init__(self, server, scene):
        self._stop = threading.Event()
        self.failed = []
        self._thread = threading.Thread(target=self._work, args=(server, scene))
        self._thread.start()

    def _work(self, server, scene):
        turns = 0
        while not self._stop.is_set():
            try:
                server.maneuver("predict", scene, "--model", "small")
                server.maneuver("model", "promote", f"small/{1 + turns % 2}", "--alias", "candidate")
                turns += 1
            except RuntimeError as error:
                self.failed.append(str(error))

    def end(self):
        self._stop.set()
        self._thread.join()


def script(name, *arguments):
    return subprocess.run([DEPLOY / name, *map(str, arguments)], capture_output=True, text=True)


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def expect_done(done):
    check(done.returncode == 0, f"{done.args}: {done.returncode}\n{done.stdout}{done.stderr}")


def weights(data, version):
    return hashlib.sha256((data / "models" / version / "weights.safetensors").read_bytes()).hexdigest()


def prepare(options, work, servers):
    """A server with a model of two versions, and a town to learn from."""
    data = work / "data"
    (data / "models" / "small").mkdir(parents=True)
    for version in (1, 2):
        subprocess.run([options.small_model, data / "models" / "small" / str(version), str(version)], check=True)
    (data / "outcomes").mkdir()
    (data / "outcomes" / "kept").write_bytes(b"a recording of an outcome")
    server = Server(options, data)
    servers.append(server)
    server.maneuver("model", "promote", "small/2")
    server.maneuver("synthesize", work / "town", "--recordings", 24)
    server.maneuver("dataset", "upload", work / "town", "town")
    ids = re.findall('"(town-[^"]*)"', server.maneuver("scenario", "list", work / "town"))
    scenes = [work / f"{scene}.json" for scene in ids[:3]]
    check(len(scenes) == 3, "the town has scenes")
    for scene in scenes:
        server.maneuver("scenario", "extract", work / "town", scene.stem, "--out", scene)
    return server, scenes


def run(options, work, servers):
    server, scenes = prepare(options, work, servers)
    (work / "settings.json").write_text(json.dumps(SETTINGS))
    job = json.loads(server.maneuver("train", "town", "--dataset", "town", "--settings", work / "settings.json",
                                     "--set", "optimization.joint_epochs=12", "--detach"))["name"]
    folder = server.data / "jobs" / job.removeprefix("jobs/")
    wait_for(lambda: any(folder.glob("checkpoints/*")), "the job has a checkpoint")

    busy = Busy(server, scenes[0])
    first = script("backup.sh", server.data, work / "backup-1")
    again = script("backup.sh", server.data, work / "backup-2", "--previous", work / "backup-1")
    still_learning = server.runs(job)
    busy.end()
    expect_done(first)
    expect_done(again)
    check(not busy.failed, busy.failed)
    check(still_learning, "the job ended before the back-ups did: it was to be backed up while it runs")
    shard = "datasets/town/scenarios-00000.tfrecord"
    inodes = {os.stat(work / f"backup-{i}" / shard).st_ino for i in (1, 2)}
    check(len(inodes) == 1, "what has not changed is there once")
    check((work / "backup-1/outcomes/kept").exists(), "recordings of outcomes are backed up")
    for path in (work / "backup-1", work / "backup-1/maneuver.db"):
        check(path.stat().st_mode & 0o077 == 0, f"{path} is its owner's alone")

    second = subprocess.run([options.maneuverd, "--data-dir", server.data, "--listen", "127.0.0.1:0", "--metrics-listen",
                             "none"], capture_output=True, text=True, timeout=PATIENCE_S)
    check(second.returncode == 1 and "another maneuverd uses" in second.stderr, "a second server is kept off the folder")

    expect_done(script("restore.sh", work / "backup-2", work / "restored"))
    other = Server(options, work / "restored")
    servers.append(other)
    wait_for(lambda: subprocess.run([options.maneuver, "--server", other.address, "health"],
                                    capture_output=True).returncode == 0, "the restored server serves")
    expected = server.answers(scenes)
    check("models/small/versions/2" in expected[0], expected[0])
    check(other.answers(scenes) == expected, "the restored server answers the same bits")
    check(other.maneuver("dataset", "list") == server.maneuver("dataset", "list"), "the same datasets")
    for each in (server, other):
        each.maneuver("job", "watch", job)
        check(each.job(job)["state"] == "JOB_STATE_SUCCEEDED", each.job(job))
    check(other.job(job)["attempts"]["started"] > 1, "the restored server went on with the job")
    check(weights(other.data, "town/1") == weights(server.data, "town/1"), "and learned the same, to the bit")

    no_user = script("restore.sh", work / "backup-1", work / "other", "--owner", "nobody-of-that-name")
    check(no_user.returncode == 2 and "nobody-of-that-name" in no_user.stderr, "an owner that is not there is refused")
    check(not (work / "other").exists(), "before anything is restored")
    check(script("restore.sh", work / "backup-1", work / "other", "--folder-only").returncode == 2,
          "a back-up with maneuver.db is restored as a whole")
    check(script("restore.sh", work / "backup-1", work / "restored").returncode == 2, "nothing is overwritten")
    check(script("backup.sh", server.data, work / "backup-1").returncode == 2, "no back-up is overwritten")
    (work / "bin").mkdir()
    (work / "bin" / "sqlite3").write_text("#!/bin/sh\nexit 1\n")
    (work / "bin" / "sqlite3").chmod(0o755)
    broken = subprocess.run([DEPLOY / "backup.sh", server.data, work / "backup-3"], capture_output=True, text=True,
                            env=dict(os.environ, PATH=f"{work / 'bin'}:{os.environ['PATH']}"))
    check(broken.returncode != 0 and not list(work.glob("backup-3*")), "a back-up that fails leaves nothing")
    with open(work / "backup-1" / shard, "r+b") as file:
        file.seek(1000)
        byte = file.read(1)
        file.seek(1000)
        file.write(bytes([byte[0] ^ 1]))
    damaged = script("restore.sh", work / "backup-1", work / "other")
    check(damaged.returncode == 1 and shard in damaged.stdout + damaged.stderr, "a damaged back-up is refused")
    check(not (work / "other").exists(), "and nothing of it is restored")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", required=True, type=pathlib.Path)
    parser.add_argument("--maneuver", required=True, type=pathlib.Path)
    parser.add_argument("--small-model", required=True, type=pathlib.Path, help="program that writes one")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        servers = []
        try:
            run(options, pathlib.Path(work), servers)
        finally:
            for server in servers:
                server.stop()
    print("Restored: the same answers, aliases and datasets; the job went on to the same weights")


if __name__ == "__main__":
    main()
