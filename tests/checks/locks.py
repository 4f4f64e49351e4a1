#!/usr/bin/env python3
"""Checks that state which a mutex guards is used under that mutex alone.

Compiles with clang, without making code, every header and source of server/, client/ and model/
that uses locks/mutex.h: itself, by a header of its own folder, or by a header with templates, which
clang checks where they are used. The files of a folder are one unit, so that clang reads once what
they all include. A warning fails the check. So does a mutex of the standard library, which clang
knows nothing of.

Takes the compile commands of a build whose protobuf headers have been generated. clang 14 does not
compile LibTorch's headers: keep guarded state out of sources that include them.
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import tidy  # noqa: E402

ROOT = tidy.ROOT
FOLDERS = ("server", "client", "model")
# Not -w, which would silence these as well.
WARNINGS = ["-Wno-everything", "-Wthread-safety", "-Wthread-safety-beta", "-Werror"]
# Options of GCC that clang 14 does not know.
GCC_ONLY = {"-fcf-protection=full"}
UNCHECKED = re.compile(r"std::(\w*_)?(mutex|lock_guard|unique_lock|shared_lock|scoped_lock|"
                       r"condition_variable(_any)?)\b|absl::(Mutex|CondVar)\b")


def files_of(pattern):
    """Returns the files of the checked folders that match a pattern, in order."""
    return sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob(pattern))


def unchecked_locks():
    """Returns where a mutex is used that clang does not check."""
    return [f"{file.relative_to(ROOT)}:{number}: use locks/mutex.h: {line.strip()}"
            for pattern in ("*.h", "*.cc") for file in files_of(pattern)
            for number, line in enumerate(file.read_text().splitlines(), 1)
            if UNCHECKED.search(line)]


def guarding_headers():
    """Returns the headers that use locks/mutex.h, and whether each has templates."""
    headers = {}
    for header in files_of("*.h"):
        text = header.read_text()
        if '#include "locks/mutex.h"' in text:
            headers[header.relative_to(ROOT)] = "\ntemplate <" in text
    return headers


def files_to_check(commands):
    """Returns the headers and sources to compile, by folder; with each folder a compile command."""
    headers = guarding_headers()
    by_folder = {}
    for source in sorted(commands):
        if not source.is_relative_to(ROOT) or source.relative_to(ROOT).parts[0] not in FOLDERS:
            continue
        folder = source.relative_to(ROOT).parent
        included = re.findall(r'^#include "(.*)"', source.read_text(), re.MULTILINE)
        if "locks/mutex.h" in included or any(
                has_templates or header.parent == folder
                for header, has_templates in headers.items() if str(header) in included):
            files, _ = by_folder.setdefault(folder, ([], commands[source]))
            files.append(source)
    for header in headers:
        if header.parent in by_folder:
            by_folder[header.parent][0].append(ROOT / header)
    return by_folder


def check(folder, files, command, units):
    """Returns what clang says of the files of a folder, nothing if all is well."""
    unit = units / (str(folder).replace("/", "_") + ".cc")
    unit.write_text("".join(f'#include "{file}"\n' for file in files))
    arguments = [a for a in command["arguments"][1:] if a not in GCC_ONLY and not a.startswith("-W")]
    output = arguments.index("-o")
    del arguments[output:output + 2]
    arguments[arguments.index("-c"):] = ["-fsyntax-only", *WARNINGS, str(unit)]
    result = subprocess.run(["clang++", *arguments], cwd=command["directory"], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return "" if result.returncode == 0 else f"{folder}:\n{result.stdout}"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", help="compile these folders alone: server/rpc ...")
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build" / "release")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if shutil.which("clang++") is None:
        sys.exit("locks: there is no clang++; run deploy/install-deps.sh --tests")
    if not (options.build / "compile_commands.json").exists():
        sys.exit("locks: the build is not configured; run cmake --preset release")

    start = time.monotonic()
    units = ROOT / "build" / "checks" / "locks"
    units.mkdir(parents=True, exist_ok=True)
    by_folder = {str(folder): checked
                 for folder, checked in files_to_check(tidy.commands_by_source(options.build)).items()
                 if not options.folders or str(folder) in options.folders}
    found = unchecked_locks()
    with ThreadPoolExecutor(options.jobs) as pool:
        found += filter(None, pool.map(lambda folder: check(folder, *by_folder[folder], units),
                                       by_folder))
    for each in found:
        print(each)
    count = sum(len(files) for files, _ in by_folder.values())
    print(f"locks: clang checked {count} files in {len(by_folder)} folders, "
          f"{time.monotonic() - start:.0f} s")
    if found:
        sys.exit(f"locks: {len(found)} need repair")


if __name__ == "__main__":
    main()
