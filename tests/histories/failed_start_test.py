#!/usr/bin/python3
"""A start that fails because the disk fails loses nothing.

SQLite once brought its journal into the database and deleted it while it closed a database that it could not open, and
went by an index of the journal that was out of date: the newest changes were gone. Each of the first operations of a
start fails here, from that one on, and the next start has everything.
"""

import argparse
import errno
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile

from histories import Faults, wait_for

# More than SQLite keeps in its journal before it begins a new one (1,000 pages), then a sudden death.
WRITES = 1100
WRITER = f"""
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA synchronous = OFF")
for number in range({WRITES}):
    database.execute("INSERT OR REPLACE INTO aliases VALUES ('m', 'a' || ?, ?, NULL)", (number % 5, number))
os.kill(os.getpid(), 9)
"""


def start(options, work):
    """Starts the server, and kills it once it listens. Returns whether it did."""
    ports = work / "ports.json"
    ports.unlink(missing_ok=True)
    with open(work / "log", "ab") as log:
        server = subprocess.Popen(
            [options.maneuverd, "--data-dir", work / "data", "--listen", "127.0.0.1:0", "--metrics-listen", "none",
             "--port-file", ports], stdout=log, stderr=log,
            env={**os.environ, "LD_PRELOAD": str(options.fault_shim), "MANEUVER_FAULTS": str(work / "faults"),
                 "MANEUVER_FAULT_ROOT": str(work / "data")})
    wait_for(lambda: ports.exists() or server.poll() is not None, "the server starts or ends")
    listens = server.poll() is None
    server.kill()
    server.wait()
    return listens


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", type=pathlib.Path, required=True)
    parser.add_argument("--fault-shim", type=pathlib.Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)
        data, database = work / "data", work / "data" / "maneuver.db"
        faults = Faults(work / "faults")
        start(options, work)
        subprocess.run([sys.executable, "-c", WRITER, database])
        shutil.copytree(data, work / "killed")
        refused = 0
        for operation in range(12):
            shutil.rmtree(data)
            shutil.copytree(work / "killed", data)
            faults.arm(errno.EIO, operation, 10**9)
            refused += not start(options, work)
            faults.heal()
            with sqlite3.connect(database) as opened:
                newest = opened.execute("SELECT MAX(version) FROM aliases").fetchone()[0]
            if newest != WRITES - 1:
                sys.exit(f"FAILED: a start whose operations failed from {operation} on lost changes: {newest} is the newest")
    if refused < 3:
        sys.exit(f"FAILED: only {refused} starts of 12 were refused: the faults do not reach the server")
    print(f"{refused} of 12 starts were refused, and nothing was lost")


if __name__ == "__main__":
    main()
