#!/usr/bin/python3
"""Runs the commands that pages show, against a small server, and fails where one of them fails.

    tests/docs/run_pages.py --bin build/release/bin --small-model build/release/tests/write_small_model [PAGE ...]

What is run is marked in the page:

    ```sh run                 shell commands that a reader would type, in bash -euo pipefail
    ```json file=scene.json   a file that they find in their folder
    <!-- sh run ... -->       commands that the reader does not see: what the page takes for granted

All blocks of a page are one script, in a folder of its own, with a server of its own on a free port of loopback that
MANEUVER_SERVER names. It has the model `town`, whose versions 1 and 2 have random weights; version 1 serves.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^(?:```sh run|```\w+ file=(?P<file>\S+)|<!-- sh run)\n(?P<text>.*?)^(?:```|-->)$",
                   re.MULTILINE | re.DOTALL)
MARK = re.compile(r"^\s*(?:```sh run|```\w+ file=|<!-- sh run)", re.MULTILINE)
PATIENCE_S = 60


def server(options, folder):
    """A running server, and its address."""
    data, ports = folder / "data", folder / "ports.json"
    for version in ("1", "2"):
        place = data / "models/town" / version
        place.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run([options.small_model, place, version], check=True)
    with open(folder / "maneuverd.log", "wb") as log:
        process = subprocess.Popen(
            [options.bin / "maneuverd", "--data-dir", data, "--listen", "127.0.0.1:0", "--metrics-listen", "none",
             "--serve", "town/1", "--port-file", ports], stdout=log, stderr=log)
    give_up = time.monotonic() + PATIENCE_S
    while not ports.exists() and process.poll() is None and time.monotonic() < give_up:
        time.sleep(0.02)
    if not ports.exists():
        process.kill()
        raise RuntimeError("the server did not start:\n" + (folder / "maneuverd.log").read_text())
    return process, re.search(r'"grpc": *"([^"]*)"', ports.read_text())[1]


def open_secrets(folder):
    """What is wrong with files of tokens and keys that others may read, if there are any."""
    names = [path.name for path in sorted(folder.rglob("*")) if path.suffix in (".token", ".key") or path.name == "tokens"
             if path.stat().st_mode & 0o077]
    return f"others may read {', '.join(names)}" if names else None


def run(options, page):
    """Runs a page's blocks. Returns how many there were, and what went wrong, if anything did."""
    text = page.read_text()
    blocks = list(BLOCK.finditer(text))
    if len(blocks) != len(MARK.findall(text)):
        return len(blocks), "a marked block is indented, or does not end"
    if not any(block["file"] is None for block in blocks):
        return 0, None
    with tempfile.TemporaryDirectory(prefix="maneuver-page.") as name:
        folder = pathlib.Path(name)
        work = folder / "work"
        work.mkdir()
        script = ""
        for block in blocks:
            if block["file"]:
                (work / block["file"]).write_text(block["text"])
            else:
                script += block["text"]
        process, address = server(options, folder)
        try:
            environment = dict(os.environ, MANEUVER_SERVER=address, HOME=name,
                               PATH=f"{options.bin}:{os.environ['PATH']}")
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", "set -v\n" + script], cwd=work, env=environment,
                                  stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  timeout=PATIENCE_S)
        except subprocess.TimeoutExpired as late:
            return len(blocks), f"took more than {PATIENCE_S} s:\n{(late.stdout or b'').decode()[-3000:]}"
        finally:
            process.terminate()
            process.wait()
        if done.returncode:
            return len(blocks), done.stdout.decode()[-3000:]
        return len(blocks), open_secrets(work)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="folder of maneuver and maneuverd")
    parser.add_argument("--small-model", type=pathlib.Path, required=True, help="write_small_model")
    parser.add_argument("pages", nargs="*", type=pathlib.Path, help="all that have such blocks, if none is named")
    options = parser.parse_args()
    options.bin = options.bin.resolve()
    options.small_model = options.small_model.resolve()
    failed = ran = 0
    for page in options.pages or [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]:
        began = time.monotonic()
        blocks, fault = run(options, page.resolve())
        if blocks:
            ran += 1
            print(f"{page.resolve().relative_to(REPOSITORY)}: {blocks} blocks, {time.monotonic() - began:.1f} s")
        if fault is not None:
            failed += 1
            print(fault)
    print(f"{ran} pages, {failed} failed")
    return 1 if failed or not ran else 0


if __name__ == "__main__":
    sys.exit(main())
