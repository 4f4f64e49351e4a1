"""Processes of the test: replicas of maneuverd, and HAProxy in front of them."""

import os
import pathlib
import random
import shutil
import socket
import subprocess
import time

import grpc

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
SERVICE = b"maneuver.v1.PredictionService"
SERVING = b"\x08\x01"  # HealthCheckResponse {status: SERVING}
PATIENCE_S = 60


def free_port():
    """One that the system does not give to others who ask for any: it has to be there again after a restart."""
    while True:
        port = random.randrange(20000, 32000)
        with socket.socket() as listener:
            try:
                listener.bind(("127.0.0.1", port))
                return port
            except OSError:
                continue


def wait_for(condition, what):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > give_up:
            raise RuntimeError(f"{what} for {PATIENCE_S} s in vain")
        time.sleep(0.02)


class Replica:
    """A maneuverd with a data folder of its own, on the same port whenever it is started."""

    def __init__(self, work, name, program, model, delay_s):
        self.name = name
        self.data = work / name
        self.log = work / f"{name}.log"
        self.port = free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.delay_s = delay_s
        self.process = None
        shutil.copytree(model, self.data / "models" / "small" / "1")
        self.start(program)

    def start(self, program):
        command = [program, "--data-dir", self.data, "--listen", self.address, "--metrics-listen", "none",
                   "--workers", "1", "--shutdown-delay", str(self.delay_s)]
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log)

    def wait_until_listening(self):
        wait_for(lambda: self._health() is not None, f"waited for {self.name} to listen")

    def wait_until_ready(self):
        wait_for(lambda: self._health() == SERVING, f"waited for {self.name} to serve")

    def signal(self, signal):
        self.process.send_signal(signal)

    def wait_for_end(self):
        return self.process.wait(PATIENCE_S)

    def _health(self):
        request = b"\x0a" + bytes([len(SERVICE)]) + SERVICE
        try:
            with grpc.insecure_channel(self.address) as channel:
                return channel.unary_unary("/grpc.health.v1.Health/Check")(request, timeout=2)
        except grpc.RpcError:
            return None


class Balancer:
    """HAProxy with the configuration that is shipped."""

    def __init__(self, work, replicas):
        self.address = f"127.0.0.1:{free_port()}"
        self.authority = work / "edge.crt"
        key = work / "edge.key"
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                        "-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1",
                        "-keyout", key, "-out", self.authority], check=True, capture_output=True)
        certificate = work / "edge.pem"
        certificate.write_bytes(self.authority.read_bytes() + key.read_bytes())
        self.admin = work / "admin.sock"
        environment = dict(os.environ, MANEUVER_EDGE=self.address, MANEUVER_CERTIFICATE=str(certificate),
                           MANEUVER_ADMIN=str(self.admin), MANEUVER_METRICS=f"127.0.0.1:{free_port()}",
                           MANEUVER_REPLICA_1=replicas[0].address, MANEUVER_REPLICA_2=replicas[1].address)
        if os.geteuid() != 0:
            environment["MANEUVER_UNPRIVILEGED"] = "1"
        with open(work / "haproxy.log", "ab") as log:
            self.process = subprocess.Popen(
                ["haproxy", "-db", "-f", REPOSITORY / "deploy" / "balancing" / "haproxy.cfg"],
                env=environment, stdout=log, stderr=log)

    def states(self):
        """What HAProxy thinks of each replica: {"replica1": "UP", ...}."""
        return {row[1]: row[17] for row in self._statistics()}

    def calls(self):
        """Returns how many calls HAProxy has given to the replicas for predictions."""
        return sum(int(row[7]) for row in self._statistics())

    def _statistics(self):
        """Returns a row for each replica for predictions, as `show stat` has it; none while HAProxy does not listen."""
        with socket.socket(socket.AF_UNIX) as connection:
            try:
                connection.connect(str(self.admin))
            except OSError:
                return []
            connection.sendall(b"show stat predictions 4 -1\n")
            lines = connection.makefile().read().splitlines()
        return [line.split(",") for line in lines if line.startswith("predictions,")]

    def wait_until(self, name, state):
        wait_for(lambda: self.states().get(name) == state, f"waited for {name} to be {state}")
