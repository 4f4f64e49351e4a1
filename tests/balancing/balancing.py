#!/usr/bin/python3
"""Two replicas under steady load: one is killed, one is drained, one is upgraded. Counts what callers saw.

Through HAProxy with deploy/balancing/haproxy.cfg, over TLS, or (--through clients) with clients that balance by
themselves. Prints a table; the exit status is 1 if a promise of docs/guides/balancing.md was not kept:
  - no call fails when a replica is drained (SIGTERM) or upgraded, whether its caller tries again or not;
  - when one is killed, no call fails that began afterwards, and none of callers who try again as
    deploy/balancing/retry-policy.json says.

Needs haproxy, openssl, protoc, python3-grpcio and python3-protobuf, as Debian 12 has them.
"""

import argparse
import collections
import json
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import grpc
from google.protobuf import json_format

from callers import Callers, Streamer
from replicas import REPOSITORY, SERVICE, Balancer, Replica

sys.path.insert(0, str(REPOSITORY / "tests" / "clients"))
from predict import load_messages  # noqa: E402

RETRY_POLICY = json.loads((REPOSITORY / "deploy" / "balancing" / "retry-policy.json").read_text())
IN_TURN = {"loadBalancingConfig": [{"round_robin": {}}], "healthCheckConfig": {"serviceName": SERVICE.decode()}}
# A caller may still write to a connection whose end is just being told.
TELLING_S = 0.1


class Way:
    """How calls get to the replicas."""

    def __init__(self, balancer, replicas):
        self._balancer = balancer
        self._all = ",".join(replica.address for replica in replicas)

    def channel(self, retries):
        config = {} if self._balancer else dict(IN_TURN)
        if retries:
            config.update(RETRY_POLICY)
        options = [("grpc.service_config", json.dumps(config)), ("grpc.per_rpc_retry_buffer_size", 64 << 20),
                   ("grpc.enable_retries", int(retries)), ("grpc.use_local_subchannel_pool", 1)]
        if not self._balancer:
            return grpc.insecure_channel("ipv4:" + self._all, options)
        roots = grpc.ssl_channel_credentials(self._balancer.authority.read_bytes())
        return grpc.secure_channel(self._balancer.address, roots, options)

    def flags(self):
        if not self._balancer:
            return ["--server", self._all]
        return ["--server", self._balancer.address, "--tls-ca", str(self._balancer.authority)]

    def wait_until(self, replica, state):
        if self._balancer:
            self._balancer.wait_until(replica.name, state)


class Trial:
    def __init__(self, options, work):
        self.options = options
        self.work = work
        self.replicas = []
        self.balancer = None
        self.rows = []
        self.broken = []
        with tempfile.TemporaryDirectory() as folder:
            self.messages = load_messages(folder)[0]
        request_json = (REPOSITORY / "tests" / "clients" / "request.json").read_text()
        self.request = json_format.Parse(request_json, self.messages.PredictRequest())

    def start(self):
        for i in (1, 2):
            self.replicas.append(Replica(self.work, f"replica{i}", self.options.maneuverd, self.options.model,
                                         self.options.delay))
        if self.options.through == "edge":
            self.balancer = Balancer(self.work, self.replicas)
        self.way = Way(self.balancer, self.replicas)

    def prepare(self):
        for replica in self.replicas:
            replica.wait_until_listening()
            subprocess.run([self.options.maneuver, "--server", replica.address, "model", "promote", "small/1"],
                           check=True, stdout=subprocess.DEVNULL)
            replica.wait_until_ready()
            self.way.wait_until(replica, "UP")

    def stop(self):
        for process in [r.process for r in self.replicas] + ([self.balancer.process] if self.balancer else []):
            process.kill()
            process.wait()

    def under_load(self, name, happens, kill=False):
        """Has `happens` happen while everybody calls; it returns when the replica was gone."""
        channels = [self.way.channel(retries) for retries in (False, True, True)]
        plain, retrying = (Callers(channel, self.request.SerializeToString()) for channel in channels[:2])
        stream = Streamer(channels[2], self.messages, self.request)
        loads = [self._start_load(name, retries) for retries in (False, True)]
        time.sleep(self.options.seconds / 6)
        gone = happens()
        ended = [self._end_load(load) for load in loads]
        for callers in (plain, retrying, stream):
            callers.end()
        for channel in channels:
            channel.close()

        def count(who, answered, failures):
            self.rows.append((name, who, answered, dict(collections.Counter(f.code for f in failures))))

        count("4 Python callers, one attempt", plain.answered, plain.failures)
        count("4 Python callers, retry policy", retrying.answered, retrying.failures)
        count(f"Python stream, opened again {stream.reopened} times", stream.answered, stream.failures)
        late = [f for f in plain.failures if f.begun > gone + TELLING_S]
        if plain.failures and not kill or late:
            self.broken.append(f"{name}: {(late or plain.failures)[0]} with the replica gone at {gone}")
        if not (plain.answered and retrying.answered and stream.answered):
            self.broken.append(f"{name}: some of the Python callers were never answered")
        if retrying.failures or stream.failures:
            self.broken.append(f"{name}: {(retrying.failures + stream.failures)[0]} in spite of retries")
        for retries, codes in zip((False, True), ended):
            answered = codes.pop("OK", 0)
            who = "maneuver load --retry" if retries else "maneuver load"
            self.rows.append((name, who, answered, codes))
            if answered == 0 or codes and (retries or not kill):
                self.broken.append(f"{name}: {who}: {answered} answered, {codes}")

    def _start_load(self, name, retries):
        file = self.work / f"{name}-{retries}.json"
        command = [self.options.maneuver, *self.way.flags(), "--timeout", "600", "load", "--rate", str(self.options.rate), "--scenes", "4",
                   "--warm-up", "0", "--duration", str(self.options.seconds), "--connections", "2", "--json", str(file)]
        process = subprocess.Popen(command + ["--retry"] * retries, stdout=subprocess.DEVNULL,
                                   stderr=open(self.work / "load.log", "ab"))
        return process, file

    @staticmethod
    def _end_load(load):
        process, file = load
        process.wait(900)
        return json.loads(file.read_text())["steps"][0]["ended"] if file.exists() else {}

    def restart(self, replica, program):
        replica.start(program)
        replica.wait_until_ready()
        self.way.wait_until(replica, "UP")

    def kill(self):
        replica = self.replicas[0]
        replica.signal(signal.SIGKILL)
        replica.wait_for_end()
        gone = time.monotonic()
        time.sleep(1)
        self.restart(replica, self.options.maneuverd)
        return gone

    def stop_and_start(self, replica, program):
        replica.signal(signal.SIGTERM)
        status = replica.wait_for_end()
        gone = time.monotonic()
        if status != 0:
            self.broken.append(f"{replica.name} ended with status {status}")
        self.restart(replica, program)
        return gone

    def run(self):
        other_version = self.work / "maneuverd-next"
        shutil.copy2(self.options.maneuverd, other_version)
        self.start()
        self.prepare()
        self.under_load("killed", self.kill, kill=True)
        self.under_load("drained", lambda: self.stop_and_start(self.replicas[1], self.options.maneuverd))
        self.under_load("upgraded", lambda: self.stop_and_start(self.replicas[0], other_version))
        for replica in self.replicas:
            errors = [line for line in replica.log.read_text().splitlines() if " error " in line]
            if errors:
                self.broken.append(f"{replica.name} logged {len(errors)} errors: {errors[0]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    programs = REPOSITORY / "build" / "release" / "bin"
    parser.add_argument("--maneuverd", default=programs / "maneuverd", type=pathlib.Path)
    parser.add_argument("--maneuver", default=programs / "maneuver", type=pathlib.Path)
    model = parser.add_mutually_exclusive_group(required=True)
    model.add_argument("--model", type=pathlib.Path, help="folder of a model version")
    model.add_argument("--small-model", type=pathlib.Path, help="program that writes one")
    parser.add_argument("--through", choices=("edge", "clients"), default="edge")
    parser.add_argument("--seconds", type=float, default=6, help="of load for each of the three")
    parser.add_argument("--rate", type=float, default=40, help="calls a second of each of the two maneuver load")
    parser.add_argument("--delay", type=float, default=3, help="--shutdown-delay of the replicas, seconds")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        if options.small_model:
            options.model = pathlib.Path(work) / "model"
            subprocess.run([options.small_model, options.model], check=True)
        trial = Trial(options, pathlib.Path(work))
        try:
            trial.run()
        finally:
            trial.stop()
            if trial.broken or not trial.rows:
                for log in pathlib.Path(work).glob("*.log"):
                    print(f"--- {log.name}", *log.read_text().splitlines()[-15:], sep="\n", file=sys.stderr)
    print("| replica | callers | answered | failed |\n|---|---|---:|---|")
    for happened, who, answered, failed in trial.rows:
        words = ", ".join(f"{count} {code}" for code, count in sorted(failed.items())) or "0"
        print(f"| {happened} | {who} | {answered} | {words} |")
    for line in trial.broken:
        print("broken:", line, file=sys.stderr)
    sys.exit(1 if trial.broken else 0)


if __name__ == "__main__":
    main()
