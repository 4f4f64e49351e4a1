#!/usr/bin/env python3
"""Checks that each source that has changed compiles by itself.

A unity build hides a missing include. So this compiles each source by itself, without making code,
with the compile commands of the build.
Changed is what tidy.py takes for changed, in its order. Says what it left out: what is beyond
--sources or --minutes.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import tidy  # noqa: E402


def without_code(command):
    """Returns the arguments that compile a source and make no object of it."""
    arguments = list(command["arguments"])
    output = arguments.index("-o")
    del arguments[output:output + 2]
    return arguments + ["-fsyntax-only"]


def compile_error(command, end):
    """Returns what the compiler says, nothing if all is well, or None if no time is left."""
    left = end - time.monotonic()
    if left <= 0:
        return None
    try:
        result = subprocess.run(without_code(command), cwd=command["directory"], text=True,
                                timeout=left, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    except subprocess.TimeoutExpired:
        return None
    return "" if result.returncode == 0 else result.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="compile these files instead of the changed ones")
    parser.add_argument("--build", type=pathlib.Path, default=tidy.ROOT / "build" / "release")
    parser.add_argument("--sources", type=int, help="compile no more than these")
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if not (options.build / "compile_commands.json").exists():
        sys.exit("alone: the build is not configured; run cmake --preset release")

    files = [str(pathlib.Path(file).resolve().relative_to(tidy.ROOT)) for file in options.files]
    if not files:
        commit = tidy.first_commit_to_check()
        if commit is None:
            print("alone: SKIPPED: git does not know what has changed")
            return
        files = tidy.changed_sources(tidy.changed_lines(commit))
    commands = tidy.commands_by_source(options.build)
    files = [file for file in files if tidy.ROOT / file in commands]
    count = len(files)
    files = files[:options.sources]
    if len(files) < count:
        print(f"alone: left out {count - len(files)} sources beyond the first {options.sources}")

    end = time.monotonic() + options.minutes * 60
    with ThreadPoolExecutor(options.jobs) as pool:
        errors = dict(zip(files, pool.map(
            lambda file: compile_error(commands[tidy.ROOT / file], end), files)))
    for file, error in errors.items():
        if error is None:
            print(f"alone: left out {file}: no time was left")
        elif error:
            print(error)
    failed = [file for file, error in errors.items() if error]
    compiled = [file for file, error in errors.items() if error is not None]
    print(f"alone: compiled {len(compiled)} of {count} sources")
    if failed:
        sys.exit(f"alone: {len(failed)} do not compile alone: " + " ".join(failed))


if __name__ == "__main__":
    main()
