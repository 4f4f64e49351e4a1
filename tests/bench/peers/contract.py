"""The API's messages, compiled from proto/ when this module is loaded."""

import importlib
import pathlib
import subprocess
import sys
import tempfile

PROTO = pathlib.Path(__file__).resolve().parents[3] / "proto"


def _load():
    with tempfile.TemporaryDirectory() as folder:
        protos = sorted(str(p) for p in (PROTO / "maneuver" / "v1").glob("*.proto"))
        subprocess.run(
            ["protoc", f"--proto_path={PROTO}", f"--python_out={folder}", *protos], check=True
        )
        sys.path.insert(0, folder)
        return (
            importlib.import_module("maneuver.v1.prediction_service_pb2"),
            importlib.import_module("maneuver.v1.scenario_pb2"),
        )


prediction, scenario = _load()
