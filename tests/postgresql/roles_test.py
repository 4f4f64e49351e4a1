#!/usr/bin/python3
"""Servers with different roles share one PostgreSQL database and one data folder.

--role api and --role serve take every call about models, datasets and jobs; serve alone predicts; --role work runs the
jobs, each one that it can. A worker that gets SIGTERM writes a checkpoint and hands its job to another one, which ends
it with the weights of an undisturbed run. A job that no server can run says why.

Needs PostgreSQL 15 of Debian; skips (77) without it.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request

from server_test import POSTGRESQL, SETTINGS, Cluster, Server, check, store, wait_for


class Fleet:
    def __init__(self, options, work, cluster):
        self.options = options
        self._shared = ("--store", cluster.uri(), "--shared")
        self.data = work / "data"
        self.settings = work / "settings.json"
        self.settings.write_text(json.dumps(SETTINGS))
        self.servers = {}

    def start(self, name, role, *flags):
        # One checkpoint a day: what a job resumes from was written because it was asked to stop.
        server = Server(self.options, self.data, *self._shared, "--role", role, "--replica-name", name,
                        "--checkpoint-interval", "86400", *flags, name=name)
        self.servers[name] = server
        wait_for(server.serves, f"{name} is up")
        return server

    def train(self, server, model, *flags):
        done = server.ask("train", model, "--dataset", "town", "--settings", self.settings, "--set",
                          "optimization.joint_epochs=20", "--detach", *flags)
        check(done.returncode == 0, done.stderr)
        return json.loads(done.stdout)["name"], done.stderr

    def ended(self, server, job):
        wait_for(lambda: server.job(job)["state"] not in ("JOB_STATE_PENDING", "JOB_STATE_RUNNING"), f"{job} ends")
        return server.job(job)

    def started(self, job):
        """The servers that began an attempt at a job."""
        return {name for name, server in self.servers.items()
                if re.search(f"job started.*{job}", server.log.read_text())}

    def weights(self, model):
        return (self.data / "models" / model / "1" / "weights.safetensors").read_bytes()

    def stop(self):
        for server in self.servers.values():
            if server.process.poll() is None:
                server.stop()


def ready(server, query=""):
    try:
        return urllib.request.urlopen(f"http://{server.metrics}/readyz{query}").status
    except urllib.error.HTTPError as error:
        return error.code


def predicts_elsewhere(server, scene):
    check(ready(server) == 200, "a server without predictions is ready")
    check(ready(server, "?service=maneuver.v1.PredictionService") == 503, "and says that it does not predict")
    check(server.ask("health", "maneuver.v1.PredictionService").returncode != 0, "over gRPC, too")
    for call in (["predict", scene, "--model", "small"], ["predict", scene]):
        refused = server.ask(*call)
        check(refused.returncode != 0 and "PREDICTIONS_ELSEWHERE" in refused.stdout + refused.stderr,
              f"{call}: {refused.stdout}{refused.stderr}")
    check("maneuver_model_version{" not in server.metrics_page(), "it has loaded no model")
    check("maneuver_serving_models" not in server.metrics_page(), "and none is missing: nobody is woken up")


def replicas(fleet, server, model):
    """The table of `maneuver model show`: what each server that predicts has loaded."""
    text = subprocess.run([fleet.options.maneuver, "--server", server.address, "model", "show", model],
                          capture_output=True, text=True, check=True).stdout
    return dict(re.findall(r"^(\S+) {2,}((?:\w+ \d+(?:, )?)+|-)$", text[text.find("REPLICA"):], re.MULTILINE))


def without_worker(server):
    return int(re.search(r"^maneuver_jobs_without_worker (\d+)", server.metrics_page(), re.MULTILINE)[1])


def a_drained_worker(fleet, weights):
    api = fleet.servers["api"]
    job, _ = fleet.train(api, "drained")
    wait_for(lambda: api.job(job).get("progress", {}).get("phase") == "joint", f"{job} learns")
    owner, = fleet.started(job)
    fleet.servers[owner].stop()
    ended = fleet.ended(api, job)
    check(ended["state"] == "JOB_STATE_SUCCEEDED", ended)
    check(fleet.started(job) == {"work-1", "work-2"}, f"another worker continued it: {fleet.started(job)}")
    attempts = ended["attempts"]
    check(attempts["started"] == 2 and attempts.get("withoutProgress", 0) == 0, f"no attempt failed: {attempts}")
    check(int(attempts["checkpoint"]) > 0, f"the second one began at the checkpoint of the first: {attempts}")
    other, = {"work-1", "work-2"} - {owner}
    log = fleet.servers[other].log.read_text()
    check("job was interrupted" not in log, f"the job was handed over; no lease had to end: {log[-2000:]}")
    check(fleet.weights("drained") == weights, "the weights are those of an undisturbed run")


def run(options, work, fleet, cluster):
    for version in (1, 2):
        folder = fleet.data / "models" / "small" / str(version)
        folder.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run([options.small_model, folder, str(version)], check=True)
    made = store(options, "migrate", "--store", cluster.uri())
    check(made.returncode == 0, made.stderr)
    alone = subprocess.run([options.maneuverd, "--data-dir", fleet.data, "--role", "work"], capture_output=True, text=True)
    check(alone.returncode == 2 and "--role work needs --shared" in alone.stderr, alone.stderr)

    subprocess.run([options.maneuver, "synthesize", work / "town", "--recordings", "8"], check=True, capture_output=True)
    size = sum(shard.stat().st_size for shard in (work / "town").glob("*.tfrecord*"))
    quota = ("--dataset-quota", str(size * 3 // 2))
    api, serve = fleet.start("api", "api", *quota), fleet.start("serve", "serve", *quota)
    scene = work / "scene.json"
    name = re.search('"(town-[^"]*)"', api.maneuver("scenario", "list", work / "town"))[1]
    api.maneuver("scenario", "extract", work / "town", name, "--out", scene)

    check(ready(serve) == 503, "a server that predicts is not ready without a model")
    api.maneuver("model", "promote", "small/2")
    wait_for(lambda: ready(serve) == 200, "it is, once a model was promoted elsewhere")
    answer = json.loads(serve.maneuver("predict", scene, "--model", "small"))
    check(answer["modelVersion"] == "models/small/versions/2", answer["modelVersion"])
    predicts_elsewhere(api, scene)
    serve.maneuver("model", "promote", "small/1")
    wait_for(lambda: replicas(fleet, api, "small") == {"serve": "serving 1"}, "each knows what the others have loaded")

    serve.maneuver("dataset", "upload", work / "town", "town")
    refused = api.ask("dataset", "upload", work / "town", "again")
    check(refused.returncode != 0 and "DATASET_QUOTA" in refused.stdout + refused.stderr,
          f"the quota counts what came through another server: {refused.stdout}{refused.stderr}")
    calm, said = fleet.train(serve, "calm")
    check("waits: no server can run it: no server that runs jobs is up" in said, said)
    check("no server that runs jobs is up" in api.job(calm)["error"]["message"], api.job(calm))
    wait_for(lambda: without_worker(serve) == 1, "the metric counts the job that waits")
    first = fleet.start("work-1", "work", "--job-ranks", "2")
    ended = fleet.ended(api, calm)
    check(ended["state"] == "JOB_STATE_SUCCEEDED", ended)
    check(fleet.started(calm) == {"work-1"}, f"a worker ran it: {fleet.started(calm)}")
    wait_for(lambda: replicas(fleet, first, "calm") == {"serve": "serving 1"}, "what it made serves, and nobody else")
    predicts_elsewhere(first, scene)

    wide, said = fleet.train(api, "wide", "--ranks", "4")
    check("needs 4 ranks, and the servers that run jobs take at most 2" in said, said)
    check("4 ranks" in serve.job(wide)["error"]["message"], serve.job(wide))
    wait_for(lambda: without_worker(api) == 1, "the metric counts a job that is too large for the worker")
    narrow, said = fleet.train(api, "narrow", "--priority", "-1")
    check("waits" not in said, said)
    check(fleet.ended(serve, narrow)["state"] == "JOB_STATE_SUCCEEDED", "a job that waits keeps no other from running")
    serve.maneuver("job", "cancel", wide)
    check(api.job(wide)["state"] == "JOB_STATE_CANCELLED" and "error" not in api.job(wide), api.job(wide))
    wait_for(lambda: without_worker(serve) == 0, "no job waits in vain any more")

    fleet.start("work-2", "work")
    a_drained_worker(fleet, fleet.weights("calm"))


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
