#!/usr/bin/python3
"""Three servers are upgraded one after the other, with a change of the tables before, under load: no call fails.

The callers are those of chaos_test.py: they train, upload, promote, cancel, delete, watch and predict, with retries, and
all that is checked there is checked here. First the tables get what the new release adds, while the old servers use
them. Then each server is stopped by SIGTERM and started as the new program. At the end one goes back to the old program.

  --maneuverd OLD --new NEW [--new-trainer TRAINER]   two builds; NEW makes its tables by `maneuverd store migrate`

Without --new there is one build, and the addition is a column that a later release might add. Needs PostgreSQL 15,
HAProxy and openssl of Debian; skips (77) without them.
"""

import argparse
import pathlib
import shutil
import signal
import tempfile
import time

from chaos_test import FLAGS, check_promises, prepare_callers
from sharing import SharingFleet, add_programs, check, enter, prepare

ADDITION = """
ALTER TABLE jobs ADD COLUMN later_release TEXT;
UPDATE store SET latest_version = latest_version + 1;
"""


def versions(fleet):
    row = fleet.cluster.ask("SELECT schema_version, coalesce((to_jsonb(store) ->> 'latest_version')::int8, schema_version)"
                            " FROM store")[0]
    return f"needed {row[0]}, latest {row[1]}"


def restart(fleet, server, program):
    """As a package's upgrade does: SIGTERM, and the new program once the old one has ended."""
    begun = time.monotonic()
    server.signal(signal.SIGTERM)
    server.process.wait(120)
    check(server.process.returncode == 0, f"{server.name} ends in order: {server.process.returncode}")
    server.start(program)
    fleet.wait_until_up(server)
    print(f"{server.name} is {program.parent.name}/{program.name} after {time.monotonic() - begun:.1f} s", flush=True)


def run(options, fleet):
    callers, weights = prepare_callers(options, fleet)
    before = versions(fleet)
    new = options.new or options.maneuverd
    callers.start()
    try:
        time.sleep(2)
        if options.new:
            made = fleet.migrate(options.new)
            check(made.returncode == 0, f"the tables are migrated while the old servers run: {made.stderr}")
            print(made.stdout.strip())
        else:
            done = fleet.cluster.sql(ADDITION)
            check(done.returncode == 0, done.stderr)
        check(versions(fleet) != before, f"the tables changed: {before}")
        # The old servers' next connections find the new tables.
        fleet.cluster.ask("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'maneuverd'")
        time.sleep(2)
        if options.new_trainer:
            options.trainer = options.new_trainer
        for server in fleet.servers:
            restart(fleet, server, new)
            time.sleep(1)
        restart(fleet, fleet.servers[0], options.maneuverd)
        time.sleep(1)
    finally:
        callers.end()
    ends, interrupted = check_promises(fleet, callers, weights)
    calls = ", ".join(f"{count} {name}" for name, count in sorted(callers.calls.items()))
    print(f"upgraded, schema {before} to {versions(fleet)}; calls: {calls}; slowest prediction "
          f"{callers.slowest_prediction_s:.1f} s; jobs: {dict(ends)}, {interrupted} attempts went on elsewhere. No call failed.")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_programs(parser)
    parser.add_argument("--new", type=pathlib.Path, help="maneuverd of the new release")
    parser.add_argument("--new-trainer", type=pathlib.Path, help="its trainer")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--epochs", type=int, default=6, help="joint epochs of each training")
    options = parser.parse_args()
    in_network = enter()
    prepare(options)
    work = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-upgrade-"))
    work.chmod(0o755)  # for PostgreSQL's user
    fleet = None
    try:
        fleet = SharingFleet(options, work, in_network, flags=FLAGS)
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
