#!/usr/bin/python3
"""A server in a control group of 512 MB gets three times the load that fits, in bytes and in calls, and is never ended by
the system.

Bytes: callers keep answers and recordings unread, and send large scenes, maps and uploads again and again. Together they
hold or send three times the limit at any moment. Calls: `maneuver load` first measures how many calls a second the server answers,
then sends three times as many. A thousand watches stay open. The server must refuse what does not fit, and give a
reason. A planner with small requests must get answers before the load, some during it, and all after it.

Ends with status 77, and says so, where no control group can be made.
"""

import argparse
import collections
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

import grpc
import json

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
BUILD = REPOSITORY / "build" / "release"
import maneuver  # noqa: E402
from maneuver import v1  # noqa: E402

PATIENCE_S = 120
MB = 1 << 20
TIMES = 3  # what callers ask for, in limits and in what the server can answer
SKIPPED = 77
WATCHES = 1000
MOST_POINTS = 490_000  # of a map
PREDICT = "/maneuver.v1.PredictionService/Predict"
GET_SCENARIO = "/maneuver.v1.DatasetService/GetScenario"
# How a call may end. The server also cancels what is large and slow, and finds that an upload is damaged.
ENDS = {"OK", "RESOURCE_EXHAUSTED", "DEADLINE_EXCEEDED", "UNAVAILABLE", "CANCELLED"}
UPLOAD_ENDS = ENDS - {"OK"} | {"DATA_LOSS"}
# What is asked for at any moment, in limits: three together.
SHARES = {"hold": 0.5, "fetch": 0.5, "predict": 0.75, "register": 0.75, "upload": 0.5}


class ControlGroup:
    """A control group with a memory limit, of version 1 or 2; `folder` is None where it cannot be made or entered."""

    def __init__(self, limit):
        self.folder = None
        for parent, file in ((pathlib.Path("/sys/fs/cgroup/memory"), "memory.limit_in_bytes"),
                             (pathlib.Path("/sys/fs/cgroup"), "memory.max")):
            folder = parent / f"maneuver-memory-test-{os.getpid()}"
            try:
                folder.mkdir()
            except OSError:
                continue
            # In a folder that is no control group there is no such file, and it would be an ordinary one.
            if (folder / file).exists():
                try:
                    self.folder = folder
                    (folder / file).write_text(str(limit))
                    subprocess.run(["true"], preexec_fn=self.enter, check=True)
                    return
                except (OSError, subprocess.SubprocessError):
                    self.folder = None
            folder.rmdir()

    def enter(self):
        (self.folder / "cgroup.procs").write_text(str(os.getpid()))

    def kills(self):
        """How often the system ended a process of the group for its memory."""
        for name in ("memory.oom_control", "memory.events"):
            file = self.folder / name
            if file.exists():
                return int(re.search(r"^oom_kill (\d+)", file.read_text(), re.MULTILINE)[1])
        return 0

    def remove(self):
        self.folder.rmdir()


class Server:
    def __init__(self, options, work, group):
        self.work = work
        ports = work / "ports.json"
        self.log = work / "maneuverd.log"
        (work / "data" / "models" / "small").mkdir(parents=True)
        subprocess.run([options.small_model, work / "data" / "models" / "small" / "1"], check=True)
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                [options.maneuverd, "--data-dir", work / "data", "--listen", "127.0.0.1:0", "--metrics-listen",
                 "127.0.0.1:0", "--port-file", ports, "--serve", "small/1", "--memory-limit", f"{options.limit}MiB",
                 *options.flags], stdout=log, stderr=log, preexec_fn=group.enter)
        give_up = time.monotonic() + PATIENCE_S
        while not ports.exists():
            if self.process.poll() is not None or time.monotonic() > give_up:
                raise RuntimeError(self.log.read_text())
            time.sleep(0.05)
        addresses = json.loads(ports.read_text())
        self.address, self.metrics_address = addresses["grpc"], addresses["metrics"]

    def resident_mb(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"RssAnon:\s+(\d+)", status)[1]) / 1024

    def metric(self, name):
        with urllib.request.urlopen(f"http://{self.metrics_address}/metrics", timeout=PATIENCE_S) as page:
            return float(re.search(rf"^{name} (\S+)", page.read().decode(), re.MULTILINE)[1])


def vehicle(number, states=3):
    return v1.Agent(id=number, type=v1.AGENT_TYPE_VEHICLE, length=4.5, width=1.9, states=[
        v1.AgentState(time=0.1 * i, x=number % 1000 + 0.5 * i, velocity_x=5) for i in range(states)])


class Load:
    """Callers who ask for three times what fits, and for three times what can be answered."""

    def __init__(self, options, server):
        self.options = options
        self.server = server
        self.over = threading.Event()
        self.ends = collections.Counter()
        self.full = 0  # refusals with the reason MEMORY_FULL
        self.watched = 0  # watches that were open to the end
        self.called = None  # the figures of `maneuver load`
        self.lock = threading.Lock()
        # The largest messages that the server takes have a 32nd of the limit. They are joined from bytes: writing large
        # ones is slow in Python.
        self.size = options.limit * MB // 34
        scene = v1.Scenario(prediction_time=0.2, target_ids=range(1, 4), agents=[vehicle(i) for i in range(1, 101)])
        scenes = v1.PredictRequest(scenarios=[scene]).SerializeToString()
        self.large = v1.PredictRequest(model="models/small", query=v1.DistributionQuery(
            min_probability=0)).SerializeToString() + scenes * (self.size // len(scenes))
        points = [0.01 * i for i in range(min(self.size // 20, MOST_POINTS))]
        self.large_map = v1.RegisterMapRequest(map_features=[v1.MapFeature(
            id=1, type=v1.MAP_FEATURE_TYPE_LANE_CENTERLINE, x=points, y=points)]).SerializeToString()
        chunk = v1.UploadDatasetRequest(chunk=bytes(MB)).SerializeToString()
        self.chunks = [chunk] * (self.size // MB)
        # Short requests with long answers: none of these targets is there, and each says so.
        missing = v1.Scenario(prediction_time=0.2, target_ids=range(100, 1100), agents=[vehicle(1)])
        question = v1.PredictRequest(model="models/small", scenarios=[missing])
        with grpc.insecure_channel(server.address) as channel:
            answer = channel.unary_unary(PREDICT)(question.SerializeToString(), timeout=PATIENCE_S)
        item = v1.StreamPredictRequest(request=question).SerializeToString()
        self.asked = [item] * max(1, self.size // len(answer))
        # A recording of some minutes: a megabyte.
        town = server.work / "town"
        subprocess.run([options.maneuver, "synthesize", town, "--recordings", "1", "--duration", "120"], check=True,
                       stdout=subprocess.DEVNULL)
        with maneuver.Client(server.address) as client:
            client.upload_dataset(town, "datasets/town")
            recording = next(iter(client.list_scenarios("datasets/town"))).scenario_id
            self.recording = v1.GetScenarioRequest(parent="datasets/town", scenario_id=recording).SerializeToString()
            size = client.get_scenario("datasets/town", recording).ByteSize()
        self.recordings = max(1, self.size // size)
        shares = {options.only: TIMES} if options.only else SHARES
        self.callers = {kind: max(1, round(share * options.limit * MB / self.size)) for kind, share in shares.items()}

    def note(self, kind, error):
        with self.lock:
            if isinstance(error, grpc.RpcError):
                details = dict(error.trailing_metadata() or ()).get("grpc-status-details-bin", b"")
                self.full += b"MEMORY_FULL" in details.replace(b"SEND_MEMORY_FULL", b"")
                error = error.code().name
            self.ends[kind, error] += 1

    def hold(self, channel):
        """Asks for answers of `size` bytes, and reads none of them."""
        answers = channel.stream_stream("/maneuver.v1.PredictionService/StreamPredict",
                                        request_serializer=lambda message: message)(iter(self.asked))
        while answers.is_active() and not self.over.wait(0.05):
            pass
        if not answers.is_active():
            raise answers
        answers.cancel()

    def fetch(self, channel):
        """Asks for recordings of `size` bytes, and reads none of them."""
        # As a stream, since gRPC would read a single answer at once.
        get = channel.unary_stream(GET_SCENARIO)
        answers = [get(self.recording) for _ in range(self.recordings)]
        while all(answer.is_active() for answer in answers) and not self.over.wait(0.05):
            pass
        ended = [answer for answer in answers if not answer.is_active()]
        for answer in answers:
            answer.cancel()
        if ended:
            raise ended[0]

    def predict(self, channel):
        channel.unary_unary(PREDICT)(self.large, timeout=5)

    def register(self, channel):
        another = v1.RegisterMapRequest(map_features=[v1.MapFeature(
            id=2, type=v1.MAP_FEATURE_TYPE_LANE_CENTERLINE, x=[0, time.monotonic()], y=[0, 1])]).SerializeToString()
        channel.unary_unary("/maneuver.v1.PredictionService/RegisterMap")(self.large_map + another, timeout=5)

    def upload(self, channel):
        """A shard that is found to be damaged once it is there."""
        name = f"datasets/d{threading.get_ident()}"
        shard = v1.Shard(file="scenarios-00000.tfrecord", content=v1.SHARD_CONTENT_SCENARIOS, records=1, sha256="0" * 64,
                         size_bytes=len(self.chunks) * MB)
        header = v1.UploadDatasetRequest(header=v1.UploadHeader(name=name, dataset=v1.Dataset(
            format_version=1, shards=[shard], recordings=1)))
        channel.stream_unary("/maneuver.v1.DatasetService/UploadDataset", request_serializer=lambda message: message)(
            iter([header.SerializeToString(), *self.chunks]), timeout=5)

    def again_and_again(self, kind, call):
        while not self.over.is_set():
            # With its probes, gRPC takes megabytes that nobody reads.
            with grpc.insecure_channel(self.server.address, options=[("grpc.use_local_subchannel_pool", 1), (
                    "grpc.max_receive_message_length", -1), ("grpc.http2.bdp_probe", 0)]) as channel:
                while not self.over.is_set():
                    try:
                        call(channel)
                        self.note(kind, "OK")
                    except grpc.RpcError as error:
                        self.note(kind, error)
                        if error.code() == grpc.StatusCode.UNAVAILABLE:
                            break
                        self.over.wait(0.05)

    def watch(self):
        """Watches the health, over connections with a hundred watches each."""
        channels = [grpc.insecure_channel(self.server.address, options=[("grpc.use_local_subchannel_pool", 1)])
                    for _ in range(WATCHES // 100)]
        watches = [channel.unary_stream("/grpc.health.v1.Health/Watch")(b"") for channel in channels for _ in range(100)]
        self.over.wait()
        self.watched = sum(watch.is_active() for watch in watches)
        for channel in channels:
            channel.close()

    def calls(self, *arguments):
        """Runs `maneuver load`. Returns its figures; None if the server did not let it begin."""
        figures = self.server.work / "load.json"
        figures.unlink(missing_ok=True)
        status = subprocess.run([self.options.maneuver, "--server", self.server.address, "load", "--model", "small",
                                 "--warm-up", "0.2", "--deadline", "5000", "--json", figures, *arguments],
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
        if status not in (0, 1):  # 1: calls failed
            raise RuntimeError(f"maneuver load ended with {status}")
        return json.loads(figures.read_text())["steps"][0] if figures.exists() else None

    def call(self, rate):
        while self.called is None and not self.over.is_set():
            self.called = self.calls("--rate", f"{rate:.0f}", "--send-all", "--duration", str(self.options.seconds))

    def begin(self):
        alone = self.calls("--concurrency", "8", "--duration", str(min(2, self.options.seconds / 4)))
        if not alone or not alone["answered_per_second"]:
            raise RuntimeError(f"maneuver load was not answered before the load: {alone}")
        capacity = alone["answered_per_second"]
        self.threads = [threading.Thread(target=self.watch), threading.Thread(target=self.call, args=(TIMES * capacity,))]
        self.threads += [threading.Thread(target=self.again_and_again, args=(kind, getattr(self, kind)))
                         for kind, count in self.callers.items() for _ in range(count)]
        for thread in self.threads:
            thread.start()

    def end(self):
        self.over.set()
        for thread in self.threads:
            thread.join()

    def report(self):
        asked = sum(self.callers.values()) * self.size / MB
        print(f"asked for at any moment: {asked:.0f} MB ({asked / self.options.limit:.1f} limits) by "
              + ", ".join(f"{count} {kind}" for kind, count in self.callers.items()) + f"; {WATCHES} watches")
        if self.called:
            print(f"calls a second: {self.called['offered_per_second']:.0f} offered, "
                  f"{self.called['answered_per_second']:.0f} answered")
        print("ends:", ", ".join(f"{count} {kind}: {end}" for (kind, end), count in sorted(self.ends.items())))
        print(f"{self.full} refused with MEMORY_FULL, {self.watched} watches were open to the end")

    def failures(self, refusals):
        """What shows that there was no such load. `refusals`: as the server counts them; it leaves some out."""
        found = []
        for kind in self.callers:
            ends = {end for of, end in self.ends if of == kind}
            odd = ends - (UPLOAD_ENDS if kind == "upload" else ENDS)
            if odd or not ends:
                found.append(f"calls of the kind {kind} ended with {sorted(odd) or 'nothing'}")
        if not self.full and not refusals and self.options.only != "upload":
            found.append("nothing was refused for want of memory")
        if not self.watched:
            found.append("no watch was open to the end")
        if not self.called or not self.called["offered_per_second"]:
            found.append("no small calls were made")
        return found


def planner(server, seconds, ends, most):
    """Asks for little, ten times a second, until `seconds` are over and it was answered once, or PATIENCE_S more are over.

    Notes the most memory that was seen.
    """
    scene = v1.Scenario(prediction_time=0.2, target_ids=[1], agents=[vehicle(1)])
    give_up = time.monotonic() + seconds
    with maneuver.Client(server.address) as client:
        while server.process.poll() is None and time.monotonic() < give_up + (0 if ends["OK"] else PATIENCE_S):
            try:
                client.predict(scene, model="models/small", timeout=10)
                ends["OK"] += 1
            except maneuver.ManeuverError as error:
                ends[f"{error.code.name} {error.reason}"] += 1
            time.sleep(0.1)
            if server.process.poll() is None:
                most[0] = max(most[0], server.resident_mb())


def run(options, work, group):
    server = Server(options, work, group)
    failures = []
    most = [server.resident_mb()]
    try:
        before, during, after = collections.Counter(), collections.Counter(), collections.Counter()
        planner(server, 0.3, before, most)
        load = Load(options, server)
        load.begin()
        planner(server, options.seconds, during, most)
        load.end()
        planner(server, 0.5, after, most)
        print(f"limit {options.limit} MiB, {options.seconds:.0f} s")
        load.report()
        print("planner before, during, after:", dict(before), dict(during), dict(after))
        print(f"most memory {most[0]:.0f} MB")
        if server.process.poll() is not None:
            failures.append(f"the server ended with status {server.process.returncode}: {server.log.read_text()[-1000:]}")
            return failures
        refusals = server.metric("maneuver_memory_refusals_total")
        print(f"maneuver_memory_bytes {server.metric('maneuver_memory_bytes') / 1e6:.0f} MB, "
              f"maneuver_memory_refusals_total {refusals:.0f}, "
              f"closed connections {server.metric('maneuver_memory_closed_connections_total'):.0f}")
        failures += load.failures(refusals)
        if group.kills():
            failures.append("the system ended a process of the control group")
        if not before["OK"] or not during["OK"] or not after["OK"]:
            failures.append("the planner was not answered before, during or after the load")
        if "UNAVAILABLE" in " ".join(during):
            failures.append("the planner lost its server during the load")
    finally:
        server.process.kill()
        server.process.wait()
    return failures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=int, default=512, help="MiB, of the control group and of --memory-limit")
    parser.add_argument("--seconds", type=float, default=30, help="of the load")
    parser.add_argument("--only", choices=SHARES, help="let all callers ask for this kind, three limits of it")
    parser.add_argument("--flags", type=str.split, default=[], help="more options of maneuverd, in one word")
    parser.add_argument("--maneuverd", type=pathlib.Path, default=BUILD / "bin" / "maneuverd")
    parser.add_argument("--maneuver", type=pathlib.Path, default=BUILD / "bin" / "maneuver")
    parser.add_argument("--small-model", type=pathlib.Path, default=BUILD / "tests" / "write_small_model")
    options = parser.parse_args()
    group = ControlGroup(options.limit * MB)
    if group.folder is None:
        print("skipped: no control group with a limit of memory can be made here; it takes root and /sys/fs/cgroup, writable")
        return SKIPPED
    with tempfile.TemporaryDirectory(prefix="maneuver-memory-") as work:
        try:
            failures = run(options, pathlib.Path(work), group)
        finally:
            group.remove()
    for failure in failures:
        print("FAILED:", failure, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
