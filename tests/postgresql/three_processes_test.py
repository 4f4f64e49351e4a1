#!/usr/bin/python3
"""Sixty callers of three servers that share one store create, cancel, resume, delete, watch and list jobs at once.

The servers are real; their trainer is a script that succeeds, fails, or dies once after a checkpoint, as the seed of a
job says, and whose model is a copy. A trigger in the database notes each move of each job in order, and they are held
against docs/guides/jobs.md (moves.py): each job ends once, is run by one server at a time, and publishes one version if
it succeeds. tests/unit/server/jobs/job_concurrency_test.cc does the same within one process over the embedded store.

Needs PostgreSQL 15 and HAProxy of Debian; skips (77) without them.
"""

import argparse
import collections
import pathlib
import random
import shutil
import tempfile
import threading

from moves import DELETED, ENDED, MOVES, RESUMED, STATES, Moves, record
from sharing import SharingFleet, add_programs, check, enter, prepare, wait_for

TRAINER = """#!/bin/sh
while [ $# -gt 0 ]; do
  case $1 in --output) output=$2;; --settings) settings=$2;; --checkpoints) checkpoints=$2;; esac
  shift
done
seed=$(sed -n 's/.*"seed": "\\([0-9]*\\)".*/\\1/p' "$settings")
mkdir -p "$checkpoints"
echo '{"phase":"joint","epochReport":{}}'
case $((seed %% 4)) in
  0) exit 80;;
  1) [ -e "$checkpoints/checkpoint-000001" ] || { : > "$checkpoints/checkpoint-000001"; kill -9 $$; };;
esac
cp -r "%s" "$output"
"""


class Caller:
    """Everything that a caller may do, in an order of its own; what it is told must be possible."""

    def __init__(self, clients, number, errors):
        self._clients, self._number, self._errors = clients, number, errors
        self._chance = random.Random(number)
        self.broken = ""

    def run(self):
        try:
            self._run()
        except BaseException as error:  # pylint: disable=broad-except
            self.broken = f"caller {self._number}: {type(error).__name__}: {error}"

    def _client(self):
        return self._chance.choice(self._clients)

    def _run(self):
        pair = self._number // 2
        job = self._client().train("models/m", ["datasets/town"], {"seed": pair + 1}, request_id=f"pair-{pair}",
                                   priority=pair % 3).name
        for _ in range(4):
            act = self._chance.choice([self._watch, self._cancel, self._resume, self._delete, self._list])
            try:
                act(job)
            except self._errors.NotFoundError:
                pass  # the other of the pair has deleted it
            except self._errors.FailedPreconditionError:
                check(act in (self._resume, self._delete), f"{act.__name__} is refused")

    def _watch(self, job):
        last, state = 0, ""
        for event in self._client().watch_job(job, timeout=120):
            state = STATES[event.state]
            check(state in ENDED or event.progress.sequence == last + 1, f"event {event.progress.sequence} after {last}")
            last = max(last, event.progress.sequence)
        check(state in ENDED, f"a watch ends with {state}")

    def _cancel(self, job):
        cancelled = self._client().cancel_job(job)
        check(STATES[cancelled.state] in ENDED or cancelled.cancel_requested, f"cancelled: {cancelled}")

    def _resume(self, job):
        state = STATES[self._client().resume_job(job).state]
        check(state in ("PENDING", "RUNNING"), f"resumed: {state}")

    def _delete(self, job):
        self._client().delete_job(job)

    def _list(self, _):
        list(self._client().list_jobs())


def run(options, fleet, errors):
    record(fleet.cluster)
    client = fleet.client(fleet.servers[0].address)
    client.upload_dataset(fleet.make_dataset("town", 8), "datasets/town")
    clients = [fleet.client(server.address) for server in fleet.servers]
    callers = [Caller(clients, number, errors) for number in range(options.callers)]
    threads = [threading.Thread(target=caller.run) for caller in callers]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    check(not any(caller.broken for caller in callers), "\n".join(caller.broken for caller in callers if caller.broken))
    jobs = {}

    def all_ended():
        jobs.clear()
        jobs.update({job.name: job for job in client.list_jobs()})
        return all(STATES[job.state] in ENDED for job in jobs.values())

    wait_for(all_ended, "all jobs end")
    moves = Moves(fleet.cluster, MOVES | RESUMED | DELETED, most_running=len(fleet.servers))
    check({name: STATES[job.state] for name, job in jobs.items()} == moves.states, "the jobs are as their moves left them")
    succeeded = sum(moves.ends.values())
    wait_for(lambda: len(list(client.list_model_versions("models/m"))) == succeeded,
             f"there is one version for each of {succeeded} jobs that succeeded, deleted ones among them")
    on_disk = [path for path in (fleet.data / "models" / "m").iterdir() if path.name.isdigit()]
    check(len(on_disk) == succeeded, f"{len(on_disk)} versions on disk, {succeeded} jobs succeeded")
    makers = collections.Counter((path / "made_by").read_text() for path in on_disk)
    check(max(makers.values()) == 1, f"a job has two versions: {makers}")
    folders = {"jobs/" + path.name for path in (fleet.data / "jobs").iterdir()}
    check(folders >= set(jobs), "each job has its folder")
    by_server = [server.log.read_text().count("job started") for server in fleet.servers]
    check(min(by_server) > 0, f"each server ran some: {by_server}")
    counts = moves.counts
    check(counts["RUNNING", "PENDING"] > 0 and succeeded > 3, f"the callers did something: {counts}")
    print(f"{options.callers} callers, {len(moves.ends)} jobs, {sum(counts.values())} moves, each allowed: {succeeded} succeeded,"
          f" {counts['RUNNING', 'PENDING']} interrupted, {sum(counts[move] for move in RESUMED)} resumed,"
          f" {sum(counts[move] for move in DELETED)} deleted; run by {by_server}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_programs(parser)
    parser.add_argument("--callers", type=int, default=60)
    options = parser.parse_args()
    in_network = enter()
    prepare(options)
    import maneuver
    work = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-three-"))
    work.chmod(0o755)  # for PostgreSQL's user
    fleet = None
    try:
        options.trainer = work / "trainer"
        options.trainer.write_text(TRAINER % (work / "data" / "models" / "small" / "1"))
        options.trainer.chmod(0o700)
        fleet = SharingFleet(options, work, in_network)
        run(options, fleet, maneuver.errors)
    except BaseException:
        if fleet:
            fleet.last_lines()
        raise
    finally:
        if fleet:
            fleet.stop()
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    main()
