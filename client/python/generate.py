#!/usr/bin/python3
"""Generates the package maneuver.v1 from the contract: messages, service stubs and type hints.

    generate.py PROTOS OUTPUT

PROTOS is the folder that holds maneuver/v1/*.proto. OUTPUT/maneuver/v1 is written. Needs protoc,
grpc_python_plugin and protoc-gen-mypy (Debian: protobuf-compiler, protobuf-compiler-grpc,
mypy-protobuf).
"""

import pathlib
import re
import shutil
import subprocess
import sys


def _program(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        raise SystemExit(f"generate.py: {name} is not installed")
    return found


def generate(protos: pathlib.Path, output: pathlib.Path) -> None:
    """Writes OUTPUT/maneuver/v1, whose __init__ names every message and enum of the contract."""
    files = sorted((protos / "maneuver" / "v1").glob("*.proto"))
    if not files:
        raise SystemExit(f"generate.py: there is no maneuver/v1/*.proto in {protos}")
    output.mkdir(parents=True, exist_ok=True)
    protoc = [_program("protoc"), f"--proto_path={protos}"]
    mypy = f"--plugin=protoc-gen-mypy={_program('protoc-gen-mypy')}"
    subprocess.run(
        [*protoc, f"--python_out={output}", mypy, f"--mypy_out=quiet:{output}", *map(str, files)],
        check=True)
    services = [file for file in files if re.search(r"^service ", file.read_text(), re.MULTILINE)]
    subprocess.run(
        [*protoc, f"--plugin=protoc-gen-grpc={_program('grpc_python_plugin')}",
         f"--grpc_out={output}",
         f"--plugin=protoc-gen-mypy_grpc={_program('protoc-gen-mypy_grpc')}",
         f"--mypy_grpc_out=quiet:{output}", *map(str, services)],
        check=True)
    lines = ['"""The contract maneuver.v1: its messages and enums, made from the protos."""', ""]
    lines += [f"from maneuver.v1.{file.stem}_pb2 import *" for file in files]
    (output / "maneuver" / "v1" / "__init__.py").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit("usage: generate.py PROTOS OUTPUT")
    generate(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
