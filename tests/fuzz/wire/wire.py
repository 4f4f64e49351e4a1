#!/usr/bin/python3
"""Calls every method of a running maneuverd with messages that are valid in form and odd in content.

Messages grow by the contract itself: fields are set, cleared, repeated, and given the values that code forgets. A
part of the messages has bytes changed as well. Prints how many calls had which status. The exit status is 1 if the
server died, answered UNKNOWN, INTERNAL or UNIMPLEMENTED, gave an error of its own without a reason, answered a number
that is not finite, took longer than --longest for one call, grew by more than --memory, answered a known request
differently afterwards, or did not end when it was told to. Some calls are of a method that no server has, and are
UNIMPLEMENTED; no others are.

    tests/fuzz/wire/wire.py --maneuverd build/release/bin/maneuverd --small-model build/release/tests/write_small_model

Needs protoc, python3-grpcio and python3-protobuf, as Debian 12 has them.
"""

import argparse
import collections
import importlib
import math
import os
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time

import grpc
from google.protobuf import descriptor_pool, json_format, message_factory
from google.protobuf.descriptor import FieldDescriptor as Field
from google.protobuf.message import DecodeError

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent.parent
sys.path += [str(REPOSITORY / "tests" / "balancing"), str(REPOSITORY / "tests" / "clients")]
from predict import load_messages  # noqa: E402
from replicas import Replica  # noqa: E402

NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 1e8, 1.1e8, 1000.0, -1001.0, 1e11, 3.4e38, -3.4e38, 1.7e308, math.inf,
           -math.inf, math.nan)
INTEGERS = (0, 1, -1, 2, 7, 127, 128, 1000, 65536, 2**31 - 1, -2**31, 2**63 - 1, -2**63)
TEXTS = ("", "a", "models/small", "models/small/versions/1", "models/small@serving", "models/../x", "datasets/town",
         "jobs/1", "\0", "é" * 40, "x" * 200, "x" * 10_000, "%s%n", "../../etc/passwd", "lanes")
LIMITS = {Field.CPPTYPE_INT32: (-2**31, 2**31 - 1), Field.CPPTYPE_INT64: (-2**63, 2**63 - 1),
          Field.CPPTYPE_UINT32: (0, 2**32 - 1), Field.CPPTYPE_UINT64: (0, 2**64 - 1)}
# Says what gRPC itself says, without our reasons.
OF_GRPC = ("received initial metadata", "Received message larger", "Sent message larger")
DEPTH = 6
NO_METHOD = "/maneuver.v1.PredictionService/Guess"
SERVICES = ("model_service", "dataset_service", "outcome_service", "training_service", "tag_service", "replica_service",
            "admin_service")  # beside the predictions


def scalar(rng, field):
    kind = field.cpp_type
    if kind in LIMITS:
        low, high = LIMITS[kind]
        return max(low, min(high, rng.choice(INTEGERS)))
    if kind in (Field.CPPTYPE_DOUBLE, Field.CPPTYPE_FLOAT):
        value = rng.choice(NUMBERS)
        return math.copysign(math.inf, value) if kind == Field.CPPTYPE_FLOAT and 3.4e38 < abs(value) < math.inf else value
    if kind == Field.CPPTYPE_BOOL:
        return rng.random() < 0.5
    if kind == Field.CPPTYPE_ENUM:
        return rng.choice([value.number for value in field.enum_type.values] + [99])
    text = rng.choice(TEXTS)
    return text.encode() if field.type == Field.TYPE_BYTES else text


def is_map(field):
    return field.message_type is not None and field.message_type.GetOptions().map_entry


def mutate(rng, message, depth=0):
    """Changes one field of the message, or of one inside it."""
    fields = message.DESCRIPTOR.fields
    if not fields:
        return
    filled = [field for field, _ in message.ListFields() if field.message_type is not None and not is_map(field)]
    if filled and depth < DEPTH and rng.random() < 0.75:  # go on inside
        field = rng.choice(filled)
        inside = getattr(message, field.name)
        mutate(rng, rng.choice(inside) if field.label == Field.LABEL_REPEATED else inside, depth + 1)
        return
    field = rng.choice(fields)
    if rng.random() < 0.1:
        message.ClearField(field.name)
    elif is_map(field):
        return
    elif field.label == Field.LABEL_REPEATED:
        change_repeated(rng, message, field, depth)
    elif field.message_type is not None:
        inside = getattr(message, field.name)
        inside.SetInParent()
        if depth < DEPTH:
            mutate(rng, inside, depth + 1)
    else:
        setattr(message, field.name, scalar(rng, field))


def change_repeated(rng, message, field, depth):
    items = getattr(message, field.name)
    if items and rng.random() < 0.3:
        del items[rng.randrange(len(items))]
    elif field.message_type is None:
        items.extend(scalar(rng, field) for _ in range(rng.choice((1, 1, 1, 3, 300))))
    elif items and rng.random() < 0.5:
        items.add().CopyFrom(rng.choice(items))
    else:
        added = items.add()
        if depth < DEPTH:
            mutate(rng, added, depth + 1)


def damage(rng, data):
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data[:rng.randrange(len(data) + 1)] if rng.random() < 0.2 else data)


def not_finite(message, path=""):
    """Returns the path of the first number in a message that is not finite; None if there is none."""
    for field, value in message.ListFields():
        place = f"{path}.{field.name}" if path else field.name
        entries = value.items() if is_map(field) else \
            enumerate(value) if field.label == Field.LABEL_REPEATED else [(None, value)]
        for key, each in entries:
            if hasattr(each, "ListFields"):
                found = not_finite(each, place if key is None else f"{place}[{key}]")
                if found:
                    return found
            elif isinstance(each, float) and not math.isfinite(each):
                return f"{place} = {each}" if key is None else f"{place}[{key}] = {each}"
    return None


class Contract:
    """The methods of all services, and a first request of each."""

    def __init__(self, folder):
        self.prediction, self.status, _ = load_messages(folder)
        pool = descriptor_pool.Default()
        for name in SERVICES:
            importlib.import_module(f"maneuver.v1.{name}_pb2")
        make = getattr(message_factory, "GetMessageClass", None) or message_factory.MessageFactory(pool).GetPrototype
        self.scene = json_format.Parse((REPOSITORY / "tests" / "clients" / "request.json").read_text(),
                                       self.prediction.PredictRequest())
        self.methods = []
        self.answers = {}  # what each method answers
        for name in ("prediction_service", *SERVICES):
            for service in pool.FindFileByName(f"maneuver/v1/{name}.proto").services_by_name.values():
                for method in service.methods:
                    seed = make(method.input_type)()
                    self._fill(seed)
                    self.methods.append((f"/{service.full_name}/{method.name}", seed))
                    self.answers[self.methods[-1][0]] = make(method.output_type)
        self.methods.append((NO_METHOD, self.prediction.PredictRequest()))
        self.answers[NO_METHOD] = self.prediction.PredictResponse

    def _fill(self, seed):
        """What leads past the first checks: a scene, a model, a name."""
        names = seed.DESCRIPTOR.fields_by_name
        if "scenarios" in names:
            seed.scenarios.extend(self.scene.scenarios)
        if "outcomes" in names:
            for scene in self.scene.scenarios:
                outcome = seed.outcomes.add(scenario=scene)
                target = outcome.targets.add(target_id=scene.target_ids[0])
                last = next(agent for agent in scene.agents if agent.id == target.target_id).states[-1]
                for step in range(1, 120):
                    target.states.add(time=scene.prediction_time + 0.1 * step, x=last.x, y=last.y)
        if "request" in names and names["request"].message_type.name == "PredictRequest":
            seed.request.CopyFrom(self.scene)
        for field, value in (("model", "models/small"), ("name", "models/small/versions/1"), ("parent", "models/small")):
            if field in names and names[field].cpp_type == Field.CPPTYPE_STRING:
                setattr(seed, field, value)

    def reason(self, error):
        details = dict(error.trailing_metadata() or ()).get("grpc-status-details-bin")
        if not details:
            return ""
        for any_message in self.status.Status.FromString(details).details:
            if any_message.type_url.endswith("ErrorInfo"):
                info = self.status.ErrorInfo()
                info.ParseFromString(any_message.value)
                return info.reason
        return ""


def resident_mb(process):
    for line in open(f"/proc/{process.pid}/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return math.inf


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", required=True)
    parser.add_argument("--small-model", required=True, help="tests/small_model's program")
    parser.add_argument("--calls", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=5.0, help="seconds for one call")
    parser.add_argument("--memory", type=float, default=300.0, help="MB")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    counts = collections.Counter()
    broken = []
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        subprocess.run([options.small_model, work / "model"], check=True)
        contract = Contract(folder)
        os.environ["MANEUVERD_SERVE"] = "small/1"
        replica = Replica(work, "fuzzed", options.maneuverd, work / "model", 0)
        try:
            replica.wait_until_ready()
            with grpc.insecure_channel(replica.address) as channel:
                known = lambda: channel.unary_unary("/maneuver.v1.PredictionService/Predict")(  # noqa: E731
                    contract.scene.SerializeToString(), timeout=20)
                expected, before = known(), resident_mb(replica.process)
                for number in range(options.calls):
                    method, seed = rng.choice(contract.methods)
                    requests = []
                    for _ in range(rng.choice((1, 1, 1, 2, 4))):
                        request = type(seed)()
                        request.CopyFrom(seed)
                        for _ in range(rng.randrange(6)):
                            mutate(rng, request)
                        data = request.SerializePartialToString()
                        requests.append(damage(rng, data) if rng.random() < 0.15 else data)
                    call = channel.stream_stream(method)
                    begun, name, about = time.monotonic(), "OK", f"call {number}, {method}"
                    try:
                        for data in call(iter(requests), timeout=options.longest + 5):
                            number_at = not_finite(contract.answers[method].FromString(data))
                            if number_at:
                                broken.append(f"{about}: {number_at}")
                            if time.monotonic() - begun > 1:  # a watch of a job that never ends
                                break
                    except DecodeError as error:
                        broken.append(f"{about}: an answer cannot be parsed: {error}")
                    except grpc.RpcError as error:
                        name = error.code().name
                        said = error.details() or ""
                        about += f": {name} {said[:200]}"
                        if name == "UNKNOWN" or replica.process.poll() is not None:
                            broken.append(about)
                        elif not contract.reason(error) and name != "UNIMPLEMENTED" and \
                                not said.startswith(OF_GRPC) and name != "DEADLINE_EXCEEDED":
                            broken.append(f"{about}: no reason")
                        elif name == "INTERNAL":
                            broken.append(about)
                    counts[name] += 1
                    if (name == "UNIMPLEMENTED") != (method == NO_METHOD):
                        broken.append(f"{about}: UNIMPLEMENTED is for a method that no server has, and for no other")
                    took = time.monotonic() - begun
                    if took > options.longest:
                        broken.append(f"call {number}, {method}: took {took:.1f} s")
                    if replica.process.poll() is not None:
                        broken.append(f"the server ended with {replica.process.returncode} at call {number}, {method}")
                        break
                else:
                    # Names, aliases and log levels may have changed; the version is still there.
                    contract.scene.model = "models/small/versions/1"
                    if contract.prediction.PredictResponse.FromString(known()).predictions != \
                            contract.prediction.PredictResponse.FromString(expected).predictions:
                        broken.append("a known request has another answer afterwards")
                    grown = resident_mb(replica.process) - before
                    if grown > options.memory:
                        broken.append(f"the server grew by {grown:.0f} MB")
                    print(f"{options.calls} calls over {len(contract.methods)} methods, +{grown:.0f} MB: " +
                          ", ".join(f"{name} {count}" for name, count in counts.most_common()))
        finally:
            if replica.process.poll() is None:
                replica.signal(signal.SIGTERM)
                if replica.wait_for_end() != 0:
                    broken.append("the server did not end well")
        if not counts["OK"]:
            broken.append("no call was answered with OK")
        if broken:
            print("\n".join(broken[:20]), file=sys.stderr)
            print(replica.log.read_text(errors="replace")[-2000:], file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
