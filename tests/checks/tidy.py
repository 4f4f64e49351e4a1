#!/usr/bin/env python3
"""Runs clang-tidy, by .clang-tidy, on the sources that have changed, and reports changed lines.

Changed is what differs from the last landed commit (landed.sh), or from the commit that brought
this script if that is later. Lines of headers are checked with the changed sources that include
them. Takes the compile commands of a build whose protobuf headers have been generated. Begins with
what is shipped, the newest first, and says what it left out: what is beyond --sources or --minutes,
and what clang 14 does not compile, though GCC 12 does.
"""

import argparse
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

ROOT = pathlib.Path(__file__).resolve().parents[2]


def git_lines(*arguments):
    """Returns the lines that a git command prints."""
    return subprocess.run(["git", *arguments], cwd=ROOT, check=True, text=True,
                          stdout=subprocess.PIPE).stdout.splitlines()


def first_commit_to_check():
    """Returns the later of the last landed commit and the commit that brought this script.

    Sources that are older than this script are checked when they change. Returns None where git
    does not know.
    """
    landed = subprocess.run([ROOT / "tests/checks/landed.sh"], text=True, stdout=subprocess.PIPE)
    if landed.returncode != 0:
        return None
    brought = git_lines("log", "--diff-filter=A", "--format=%H",
                        f"{landed.stdout.strip()}..HEAD", "--", "tests/checks/tidy.py")
    return brought[0] if brought else landed.stdout.strip()


def changed_lines(commit):
    """Returns the line ranges that differ from `commit`, by file, those that changed last first."""
    untracked = git_lines("ls-files", "--others", "--exclude-standard")
    newest_first = dict.fromkeys(git_lines("diff", "--name-only", "HEAD") +
                                 git_lines("log", "--name-only", "--format=", f"{commit}..HEAD"))
    ranges = {file: [] for file in newest_first}
    # Sources alone: other files may be in any encoding.
    for line in git_lines("diff", "--unified=0", "--no-prefix", "--diff-filter=d", commit,
                          "--", "*.cc", "*.h"):
        if line.startswith("+++ "):
            file = line[4:]
        elif hunk := re.match(r"@@ \S+ \+(\d+)(?:,(\d+))? @@", line):
            # Where lines were only removed, it is the line before them that changed.
            first, count = max(int(hunk[1]), 1), max(int(hunk[2] or 1), 1)
            ranges.setdefault(file, []).append([first, first + count - 1])
    ranges.update({file: [[1, 1000000]] for file in untracked})
    return {file: lines for file, lines in ranges.items()
            if lines and file.endswith((".cc", ".h"))}


def changed_sources(lines):
    """Returns the sources among changed files: tests come last, of the others the newest first."""
    return sorted((file for file in lines if file.endswith(".cc")),
                  key=lambda file: file.startswith("tests/"))


def commands_by_source(build):
    """Returns the compile command of each source, as a list, also of those that a unity build joins."""
    commands = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        command, unit = entry["command"], pathlib.Path(entry["file"])
        sources = [unit]
        if unit.name.startswith("unity_"):
            sources = map(pathlib.Path, re.findall(r'#include "(.*)"', unit.read_text()))
        for source in sources:
            own = command.replace(f"-c {unit}", f"-c {source}")
            commands.setdefault(source, {"directory": entry["directory"], "file": str(source),
                                         "arguments": shlex.split(own)})
    return commands


class Tidy:
    """clang-tidy over a list of files, with a limit on the time of all."""

    def __init__(self, database, lines, seconds):
        # Names of files are matched by their ends.
        self.options = ["-p", database, "--quiet", "--extra-arg=-Wno-unknown-warning-option"]
        if lines:
            line_filter = [{"name": f"/{file}", "lines": ranges} for file, ranges in lines.items()]
            self.options.append("--line-filter=" + json.dumps(line_filter))
        self.end = time.monotonic() + seconds
        self.checked, self.failed, self.left_out = [], [], []

    def check(self, file):
        left = self.end - time.monotonic()
        try:
            result = subprocess.run(["clang-tidy", *self.options, ROOT / file], cwd=ROOT, text=True,
                                    timeout=max(left, 0.01), stdout=subprocess.PIPE,
                                    stderr=subprocess.PIPE)
        except subprocess.TimeoutExpired:
            self.left_out.append(f"{file}: no time was left")
            return
        error = re.search(r"error: (.*) \[clang-diagnostic-error\]", result.stdout)
        if error:
            self.left_out.append(f"{file}: clang does not compile it: {error[1]}")
            return
        self.checked.append(file)
        if result.returncode != 0:
            self.failed.append(file)
            print(result.stdout or result.stderr, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="check these instead of those that changed")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build" / "release")
    parser.add_argument("--sources", type=int, help="check no more than these")
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()

    if shutil.which("clang-tidy") is None:
        sys.exit("tidy: there is no clang-tidy; run deploy/install-deps.sh --tests")
    if not (options.build / "compile_commands.json").exists():
        sys.exit("tidy: the build is not configured; run cmake --preset release")
    files = [str(pathlib.Path(file).resolve().relative_to(ROOT)) for file in options.files]
    lines = {}
    since = ""
    if not files:
        commit = first_commit_to_check()
        if commit is None:
            print("tidy: SKIPPED: git does not know what has changed")
            return
        since = f" that changed since {commit[:12]}"
        lines = changed_lines(commit)
        files = changed_sources(lines)

    commands = commands_by_source(options.build)
    database = ROOT / "build" / "checks"
    database.mkdir(parents=True, exist_ok=True)
    (database / "compile_commands.json").write_text(json.dumps(list(commands.values())))

    tidy = Tidy(database, lines, options.minutes * 60)
    compiled = [file for file in files if ROOT / file in commands]
    tidy.left_out += [f"{file}: the build does not compile it" for file in files
                      if file not in compiled]
    if options.sources is not None and options.sources < len(compiled):
        tidy.left_out.append(f"{len(compiled) - options.sources} sources beyond the first "
                             f"{options.sources}")
        compiled = compiled[:options.sources]
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(tidy.check, compiled))

    for line in tidy.left_out:
        print(f"tidy: left out {line}")
    print(f"tidy: checked {len(tidy.checked)} of {len(files)} sources{since}")
    if tidy.failed:
        sys.exit(f"tidy: {len(tidy.failed)} need repair: " + " ".join(sorted(tidy.failed)))


if __name__ == "__main__":
    main()
