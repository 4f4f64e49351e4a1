#!/usr/bin/python3
"""Runs a random history over all services of a maneuverd, with sudden deaths, full disks, input/output errors and jumps of
the clock, and compares what the server shows with a model of what it acknowledged.

In each round some callers work at once, each on models, datasets, tags and jobs of its own: they upload, register,
label, promote, alias, delete, train, evaluate, recalibrate, cross-validate, tag, cancel, resume, predict and report
outcomes. Meanwhile the disk may fail, the clock may jump, the trainer or the server may be killed. Then the server
starts again and everything that it shows is checked:

- an acknowledged change is there; a refused one is not; one without an answer is there completely or not at all;
- a version number, a job and a request id are given once; a job makes at most one version;
- a cancelled job stays cancelled; a job that has ended stays as it ended, with its result;
- versions, reports and tags that a job made keep their content; what is computed twice from the same is the same;
- a map is held until the server ends, and a registered folder is never changed;
- an outcome is counted once; nothing that was half written is left.

    tests/histories/histories.py --rounds 1000 --seed 7

A violation ends the run with status 1, the seed, the round and the last calls.
"""

import argparse
import collections
import contextlib
import errno
import fcntl
import hashlib
import json
import mmap
import os
import pathlib
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
BUILD = REPOSITORY / "build" / "release"
sys.path[:0] = [os.environ.get("PYTHONPATH", str(BUILD / "python")), str(REPOSITORY / "tests" / "python")]
import grpc  # noqa: E402
from google.protobuf import json_format  # noqa: E402
import maneuver  # noqa: E402
from maneuver import v1  # noqa: E402
from server import TINY, lift_jobs  # noqa: E402

PATIENCE_S = 300  # for anything that has to happen at last, on a machine that does other things
CALL_S = 60  # for a call
RANDOM_MODELS = 3  # different small ones, without actions that could be labelled
LEARNED_MODELS = 2
TOWNS = 3  # different datasets
MAX_VERSIONS = 6  # of a model; then a caller deletes before it uploads
ACTIVE_JOBS = 2  # of a caller
EXAMPLES = {"max_examples": 40}
SETTINGS = {**TINY, "examples": EXAMPLES}
# Versions that nobody deletes, for jobs that need one.
BASES = [f"models/seed/versions/{number}" for number in range(1, LEARNED_MODELS + 1)]
HOUR_NS = 3600 * 10**9
# Codes after which a change may have happened: the answer was lost, or nobody can know.
LOST = {grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED, grpc.StatusCode.DEADLINE_EXCEEDED}
# Codes of google.rpc.Status with which no job fails on a sound machine.
AT_FAULT = {code.value[0] for code in (grpc.StatusCode.UNKNOWN, grpc.StatusCode.INTERNAL, grpc.StatusCode.DATA_LOSS)}
ENDED = {v1.JOB_STATE_SUCCEEDED, v1.JOB_STATE_FAILED, v1.JOB_STATE_CANCELLED}


class Violation(Exception):
    pass


def require(condition, what):
    if not condition:
        raise Violation(what)


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def map_id(feature):
    """The id of a map of one lane without neighbours, as RegisterMapResponse defines it."""
    return hashlib.sha256(b"".join((
        struct.pack("<qii", feature.id, feature.type, len(feature.x)), struct.pack(f"<{len(feature.x)}d", *feature.x),
        struct.pack(f"<{len(feature.y)}d", *feature.y), struct.pack("<d", feature.speed_limit)))).hexdigest()


def wait_for(condition, what, patience=PATIENCE_S):
    give_up = time.monotonic() + patience
    while not condition():
        require(time.monotonic() < give_up, f"{what}: not within {patience:.0f} s")
        time.sleep(0.02)


class Faults:
    """Says to fault_shim.cc what fails."""

    def __init__(self, file):
        file.write_bytes(bytes(32))
        with open(file, "r+b") as opened:
            self._map = mmap.mmap(opened.fileno(), 32)
        self.armed = 0
        self.injected = 0  # faults so far
        self.told = "no fault yet"

    def arm(self, error, succeed, fail):
        self.armed = error
        self.injected += 1
        self.told = f"{errno.errorcode.get(error, 'hangs')} after {succeed} operations, {fail} times"
        self._map[8:24] = struct.pack("<qq", succeed, fail)
        self._map[0:8] = struct.pack("<q", error)

    def heal(self):
        self._map[0:8] = bytes(8)
        self.armed = 0

    def mark(self):
        """A number that stays the same until another fault is injected; None while something fails."""
        return None if self.armed else self.injected

    def jump(self, offset_ns):
        self.injected += 1
        self._map[24:32] = struct.pack("<q", offset_ns)


class Server:
    def __init__(self, options, work, faults):
        self.data = work / "data"
        self.faults = faults
        self._ports = work / "ports.json"
        self.log = work / "maneuverd.log"
        self._command = [options.maneuverd, "--data-dir", self.data, "--listen", "127.0.0.1:0", "--metrics-listen",
                         "127.0.0.1:0", "--port-file", self._ports, "--checkpoint-interval", "0.1", "--job-attempts", "1000",
                         "--outcome-memory", "16MiB", "--shutdown-timeout", "2", "--dataset-folders", work, *options.flags]
        self._environment = {**os.environ, "LD_PRELOAD": str(options.fault_shim), "MANEUVER_FAULTS": str(work / "faults"),
                             "MANEUVER_FAULT_ROOT": str(self.data), "OMP_NUM_THREADS": "1"}
        self.process = None
        self.client = None
        self.starts = 0

    def start(self):
        """Returns whether it listens; false if it ended instead."""
        self.starts += 1
        self._ports.unlink(missing_ok=True)
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(self._command, stdout=log, stderr=log, env=self._environment)
        threading.Thread(target=lift_jobs, args=(self.process,), daemon=True).start()
        wait_for(lambda: self._ports.exists() or self.process.poll() is not None, "the server starts or ends")
        if not self._ports.exists():
            return False
        addresses = json.loads(self._ports.read_text())
        self.metrics_address = addresses["metrics"]
        self.client = maneuver.Client(addresses["grpc"], deadline=maneuver.Deadlines(
            prediction=CALL_S, management=CALL_S, upload=CALL_S), retries=0, clock=maneuver.Clock(sleep=self._sleep))
        return True

    def _sleep(self, seconds):
        """Between two attempts of an upload: there is none once the server is gone."""
        if self.process.poll() is not None:
            raise maneuver.UnavailableError(grpc.StatusCode.UNAVAILABLE, "the server is gone")
        time.sleep(seconds)

    def trainers(self):
        tasks = pathlib.Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [int(child) for task in tasks for child in task.read_text().split()]

    def stop(self, kill):
        if self.process.poll() is None:
            self.process.kill() if kill else self.process.terminate()
        status = self.process.wait(PATIENCE_S)
        self.close()
        return status

    def stop_well(self):
        """Stops it in order. It has run until then, and no signal ends it."""
        self.check_runs()
        status = self.stop(kill=False)
        if status < 0:
            raise Violation(self.ended(status))

    def check_runs(self):
        status = self.process.poll()
        if status is not None:
            raise Violation(self.ended(status))

    def ended(self, status):
        return f"the server ended with {status}:\n{self.log.read_text(errors='replace')[-2000:]}"

    def close(self):
        if self.client is not None:
            self.client.close()
            self.client = None

    def scored_outcomes(self):
        with urllib.request.urlopen(f"http://{self.metrics_address}/metrics", timeout=CALL_S) as page:
            found = re.search(r'maneuver_outcome_targets_total\{result="scored"\} (\d+)', page.read().decode())
        return int(found[1])


class Cell:
    """What one thing may be, after all calls that were acknowledged, and those that were not answered."""

    def __init__(self, value):
        self.may = {value}

    @property
    def value(self):
        """What it is; None if that is not certain."""
        return next(iter(self.may)) if len(self.may) == 1 else None

    def see(self, value, what):
        require(value in self.may, f"{what} is {value!r}; acknowledged: {self.may!r}")
        self.may = {value}


# What a job is asked for with: its kind as Job.work names it, the model that gets a version ("": none), the call, and
# the tags that it writes, with what they are of.
Work = collections.namedtuple("Work", "kind model call tags", defaults=(None,))


class Job:
    def __init__(self, name, work):
        self.name = name
        self.work = work
        self.there = Cell(True)
        self.state = v1.JOB_STATE_UNSPECIFIED  # as it was last seen
        self.cancelled = False  # acknowledged, and not resumed since
        self.may_be_resumed = False
        self.ended = None  # all of it, once it has ended
        self.version = ""
        self.weights = ""  # SHA-256 of the version's
        self.tag_deletions = 0  # of its tags, when it was asked for
        self.mark = None  # Faults.mark() when it was asked for


class Caller:
    """Works on models, datasets and jobs of its own, and keeps in mind what the server acknowledged."""

    def __init__(self, run, number):
        self.run = run
        self.random = random.Random(run.options.seed * 1000 + number)
        self.model = f"models/m{number}"
        self.trained = f"models/t{number}"
        self.datasets = {f"datasets/d{number}-{i}": Cell(None) for i in range(2)}  # SHA-256 of the shard
        self.versions = {}  # uploaded ones, by name: SHA-256 of the weights, or None once deleted
        self.lost_uploads = []  # weights of uploads that were not answered
        self.highest = 0  # the highest number of the model ever seen
        self.labels = collections.defaultdict(lambda: Cell(""))  # by (version, action)
        self.aliases = {f"{self.model}/aliases/{alias}": Cell(None) for alias in ("serving", "candidate", "stable")}
        self.jobs = {}
        self.tags = {f"tags/g{number}-{i}": Cell(None) for i in range(2)}  # (version, dataset)
        self.tag_deletions = collections.Counter()
        self.tag_files = {name: {} for name in self.tags}  # SHA-256 of each complete file
        self.reports = set()  # (version, dataset) that were evaluated
        self.map = None  # (the server's start, id) of the newest map that was registered
        self.lost_requests = {}  # request id: work
        self.requests = {}  # request id: (work, job)
        self.marks = {}  # request id: Faults.mark() when it was sent first
        self.gone = set()  # trained versions that were deleted, or may be
        self.scenes = 0
        self.failure = None

    # Calls.

    def attempt(self, what, call, *cells_and_values):
        """Calls; the cells become their values if it is acknowledged, and may be either if it is not answered.

        Returns what the call returned, or None.
        """
        before = [(cell, set(cell.may)) for cell, _ in cells_and_values]
        for cell, value in cells_and_values:
            cell.may.add(value)
        try:
            answer = call()
        except maneuver.ManeuverError as error:
            self.run.note(self, f"{what}: {error.code.name} {error.reason}")
            unknown = error.code in LOST or self.run.faults.armed == errno.EIO or self.run.may_have_failed == errno.EIO
            if not unknown:
                for cell, may in before:
                    cell.may = may
            self.check_error(what, error)
            self.lost = unknown
            return None
        self.run.note(self, f"{what}: OK")
        for cell, value in cells_and_values:
            cell.may = {value}
        return True if answer is None else answer

    def check_error(self, what, error):
        require(error.code not in (grpc.StatusCode.UNKNOWN, grpc.StatusCode.UNIMPLEMENTED, grpc.StatusCode.UNAUTHENTICATED,
                                   grpc.StatusCode.INVALID_ARGUMENT), f"{what}: {error}")
        if self.run.may_have_failed == 0:
            require(error.code not in (grpc.StatusCode.INTERNAL, grpc.StatusCode.DATA_LOSS,
                                       grpc.StatusCode.RESOURCE_EXHAUSTED), f"{what}: {error}, and the disk was sound")

    def client(self):
        return self.run.server.client

    def existing(self):
        return [name for name, cell in self.versions.items() if cell.value is not None]

    def upload_model(self):
        if len(self.existing()) >= MAX_VERSIONS:
            return self.delete_version()
        folder = self.random.choice(self.run.contents)
        weights = digest(folder / "weights.safetensors")
        version = self.attempt(f"upload {folder.name} to {self.model}",
                               lambda: self.client().upload_model_version(folder, self.model))
        if version is None:
            self.lost_uploads.append(weights)
            return
        number = int(version.name.rsplit("/", 1)[1])
        if version.name in self.versions:
            self.versions[version.name].see(weights, f"weights of {version.name}, returned by an upload")
        else:
            self.adopt(version.name, number, weights)

    def adopt(self, name, number, weights):
        require(number > self.highest, f"{name} is new, and a number up to {self.highest} was given before")
        self.highest = number
        self.versions[name] = Cell(weights)

    def delete_version(self):
        names = self.existing()
        if not names:
            return
        name = self.random.choice(names)
        # Refused while an alias points to it: that is not an error of the server.
        self.attempt(f"delete {name}", lambda: self.client().delete_model_version(name), (self.versions[name], None))

    def set_alias(self):
        names = self.existing()
        if not names:
            return
        alias, version = self.random.choice(sorted(self.aliases)), self.random.choice(names)
        self.attempt(f"point {alias} to {version}", lambda: self.client().set_model_alias(alias, version),
                     (self.aliases[alias], version))

    def remove_alias(self):
        alias = self.random.choice(sorted(self.aliases))
        self.attempt(f"remove {alias}", lambda: self.client().delete_model_alias(alias), (self.aliases[alias], None))

    def label(self):
        names = [name for name in self.existing() if self.versions[name].value in self.run.with_actions]
        if not names:
            return
        name, action = self.random.choice(names), self.random.randrange(3)
        # Names of a version differ.
        label = self.random.choice(["", f"left {action}", f"right {action}", f"straight {action}",
                                    f"name {action}-{self.random.randrange(1000)}"])
        self.attempt(f"label {name} {action} {label!r}", lambda: self.client().label_action(name, action, label),
                     (self.labels[name, action], label))

    def upload_dataset(self):
        name, town = self.random.choice(sorted(self.datasets)), self.random.choice(self.run.towns)
        # One that is there is refused, unless it is the same.
        self.attempt(f"upload {town.name} as {name}", lambda: self.client().upload_dataset(town, name),
                     (self.datasets[name], self.run.shards[town.name]))

    def register_dataset(self):
        name, town = self.random.choice(sorted(self.datasets)), self.random.choice(self.run.towns)
        # One that is there is refused, unless it is this folder.
        self.attempt(f"register {town.name} as {name}", lambda: self.client().register_dataset(name, str(town)),
                     (self.datasets[name], self.run.shards[town.name]))

    def delete_dataset(self):
        name = self.random.choice(sorted(self.datasets))
        self.attempt(f"delete {name}", lambda: self.client().delete_dataset(name), (self.datasets[name], None))

    def request_job(self, kind, model, call, tags=None):
        """Asks for a job on a dataset and a version.

        call: given the client, the dataset, the version and the keyword request_id
        """
        names = [name for name, cell in self.datasets.items() if cell.value is not None]
        if not names or sum(job.state not in ENDED for job in self.jobs.values()) >= ACTIVE_JOBS:
            return
        dataset, version = self.random.choice(names), self.random.choice(BASES)
        self.ask(f"r{self.random.getrandbits(60):x}", Work(
            kind, model, lambda request: call(self.client(), dataset, version, request_id=request),
            tags and (tags, (version, dataset))))

    def ask(self, request, work):
        begun = [(self.tags[work.tags[0]], work.tags[1])] if work.tags else []
        deletions = self.tag_deletions[work.tags[0]] if work.tags else 0
        self.marks.setdefault(request, self.run.faults.mark())
        job = self.attempt(f"{work.kind} as {request}", lambda: work.call(request), *begun)
        if job is None:
            if self.lost:
                self.lost_requests[request] = work
            return
        require(job.name not in self.jobs, f"{job.name} of {request} is that of another request")
        self.jobs[job.name] = Job(job.name, work)
        self.jobs[job.name].tag_deletions = deletions
        self.jobs[job.name].mark = self.marks[request]
        self.requests[request] = (work, job.name)

    def promotion(self):
        return self.random.choice([v1.PROMOTION_NEVER, v1.PROMOTION_ALWAYS])

    def train(self):
        promotion = self.promotion()
        self.request_job("train", self.trained, lambda client, dataset, version, **request: client.train(
            self.trained, [dataset], SETTINGS, promotion=promotion, **request))

    def evaluate(self):
        self.request_job("evaluate", "", lambda client, dataset, version, **request: client.evaluate(
            version, dataset, examples=EXAMPLES, **request))

    def recalibrate(self):
        promotion = self.promotion()
        self.request_job("recalibrate", "models/seed", lambda client, dataset, version, **request: client.recalibrate(
            version, [dataset], examples=EXAMPLES, promotion=promotion, **request))

    def cross_validate(self):
        self.request_job("cross_validate", "", lambda client, dataset, version, **request: client.cross_validate(
            v1.CrossValidateRequest(datasets=[dataset], settings=self.run.settings, folds=2, **request)))

    def tag(self):
        tags = self.random.choice(sorted(self.tags))
        self.request_job("tag", "", lambda client, dataset, version, **request: client.tag(
            version, [dataset], tags, **request), tags)

    def delete_tags(self):
        name = self.random.choice(sorted(self.tags))
        # Refused while a job writes them.
        if self.attempt(f"delete {name}", lambda: self.client().delete_tags(name), (self.tags[name], None)) or self.lost:
            self.tag_deletions[name] += 1
            self.tag_files[name] = {}

    def ask_for_a_job_again(self):
        """A request that is repeated is the same job."""
        known = [request for request, (_, job) in self.requests.items() if self.jobs[job].there.value]
        if not known:
            return
        request = self.random.choice(known)
        work, name = self.requests[request]
        job = self.attempt(f"{work.kind} again as {request}", lambda: work.call(request))
        require(job is None or job.name == name, f"{request} made {name} and {job and job.name}")

    def pick_job(self, states):
        found = [job for job in self.jobs.values() if job.there.value and job.state in states]
        return self.random.choice(found) if found else None

    def cancel(self):
        job = self.pick_job({v1.JOB_STATE_UNSPECIFIED, v1.JOB_STATE_PENDING, v1.JOB_STATE_RUNNING})
        if job is None:
            return
        if self.attempt(f"cancel {job.name}", lambda: self.client().cancel_job(job.name)) is not None:
            job.cancelled = True

    def resume(self):
        job = self.pick_job({v1.JOB_STATE_FAILED, v1.JOB_STATE_CANCELLED})
        if job is None:
            return
        job.may_be_resumed = True
        job.cancelled = False
        self.attempt(f"resume {job.name}", lambda: self.client().resume_job(job.name))

    def delete_job(self):
        job = self.pick_job(ENDED)
        if job is not None:
            self.attempt(f"delete {job.name}", lambda: self.client().delete_job(job.name), (job.there, False))

    def delete_trained(self):
        versions = [job.version for job in self.jobs.values() if job.version and job.version not in self.gone]
        if not versions:
            return
        version = self.random.choice(versions)
        # One that serves is refused. The check then finds it and takes it out again.
        self.gone.add(version)
        self.attempt(f"delete {version}", lambda: self.client().delete_model_version(version))

    def report_outcome(self):
        """Predicts, and reports what followed twice: it is scored once."""
        names = self.existing()
        if not names:
            return
        self.scenes += 1
        scene = f"{self.model}-{self.scenes}"
        version = self.random.choice(names)
        outcome = v1.Outcome(scenario_id=scene, prediction_time=0, model=version, targets=[v1.TargetOutcome(
            target_id=7, states=[v1.AgentState(time=0.1 * i, x=0.5 * i, velocity_x=5) for i in range(1, 51)])])
        if self.attempt(f"predict {scene}", lambda: self.client().predict(self.scene(scene), model=version)) is None:
            return
        for turn in range(2):
            with self.run.lock:
                self.run.outcomes_maybe += 1
            answer = self.attempt(f"report {scene}", lambda: self.client().report_outcomes([outcome]))
            if answer is None:
                return
            error = answer.scores[0].targets[0].error if answer.scores[0].targets else answer.scores[0].error
            with self.run.lock:
                self.run.outcomes_maybe -= 1
                self.run.outcomes += not error.code
            require(bool(error.code) == bool(turn), f"report {turn + 1} of {scene}: {error or 'scored'}")

    def scene(self, name, **of_the_map):
        vehicle = v1.Agent(id=7, type=v1.AGENT_TYPE_VEHICLE, length=4.5, width=1.9, states=[v1.AgentState(velocity_x=5)])
        return v1.Scenario(scenario_id=name, target_ids=[7], agents=[vehicle], **of_the_map)

    def register_map(self):
        """Predicts with the map by its id and with the map itself: the answers are the same."""
        lane = v1.MapFeature(id=1, type=v1.MAP_FEATURE_TYPE_LANE_CENTERLINE, x=[-20, 0, self.random.uniform(5, 40)],
                             y=[self.random.uniform(-9, 9) for _ in range(3)], speed_limit=14)
        held = self.attempt("register a map", lambda: self.client().register_map([lane]))
        if held is None:
            return
        require(held == map_id(lane), f"a map is {held}; its SHA-256 is {map_id(lane)}")
        self.map = (self.run.server.starts, held)
        version = self.random.choice(BASES)
        answers = [self.attempt(f"predict with {what}", lambda: self.client().predict(
            self.scene("map", **of_the_map), model=version).target().probabilities)
                   for what, of_the_map in (("a map's id", {"map_id": held}), ("a map", {"map_features": [lane]}))]
        require(any(answer is None for answer in answers) or abs(answers[0] - answers[1]).max() < 1e-6,
                f"with the map {held} the answer is {answers[0]}, and without its id {answers[1]}")

    OPERATIONS = ((upload_model, 6), (delete_version, 3), (set_alias, 6), (remove_alias, 2), (label, 6), (upload_dataset, 4),
                  (register_dataset, 3), (delete_dataset, 2), (train, 1), (evaluate, 1), (recalibrate, 1),
                  (cross_validate, 1), (tag, 2), (delete_tags, 1), (ask_for_a_job_again, 1), (cancel, 0.1), (resume, 1),
                  (delete_job, 1), (delete_trained, 1), (report_outcome, 3), (register_map, 2))

    def work(self, over):
        operations, weights = zip(*self.OPERATIONS)
        try:
            while not over.is_set():
                self.random.choices(operations, weights)[0](self)
        except Violation as violation:
            self.failure = str(violation)
        except Exception as error:  # a client that breaks is a finding, too
            self.failure = f"{type(error).__name__}: {error}"

    # What the server shows, with nobody at work on this caller's things.

    def check(self):
        client = self.client()
        shown = {version.name: version for version in client.list_model_versions(self.model)} if self.has(self.model) else {}
        for name, cell in self.versions.items():
            folder = self.run.server.data / "models" / self.model[7:] / name.rsplit("/", 1)[1]
            cell.see(digest(folder / "weights.safetensors") if name in shown else None, f"weights of {name}")
        for name in sorted(set(shown) - set(self.versions), key=lambda name: int(name.rsplit("/", 1)[1])):
            folder = self.run.server.data / "models" / self.model[7:] / name.rsplit("/", 1)[1]
            weights = digest(folder / "weights.safetensors")
            require(weights in self.lost_uploads, f"{name} was never uploaded")
            self.adopt(name, int(name.rsplit("/", 1)[1]), weights)
        self.lost_uploads.clear()
        for name, cell in self.aliases.items():
            alias = name.rsplit("/", 1)[1]
            owners = [version for version, seen in shown.items() if alias in seen.aliases]
            require(len(owners) < 2, f"{name} points to {owners}")
            cell.see(owners[0] if owners else None, name)
        for name in shown:
            actions = None
            for (version, action), cell in self.labels.items():
                if version == name:
                    actions = actions or client.get_model_version(name).manifest.actions
                    cell.see(actions[action].label, f"the label of action {action} of {name}")
        datasets = {dataset.name: dataset.shards for dataset in client.list_datasets()}
        for name, cell in self.datasets.items():
            shards = datasets.get(name, [])
            cell.see(shards[0].sha256 if shards else None, f"the first shard of {name}")
            for shard in shards:
                require(digest(self.run.server.data / name / shard.file) == shard.sha256, f"{shard.file} of {name}")
        self.check_tags({tags.name: tags for tags in client.list_tags()})
        self.check_map()

    def may_begin_tags(self, job):
        """A job that was resumed begins tags that were deleted again."""
        if job.work.tags:
            tags, of = job.work.tags
            self.tags[tags].may.add(of)

    def check_tags(self, shown):
        for job in self.jobs.values():
            if job.state not in ENDED or job.may_be_resumed:
                self.may_begin_tags(job)
        for name, cell in self.tags.items():
            tags = shown.get(name)
            cell.see(tags and (tags.model_version, tags.datasets[0] if tags.datasets else ""), name)
            files = {file.name: digest(file) for file in (self.run.server.data / name).glob("[!.]*")}
            require(self.tag_files[name].items() <= files.items(), f"{name} had {self.tag_files[name]} and has {files}")
            self.tag_files[name] = files
            if "schema.json" in files:
                for file, content in files.items():
                    self.run.same(f"{file} of {files['schema.json']}", content)

    def check_map(self):
        """A map is held until the server ends, and no longer."""
        if self.map is None:
            return
        start, held = self.map
        try:
            self.client().predict(self.scene("map", map_id=held), model=BASES[0]).target()
            reason = ""
        except maneuver.ManeuverError as error:
            reason = error.reason
        expected = "" if start == self.run.server.starts else "MAP_NOT_REGISTERED"
        require(reason == expected, f"a map of start {start} in start {self.run.server.starts}: {reason or 'it is held'}")

    def has(self, model):
        return any((self.run.server.data / "models" / model[7:]).glob("[0-9]*"))

    def ask_again(self):
        """Requests whose answers were lost: asked again, each is one job."""
        for request, work in list(self.lost_requests.items()):
            del self.lost_requests[request]
            self.ask(request, work)

    def check_jobs(self, shown):
        for job in self.jobs.values():
            seen = shown.get(job.name)
            job.there.see(seen is not None, f"whether {job.name} is there")
            if seen is None:
                continue
            if job.state in ENDED and not job.may_be_resumed:
                require(seen.state == job.state, f"{job.name} had ended as {job.state} and is {seen.state}")
            if job.cancelled and seen.state not in ENDED:
                require(seen.cancel_requested, f"{job.name} was cancelled and goes on: {seen.state}")
            if seen.state in ENDED:
                self.check_ended(job)
            job.state = seen.state
            if seen.state in ENDED:
                job.may_be_resumed = False
        for version, dataset in self.reports:
            self.check_report(self.client().get_evaluation_report(f"{version}/evaluations/{dataset[9:]}"))

    def check_ended(self, job):
        seen = self.client().get_job(job.name)
        whole = seen.SerializeToString(deterministic=True)
        if job.ended is None or job.may_be_resumed:
            self.may_begin_tags(job)  # after the tags were listed
            why = maneuver.errors.from_status(seen.error) if seen.HasField("error") else ""
            self.run.ends[f"{job.work.kind}: {v1.JobState.Name(seen.state)[10:]} {why}"] += 1
            require(seen.error.code not in AT_FAULT or job.mark is None or job.mark != self.run.faults.mark(),
                    f"{job.name} failed without a fault since it was asked for: {why}")
        else:
            require(whole == job.ended, f"{job.name} had ended, and has changed:\n{v1.Job.FromString(job.ended)}\n{seen}")
        job.ended = whole
        if seen.state != v1.JOB_STATE_SUCCEEDED:
            return
        require(seen.WhichOneof("work") == job.work.kind, f"{job.name} is no {job.work.kind}")
        result = {"evaluate": "evaluation", "cross_validate": "cross_validation", "tag": "tagged"}.get(job.work.kind)
        require(result is None or seen.HasField(result), f"{job.name} succeeded without a result")
        if job.work.model:
            self.check_version(job, seen.model_version)
        elif job.work.kind == "evaluate":
            self.check_report(seen.evaluation)
            self.reports.add((seen.evaluate.model, seen.evaluate.dataset))
        elif job.work.tags:
            name, _ = job.work.tags
            require(seen.tagged.shards == seen.tagged.all_shards > 0, f"{job.name} ended and tagged {seen.tagged}")
            if self.tag_deletions[name] == job.tag_deletions:
                files = list((self.run.server.data / name).glob("*.tags"))
                require(len(files) == seen.tagged.shards, f"{job.name} tagged {name}, which has {files}")

    def check_version(self, job, version):
        require(version.startswith(job.work.model + "/"), f"{job.name} succeeded with {version!r}")
        require(job.version in ("", version), f"{job.name} made {job.version} and {version}")
        job.version = version
        weights = self.run.server.data / version.replace("/versions", "") / "weights.safetensors"
        require(version in self.gone or weights.exists(), f"{version} is gone")
        if weights.exists():
            self.gone.discard(version)
            content = digest(weights)
            require(job.weights in ("", content), f"the weights of {version} were {job.weights} and are {content}")
            job.weights = content

    def check_report(self, report):
        """Two reports on the same are the same, beside when they were made."""
        require(report.metrics, f"no metrics: {report}")
        what = f"the report on {report.model_version}, {report.dataset}, {report.dataset_sha256}"
        content = v1.EvaluationReport()
        content.CopyFrom(report)
        content.ClearField("create_time")
        content.ClearField("name")
        self.run.same(what, content.SerializeToString(deterministic=True))


class Run:
    def __init__(self, options, work):
        self.options = options
        self.random = random.Random(options.seed)
        self.lock = threading.Lock()
        self.faults = Faults(work / "faults")
        self.server = Server(options, work, self.faults)
        self.calls = collections.Counter()
        self.notes = collections.deque(maxlen=200)
        self.events = collections.Counter()
        self.ends = collections.Counter()
        self.made = {}
        self.settings = json_format.ParseDict(SETTINGS, v1.TrainingSettings())
        self.outcomes = self.outcomes_maybe = 0
        self.may_have_failed = 0  # the error with which operations of this round may have failed
        self.contents, self.with_actions, self.towns, self.shards = [], set(), [], {}
        self.bases = {}  # SHA-256 of the weights of BASES
        for seed in range(1, RANDOM_MODELS + 1):
            self.contents.append(work / f"random{seed}")
            subprocess.run([options.small_model, self.contents[-1], str(seed)], check=True)
        for seed in range(1, TOWNS + 1):
            self.towns.append(work / f"town{seed}")
            subprocess.run([options.maneuver, "synthesize", self.towns[-1], "--recordings", "6", "--seed", str(seed)],
                           check=True, stdout=subprocess.DEVNULL)
            self.shards[self.towns[-1].name] = json.loads((self.towns[-1] / "dataset.json").read_text())["shards"][0]["sha256"]
        self.callers = [Caller(self, number) for number in range(options.callers)]

    def note(self, caller, text):
        with self.lock:
            self.calls[text.split(" ")[0] + ": " + text.rsplit(": ", 1)[1]] += 1
            self.notes.append(f"{time.monotonic():.3f} {caller.model}: {text}")

    def same(self, what, content):
        """Requires that what is made again, from the same, has the same content."""
        require(self.made.setdefault(what, content) == content, f"{what} was {self.made[what]} and is {content}")

    def event(self, what):
        with self.lock:
            self.events[what] += 1
            self.notes.append(f"{time.monotonic():.3f} {what}; {self.faults.told}")

    def start(self):
        """Starts the server, at times on a disk that fails meanwhile."""
        while True:
            if self.random.random() < 0.1:
                self.faults.arm(*self.a_fault(15))
                self.event("start on a disk that fails")
            if self.random.random() < 0.1:
                self.hold_lock()
            listens = self.server.start()
            was_armed, _ = self.faults.armed, self.faults.heal()
            if listens:
                return
            status = self.server.process.returncode
            require(was_armed and status >= 0, f"the server did not start: {self.server.ended(status)}")
            self.event("refused to start on a disk that fails")

    def hold_lock(self):
        """What a child does that a killed server was about to make a trainer: it holds the lock for a moment."""
        self.event("start while the lock is still held")
        file = open(self.server.data / "maneuverd.lock", "w")
        fcntl.flock(file, fcntl.LOCK_EX)
        threading.Timer(0.5, file.close).start()

    def a_fault(self, most):
        if self.random.random() < 0.5:
            return errno.ENOSPC, self.random.randrange(most), 10**9
        return errno.EIO, self.random.randrange(most), self.random.choice((1, 1, 3))

    def round(self, number):
        self.may_have_failed = 0
        self.outcomes = self.outcomes_maybe = 0
        if self.random.random() < 0.2:
            self.event("jump of the clock")
            self.faults.jump(self.random.choice((0, self.random.randrange(-12 * HOUR_NS, 12 * HOUR_NS))))
        over = threading.Event()
        threads = [threading.Thread(target=caller.work, args=(over,)) for caller in self.callers]
        faulty = self.random.random() < 0.4
        if faulty:
            fault = self.a_fault(60)
            self.may_have_failed = fault[0]
            self.faults.arm(*fault)
            self.event("full disk" if fault[0] == errno.ENOSPC else "input/output error")
        for thread in threads:
            thread.start()
        # Every tenth round is long enough for a job to end.
        time.sleep(self.random.uniform(0.05, self.options.longest) if number % 10 else 3 * self.options.longest)
        killed = 0
        if self.random.random() < 0.2:
            for trainer in self.server.trainers():
                self.event("kill of a trainer")
                killed += 1
                with contextlib.suppress(ProcessLookupError):  # it may have ended just now
                    os.kill(trainer, 9)
        end = self.random.choices(("kill", "term", "none"), (6, 1, 3))[0]
        self.event({"kill": "kill", "term": "orderly end", "none": "no end"}[end])
        ended = self.server.process.poll()
        if end == "kill":
            killed += 1
            self.server.process.kill()
        over.set()
        if end == "none":
            self.faults.heal()
        for thread in threads:
            thread.join()
        self.faults.injected += killed
        if ended is not None:
            raise Violation(self.server.ended(ended))
        for caller in self.callers:
            require(caller.failure is None, caller.failure)
        if end == "kill":
            status = self.server.stop(kill=True)
            if status != -signal.SIGKILL:
                raise Violation(self.server.ended(status))
        elif end == "term":
            self.server.stop_well()
        if end != "none":
            self.faults.heal()
            self.start()
            self.check_leftovers()
        else:
            self.server.check_runs()
            scored = self.server.scored_outcomes()
            require(self.scored_before + self.outcomes <= scored <= self.scored_before + self.outcomes + self.outcomes_maybe,
                    f"{scored} outcomes are counted; {self.scored_before} were before, {self.outcomes} are acknowledged")
        self.may_have_failed = 0
        self.check()
        self.scored_before = self.server.scored_outcomes()

    def check(self):
        for caller in self.callers:
            caller.check()
            caller.ask_again()
        jobs = {job.name: job for job in self.server.client.list_jobs()}
        damaged = [(job.name, job.error) for job in jobs.values() if job.WhichOneof("work") is None]
        require(not damaged, f"damaged: {damaged}")
        requests = collections.Counter(getattr(job, job.WhichOneof("work")).request_id for job in jobs.values())
        require(all(count == 1 for count in requests.values()), f"a request made several jobs: {requests.most_common(3)}")
        known = {name for caller in self.callers for name in caller.jobs}
        for name, job in jobs.items():
            require(name in known, f"nobody asked for {name}")
        for caller in self.callers:
            caller.check_jobs(jobs)
        makers = collections.Counter(file.read_text() for file in self.server.data.glob("models/*/*/made_by"))
        several = [maker for maker, count in makers.items() if count > 1 and maker.startswith("jobs/")]
        require(not several, f"made several versions: {several}")
        for town in self.towns:
            require(digest(town / "scenarios-00000.tfrecord") == self.shards[town.name], f"{town.name} has changed")
        for version, weights in self.bases.items():
            require(digest(self.server.data / version.replace("/versions", "") / "weights.safetensors") == weights,
                    f"{version} has changed")

    def check_leftovers(self):
        """What was half written is gone once the server listens. Jobs may be at work again."""
        for folder in ("models", "datasets"):
            left = [path for path in (self.server.data / folder).glob("**/.*.tmp-*")]
            require(not left, f"left half written: {left}")
        # A tagging that goes on makes its tags again if they were deleted, by a folder that it then moves.
        left = set((self.server.data / "tags").glob(".*.tmp-*"))
        wait_for(lambda: not left & set((self.server.data / "tags").glob(".*.tmp-*")), f"half written, {left} go")

    def settle(self):
        """Every job ends, on a sound machine."""
        def all_ended():
            jobs = {job.name: job for job in self.server.client.list_jobs()}
            return all(job.state in ENDED for job in jobs.values())

        wait_for(all_ended, "every job ends", self.options.patience)
        self.check()
        self.server.check_runs()

    def keep(self):
        """Keeps the data folder and the log so that a violation can be examined."""
        if self.options.keep is not None:
            self.server.stop(kill=True)
            shutil.copytree(self.server.data, self.options.keep / "data")
            shutil.copy(self.server.log, self.options.keep)

    def learn(self, work):
        """Makes models with actions, on a server that nothing happens to."""
        self.server.start()
        client = self.server.client
        client.upload_dataset(self.towns[0], "datasets/seed")
        for seed in range(1, LEARNED_MODELS + 1):
            job = client.wait_for_job(client.train("models/seed", ["datasets/seed"], {**SETTINGS, "seed": seed}))
            folder = self.server.data / job.model_version.replace("/versions", "")
            self.contents.append(work / f"learned{seed}")
            self.contents[-1].mkdir()
            for file in ("model.json", "weights.safetensors"):
                shutil.copy(folder / file, self.contents[-1])
            self.bases[job.model_version] = digest(folder / "weights.safetensors")
            self.with_actions.add(self.bases[job.model_version])
            client.delete_job(job.name)
        self.server.stop_well()

    def play(self):
        self.start()
        self.scored_before = self.server.scored_outcomes()
        for number in range(1, self.options.rounds + 1):
            try:
                self.round(number)
            except (Violation, maneuver.ManeuverError) as violation:
                print("\n".join(self.notes), file=sys.stderr)
                print(f"VIOLATION in round {number} of seed {self.options.seed}: {violation}", file=sys.stderr)
                self.keep()
                return 1
            if number % 50 == 0:
                print(f"round {number}: {sum(self.calls.values())} calls", flush=True)
        try:
            self.settle()
        except (Violation, maneuver.ManeuverError) as violation:
            print(f"VIOLATION after the last round of seed {self.options.seed}: {violation}", file=sys.stderr)
            self.keep()
            return 1
        succeeded = sum(job.state == v1.JOB_STATE_SUCCEEDED for caller in self.callers for job in caller.jobs.values())
        jobs = sum(len(caller.jobs) for caller in self.callers)
        acknowledged = sum(count for what, count in self.calls.items() if what.endswith(": OK"))
        print(f"{self.options.rounds} rounds, seed {self.options.seed}: {sum(self.calls.values())} calls, {acknowledged} "
              f"acknowledged, {jobs} jobs of which {succeeded} succeeded; nothing acknowledged was lost")
        print("events: " + ", ".join(f"{count} {what}" for what, count in sorted(self.events.items())))
        if self.options.verbose:
            for what, count in sorted(self.calls.items()):
                print(f"{count:7d} {what}")
            for what, count in sorted(self.ends.items()):
                print(f"{count:7d} jobs ended: {what}")
        if not acknowledged:
            print("FAILED: no call was acknowledged", file=sys.stderr)
            return 1
        return 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--callers", type=int, default=3, help="at work at once")
    parser.add_argument("--longest", type=float, default=0.6, help="seconds of a round; each tenth takes three times that")
    parser.add_argument("--patience", type=float, default=PATIENCE_S, help="seconds for the jobs that are left at the end")
    parser.add_argument("--keep", type=pathlib.Path, help="copy the data folder and the log there after a violation")
    parser.add_argument("--verbose", action="store_true", help="count calls by their answers")
    parser.add_argument("--maneuverd", type=pathlib.Path, default=BUILD / "bin" / "maneuverd")
    parser.add_argument("--maneuver", type=pathlib.Path, default=BUILD / "bin" / "maneuver")
    parser.add_argument("--small-model", type=pathlib.Path, default=BUILD / "tests" / "write_small_model")
    parser.add_argument("--fault-shim", type=pathlib.Path, default=BUILD / "tests" / "libfault_shim.so")
    parser.add_argument("--flags", type=str.split, default=[], help="more options of maneuverd, in one word; commas stand for spaces")
    options = parser.parse_args()
    options.flags = [flag.replace(",", " ") for flag in options.flags]
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped by SIGTERM"))  # and ends the server
    with tempfile.TemporaryDirectory(prefix="maneuver-histories-") as work:
        run = Run(options, pathlib.Path(work))
        try:
            run.learn(pathlib.Path(work))
            return run.play()
        finally:
            run.faults.heal()
            if run.server.process is not None:
                run.server.stop(kill=True)


if __name__ == "__main__":
    sys.exit(main())
