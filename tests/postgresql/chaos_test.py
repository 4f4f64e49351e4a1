#!/usr/bin/python3
"""Three servers share one PostgreSQL and one folder behind HAProxy, and things break, round after round.

A round, drawn by --seed, kills a server (SIGKILL), freezes it beyond the lease (SIGSTOP), stops the database
(pg_ctl stop -m immediate), or cuts the link of a server to the database or to HAProxy. At least one server is left
alone. Meanwhile callers train, upload, promote, cancel and delete, and predict, and try again as callers with retries
do. Then everything is mended, and it must hold that
  - nothing that was acknowledged is lost: jobs, datasets, deletions, cancellations, the alias;
  - each job ended once, by moves that the contract knows (a trigger in the database has seen every one);
  - there is exactly one version for each training that succeeded, and none besides;
  - all of them have the weights, to the bit, of a training that nothing disturbed;
  - no prediction failed, and each was the answer of the version that it names.

It stops after --rounds rounds or --minutes minutes, whichever comes first, and says how many rounds there were.
Needs PostgreSQL 15, HAProxy and openssl of Debian; skips (77) without them. Links are cut where it is root.
"""

import argparse
import collections
import pathlib
import random
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
import uuid

from moves import DELETED, ENDED, MOVES, STATES, Moves, record
from sharing import LEASE_S, SETTINGS, Network, SharingFleet, add_programs, check, enter, prepare, wait_for

# A job whose servers are gone again and again before its next checkpoint fails after so many attempts.
FLAGS = ("--precision", "f32", "--job-attempts", "100")
ATTEMPT_S = 3.0  # a frozen server answers nothing: callers limit each attempt
PATIENCE_S = 180.0


class Callers:
    """Threads that call until they are told to stop, and what they were told."""

    def __init__(self, fleet, scene, dataset, settings, seed):
        self.fleet, self.scene, self.dataset, self.settings, self.seed = fleet, scene, dataset, settings, seed
        self.stop = threading.Event()
        self.broken = []  # promises that were not kept, and errors of the test
        self.calls = collections.Counter()
        self.slowest_prediction_s = 0.0
        self.trainings, self.cancelled, self.deleted, self.uploads = {}, set(), set(), set()
        self.aliases = []  # that `serving` may have: the one that was acknowledged last, and those in doubt since
        self._threads = []

    def start(self):
        for work in (self._predict, self._predict, self._train, self._cancel, self._upload, self._promote, self._watch):
            self._threads.append(threading.Thread(target=self._run, args=(work, len(self._threads))))
            self._threads[-1].start()

    def end(self):
        self.stop.set()
        for thread in self._threads:
            thread.join()

    def _run(self, work, number):
        client = self.fleet.client()
        chance = random.Random(self.seed * 100 + number)
        try:
            while not self.stop.is_set():
                work(client, chance)
        except BaseException as error:  # pylint: disable=broad-except
            self.broken.append(f"{work.__name__}: {type(error).__name__}: {error}")

    def _call(self, name, call, patience_s=PATIENCE_S):
        answer = self.fleet.patiently(call, patience_s)
        self.calls[name] += 1
        return answer

    def expect(self, direct):
        """Asks a server, before anything breaks, what each version answers."""
        self.expected = {version: self._numbers(direct.predict(self.scene, model=f"models/small/versions/{version}"))
                         for version in (1, 2)}
        check(self.expected[1] != self.expected[2], "the versions differ")

    @staticmethod
    def _numbers(answer):
        """What an answer says of each target: in f32 always the same bits."""
        return [list(target.probabilities) for scene in answer.raise_errors().predictions for target in scene.targets]

    def _predict(self, client, chance):
        begun = time.monotonic()
        model = chance.choice(["models/small", "models/small", "models/small/versions/1"])
        answer = self._call("predict", lambda: client.predict(self.scene, model=model, timeout=ATTEMPT_S), 60)
        self.slowest_prediction_s = max(self.slowest_prediction_s, time.monotonic() - begun)
        version = int(answer.model_version.rsplit("/", 1)[1])
        if self._numbers(answer) != self.expected[version]:
            self.broken.append(f"a prediction of version {version} is not that version's")
        self.stop.wait(0.05)

    def _train(self, client, chance):
        open_jobs = [job for job in self.trainings if job not in self.cancelled and job not in self.deleted]
        if len(self.trainings) - self._ended(client, open_jobs) > 3:
            self.stop.wait(1)
            return
        model, request = f"models/m{chance.randrange(3)}", uuid.uuid4().hex
        ask = lambda: client.train(model, ["datasets/town"], self.settings, request_id=request, timeout=5)
        job = self._call("train", ask)
        if job.name in self.trainings:
            self.broken.append(f"two requests became {job.name}")
        self.trainings[job.name] = model
        again = self._call("train again", ask)
        if again.name != job.name:
            self.broken.append(f"a request became {job.name} and {again.name}")
        self.stop.wait(chance.random())

    def _ended(self, client, names):
        listed = self._call("list", lambda: {job.name: job for job in client.list_jobs(timeout=5)})
        for name in names:
            # It was acknowledged before the list was asked for.
            if name not in listed and name not in self.deleted:
                self.broken.append(f"{name} is not listed")
        return sum(1 for name in self.trainings if name not in listed or listed[name].state > 2)

    def _cancel(self, client, chance):
        self.stop.wait(2 + chance.random() * 6)
        # Every second training is let alone.
        rest = [job for job in list(self.trainings)[1::2] if job not in self.cancelled]
        if not rest or self.stop.is_set():
            return
        name = chance.choice(rest)
        job = self._call("cancel", lambda: client.cancel_job(name, timeout=5))
        state = STATES[job.state]
        if state in ENDED or job.cancel_requested:
            if state not in ("SUCCEEDED", "FAILED"):
                self.cancelled.add(name)
        else:
            self.broken.append(f"{name} was cancelled and is {state}")
        if state == "CANCELLED" and chance.random() < 0.5:
            self.deleted.add(name)  # before: others must not miss it
            try:
                self._call("delete", lambda: client.delete_job(name, timeout=5))
            except Exception as error:  # pylint: disable=broad-except
                if type(error).__name__ != "NotFoundError":  # an attempt whose answer was lost has deleted it
                    raise

    def _upload(self, client, chance):
        self.stop.wait(1 + chance.random() * 4)
        name = f"datasets/u{len(self.uploads)}"
        self._call("upload", lambda: client.upload_dataset(self.dataset, name, timeout=5))
        self.uploads.add(name)

    def _promote(self, client, chance):
        version = chance.choice([1, 2])
        self.aliases.append(version)
        self._call("promote", lambda: client.set_model_alias(
            "models/small/aliases/serving", f"models/small/versions/{version}", timeout=5))
        self.aliases[:] = [version]
        self.stop.wait(chance.random())

    def _watch(self, client, chance):
        """Follows a job to its end: consecutive numbers, then one that has ended."""
        rest = [job for job in list(self.trainings) if job not in self.deleted]
        if not rest:
            self.stop.wait(0.5)
            return
        name, last, state = rest[-1], 0, ""
        while state not in ENDED and not self.stop.is_set():
            try:
                for event in client.watch_job(name, after_sequence=last, timeout=20):
                    state = STATES[event.state]
                    if state not in ENDED and event.progress.sequence != last + 1:
                        self.broken.append(f"{name}: event {event.progress.sequence} follows {last}")
                    last = max(last, event.progress.sequence)
            except Exception as error:  # pylint: disable=broad-except
                if type(error).__name__ == "NotFoundError" and name in self.deleted:
                    return
                if type(error).__name__ not in ("UnavailableError", "DeadlineExceededError"):
                    raise
                self.stop.wait(0.5)
        self.calls["watch"] += 1


class Chaos:
    """Breaks things and mends them."""

    def __init__(self, fleet, chance):
        self.fleet, self.chance = fleet, chance
        self.done = collections.Counter()
        self._mends = []  # (time, what is mended, how)
        self._broken = set()  # names of servers that are not to be counted on

    def mend_due(self):
        for mend in list(self._mends):
            if time.monotonic() >= mend[0]:
                self._mends.remove(mend)
                mend[2]()
        for server in self.fleet.servers:
            # As systemd does: it needs the database to start.
            if not server.is_running() and not any(mend[1] is server for mend in self._mends):
                server.start(server.program)
            if server.name in self._broken and self.fleet.is_up(server) and not any(
                    mend[1] is server for mend in self._mends):
                self._broken.discard(server.name)

    def mend_all(self):
        while self._mends or self._broken:
            self.mend_due()
            time.sleep(0.1)

    def wait(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.mend_due()
            time.sleep(0.1)

    def kill(self, server):
        self._broken.add(server.name)
        server.signal(signal.SIGKILL)
        server.process.wait()
        self._mends.append((time.monotonic() + self.chance.uniform(0.5, 8), server, lambda: server.start(server.program)))
        self.done["kill"] += 1

    def break_something(self, kind):
        """One round. Waits until enough is whole for it."""
        if kind == "database":
            self.fleet.cluster.stop_immediately()
            self.wait(self.chance.uniform(0, 4))
            self.fleet.cluster.start()
            self.done[kind] += 1
            return "database"
        give_up = time.monotonic() + PATIENCE_S
        while len(self._broken) > 1:
            check(time.monotonic() < give_up, f"{sorted(self._broken)} come back")
            self.wait(0.1)
        server = self.chance.choice([server for server in self.fleet.servers if server.name not in self._broken])
        self._broken.add(server.name)
        if kind == "kill":
            self.kill(server)
            return server.name
        after = self.chance.uniform(0.5, 8)
        if kind == "freeze":
            server.signal(signal.SIGSTOP)
            after = LEASE_S + self.chance.uniform(1, 4)
            mend = lambda: server.signal(signal.SIGCONT)
        else:  # "database link" or "edge link"
            link = "db" if kind == "database link" else "edge"
            self.fleet.network.set_link(link, server.i, "down")
            after = self.chance.choice([after, LEASE_S + 3])
            mend = lambda: self.fleet.network.set_link(link, server.i, "up")
        self._mends.append((time.monotonic() + after, server, mend))
        self.done[kind] += 1
        return server.name


def lose_uploading_server(fleet, callers, chaos):
    """Kills the server through which an upload goes, in its middle: the caller goes on through another one."""
    from maneuver import uploads
    uploads.CHUNK_BYTES = 64 * 1024
    folder = fleet.make_dataset("resumed", 60)
    killed, shown = [], []  # [bytes on the disk], all that the caller was shown since

    def parts():
        slots = (fleet.data / "datasets" / ".uploads").glob("resumed.*")
        return [file for slot in slots for file in slot.iterdir() if not file.name.startswith(".")]

    def on_progress(progress):
        if killed:
            shown.append(progress.there)
        elif progress.there > progress.total / 2:
            owners = lambda: [server for server in fleet.servers if server.has_open(parts())]
            wait_for(lambda: sum(file.stat().st_size for file in parts()) > 0 and owners(), "bytes have arrived")
            chaos.kill(owners()[0])
            killed.append(sum(file.stat().st_size for file in parts()))

    callers.fleet.client().upload_dataset(folder, "datasets/resumed", on_progress=on_progress, timeout=PATIENCE_S)
    check(killed, "the upload was interrupted")
    check(min(shown) == killed[0], f"of {killed[0]} bytes that had arrived none was sent again: from {min(shown)}")
    for file in folder.iterdir():
        there = (fleet.data / "datasets" / "resumed" / file.name).read_bytes()
        check(file.suffix == ".json" or there == file.read_bytes(), f"{file.name} is whole")
    print(f"an upload whose server was killed went on through another one, from byte {killed[0]} of {shown[-1]}", flush=True)


def versions_on_disk(fleet, model):
    folder = fleet.data / model
    return {path.name for path in folder.iterdir() if path.name.isdigit()} if folder.exists() else set()


def check_promises(fleet, callers, weights):
    client = fleet.client()
    jobs = {}

    def all_ended():
        jobs.update({job.name: job for job in fleet.patiently(lambda: list(client.list_jobs(timeout=20)))})
        return all(STATES[job.state] in ENDED for job in jobs.values())

    give_up = time.monotonic() + 600
    while not all_ended():
        check(time.monotonic() < give_up, "all jobs end")
        time.sleep(0.5)
    ends = collections.Counter()
    made = collections.defaultdict(set)
    for name, model in callers.trainings.items():
        if name in callers.deleted:
            check(name not in jobs, f"{name} was deleted and is there")
            continue
        check(name in jobs, f"{name} was acknowledged and is lost")
        job = jobs[name]
        state = STATES[job.state]
        ends[state] += 1
        check(state != "FAILED", f"{name} failed: {job.error}")
        if state == "CANCELLED":
            check(name in callers.cancelled, f"{name} is CANCELLED and nobody asked for it")
            check(not job.model_version, f"{name} was cancelled and has {job.model_version}")
            continue
        found = re.fullmatch(rf"{model}/versions/(\d+)", job.model_version)
        check(found, f"{name} of {model} has the version '{job.model_version}'")
        check(found[1] not in made[model], f"{job.model_version} has two jobs")
        made[model].add(found[1])
        file = fleet.data / model / found[1] / "weights.safetensors"
        check(file.read_bytes() == weights, f"{job.model_version} has the weights of an undisturbed run")
    check(ends["SUCCEEDED"] > 0, f"some training succeeds: {ends}")
    check(not (set(jobs) - set(callers.trainings) - {callers.calm}), "there are jobs that nobody asked for")
    interrupted = Moves(fleet.cluster, MOVES | DELETED).counts["RUNNING", "PENDING"]

    def listed(server, model):
        names = [version.name for version in fleet.client(server.address).list_model_versions()]
        return {name.rsplit("/", 1)[1] for name in names if name.startswith(f"{model}/")}

    for model in {f"models/m{i}" for i in range(3)}:
        for server in fleet.servers:
            # A server learns within seconds of a version that another one has published.
            wait_for(lambda: made[model] <= listed(server, model), f"{server.name} lists {made[model]} of {model}")
            check(listed(server, model) == made[model], f"{model}: {listed(server, model)}, made {made[model]}")
        check(versions_on_disk(fleet, model) == made[model], f"{model}: {versions_on_disk(fleet, model)} on disk")
    datasets = {dataset.name: dataset for dataset in client.list_datasets()}
    for name in callers.uploads:
        check(name in datasets, f"{name} was acknowledged and is lost")
        for shard in datasets[name].shards:
            there = (fleet.data / name / shard.file).read_bytes()
            check(there == (callers.dataset / shard.file).read_bytes(), f"{name}/{shard.file} is whole")
    serving = int(fleet.cluster.ask("SELECT version FROM aliases WHERE model = 'small'")[0][0])
    check(serving in callers.aliases, f"small serves {serving} and {callers.aliases} was acknowledged")
    for server in fleet.servers:
        direct = fleet.client(server.address)
        wait_for(lambda: direct.predict(callers.scene, model="models/small").model_version ==
                 f"models/small/versions/{serving}", f"{server.name} serves what the alias says")
    check(not callers.broken, "\n".join(callers.broken))
    return ends, interrupted


def prepare_callers(options, fleet):
    """Returns callers, not yet started, and the weights of a training that nothing disturbed."""
    import maneuver
    dataset = fleet.make_dataset("town", 8)
    scene = maneuver.load_scenario(fleet.make_scene(dataset))
    settings = dict(SETTINGS, optimization=dict(SETTINGS["optimization"], joint_epochs=options.epochs))
    client = fleet.client()
    client.upload_dataset(dataset, "datasets/town")
    callers = Callers(fleet, scene, dataset, settings, options.seed)
    callers.expect(fleet.client(fleet.servers[0].address))
    record(fleet.cluster)
    callers.calm = client.train("models/calm", ["datasets/town"], settings).name
    calm = client.wait_for_job(callers.calm)
    check(STATES[calm.state] == "SUCCEEDED", f"the undisturbed training: {calm.error}")
    weights = (fleet.data / "models" / "calm" / "1" / "weights.safetensors").read_bytes()
    return callers, weights


def run(options, fleet, kinds):
    callers, weights = prepare_callers(options, fleet)
    chance = random.Random(options.seed)
    chaos = Chaos(fleet, chance)
    begun = time.monotonic()
    callers.start()
    rounds = 0
    try:
        lose_uploading_server(fleet, callers, chaos)
        chaos.wait(2)
        while rounds < options.rounds and time.monotonic() < begun + 60 * options.minutes and not callers.broken:
            # Each kind once in so many rounds as there are kinds.
            if rounds % len(kinds) == 0:
                turn = chance.sample(kinds, len(kinds))
            kind = turn[rounds % len(kinds)]
            name = chaos.break_something(kind)
            rounds += 1
            print(f"{time.monotonic() - begun:6.1f} s, round {rounds}: {kind}, {name}", flush=True)
            chaos.wait(chance.uniform(0.5, 4))
    finally:
        callers_stop = threading.Thread(target=callers.end)
        callers_stop.start()
        while callers_stop.is_alive():
            chaos.mend_due()
            time.sleep(0.1)
    chaos.mend_all()
    ends, interrupted = check_promises(fleet, callers, weights)
    calls = ", ".join(f"{count} {name}" for name, count in sorted(callers.calls.items()))
    print(f"{rounds} rounds in {time.monotonic() - begun:.0f} s ({', '.join(f'{n} {k}' for k, n in sorted(chaos.done.items()))});"
          f" calls: {calls}; slowest prediction {callers.slowest_prediction_s:.1f} s;"
          f" jobs: {dict(ends)}, {len(callers.deleted)} deleted, {interrupted} attempts went on elsewhere;"
          f" {len(callers.uploads)} datasets. Every promise was kept.")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_programs(parser)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=60, help="no round begins after so long")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--epochs", type=int, default=6, help="joint epochs of each training")
    parser.add_argument("--keep", action="store_true", help="keep the folder of the servers if a promise is broken")
    options = parser.parse_args()
    in_network = enter()
    prepare(options)
    work = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-chaos-"))
    work.chmod(0o755)  # for PostgreSQL's user
    fleet = None
    try:
        fleet = SharingFleet(options, work, in_network, flags=FLAGS)
        kinds = ["kill", "freeze", "database"]
        if isinstance(fleet.network, Network):
            kinds += ["database link", "edge link"]
        run(options, fleet, kinds)
    except BaseException:
        if fleet:
            fleet.last_lines()
        if options.keep:
            print(f"kept: {work}", file=sys.stderr)
            work = None
        raise
    finally:
        if fleet:
            fleet.stop()
        if work:
            shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    main()
