#!/usr/bin/python3
"""What a server makes of its data folder: its modes, its damage, and what it may not read.

Needs rsync and sqlite3.
"""

import argparse
import json
import os
import pathlib
import sqlite3
import stat
import subprocess
import sys
import tempfile
import unittest

from backup_test import PATIENCE_S, wait_for

DEPLOY = pathlib.Path(__file__).resolve().parent.parent.parent / "deploy"
ENDED = ("JOB_STATE_FAILED", "JOB_STATE_CANCELLED")
options = None


def mode_of(path):
    return oct(stat.S_IMODE(os.stat(path).st_mode))


class Server:
    """A server of a data folder. No job of it learns anything: its trainer is `false`."""

    def __init__(self, data, before=(), *arguments):
        ports = data.with_suffix(".ports")
        ports.unlink(missing_ok=True)
        self.log = data.with_suffix(".log")
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                [*before, options.maneuverd, "--data-dir", data, "--listen", "127.0.0.1:0", "--metrics-listen", "none",
                 "--port-file", ports, "--trainer-command", "false", *arguments], stdout=log, stderr=log)
        wait_for(lambda: ports.exists() or self.process.poll() is not None, "the server listens")
        self.address = json.loads(ports.read_text())["grpc"] if ports.exists() else None

    def run(self, *arguments):
        return subprocess.run([options.maneuver, "--server", self.address, "--output", "json", *map(str, arguments)],
                              capture_output=True, text=True)

    def maneuver(self, *arguments):
        done = self.run(*arguments)
        if done.returncode != 0:
            raise RuntimeError(f"maneuver {arguments}: {done.stderr}")
        return json.loads(done.stdout) if done.stdout.strip() else None

    def refusal(self, *arguments):
        """What a call that must fail answered: its code and its reason."""
        done = self.run(*arguments)
        if done.returncode == 0:
            raise RuntimeError(f"maneuver {arguments} did not fail: {done.stdout}")
        error = json.loads(done.stderr)["error"]
        return error["code"], error.get("reason")

    def ended_job(self):
        job = self.maneuver("train", "town", "--dataset", "town", "--detach")["name"]
        self.run("job", "cancel", job)
        wait_for(lambda: self.maneuver("job", "show", job)["state"] in ENDED, "the job ends")
        return job

    def stop(self):
        self.process.terminate()
        self.process.wait(PATIENCE_S)


class DataFolderTest(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.work = pathlib.Path(self._folder.name)
        self.data = self.work / "data"

    def start(self, *arguments):
        server = Server(self.data, *arguments)
        self.addCleanup(server.stop)
        self.assertIsNotNone(server.address, server.log.read_text())
        return server

    def upload_town(self, server):
        server.maneuver("synthesize", self.work / "town", "--recordings", 2)
        server.maneuver("dataset", "upload", self.work / "town", "town")

    def test_a_folder_that_others_can_enter_is_closed_and_so_is_all_that_the_server_writes(self):
        self.data.mkdir()
        self.data.chmod(0o755)  # as mkdir makes it, by hand
        server = self.start()
        self.upload_town(server)
        server.ended_job()
        self.assertEqual(mode_of(self.data), "0o700")
        modes = {(path.is_dir(), mode_of(path)) for path in self.data.rglob("*")}
        self.assertEqual(modes, {(True, "0o700"), (False, "0o600")})
        self.assertIn("other users could enter the data folder; its mode is 700 now", server.log.read_text())

    def test_a_folder_that_only_a_group_can_enter_keeps_its_mode(self):
        self.data.mkdir()
        self.data.chmod(0o750)  # as the package makes it
        self.start()
        self.assertEqual(mode_of(self.data), "0o750")

    def test_a_sticky_folder_stays_and_is_warned_of(self):
        self.data.mkdir()
        self.data.chmod(0o1777)  # as /tmp
        server = self.start()
        self.assertEqual(mode_of(self.data), "0o1777")
        self.assertIn("other users can enter the data folder", server.log.read_text())

    def test_a_folder_of_another_user_stays_and_is_warned_of(self):
        if os.getuid() != 0:
            self.skipTest("only root can give a folder away")
        self.data.mkdir()
        os.chown(self.data, 65534, 65534)
        self.data.chmod(0o777)
        server = self.start(WITHOUT_CAPABILITIES)
        self.assertEqual(mode_of(self.data), "0o777")
        self.assertIn("other users can enter the data folder", server.log.read_text())

    def test_a_file_that_the_server_may_not_read_or_write_is_its_own_fault_and_not_the_callers(self):
        server = self.start(WITHOUT_CAPABILITIES)
        self.upload_town(server)
        manifest = self.data / "datasets" / "town" / "dataset.json"
        manifest.chmod(0)
        self.assertEqual(server.refusal("dataset", "show", "town"), ("INTERNAL", "STORAGE_INACCESSIBLE"))
        manifest.chmod(0o600)
        (self.data / "jobs").chmod(0o500)
        self.assertEqual(server.refusal("train", "town", "--dataset", "town", "--detach"),
                         ("INTERNAL", "STORAGE_INACCESSIBLE"))
        (self.data / "jobs").chmod(0o700)
        server.ended_job()

    def test_a_damaged_job_is_listed_by_its_name_and_the_others_as_they_are(self):
        server = self.start()
        self.upload_town(server)
        jobs = [server.ended_job() for _ in range(2)]
        with sqlite3.connect(self.data / "maneuver.db", timeout=PATIENCE_S) as database:
            database.execute("UPDATE jobs SET job = x'00' WHERE name = ?", (jobs[0],))
        database.close()
        self.assertEqual(server.refusal("job", "show", jobs[0]), ("DATA_LOSS", "STORAGE_DAMAGED"))
        newer, damaged = server.maneuver("job", "list")["jobs"]
        self.assertEqual(newer["name"], jobs[1])
        self.assertIn(newer["state"], ENDED)
        self.assertEqual(damaged["name"], jobs[0])
        self.assertEqual(damaged["error"]["code"], 15)  # DATA_LOSS
        self.assertEqual(damaged["error"]["details"][0]["reason"], "STORAGE_DAMAGED")
        if options.python:
            self.assertEqual([job.name for job in jobs_in_python(server) if job.error.code == 15], jobs[:1])

    def test_repair_brings_the_jobs_and_aliases_of_a_backup_back(self):
        models = self.data / "models" / "small"
        models.mkdir(parents=True)
        for version in (1, 2):
            subprocess.run([options.small_model, models / str(version), str(version)], check=True)
        server = self.start()
        self.upload_town(server)
        server.maneuver("model", "promote", "small/2")
        job = server.ended_job()
        before = server.maneuver("job", "list"), server.maneuver("model", "list")
        backup = subprocess.run([DEPLOY / "backup.sh", self.data, self.work / "backup"], capture_output=True, text=True)
        self.assertEqual(backup.returncode, 0, backup.stderr)
        server.stop()
        with open(self.data / "maneuver.db", "r+b") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(4096)
            file.write(b"\x5a" * (size - 4096))

        refused = Server(self.data)
        self.assertIsNone(refused.address)
        self.assertEqual(refused.process.returncode, 1)
        self.assertIn("is damaged. Bring it back with maneuverd repair --backup BACKUP: docs/guides/backup.md",
                      refused.log.read_text())
        repaired = subprocess.run([options.maneuverd, "repair", "--data-dir", self.data, "--backup",
                                   self.work / "backup"], capture_output=True, text=True)
        self.assertEqual(repaired.returncode, 0, repaired.stderr)
        self.assertIn("as they were backed up", repaired.stdout)
        self.assertTrue((self.data / "maneuver.db.damaged").exists())

        again = self.start()
        self.assertEqual(before, (again.maneuver("job", "list"), again.maneuver("model", "list")))
        self.assertIn("models/small/versions/2", json.dumps(again.maneuver("model", "show", "small@serving")))
        self.assertIn(again.maneuver("job", "show", job)["state"], ENDED)


# As root, and yet bound by the modes of files.
WITHOUT_CAPABILITIES = ("setpriv", "--bounding-set=-all", "--inh-caps=-all")


def jobs_in_python(server):
    """All jobs that the Python package lists."""
    import maneuver  # from --python
    with maneuver.Client(server.address) as client:
        return list(client.list_jobs())


def main():
    global options
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", required=True, type=pathlib.Path)
    parser.add_argument("--maneuver", required=True, type=pathlib.Path)
    parser.add_argument("--small-model", required=True, type=pathlib.Path, help="program that writes one")
    parser.add_argument("--python", type=pathlib.Path, help="folder of the Python package, if it was built")
    options, rest = parser.parse_known_args()
    if options.python:
        sys.path.insert(0, str(options.python))
    unittest.main(argv=[sys.argv[0], *rest])


if __name__ == "__main__":
    main()
