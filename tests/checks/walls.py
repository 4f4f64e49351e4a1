#!/usr/bin/env python3
"""Checks the walls between folders: which may include which, and which libraries each may see.

Reads the includes of all C++ files outside tests/ as text. Fails if

- a folder includes one that is not below it in LAYERS;
- a library of LIBRARIES is included by a folder that the table does not name;
- files include each other in a circle. A header and the source of the same name count as one.

ARCHITECTURE.md explains the tables. A new folder needs a line in LAYERS.
"""

import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Folder: the folders that it may include, beside itself and what is below it. The longest name
# that fits a file counts. "maneuver/v1" stands for the messages that are generated from proto/.
MODEL_CORE = ["locks", "model/machine", "model/files", "model/kernels", "model/probability",
              "maneuver/v1"]
LAYERS = {
    "locks": [],
    "model/machine": ["locks"],
    "model/kernels": [],
    "model/probability": [],
    "model/files": ["locks", "model/machine", "model/kernels"],
    "model/scene": MODEL_CORE,
    "model/artifact": [*MODEL_CORE, "model/scene"],
    "model/inference": [*MODEL_CORE, "model/scene", "model/artifact"],
    "model/data": [*MODEL_CORE, "model/scene", "model/artifact"],
    "model/evaluation": [*MODEL_CORE, "model/scene", "model/artifact", "model/inference",
                         "model/data"],
    "model/tags": [*MODEL_CORE, "model/scene", "model/artifact", "model/inference", "model/data",
                   "model/evaluation"],
    "model/onnx": [*MODEL_CORE, "model/scene", "model/artifact", "model/evaluation"],
    "model/learning": ["locks", "model", "maneuver/v1"],
    "server/errors": ["model/files", "model/scene", "maneuver/v1"],
    "server": ["locks", "model", "server", "maneuver/v1"],
    "client": ["locks", "client", "maneuver/v1"],
    # The command reads and writes datasets, and prints reports.
    "client/cli": ["locks", "model", "client", "maneuver/v1"],
    "client/load": ["locks", "model", "client", "maneuver/v1"],
    "client/plot": ["locks", "model", "client", "maneuver/v1"],
    "client/report": ["locks", "model", "client", "maneuver/v1"],
}
# What nobody may include although a line above allows it: folder, included folder.
NEVER = [
    ("client", "server"),
    ("client", "model/learning"),
    ("model", "server"),
    ("model", "client"),
    ("server/errors", "server/rpc"),
    ("server/security", "server/rpc"),
    ("server/monitoring", "server/rpc"),
    ("server/serving", "server/rpc"),
    ("server/serving", "server/jobs"),
    ("server/jobs", "server/rpc"),
    ("server/jobs", "server/store"),
    ("server/rpc", "server/store"),
    ("server/store", "server/rpc"),
    ("server/rpc", "server/maneuverd"),
]
# The server links no LibTorch: the process that learns does.
LEARNS = "server/jobs/trainer"

# Headers of a library (a regular expression of what follows #include <): who may include them.
LIBRARIES = {
    r"(ATen|torch|c10)/": ["model/learning"],
    r"grpc(pp)?/": ["server/rpc", "server/security", "server/maneuverd", "client"],
    r"prometheus/": ["server/monitoring"],
    r"sqlite3\.h": ["server/store"],
    r"libpq-fe\.h": ["server/store"],
    r"opencv2/": ["model/scene", "client/plot"],
    r"png\.h": ["client/plot"],
    r"(oneapi/)?dnnl": ["model/inference"],
    r"hwy/|immintrin": ["model/kernels"],
    r"pugixml": ["model/data"],
    r"spdlog/": ["server/monitoring"],
    r"CLI/": ["client/cli", "server/maneuverd", "server/jobs/trainer"],
}

# Libraries that everything may use, and whose headers are named in quotes.
QUOTED_LIBRARIES = ("absl/", "google/", "grpc/")
INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)', re.MULTILINE)


def is_within(path, folder):
    """Returns whether a file or a folder is `folder` or lies in it."""
    return path == folder or path.startswith(folder + "/")


def layer_of(path):
    """Returns the longest folder of LAYERS that contains a file, or None."""
    return max((folder for folder in LAYERS if is_within(path, folder)), key=len, default=None)


def includes_of_all():
    """Returns the project's and the libraries' includes of each file."""
    names = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard",
                            "*.cc", "*.h"], cwd=ROOT, check=True, text=True,
                           stdout=subprocess.PIPE).stdout.split()
    includes = {}
    for name in names:
        if name.startswith(("tests/", "examples/")) or not (ROOT / name).exists():
            continue
        found = INCLUDE.findall((ROOT / name).read_text())
        own = [header for header, _ in found if header and not header.startswith(QUOTED_LIBRARIES)]
        includes[name] = (own, [header for _, header in found if header])
    return includes


def wrong_layer(name, own):
    """Returns why a file may not include another of the project, or nothing."""
    layer = layer_of(name)
    if layer is None:
        return "the folder has no line in LAYERS of tests/checks/walls.py"
    if "/" not in own:
        return None  # generated beside a .proto of the same folder
    if own.startswith("maneuver/v1/"):
        allowed = "maneuver/v1" in LAYERS[layer]
    else:
        allowed = any(is_within(own, folder) for folder in [layer, *LAYERS[layer]])
    if not allowed:
        return f"{layer}/ may not include it"
    for folder, never in NEVER:
        if is_within(name, folder) and is_within(own, never):
            return f"{folder}/ may not include {never}/"
    if is_within(own, "model/learning") and not is_within(name, "model/learning"):
        if not is_within(name, LEARNS):
            return f"only {LEARNS}/ may include model/learning/"
    return None


def circles(includes):
    """Returns groups of files that include each other in a circle (Tarjan's components)."""
    edges = {}
    for name, (own, _) in includes.items():
        unit = re.sub(r"\.(cc|h)$", "", name)
        edges.setdefault(unit, set()).update(
            target for target in (re.sub(r"\.h$", "", header) for header in own)
            if target != unit)
    found, order, low, stack = [], {}, {}, []

    def visit(unit):
        order[unit] = low[unit] = len(order)
        stack.append(unit)
        for target in sorted(edges.get(unit, ())):
            if target not in edges:
                continue
            if target not in order:
                visit(target)
                low[unit] = min(low[unit], low[target])
            elif target in stack:
                low[unit] = min(low[unit], order[target])
        if low[unit] == order[unit]:
            at = stack.index(unit)
            group = stack[at:]
            del stack[at:]
            if len(group) > 1:
                found.append(sorted(group))

    for unit in sorted(edges):
        if unit not in order:
            visit(unit)
    return found


def main():
    sys.setrecursionlimit(10_000)
    includes = includes_of_all()
    failures = []
    for name, (own_headers, other_headers) in sorted(includes.items()):
        for own in own_headers:
            reason = wrong_layer(name, own)
            if reason:
                failures.append(f'{name}: #include "{own}": {reason}')
        for header in other_headers:
            for pattern, folders in LIBRARIES.items():
                if re.match(pattern, header) and not any(is_within(name, f) for f in folders):
                    failures.append(f"{name}: #include <{header}>: only "
                                    f"{', '.join(f + '/' for f in folders)} may include it")
    failures += ["a circle of includes: " + ", ".join(group) for group in circles(includes)]
    if failures:
        sys.exit("\n".join(["walls: " + failure for failure in failures]))
    print(f"walls: the includes of {len(includes)} files keep to the layers, without a circle")


if __name__ == "__main__":
    main()
