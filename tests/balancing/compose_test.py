#!/usr/bin/python3
"""HAProxy with the configuration of deploy/compose/shared.yaml, before three servers.

  tests/balancing/compose_test.py --maneuverd PROGRAM --maneuver PROGRAM --small-model PROGRAM

The servers listen on addresses of the loopback that stand for the containers' names. Each has a store of its own: this
test is about who gets which call. Exit status 1 if a call goes nowhere.
"""

import argparse
import pathlib
import subprocess
import tempfile

from replicas import REPOSITORY, free_port, wait_for

NAMES = {"serve-1": "127.0.0.2", "serve-2": "127.0.0.3", "work": "127.0.0.4"}


class Containers:
    """The servers and HAProxy, as processes."""

    def __init__(self, work, options):
        self.options = options
        self._work = work
        self._log = open(work / "log", "wb")
        self.processes = {}

    def start(self):
        calls, metrics, self._port = free_port(), free_port(), free_port()
        text = (REPOSITORY / "deploy" / "compose" / "haproxy.cfg").read_text()
        for name, address in NAMES.items():
            text = text.replace(f" {name}:8470", f" {address}:{calls}")
        text = text.replace("port 9470", f"port {metrics}").replace("bind :8470", f"bind 127.0.0.1:{self._port}")
        (self._work / "haproxy.cfg").write_text(text)
        for name, address in NAMES.items():
            self.processes[name] = self._start([
                self.options.maneuverd, "--data-dir", self._work / name, "--listen", f"{address}:{calls}",
                "--metrics-listen", f"{address}:{metrics}", "--insecure"])
        self.processes["haproxy"] = self._start(["haproxy", "-db", "-f", self._work / "haproxy.cfg"])
        self._direct = [f"{address}:{calls}" for address in NAMES.values()]

    def _start(self, command):
        return subprocess.Popen(command, stdout=self._log, stderr=self._log)

    def ask(self, *command, server=None):
        """Returns whether the command succeeds, by default through HAProxy."""
        server = server or f"127.0.0.1:{self._port}"
        return subprocess.run([self.options.maneuver, "--server", server, *command], stdout=self._log,
                              stderr=self._log, check=False).returncode == 0

    def serve_a_model(self, folder):
        for server in self._direct:
            assert self.ask("model", "push", folder, "small", server=server)
            assert self.ask("model", "promote", "small/1", server=server)

    def stop(self):
        for process in self.processes.values():
            process.kill()
            process.wait()
        self._log.close()


def run(options, work):
    subprocess.run([options.small_model, work / "model"], check=True, stdout=subprocess.DEVNULL)
    containers = Containers(work, options)
    predictions = ("health", "maneuver.v1.PredictionService")
    try:
        containers.start()
        wait_for(lambda: containers.ask("model", "list"), "waited for an answer through HAProxy")
        assert not containers.ask(*predictions), "a server without a model was asked for predictions"
        containers.serve_a_model(work / "model")
        wait_for(lambda: containers.ask(*predictions), "waited for a server that predicts")
        containers.processes["serve-1"].kill()
        wait_for(lambda: all(containers.ask(*predictions) for _ in range(4)), "waited for the calls to go to serve-2")
        containers.processes["serve-2"].kill()
        wait_for(lambda: not containers.ask(*predictions), "waited for predictions to end")
        wait_for(lambda: containers.ask("model", "list"), "waited for the server that works to answer")
    except Exception:
        print((work / "log").read_text(errors="replace")[-4000:])
        raise
    finally:
        containers.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for program in ("maneuverd", "maneuver", "small-model"):
        parser.add_argument(f"--{program}", required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="maneuver-compose-") as work:
        run(options, pathlib.Path(work))
    print("calls reach the servers that can answer them")


if __name__ == "__main__":
    main()
