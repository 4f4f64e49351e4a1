#!/usr/bin/python3
"""Runs a server for long under a mixed load, and fails if its memory, descriptors, threads or disk grow.

Half of the calls that the server can take come over TLS. Meanwhile others train, evaluate, cancel, upload, label, point
aliases, delete, watch jobs, stream, connect and go, and the server reloads certificates and tokens. What they make
they delete again, so that a sound server takes the same after an hour as after a minute.

The measure is the slope of each quantity over the last two thirds of the run (the median of the slopes between all
pairs of samples, after Theil and Sen), times their length. Prints a table; the exit status is 1 if one grew too much
or a call failed.
"""

import argparse
import collections
import csv
import json
import os
import pathlib
import random
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

import maneuver
from maneuver import v1

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
BUILD = REPOSITORY / "build" / "release"
sys.path.append(str(REPOSITORY / "tests" / "python"))
from server import TINY, lift_jobs  # noqa: E402

PATIENCE_S = 300
SETTINGS = {**TINY, "examples": {"max_examples": 40}}
# Most that a quantity may grow: so much, and this share of its median. Memory settles for minutes: pages that were once
# freed stay with the allocator of the thread that used them. What is allocated has no such excuse: if it grows, the
# server leaks; but 24 MiB are kept for outcomes, which take an hour to fill.
ALLOWED = {"memory, MB": (32, 0.05), "allocated, MB": (12, 0.05), "descriptors": (4, 0), "threads": (2, 0),
           "disk, MB": (2, 0.02)}
# Threads of gRPC that are not counted: two pools that grow under load, to four threads on two cores, and stay.
POOLS = ("default-executo", "grpc_global_tim")


class Certificates:
    """A server's certificate, of an authority of the test's own, that is renewed now and then."""

    def __init__(self, folder):
        self._folder = folder
        self.authority, self.certificate, self.key = folder / "ca.crt", folder / "server.crt", folder / "server.key"
        self._run("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "9", "-subj",
                  "/CN=soak", "-keyout", folder / "ca.key", "-out", self.authority)
        (folder / "names").write_text("subjectAltName=IP:127.0.0.1\n")
        self.renew()

    def renew(self):
        new_key, new, request = self._folder / "new.key", self._folder / "new.crt", self._folder / "new.csr"
        self._run("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", "/CN=server", "-keyout",
                  new_key, "-out", request)
        self._run("x509", "-req", "-in", request, "-CA", self.authority, "-CAkey", self._folder / "ca.key", "-days", "9",
                  "-extfile", self._folder / "names", "-out", new)
        new_key.replace(self.key)
        new.replace(self.certificate)

    @staticmethod
    def _run(*arguments):
        subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True)


class Server:
    def __init__(self, options, work):
        self._options = options
        self._work = work
        self.data = work / "data"
        self.certificates = Certificates(work)
        self._tokens = work / "tokens"
        self.token = self.add_token("operator", "predict,train,admin")
        ports = work / "ports.json"
        with open(work / "maneuverd.log", "ab") as log:
            self.process = subprocess.Popen(
                [options.maneuverd, "--data-dir", self.data, "--listen", "127.0.0.1:0", "--metrics-listen",
                 "127.0.0.1:0", "--port-file", ports, "--tls-certificate", self.certificates.certificate, "--tls-key",
                 self.certificates.key, "--tokens", self._tokens, "--max-connection-age", "20", "--outcome-memory", "8MiB",
                 "--max-maps", "16", "--checkpoint-interval", "1",
                 *options.flags], stdout=log, stderr=log)
        give_up = time.monotonic() + PATIENCE_S
        while not ports.exists():
            if self.process.poll() is not None or time.monotonic() > give_up:
                raise RuntimeError((work / "maneuverd.log").read_text())
            time.sleep(0.05)
        addresses = json.loads(ports.read_text())
        self.address = addresses["grpc"]
        self._metrics = f"http://{addresses['metrics']}/metrics"

    def _change_tokens(self, *arguments):
        return subprocess.run([self._options.maneuverd, "token", *arguments, "--tokens", self._tokens], check=True,
                              capture_output=True, text=True).stdout

    def add_token(self, name, roles):
        file = self._work / f"{name}.token"
        file.touch(mode=0o600)
        file.write_text(self._change_tokens("create", "--name", name, "--roles", roles))
        return file

    def revoke_token(self, name):
        self._change_tokens("revoke", "--name", name)

    def client(self, token=None):
        tls = maneuver.Tls(root_certificates=str(self.certificates.authority))
        return maneuver.Client(self.address, tls=tls, token_file=str(token or self.token))

    def maneuver(self, *arguments):
        return [self._options.maneuver, "--server", self.address, "--tls-ca", self.certificates.authority, "--token-file",
                self.token, *map(str, arguments)]

    def sample(self):
        process = pathlib.Path(f"/proc/{self.process.pid}")
        status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
        threads = 0
        for task in (process / "task").iterdir():
            try:
                threads += (task / "comm").read_text().strip() not in POOLS
            except (FileNotFoundError, ProcessLookupError):
                pass  # it ended meanwhile
        size = 0
        for folder, _, files in os.walk(self.data):
            for file in files:
                try:
                    size += os.stat(os.path.join(folder, file)).st_blocks * 512
                except FileNotFoundError:
                    pass
        with urllib.request.urlopen(self._metrics, timeout=PATIENCE_S) as page:
            allocated = re.search(rb"^maneuver_allocated_bytes (\S+)", page.read(), re.MULTILINE)
        return {"memory, MB": int(status["RssAnon"].split()[0]) / 1024, "allocated, MB": float(allocated[1]) / 2**20,
                "descriptors": len(os.listdir(process / "fd")), "threads": threads, "disk, MB": size / 1e6}


def scenario(number, **fields):
    vehicle = v1.Agent(id=7, type=v1.AGENT_TYPE_VEHICLE, length=4.5, width=1.9, states=[v1.AgentState(velocity_x=5)])
    return v1.Scenario(scenario_id=f"soak-{number}", target_ids=[7], agents=[vehicle], **fields)


class Soak:
    def __init__(self, options, work):
        self.options = options
        self.work = work
        self.random = random.Random(options.seed)
        self.server = Server(options, work)
        threading.Thread(target=lift_jobs, args=(self.server.process,), daemon=True).start()
        self.over = threading.Event()
        self.done = collections.Counter()
        self.failures = []
        self.samples = []  # (seconds, {quantity: value})
        for town in range(2):
            subprocess.run([options.maneuver, "synthesize", work / f"town{town}", "--recordings", "4", "--seed", str(town + 1)],
                           check=True, stdout=subprocess.DEVNULL)
        for seed in (1, 2):
            subprocess.run([options.small_model, work / f"model{seed}", str(seed)], check=True)
        self._client = self.server.client()
        self._client.upload_dataset(work / "town0", "datasets/town")
        job = self._client.wait_for_job(self._client.train("models/served", ["datasets/town"], SETTINGS))
        self.served = [job.model_version]
        self.served.append(self._client.wait_for_job(self._client.train(
            "models/served", ["datasets/town"], {**SETTINGS, "seed": 2})).model_version)

    # What happens beside the load, each again and again in a thread of its own.

    def swap(self):
        version = self.served[self.done["swap"] % 2]
        self._client.set_model_alias("models/served/aliases/serving", version)
        action = self.random.randrange(12)
        # Names of a version differ.
        self._client.label_action(version, action, f"label {action}-{self.random.randrange(9)}")
        return 0.5

    def learn(self):
        """A training, which is cancelled at times, and an evaluation; then it is all deleted."""
        job = self._client.train("models/learned", ["datasets/town"], SETTINGS, promotion=v1.PROMOTION_NEVER)
        if self.random.random() < 0.3:
            self._client.cancel_job(job.name)
        ended = job
        for ended in self._client.watch_job(job.name, timeout=PATIENCE_S):
            pass
        if ended.state == v1.JOB_STATE_FAILED:
            raise RuntimeError(f"{job.name} failed: {ended.error.message}")
        if ended.model_version:
            measured = self._client.wait_for_job(self._client.evaluate(ended.model_version, "datasets/town"))
            self._client.delete_job(measured.name)
            self._client.delete_model_version(ended.model_version)
        self._client.delete_job(job.name)
        return 1

    def upload(self):
        name = f"datasets/passing-{self.done['upload'] % 3}"
        try:
            self._client.delete_dataset(name)  # what a round left that was cut short
        except maneuver.NotFoundError:
            pass
        self._client.upload_dataset(self.work / "town1", name)
        next(iter(self._client.list_scenarios(name)))
        self._client.delete_dataset(name)
        version = self._client.upload_model_version(self.work / f"model{1 + self.done['upload'] % 2}", "models/passing")
        self._client.delete_model_version(version.name)
        return 0.5

    def connect(self):
        """Connections that come and go, streams and calls that are given up, a stranger without a token."""
        number = self.done["connect"]
        with self.server.client() as client:
            client.predict(scenario(number), model="models/served")
            features = [v1.MapFeature(id=1, type=v1.MAP_FEATURE_TYPE_LANE_CENTERLINE, x=[0, 10 + number % 50], y=[0, 0])]
            map_id = client.register_map(features)
            client.predict(scenario(number, map_id=map_id), model="models/served")
            client.report_outcomes([v1.Outcome(scenario_id=f"soak-{number}", model="models/served", targets=[
                v1.TargetOutcome(target_id=7, states=[v1.AgentState(time=0.1 * i, x=0.5 * i, velocity_x=5)
                                                      for i in range(1, 51)])])])
            stream = client.stream_predict(lambda answer: None)
            for frame in range(5):
                stream.send(str(frame), scenario(number), model="models/served")
            stream.finish() if number % 2 else stream.cancel()
            try:
                client.predict(scenario(number), model="models/served", timeout=0.001)
            except maneuver.ManeuverError:
                pass  # given up on purpose
        return 0.05

    def reload(self):
        """A new certificate, and tokens that come and go."""
        self.server.certificates.renew()
        name = f"guest{self.done['reload'] % 3}"
        token = self.server.add_token(name, "predict")
        give_up = time.monotonic() + PATIENCE_S
        while True:
            with self.server.client(token) as client:
                try:
                    client.predict(scenario(0), model="models/served")
                    break
                except (maneuver.UnauthenticatedError, maneuver.UnavailableError):
                    if time.monotonic() > give_up:
                        raise
            time.sleep(0.1)
        self.server.revoke_token(name)
        return 2

    def capacity(self, seconds):
        """Calls a second that the server can take beside the other work, measured for so long."""
        figures = self.work / "load.json"
        # Its status is 1 if a call met a connection that aged, or a certificate half renewed.
        subprocess.run(self.server.maneuver("load", "--model", "models/served", "--concurrency", "8", "--warm-up", "1",
                                            "--duration", f"{seconds:.0f}", "--json", figures), stdout=subprocess.DEVNULL)
        return json.loads(figures.read_text())["steps"][0]["answered_per_second"]

    def again_and_again(self, what):
        while not self.over.is_set():
            try:
                pause = what()
                self.done[what.__name__] += 1
            except maneuver.UnavailableError as error:
                self.done[f"{what.__name__}: unavailable"] += 1  # a connection that aged, or a certificate half renewed
                pause = 0.5
                if self.server.process.poll() is not None:
                    self.failures.append(f"{what.__name__}: {error}")
                    return
            except Exception as error:
                self.failures.append(f"{what.__name__}: {type(error).__name__}: {error}")
                return
            self.over.wait(pause)

    def run(self):
        seconds = self.options.hours * 3600 + self.options.minutes * 60
        tasks = (self.swap, self.learn, self.upload, self.connect, self.reload)
        threads = [threading.Thread(target=self.again_and_again, args=(what,)) for what in tasks]
        for thread in threads:
            thread.start()
        rate = self.options.rate or 0.5 * self.capacity(min(60, max(3, seconds / 20)))
        figures = self.work / "calls.json"
        load = subprocess.Popen(self.server.maneuver("load", "--model", "models/served", "--rate", f"{rate:.1f}", "--retry",
                                                     "--deadline", "20000", "--duration", f"{seconds:.0f}", "--json", figures),
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        begun = time.monotonic()
        between = max(0.5, seconds / 400)
        while time.monotonic() - begun < seconds and not self.failures and self.server.process.poll() is None:
            self.samples.append((time.monotonic() - begun, self.server.sample()))
            time.sleep(between)
        self.over.set()
        for thread in threads:
            thread.join()
        if self.failures:
            load.terminate()
        print(load.communicate(timeout=PATIENCE_S)[0])
        print(f"{seconds:.0f} s at {rate:.0f} calls/s; " + ", ".join(f"{count} {what}" for what, count in sorted(self.done.items())))
        if self.server.process.poll() is not None:
            self.failures.append(f"the server ended with {self.server.process.returncode}")
        if not self.failures:
            self.failures += [f"{what.__name__} never succeeded" for what in tasks if not self.done[what.__name__]]
            # Its status is 1 if a call met a connection that aged, or a certificate half renewed.
            if load.returncode not in (0, 1) or not figures.exists():
                self.failures.append(f"maneuver load ended with {load.returncode}")
            elif not json.loads(figures.read_text())["steps"][0]["calls_answered"]:
                self.failures.append("maneuver load was never answered")
        self.judge()
        return self.failures

    def judge(self):
        first = len(self.samples) // 3
        late = self.samples[first:]
        print("\n| | at the begin | after a third | at the end | most | slope x time | allowed |\n|---|---:|---:|---:|---:|---:|---:|")
        for quantity, (absolute, share) in ALLOWED.items():
            values = [sample[quantity] for _, sample in self.samples]
            growth = slope([(at, sample[quantity]) for at, sample in late]) * (late[-1][0] - late[0][0])
            allowed = absolute + share * statistics.median(values)
            print(f"| {quantity} | {values[0]:.1f} | {values[first]:.1f} | {values[-1]:.1f} | {max(values):.1f} | {growth:+.2f} "
                  f"| {allowed:.1f} |")
            if growth > allowed:
                self.failures.append(f"{quantity} grows: {growth:+.2f} in {late[-1][0] - late[0][0]:.0f} s")

    def close(self):
        self._client.close()
        self.server.process.terminate()
        self.server.process.wait(PATIENCE_S)


def slope(points):
    """The median of the slopes between all pairs: a few spikes do not move it."""
    step = max(1, len(points) // 200)
    points = points[::step]
    slopes = [(b[1] - a[1]) / (b[0] - a[0]) for i, a in enumerate(points) for b in points[i + 1:]]
    return statistics.median(slopes) if slopes else 0.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=0)
    parser.add_argument("--minutes", type=float, default=0)
    parser.add_argument("--rate", type=float, default=0, help="calls a second; 0: half of what the server can take "
                        "beside the other work")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--csv", type=pathlib.Path, help="write the samples to this file")
    parser.add_argument("--maneuverd", type=pathlib.Path, default=BUILD / "bin" / "maneuverd")
    parser.add_argument("--maneuver", type=pathlib.Path, default=BUILD / "bin" / "maneuver")
    parser.add_argument("--small-model", type=pathlib.Path, default=BUILD / "tests" / "write_small_model")
    parser.add_argument("--flags", type=str.split, default=[], help="more options of maneuverd, in one word; commas stand "
                        "for spaces")
    options = parser.parse_args()
    options.flags = [flag.replace(",", " ") for flag in options.flags]
    if options.hours + options.minutes <= 0:
        parser.error("--hours or --minutes: how long?")
    with tempfile.TemporaryDirectory(prefix="maneuver-soak-") as work:
        soak = Soak(options, pathlib.Path(work))
        try:
            failures = soak.run()
        finally:
            soak.close()
            if options.csv:
                with open(options.csv, "w", newline="") as file:
                    rows = csv.writer(file)
                    rows.writerow(["seconds", *ALLOWED])
                    rows.writerows([round(at, 1), *(round(sample[quantity], 2) for quantity in ALLOWED)]
                                   for at, sample in soak.samples)
    for failure in failures:
        print("FAILED:", failure, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
