#!/usr/bin/python3
"""Two hundred callers watch jobs on three servers: what that costs the database does not grow with their number.

Three trainings run and report, and seventeen wait. PostgreSQL counts the statements of the servers (pg_stat_statements)
with few watchers and with many. Each server asks once in two seconds how far all watched jobs are, and reads a job only
if it has news, once for all who watch it.

Needs PostgreSQL 15 and HAProxy of Debian; skips (77) without them.
"""

import argparse
import pathlib
import shutil
import tempfile
import threading
import time

from moves import ENDED, STATES
from sharing import SETTINGS, SharingFleet, add_programs, check, enter, prepare, wait_for

JOBS = 20
FEW = 20
# Of all servers. 200 callers that each asked for themselves would make 250 and more.
MOST_A_SECOND = 120
# What reads for watchers: a job, its progress, and how far all watched jobs are.
READING = ("SELECT number, job%name = $1", "SELECT sequence, progress FROM progress%", "SELECT name, state, coalesce%")


class Watchers:
    """Each follows one job until it ends or is told to stop."""

    def __init__(self, clients, jobs):
        self._clients, self._jobs = clients, jobs
        self._lock = threading.Lock()
        self.threads, self.watching, self.ended, self.events = [], 0, 0, 0
        self.broken = []

    def add(self, count):
        for _ in range(count):
            number = len(self.threads)
            # Each job is watched on each server.
            client = self._clients[number % len(self._clients)]
            job = self._jobs[number // len(self._clients) % len(self._jobs)]
            self.threads.append(threading.Thread(target=self._watch, args=(client, job)))
            self.threads[-1].start()

    def _watch(self, client, job):
        with self._lock:
            self.watching += 1
        last = 0
        try:
            for event in client.watch_job(job, timeout=600):
                if STATES[event.state] in ENDED:
                    with self._lock:
                        self.ended += 1
                elif event.progress.sequence != last + 1:
                    self.broken.append(f"{job}: event {event.progress.sequence} follows {last}")
                last = max(last, event.progress.sequence)
                self.events += 1
        except Exception as error:  # pylint: disable=broad-except
            self.broken.append(f"{job}: {error}")


def statements(fleet, pattern="%"):
    return int(fleet.cluster.ask(f"SELECT coalesce(sum(calls), 0) FROM pg_stat_statements WHERE query LIKE '{pattern}'"
                                 " AND query NOT LIKE '%pg_stat_statements%'")[0][0])


def rate(fleet, seconds):
    """Statements a second, all of them and those that read for watchers."""
    patterns = ("%", *READING)
    before = [statements(fleet, pattern) for pattern in patterns]
    begun = time.monotonic()
    time.sleep(seconds)
    after = [statements(fleet, pattern) for pattern in patterns]
    taken = time.monotonic() - begun
    rates = [(now - then) / taken for then, now in zip(before, after)]
    return rates[0], sum(rates[1:])


def run(options, fleet):
    check(fleet.cluster.sql("CREATE EXTENSION pg_stat_statements").returncode == 0, "PostgreSQL counts statements")
    clients = [fleet.client(server.address) for server in fleet.servers]
    clients[0].upload_dataset(fleet.make_dataset("town", 8), "datasets/town")
    settings = dict(SETTINGS, optimization=dict(SETTINGS["optimization"], joint_epochs=10000))
    jobs = [clients[i % 3].train("models/m", ["datasets/town"], settings).name for i in range(JOBS)]
    wait_for(lambda: sum(STATES[job.state] == "RUNNING" for job in clients[0].list_jobs()) == 3, "three jobs run")
    watchers = Watchers(clients, jobs)
    time.sleep(3)
    print(f"without watchers: {rate(fleet, options.seconds)[0]:.1f} statements a second")
    for count in (FEW, options.watchers):
        watchers.add(count - len(watchers.threads))
        wait_for(lambda: watchers.watching == count, f"{count} callers watch")
        time.sleep(3)
        everything, reading = rate(fleet, options.seconds)
        print(f"{count} watchers: {everything:.1f} statements a second, {reading:.1f} of them for watchers", flush=True)
        check(reading < MOST_A_SECOND, f"{count} watchers cost {reading:.1f} statements a second")
    for job in jobs:
        clients[1].cancel_job(job)
    wait_for(lambda: watchers.ended == options.watchers or watchers.broken, "every watch ends with its job")
    check(not watchers.broken, "\n".join(watchers.broken[:10]))
    for pattern in READING:
        check(statements(fleet, pattern) > 0, f"the servers sent no statement like {pattern}")
    print(f"{watchers.events} events, none missed")
    for thread in watchers.threads:
        thread.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_programs(parser)
    parser.add_argument("--watchers", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=8, help="of each count")
    options = parser.parse_args()
    in_network = enter()
    prepare(options)
    work = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-watchers-"))
    work.chmod(0o755)  # for PostgreSQL's user
    fleet = None
    try:
        fleet = SharingFleet(options, work, in_network, settings=("shared_preload_libraries=pg_stat_statements",))
        run(options, fleet)
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
