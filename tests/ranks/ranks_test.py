#!/usr/bin/python3
"""Several processes learn one model: with the bits of one process, whatever happens to them on the way.

  tests/ranks/ranks_test.py --maneuver PROGRAM --trainer PROGRAM [--kills N] [--job-kills N] [--seed N]

maneuverd must lie beside the trainer. A loop of 60 kills in one test alone:

  ... --job-kills 60 RanksTest.test_a_job_of_two_ranks_survives_kills_of_its_ranks_and_of_its_server
"""

import argparse
import collections
import contextlib
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from training import (Training, children_of, descendants_of, end, rank_of, wait_for_phase,
                       wait_for_phase_of_job, wait_until_gone)

RANK_LOST = 83
PHASES = ("load", "pretrain", "place", "mixture", "joint", "posterior", "calibrate", "export")
options = argparse.Namespace(maneuver=None, trainer=None, kills=0, job_kills=0, seed=1)


class RanksTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="maneuver-ranks.")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.training = Training(cls.folder.name, options.maneuver, options.trainer)
        cls.training.learn("undisturbed", "--ranks", "1")

    def assert_same_weights(self, name):
        self.assertEqual(self.training.weights(name), self.training.weights("undisturbed"))

    def disturb(self, name, ranks, moment, what):
        """Runs `what` on the processes of the ranks once they learn. Returns exit status and errors."""
        process = self.training.start(name, "--ranks", str(ranks))
        try:
            wait_for_phase(process, *moment)
            pids = sorted(children_of(process.pid), key=rank_of)
            self.assertEqual(len(pids), ranks)
            what(process, pids)
            _, errors = process.communicate(timeout=60)
            wait_until_gone(pids)
            self.assertFalse((self.training.folder / name).exists())
            return process.returncode, errors
        finally:
            end(process)

    def test_two_processes_learn_the_same_weights_and_report_how_the_ranks_fare(self):
        reports = self.training.learn("two", "--ranks", "2")
        self.assert_same_weights("two")
        joint = [r for r in reports if r["phase"] == "joint" and r.get("rank_waiting_fractions")]
        self.assertTrue(joint)
        self.assertEqual({len(r["rank_waiting_fractions"]) for r in joint}, {2})
        self.assertTrue(all(0.0 <= share <= 1.0 for r in joint for share in r["rank_waiting_fractions"]))
        self.assertGreater(joint[-1]["slowest_rank_step_seconds"], 0.0)

    def test_eight_processes_learn_the_same_weights(self):
        self.training.learn("eight", "--ranks", "8", "--rank-timeout", "60")
        self.assert_same_weights("eight")

    def hurt_a_rank(self, server, job, rank, number, hurt):
        """Sends a signal to a rank of the job once both run. `hurt` has the ranks of earlier calls.

        Returns whether they ran before the job ended.
        """
        for poll in itertools.count(1):
            ranks = {rank_of(pid): pid for pid in descendants_of(server.pid) if pid not in hurt}
            if {0, 1} <= ranks.keys():
                break
            if poll % 50 == 0:
                state = json.loads(server.maneuver("job", "show", job, "--output", "json"))["state"]
                if state not in ("JOB_STATE_PENDING", "JOB_STATE_RUNNING"):
                    return False
            time.sleep(0.02)
        hurt.update((ranks[0], ranks[1]))
        try:
            os.kill(ranks[rank], number)
        except ProcessLookupError:
            return False
        return True

    def test_a_job_of_two_ranks_survives_kills_of_its_ranks_and_of_its_server(self):
        """With --job-kills: until so many of random kinds, at random moments, up to four in each job."""
        server = self.training.serve_with_impatient_ranks()
        self.addCleanup(server.close)
        draw = random.Random(options.seed)
        kinds = ("kills of a rank", "frozen ranks", "kills of the server")
        counts, phases, hurt = collections.Counter(), collections.Counter(), set()

        def disturb(job, kind, phase, epoch):
            if not wait_for_phase_of_job(server, job, phase, epoch):
                return False
            if options.job_kills:
                time.sleep(draw.uniform(0.0, 0.3))  # anywhere in the phase
            if kind == kinds[2]:
                server.kill()
                server.start()
            elif not self.hurt_a_rank(server, job, draw.randrange(2),
                                      signal.SIGKILL if kind == kinds[0] else signal.SIGSTOP, hurt):
                return False
            counts[kind] += 1
            phases[phase] += 1
            return True

        for number in range(max(1, options.job_kills)):
            plan = zip(kinds, ("joint",) * 3, (1, 2, 3))
            if options.job_kills:
                most = min(4, options.job_kills - counts.total())
                plan = [(draw.choice(kinds), phase, draw.randint(1, 4) if phase == "joint" else 0)
                        for phase in sorted(draw.choices(PHASES, k=most), key=PHASES.index)]
            job = self.training.start_job(server, f"town-{number}", 2)
            for moment in plan:
                if not disturb(job, *moment):
                    break  # it has ended
            server.maneuver("job", "watch", job)
            weights = self.training.weights_of_version(server, f"town-{number}")
            self.assertEqual(weights, self.training.weights("undisturbed"))
            if options.job_kills:
                print(f"seed {options.seed}: {counts.total()} in {number + 1} jobs: {dict(counts)}, {dict(phases)}, "
                      f"weights {weights[:16]}", flush=True)
            if counts.total() >= options.job_kills:
                break
        self.assertGreater(counts.total(), 0, "each job ended before anything happened to it")

    def end_of_a_long_job(self, *flags):
        """Runs a job of two ranks, and cancels it once both run, unless flags are given to the server.

        Returns its last state as text, and whether both ran.
        """
        ran, seen = False, set()
        with contextlib.closing(self.training.serve_with_impatient_ranks(*flags)) as server:
            job = self.training.start_job(server, "long", 2, "--set", "optimization.joint_epochs=10000")
            while True:
                pids = descendants_of(server.pid)
                seen.update(pids)
                if not ran and {0, 1} <= {rank_of(pid) for pid in pids}:
                    ran = True
                    if not flags:
                        server.maneuver("job", "cancel", job)
                shown = server.maneuver("job", "show", job, "--output", "json")
                if json.loads(shown)["state"] not in ("JOB_STATE_PENDING", "JOB_STATE_RUNNING"):
                    break
            wait_until_gone(seen, patience_s=5)
            self.assertEqual(json.loads(server.maneuver("model", "list", "--output", "json"))["modelVersions"], [])
        return shown, ran

    def test_cancelling_a_job_and_its_time_limit_end_all_ranks_and_leave_no_model(self):
        shown, _ = self.end_of_a_long_job()
        self.assertEqual(json.loads(shown)["state"], "JOB_STATE_CANCELLED")
        for limit in (2, 10, 60):
            shown, ran = self.end_of_a_long_job("--job-time-limit", str(limit))
            self.assertIn("WALL_TIME_EXCEEDED", shown)
            if ran:
                break  # otherwise the machine is busy
        self.assertTrue(ran)

    def test_killed_frozen_and_stopped_ranks_end_in_time_and_the_next_run_goes_on(self):
        def kill(_, pids):
            os.kill(pids[1], signal.SIGKILL)

        status, errors = self.disturb("disturbed", 2, ("joint",), kill)
        self.assertEqual(status, RANK_LOST, errors)
        self.assertIn("rank 1 was killed by signal 9", errors.splitlines()[-1])

        def freeze(_, pids):
            os.kill(pids[0], signal.SIGSTOP)

        status, errors = self.disturb("disturbed", 4, ("joint", 2), freeze)
        self.assertEqual(status, RANK_LOST, errors)
        self.assertIn("did not answer within 2 s", errors)

        def stop(process, _):
            os.killpg(process.pid, signal.SIGTERM)  # as the server and a terminal do

        status, errors = self.disturb("disturbed", 2, ("joint", 3), stop)
        self.assertEqual(status, 128 + signal.SIGTERM, errors)
        reports = self.training.learn("disturbed", "--ranks", "2")
        self.assertNotIn("pretrain", {r["phase"] for r in reports})
        self.assert_same_weights("disturbed")

    def test_a_rank_that_dies_while_rank_0_works_alone_ends_the_run(self):
        def kill(_, pids):
            os.kill(pids[1], signal.SIGKILL)

        status, errors = self.disturb("alone", 2, ("pretrain",), kill)
        self.assertEqual(status, RANK_LOST, errors)

    def test_a_killed_launcher_takes_its_ranks_with_it(self):
        process = self.training.start("orphans", "--ranks", "2")
        try:
            wait_for_phase(process, "joint")
            pids = children_of(process.pid)
            process.kill()
            process.communicate(timeout=60)  # ends once no rank holds the pipe
            wait_until_gone(pids)
        finally:
            end(process)

    @unittest.skipUnless(os.geteuid() == 0 and shutil.which("ip"), "needs root and ip")
    def test_ranks_that_are_cut_off_from_each_other_end_in_time(self):
        name = f"mr{os.getpid() % 100000}"
        here, there = f"{name}a", f"{name}b"
        made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
        if made.returncode != 0:
            self.skipTest(f"no network namespaces here: {made.stderr.strip()}")
        self.addCleanup(subprocess.run, ["ip", "netns", "del", name], check=False)
        net = 10 + os.getpid() % 200
        for command in [f"ip link add {here} type veth peer name {there} netns {name}",
                        f"ip addr add 10.213.{net}.1/30 dev {here}", f"ip link set {here} up",
                        f"ip -n {name} addr add 10.213.{net}.2/30 dev {there}",
                        f"ip -n {name} link set {there} up", f"ip -n {name} link set lo up"]:
            subprocess.run(command.split(), check=True)

        def environment(rank):
            return dict(os.environ, RANK=str(rank), WORLD_SIZE="2", MASTER_ADDR=f"10.213.{net}.1",
                        MASTER_PORT="29517", GLOO_SOCKET_IFNAME=(here, there)[rank])

        first = self.training.start("cut", environment=environment(0))
        second = self.training.start("cut", environment=environment(1), before=("ip", "netns", "exec", name))
        try:
            wait_for_phase(first, "joint")
            subprocess.run(["ip", "link", "set", here, "down"], check=True)
            for process in (first, second):
                _, errors = process.communicate(timeout=60)
                self.assertEqual(process.returncode, RANK_LOST, errors)
                self.assertIn("start all ranks again", errors)
        finally:
            end(first)
            end(second)
        self.training.learn("cut", "--ranks", "2")
        self.assert_same_weights("cut")

    def test_many_kills_lose_nothing(self):
        """Only with --kills: kills or freezes a rank at a random moment, that many times."""
        if options.kills == 0:
            self.skipTest("without --kills")
        draw = random.Random(1)
        for i in range(options.kills):
            name = f"many{i // 4}"
            rank, number = draw.randrange(2), draw.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGSTOP])
            moment = draw.choice([("load", 0), ("pretrain",), ("joint",), ("joint", 2), ("posterior",)])
            if i % 4 == 0:
                moment = ("pretrain",)

            def hurt(_, pids):
                os.kill(pids[rank], number)

            try:
                status, errors = self.disturb(name, 2, moment, hurt)
                self.assertEqual(status, RANK_LOST, errors)
            except AssertionError as error:
                if "it ended before" not in str(error):
                    raise
            if i % 4 == 3 or i + 1 == options.kills:
                if not (self.training.folder / name).exists():
                    self.training.learn(name, "--ranks", str(draw.choice([1, 2, 4])))
                self.assert_same_weights(name)
                print(f"{i + 1} kills, weights {self.training.weights(name)[:16]}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuver", required=True)
    parser.add_argument("--trainer", required=True)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--job-kills", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1, help="of --job-kills")
    _, rest = parser.parse_known_args(namespace=options)
    unittest.main(argv=[sys.argv[0], *rest])
