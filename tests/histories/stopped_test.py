#!/usr/bin/python3
"""histories.py ends its server and itself when it is told to stop by SIGTERM, also while its callers are at work."""

import os
import pathlib
import signal
import subprocess
import sys
import tempfile

from histories import wait_for


def processes(work):
    """Returns those that were started with a path in this folder."""
    found = []
    for file in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(work).encode() in file.read_bytes():
                found.append(int(file.parent.name))
        except OSError:  # it has just ended
            pass
    return found


def main():
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)
        history = subprocess.Popen([sys.executable, pathlib.Path(__file__).parent / "histories.py", *sys.argv[1:]],
                                   env={**os.environ, "TMPDIR": name})
        try:
            wait_for(lambda: any(work.glob("*/data/models/m*")) or history.poll() is not None, "callers are at work")
            if history.poll() is not None:
                sys.exit("FAILED: the history ended by itself")
            history.send_signal(signal.SIGTERM)
            wait_for(lambda: history.poll() is not None, "the history ends")
            wait_for(lambda: not processes(work), "its server and trainers end")
        finally:
            history.kill()
            history.wait()
            for process in processes(work):
                os.kill(process, signal.SIGKILL)
    print("nothing was left")


if __name__ == "__main__":
    main()
