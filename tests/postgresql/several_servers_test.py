#!/usr/bin/python3
"""Three servers share one PostgreSQL database and one data folder.

Each answers about jobs, versions, aliases and datasets of the others. A job whose server is killed, or frozen beyond
its lease, goes on elsewhere: it ends once, with one version and the weights of an undisturbed run.

Needs PostgreSQL 15 of Debian; skips (77) without it.
"""

import argparse
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

from server_test import POSTGRESQL, SETTINGS, Cluster, Server, check, refusal, store, wait_for


def children(server):
    pid = server.process.pid
    threads = pathlib.Path(f"/proc/{pid}/task").glob("*/children")
    return [child for thread in threads for child in thread.read_text().split()]


def is_alive(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


class Fleet:
    def __init__(self, options, work, cluster):
        self._options = options
        self._flags = ("--store", cluster.uri(), "--shared")
        self.data = work / "data"
        self.settings = work / "settings.json"
        self.settings.write_text(json.dumps(SETTINGS))
        self.servers = {}

    def start(self, name):
        self.servers[name] = Server(self._options, self.data, *self._flags, name=name)
        wait_for(self.servers[name].serves, f"{name} serves")
        return self.servers[name]

    def others(self, server):
        return [other for other in self.servers.values() if other is not server]

    def train(self, server, model):
        return json.loads(server.maneuver("train", model, "--dataset", "town", "--settings", self.settings, "--set",
                                          "optimization.joint_epochs=20", "--detach"))["name"]

    def owner(self):
        """The server that runs the only job, once it has a trainer."""
        owners = []

        def found():
            owners[:] = [server for server in self.servers.values() if children(server)]
            return bool(owners)

        wait_for(found, "a server runs the job")
        return owners[0]

    def wait_for_checkpoint(self, job):
        folder = self.data / job
        wait_for(lambda: any(folder.glob("attempts/[0-9]*/checkpoints/checkpoint-*")), f"{job} has a checkpoint")

    def wait_for_end(self, server, job):
        state = []

        def ended():
            # The command writes nothing while the job has an error, whose details it cannot write as JSON.
            found = re.search('"state":"JOB_STATE_([A-Z]+)"', server.maneuver("job", "show", job).replace(" ", ""))
            state[:] = [found[1] if found else "PENDING"]
            return state[0] not in ("PENDING", "RUNNING")

        wait_for(ended, f"{job} ends")
        return state[0]

    def versions(self, model):
        return sorted(path.name for path in (self.data / "models" / model).iterdir() if path.name.isdigit())

    def listed(self, server, model):
        names = [version["name"] for version in server.json("model", "list")["modelVersions"]]
        return [name for name in names if name.startswith(f"models/{model}/")]

    def weights(self, model):
        return (self.data / "models" / model / "1" / "weights.safetensors").read_bytes()

    def check_model(self, server, job, model):
        check(self.wait_for_end(server, job) == "SUCCEEDED", server.maneuver("job", "show", job))
        check(server.job(job)["modelVersion"] == f"models/{model}/versions/1", "the job names its version")
        wait_for(lambda: self.listed(server, model), f"a version of {model} is known")
        check(self.listed(server, model) == [f"models/{model}/versions/1"], f"one: {self.listed(server, model)}")
        check(self.versions(model) == ["1"], f"one version of {model}: {self.versions(model)}")

    def stop(self):
        for server in self.servers.values():
            server.process.send_signal(signal.SIGCONT)
            server.stop()


def version_of(server, scene):
    answer = json.loads(server.maneuver("predict", scene, "--model", "small"))
    return int(answer["modelVersion"].rsplit("/", 1)[1])


def notifications(server):
    return int(re.search(r"^maneuver_store_notifications_total (\d+)", server.metrics_page(), re.MULTILINE)[1])


def aliases_are_followed(fleet, scene):
    a, b, c = fleet.servers.values()
    for promoter, version in ((a, 2), (b, 1), (c, 2)):
        before = {server: notifications(server) for server in (a, b, c)}
        promoter.maneuver("model", "promote", f"small/{version}")
        begun = time.monotonic()
        for server in fleet.servers.values():
            wait_for(lambda: version_of(server, scene) == version, f"every server serves version {version}")
            row = f'maneuver_model_version{{alias="serving",model="small"}} {version}'
            wait_for(lambda: row in server.metrics_page(), "the metrics say which version serves")
            wait_for(lambda: notifications(server) > before[server], "the database told every server")
        print(f"small/{version} served by all after {time.monotonic() - begun:.1f} s")
    c.maneuver("model", "unalias", "small@serving")
    wait_for(lambda: a.ask("predict", scene, "--model", "small").returncode != 0, "a removed alias is gone everywhere")
    a.maneuver("model", "delete", "small/1")
    wait_for(lambda: b.ask("model", "show", "small/1").returncode != 0, "a deleted version is gone everywhere")
    c.maneuver("model", "promote", "small/2")


def labels_are_followed(fleet, scene):
    a, b, _ = fleet.servers.values()
    ask = ("predict", scene, "--model", "calm", "--min-probability", "0")
    wait_for(lambda: b.ask(*ask).returncode == 0, "a new model serves everywhere")
    a.maneuver("model", "label", "calm/1", 0, "slow left")
    wait_for(lambda: "slow left" in b.maneuver(*ask), "a label given through one server is shown by another")


def a_killed_server(fleet, calm):
    first = next(iter(fleet.servers.values()))
    job = fleet.train(first, "killed")
    fleet.wait_for_checkpoint(job)
    owner = fleet.owner()
    trainers = children(owner)
    other, third = fleet.others(owner)
    watch = subprocess.Popen([fleet._options.maneuver, "--server", other.address, "job", "watch", job],
                             stdout=subprocess.PIPE, text=True)
    name = next(name for name, server in fleet.servers.items() if server is owner)
    owner.process.kill()
    owner.process.wait()
    del fleet.servers[name]
    fleet.check_model(third, job, "killed")
    check(not any(is_alive(trainer) for trainer in trainers), "the trainer of a killed server is gone")
    check(third.job(job)["attempts"]["started"] == 2, "the second attempt ended the job")
    watched = watch.communicate(timeout=240)[0]
    check(watch.returncode == 0, f"another server's watch ends with the job: {watched}")
    check(fleet.weights("killed") == calm, "the weights are those of an undisturbed run")
    fleet.start(name)


def a_frozen_server(fleet, calm):
    first = next(iter(fleet.servers.values()))
    job = fleet.train(first, "frozen")
    fleet.wait_for_checkpoint(job)
    owner = fleet.owner()
    trainers = children(owner)
    owner.process.send_signal(signal.SIGSTOP)
    other = fleet.others(owner)[0]
    fleet.check_model(other, job, "frozen")
    ended = other.job(job)
    # Its trainer may have ended in the meantime: then it tries to publish what is there.
    owner.process.send_signal(signal.SIGCONT)
    wait_for(lambda: not any(is_alive(trainer) for trainer in trainers), "the trainer of the old lease is gone")
    wait_for(lambda: f"lease of {job} has ended" in owner.log.read_text(), "the server that was frozen gives up")
    fleet.check_model(owner, job, "frozen")
    check(owner.job(job) == ended, "the job is as its last worker left it")
    check(fleet.weights("frozen") == calm, "the weights are those of an undisturbed run")


def a_cancelled_job(fleet):
    first = next(iter(fleet.servers.values()))
    job = fleet.train(first, "cancelled")
    owner = fleet.owner()
    other, third = fleet.others(owner)
    other.maneuver("job", "cancel", job)
    check(fleet.wait_for_end(third, job) == "CANCELLED", "a job is cancelled through any server")
    wait_for(lambda: not children(owner), "its trainer is gone")
    third.maneuver("job", "delete", job)
    check(other.ask("job", "show", job).returncode != 0, "a job is deleted through any server")


def run(options, work, fleet, cluster):
    for version in (1, 2):
        folder = fleet.data / "models" / "small" / str(version)
        folder.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run([options.small_model, folder, str(version)], check=True)
    made = store(options, "migrate", "--store", cluster.uri())
    check(made.returncode == 0, made.stderr)
    a = Server(options, fleet.data, "--store", cluster.uri(), "--shared", name="a")
    fleet.servers["a"] = a
    a.maneuver("model", "promote", "small/2")
    b, c = fleet.start("b"), fleet.start("c")
    for data in (fleet.data, work / "other"):
        refused = refusal(options, data, "--store", cluster.uri())
        check("another maneuverd uses" in refused, f"a server that does not share is refused: {refused}")

    a.maneuver("synthesize", work / "town", "--recordings", 8)
    a.maneuver("dataset", "upload", work / "town", "town")
    check("datasets/town" in b.maneuver("dataset", "list"), "a dataset is listed by another server")
    scene = work / "scene.json"
    name = re.search('"(town-[^"]*)"', a.maneuver("scenario", "list", work / "town"))[1]
    a.maneuver("scenario", "extract", work / "town", name, "--out", scene)
    aliases_are_followed(fleet, scene)

    calm = fleet.train(b, "calm")
    fleet.check_model(c, calm, "calm")
    weights = fleet.weights("calm")
    labels_are_followed(fleet, scene)
    a_killed_server(fleet, weights)
    a_frozen_server(fleet, weights)
    a_cancelled_job(fleet)

    servers = list(fleet.servers.values())
    servers[0].maneuver("dataset", "delete", "town")
    check("datasets/town" not in servers[1].maneuver("dataset", "list"), "a dataset is deleted through any server")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", required=True, type=pathlib.Path)
    parser.add_argument("--trainer", required=True, type=pathlib.Path)
    parser.add_argument("--maneuver", required=True, type=pathlib.Path)
    parser.add_argument("--small-model", required=True, type=pathlib.Path, help="program that writes one")
    options = parser.parse_args()
    if not (POSTGRESQL / "initdb").exists():
        print("skipped: PostgreSQL 15 is not installed; deploy/install-deps.sh --tests installs it")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)
        work.chmod(0o755)  # for PostgreSQL's user
        cluster = Cluster(work / "postgresql")
        fleet = Fleet(options, work, cluster)
        try:
            run(options, work, fleet, cluster)
        except BaseException:
            for log in (*work.glob("data.*log"), cluster.folder / "log"):
                print(f"{log.name}, last lines:\n{log.read_text()[-3000:]}", file=sys.stderr)
            raise
        finally:
            fleet.stop()
            cluster.stop_at_once()


if __name__ == "__main__":
    main()
