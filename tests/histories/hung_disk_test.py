#!/usr/bin/python3
"""A server whose disk hangs ends in time.

A call waits for ever for a disk that does not answer, as a folder of a network does whose server is gone. Its caller
gives up, and the server is told to end: it does, with the status 1, however long the disk takes.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

from histories import Faults, wait_for

HANG = -1
PROMISED = 60  # seconds: far more than the end takes without a disk that hangs, and less than for ever


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", type=pathlib.Path, required=True)
    parser.add_argument("--maneuver", type=pathlib.Path, required=True)
    parser.add_argument("--fault-shim", type=pathlib.Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)
        faults = Faults(work / "faults")
        ports = work / "ports.json"
        subprocess.run([options.maneuver, "synthesize", work / "town", "--recordings", "2"], check=True)
        with open(work / "log", "ab") as log:
            server = subprocess.Popen(
                [options.maneuverd, "--data-dir", work / "data", "--listen", "127.0.0.1:0", "--metrics-listen", "none",
                 "--shutdown-timeout", "1", "--port-file", ports], stdout=log, stderr=log,
                env={**os.environ, "LD_PRELOAD": str(options.fault_shim), "MANEUVER_FAULTS": str(work / "faults"),
                     "MANEUVER_FAULT_ROOT": str(work / "data")})
        try:
            wait_for(ports.exists, "the server starts")
            address = json.loads(ports.read_text())["grpc"]
            upload = [options.maneuver, "--server", address, "--timeout", "2", "dataset", "upload"]
            subprocess.run([*upload, work / "town", "before"], check=True)
            faults.arm(HANG, 0, 10**9)
            if subprocess.run([*upload, work / "town", "after"]).returncode == 0:
                sys.exit("FAILED: an upload succeeded: the disk does not hang")
            server.terminate()
            status = server.wait(PROMISED)
            log = (work / "log").read_text()
            if status != 1 or "broken off" not in log:
                sys.exit(f"FAILED: the server ended with {status}:\n{log}")
        finally:
            server.kill()
    print("a server whose disk hangs ended")


if __name__ == "__main__":
    main()
