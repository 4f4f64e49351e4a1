#!/usr/bin/python3
"""Calls of an earlier release, byte by byte as they went over the wire, stand for its programs where these are not built.

    recorded_calls.py record --programs FOLDER --release 2026-11     # by hand, with a build of the release
    recorded_calls.py check                                          # ctest integration.compatibility

`record` starts the server of an earlier build on the data folder in tests/compatibility/RELEASE, runs COMMANDS by the
command of that build, and writes to RELEASE/calls.json what went over the wire and what was printed. There is no release
yet: 2026-11 is of commit 8306a461. docs/reports/compatibility.md says which methods are not recorded.

`check` holds this build against each recording:

- Old clients, this server, an old data folder: sends the recorded requests to this server. All that the old server
  answered has to be in the new answer. More may be there: old clients pass over fields that they do not know.
- This command, the old server: a server that knows only the recorded calls answers this build's command with the
  recorded bytes, or with UNIMPLEMENTED where the old server had no such method. All that the old command said has to be
  in the new request, and all that it printed as JSON in what the new one prints.
"""

import argparse
import base64
import collections.abc
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent import futures

import grpc
from google.protobuf import message_factory, symbol_database

from maneuver import v1
from two_builds import PATIENCE_S, Server

HERE = pathlib.Path(__file__).resolve().parent
BUILD = HERE.parent.parent / "build" / "release"
# Of numbers: processors with other vectors add in another order. The recordings are of one with bf16; others answer in f32.
HAS_BF16 = re.search(r"^flags.*\bavx512_bf16\b", pathlib.Path("/proc/cpuinfo").read_text(), re.MULTILINE) is not None
TOLERANCE = 1e-5 if HAS_BF16 else 1e-2
VARYING = ("google.protobuf.Timestamp", "google.protobuf.Duration")
MADE_UP = re.compile(r"[0-9a-f]{8}[0-9a-f-]{8,}")  # by a client, for a request
DETAILS = "grpc-status-details-bin"

STATES = [{"time": 0.1 * i, "x": 100.0 + 0.9 * i, "y": 50.0, "velocity_x": 9.0} for i in range(60)]
SCENE = {"scenario_id": "recorded", "prediction_time": 1.0, "target_ids": ["7"], "agents": [
    {"id": "7", "type": "AGENT_TYPE_VEHICLE", "length": 4.5, "width": 1.9, "states": STATES[:11]},
    {"id": "8", "type": "AGENT_TYPE_PEDESTRIAN", "length": 0.6, "width": 0.6, "states": [{"time": 1.0, "x": 112, "y": 58}]}],
    "map_features": [{"id": "1", "type": "MAP_FEATURE_TYPE_LANE_CENTERLINE", "x": [90, 130], "y": [50, 50]}]}
DRIVEN = {**SCENE, "agents": [{**SCENE["agents"][0], "states": STATES}]}

# What a user does from day to day. {NAME} is a file or folder.
COMMANDS = """health
health maneuver.v1.PredictionService
model list
model show town/1
model actions town
model pull town/1 {pulled}
model push {pulled} again
model delete again/1
model delete again/1
predict {scene} --model town --min-probability 0
predict {scene} --model nothing
probability {scene} --model town
distribution {scene} --model town --top-k 2
classify {driven} --model town
model promote town/1 --alias candidate
model label town/1 0 slow
model unalias town@candidate
dataset list
dataset show seed
scenario list datasets/seed
dataset upload {seed} uploaded
dataset delete uploaded
train learned --dataset nothing --detach
job list
log-level""".splitlines()


class Work:
    """A folder with a copy of the release's data, and the files that COMMANDS name."""

    def __init__(self, folder, release):
        self.folder = folder
        self.data = folder / "data"
        shutil.copytree(HERE / release, self.data, ignore=shutil.ignore_patterns("*.bin", "calls.json"))
        self.files = {"pulled": folder / "pulled", "seed": folder / "seed", "scene": folder / "scene.json",
                      "driven": folder / "driven.json"}
        shutil.copytree(self.data / "datasets" / "seed", self.files["seed"])
        self.files["scene"].write_text(json.dumps(SCENE))
        self.files["driven"].write_text(json.dumps(DRIVEN))

    def run(self, programs, address, line):
        done = subprocess.run([programs / "maneuver", "--server", address, "--output", "json", *line.format(**self.files).split()],
                              capture_output=True, text=True, timeout=PATIENCE_S)
        return {"status": done.returncode, "printed": done.stdout.replace(str(self.folder), "WORK")}


class Listener(grpc.GenericRpcHandler):
    """A server of every method: each call goes to `answer(method, requests, context)`, which yields bytes."""

    def __init__(self, answer):
        self._answer = answer
        self._server = grpc.server(futures.ThreadPoolExecutor(8))
        self._server.add_generic_rpc_handlers((self,))
        self.address = f"127.0.0.1:{self._server.add_insecure_port('127.0.0.1:0')}"
        self._server.start()

    def service(self, details):
        return grpc.stream_stream_rpc_method_handler(lambda requests, context: self._answer(details.method, requests, context))

    def stop(self):
        self._server.stop(0).wait()


def status_of(error):
    trailers = {name: value for name, value in error.trailing_metadata() or () if name == DETAILS}
    return {"code": error.code().value[0], "message": error.details(), "details": text_of(trailers.get(DETAILS, b""))}


def end(context, status):
    if status["code"]:
        context.set_trailing_metadata([(DETAILS, base64.b64decode(status["details"]))] if status["details"] else [])
        context.set_code(next(code for code in grpc.StatusCode if code.value[0] == status["code"]))
        context.set_details(status["message"])


def text_of(data):
    return base64.b64encode(data).decode()


def call_with(channel, method, requests):
    """Returns the answers and the status of a call of any kind."""
    answers = []
    try:
        for answer in channel.stream_stream(method)(iter(requests), timeout=PATIENCE_S):
            answers.append(answer)
    except grpc.RpcError as error:
        return answers, status_of(error)
    return answers, {"code": 0}


def wait_until_ready(channel):
    give_up = time.monotonic() + PATIENCE_S
    service = b"maneuver.v1.PredictionService"
    ask = channel.unary_unary("/grpc.health.v1.Health/Check")
    while ask(b"\x0a" + bytes([len(service)]) + service, wait_for_ready=True, timeout=PATIENCE_S) != b"\x08\x01":
        if time.monotonic() > give_up:
            raise RuntimeError(f"no model serves within {PATIENCE_S} s")
        time.sleep(0.02)


def record(programs, release):
    calls = []

    def forward(method, requests, context):
        call = {"method": method, "requests": [], "answers": []}
        calls.append(call)

        def noted():
            for request in requests:
                call["requests"].append(text_of(request))
                yield request

        status = {"code": 0}
        try:
            for answer in channel.stream_stream(method)(noted(), timeout=PATIENCE_S):
                call["answers"].append(text_of(answer))
                yield answer
        except grpc.RpcError as error:
            status = status_of(error)
        call["status"] = status
        end(context, status)

    with tempfile.TemporaryDirectory(prefix="maneuver-record-") as folder:
        work = Work(pathlib.Path(folder), release)
        server = Server(programs, work.data)
        channel = grpc.insecure_channel(server.address)
        wait_until_ready(channel)
        proxy = Listener(forward)
        recorded = []
        for line in COMMANDS:
            calls.clear()
            recorded.append({"command": line, **work.run(programs, proxy.address, line), "calls": list(calls)})
            print(f"{line}: status {recorded[-1]['status']}, {len(calls)} calls")
        proxy.stop()
        server.stop()
    (HERE / release / "calls.json").write_text(json.dumps(recorded, indent=1) + "\n")


def types_of(method):
    """The request and answer of a method of the contract; None for others, such as those of health."""
    _, service, name = method.split("/")
    try:
        described = symbol_database.Default().pool.FindServiceByName(service).FindMethodByName(name)
    except KeyError:
        return None, None
    factory = message_factory.MessageFactory(symbol_database.Default().pool)
    return factory.GetPrototype(described.input_type), factory.GetPrototype(described.output_type)


def lacks(old, new, where):
    """What of `old` is not in `new`: messages, or values as JSON has them."""
    if hasattr(old, "ListFields"):
        if old.DESCRIPTOR.full_name in VARYING:
            return []
        return [each for field, value in old.ListFields()
                for each in lacks(value, getattr(new, field.name), f"{where}.{field.name}")]
    if isinstance(old, float) or isinstance(new, float):
        return [] if math.isclose(old, new, rel_tol=TOLERANCE, abs_tol=TOLERANCE) else [f"{where} was {old} and is {new}"]
    if isinstance(old, collections.abc.Mapping):
        if not isinstance(new, collections.abc.Mapping):
            return [f"{where} was an object and is {new!r}"]
        return [each for name, value in old.items() if not re.search("_time$|Time$", str(name))
                for each in (lacks(value, new[name], f"{where}.{name}") if name in new else [f"{where}.{name} is gone"])]
    if not isinstance(old, (str, bytes)) and hasattr(old, "__len__"):
        if len(old) != len(new):
            return [f"{where} had {len(old)} elements and has {len(new)}"]
        return [each for i, (a, b) in enumerate(zip(old, new)) for each in lacks(a, b, f"{where}[{i}]")]
    if old == new or (isinstance(old, str) and isinstance(new, str) and MADE_UP.fullmatch(old) and MADE_UP.fullmatch(new)):
        return []
    return [f"{where} was {old!r} and is {new!r}"]


def lacks_message(kind, old, new, where):
    if kind is None:
        return [] if old == new else [f"{where} was {old!r} and is {new!r}"]
    return lacks(kind.FromString(old), kind.FromString(new), where)


def reasons(status):
    """Code and reasons of an error; its words may change."""
    details = v1.Status.FromString(base64.b64decode(status.get("details", "")))
    found = []
    for detail in details.details:
        if detail.type_url.endswith("ErrorInfo"):
            info = v1.ErrorInfo.FromString(detail.value)
            found.append(info.reason)
    return status["code"], found


def check_server(programs, release, recorded):
    """The requests of the old command get from this server what they got from the old one, or more."""
    found = []
    with tempfile.TemporaryDirectory(prefix="maneuver-compatibility-") as folder:
        server = Server(programs, Work(pathlib.Path(folder), release).data)
        with grpc.insecure_channel(server.address) as channel:
            wait_until_ready(channel)
            for step in recorded:
                for call in step["calls"]:
                    where = f"old client, {step['command']}: {call['method']}"
                    requests = [base64.b64decode(request) for request in call["requests"]]
                    answers, status = call_with(channel, call["method"], requests)
                    if reasons(status) != reasons(call["status"]):
                        found.append(f"{where} ended with {reasons(call['status'])} and ends with {reasons(status)}")
                    if len(answers) != len(call["answers"]):
                        found.append(f"{where} had {len(call['answers'])} answers and has {len(answers)}")
                    for old, new in zip(call["answers"], answers):
                        found += lacks_message(types_of(call["method"])[1], base64.b64decode(old), new, where)
        server.stop()
    return found


def check_command(programs, release, recorded):
    """This command says to the old server what the old one said, and prints what it printed, or more."""
    found, left = [], []
    known = {call["method"] for step in recorded for call in step["calls"]}

    def replay(method, requests, context):
        call = next((each for each in left if each["method"] == method), None)
        if call is None:
            # A server of the release has some methods that no command called. None of them may be needed.
            if method in known:
                found.append(f"{where}: {method} is called once more than by the old command")
            end(context, {"code": grpc.StatusCode.UNIMPLEMENTED.value[0], "message": "", "details": ""})
            return
        left.remove(call)
        sent = list(requests)
        if len(sent) != len(call["requests"]):
            found.append(f"{where}: {method} had {len(call['requests'])} requests and has {len(sent)}")
        for old, new in zip(call["requests"], sent):
            found.extend(lacks_message(types_of(method)[0], base64.b64decode(old), new, f"{where}: {method}"))
        for answer in call["answers"]:
            yield base64.b64decode(answer)
        end(context, call["status"])

    with tempfile.TemporaryDirectory(prefix="maneuver-compatibility-") as folder:
        work = Work(pathlib.Path(folder), release)
        listener = Listener(replay)
        for step in recorded:
            where = f"old server, {step['command']}"
            left[:] = step["calls"]
            done = work.run(programs, listener.address, step["command"])
            found += [f"{where}: {call['method']} is not called any more" for call in left]
            if done["status"] != step["status"]:
                found.append(f"{where} ended with {step['status']} and ends with {done['status']}: {done['printed']}")
            elif step["printed"].startswith(("{", "[")):
                found += lacks(json.loads(step["printed"]), json.loads(done["printed"]), where)
        listener.stop()
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("--programs", type=pathlib.Path, default=BUILD / "bin", help="folder of maneuverd and maneuver")
    parser.add_argument("--release", help="folder of tests/compatibility; check takes all without it")
    options = parser.parse_args()
    if options.what == "record":
        record(options.programs.resolve(), options.release)
        return 0
    releases = [options.release] if options.release else sorted(file.parent.name for file in HERE.glob("*/calls.json"))
    found = []
    for release in releases:
        recorded = json.loads((HERE / release / "calls.json").read_text())
        found += check_server(options.programs.resolve(), release, recorded)
        found += check_command(options.programs.resolve(), release, recorded)
        print(f"{release}: {sum(len(step['calls']) for step in recorded)} calls of {len(recorded)} commands")
    for each in found:
        print("FAILED:", each, file=sys.stderr)
    return 1 if found or not releases else 0


if __name__ == "__main__":
    sys.exit(main())
