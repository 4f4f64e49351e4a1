#!/usr/bin/python3
"""Several tasks of a Slurm job learn one model, or tag, on a cluster of two nodes that this test starts.

  tests/ranks/slurm_test.py --maneuver PROGRAM --trainer PROGRAM
"""

import argparse
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

from slurm_cluster import SlurmCluster, missing_programs, wait_for
from training import Training

SCRIPT = pathlib.Path(__file__).resolve().parent.parent.parent / "deploy" / "slurm" / "train.sbatch"
GUIDE = SCRIPT.parent.parent.parent / "docs" / "guides" / "tagging.md"
options = argparse.Namespace(maneuver=None, trainer=None)


class SlurmTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="maneuver-slurm.")
        cls.addClassCleanup(folder.cleanup)
        work = pathlib.Path(folder.name)
        (work / "cluster").mkdir()
        cls.training = Training(work, options.maneuver, options.trainer)
        cls.cluster = SlurmCluster(work / "cluster")
        # Both nodes are this machine.
        cls.cluster.environment.update(MASTER_ADDR="127.0.0.1", MANEUVER_TRAINER=options.trainer)
        cls.cluster.__enter__()
        cls.addClassCleanup(cls.cluster.__exit__, None, None, None)
        cls.cluster.run("srun", "-n1", *cls.training.arguments("one"))

    def submit(self, *arguments):
        return self.cluster.run("sbatch", "--parsable", *arguments).strip()

    def fields(self, job):
        return dict(field.split("=", 1) for field in self.cluster.run("scontrol", "show", "job", "-o", job).split()
                    if "=" in field)

    def wait_for_end(self, job, seconds=240):
        ended = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL")
        wait_for(lambda: self.fields(job)["JobState"] in ended, seconds, f"job {job} does not end")
        return self.fields(job)

    def tasks(self, folder):
        """The trainers that Slurm runs now on files of a folder: their ranks and process ids."""
        found = {}
        for process in pathlib.Path("/proc").iterdir():
            if not process.name.isdigit():
                continue
            try:
                command = (process / "cmdline").read_bytes().split(b"\0")
                variables = dict(v.split(b"=", 1) for v in (process / "environ").read_bytes().split(b"\0") if b"=" in v)
            except OSError:
                continue
            if command[0].decode() == self.training.trainer and b"SLURM_STEP_ID" in variables and \
                    str(folder).encode() in b" ".join(command):
                found[int(variables[b"SLURM_PROCID"])] = int(process.name)
        return found

    def test_a_step_of_two_tasks_learns_the_same_weights(self):
        self.cluster.run("srun", "-N2", "-n2", *self.training.arguments("two"))
        self.assertEqual(self.training.weights("two"), self.training.weights("one"))

    def test_a_job_of_a_server_that_starts_its_trainer_by_srun_learns_the_same_weights(self):
        with unittest.mock.patch.dict(os.environ, self.cluster.environment):
            server = self.training.serve("--trainer-command", "srun -n{ranks} --export=ALL")
        self.addCleanup(server.close)
        job = self.training.start_job(server, "town", 4)
        wait_for(lambda: set(self.tasks(server.folder)) == {0, 1, 2, 3}, 120, "Slurm does not run four tasks")
        server.maneuver("job", "watch", job)
        self.assertEqual(self.training.weights_of_version(server, "town"), self.training.weights("one"))

    def test_a_killed_task_is_requeued_and_ends_with_the_same_weights(self):
        folder = self.training.folder
        log = folder / "killed.log"
        job = self.submit("-N2", "-n2", "--output", str(log), str(SCRIPT), str(self.training.settings),
                          str(folder / "killed"), str(folder / "killed.checkpoints"), str(folder / "town"))
        wait_for(lambda: log.exists() and '"phase":"joint"' in log.read_text(), 120, "it does not learn")
        os.kill(self.tasks(folder)[1], signal.SIGKILL)
        ended = self.wait_for_end(job)
        self.assertEqual(ended["JobState"], "COMPLETED", log.read_text())
        self.assertEqual(ended["Restarts"], "1")
        self.assertIn("requeued", log.read_text())
        self.assertEqual(self.training.weights("killed"), self.training.weights("one"))

    def test_each_task_of_an_array_learns_a_model_of_its_own(self):
        folder = self.training.folder
        for name in ("settings", "models", "array.checkpoints"):
            (folder / name).mkdir()
        for seed in (1, 2):
            text = self.training.settings.read_text().replace('"seed": 7', f'"seed": {seed}')
            (folder / "settings" / f"{seed}.json").write_text(text)
        job = self.submit("--array=1-2", "-n2", "--output", str(folder / "array.%a.log"), str(SCRIPT),
                          f"{folder}/settings/%a.json", f"{folder}/models/%a", f"{folder}/array.checkpoints/%a",
                          str(folder / "town"))
        wait_for(lambda: not self.cluster.run("squeue", "-h", "-j", job).strip(), 240, "the array does not end")
        logs = "".join((folder / f"array.{seed}.log").read_text() for seed in (1, 2))
        weights = {seed: (folder / "models" / str(seed) / "weights.safetensors") for seed in (1, 2)}
        self.assertTrue(all(file.exists() for file in weights.values()), logs)
        self.assertNotEqual(weights[1].read_bytes(), weights[2].read_bytes())

    def test_an_array_tags_as_one_process_does(self):
        """By the script of the guide, with three tasks and other paths."""
        folder = self.training.folder
        (folder / "recordings").mkdir()
        for seed in range(4):
            subprocess.run([options.maneuver, "synthesize", folder / "recordings" / f"d{seed}", "--recordings", "1",
                            "--seed", str(seed)], check=True, capture_output=True)
        script = re.search(r"^```sh\n(#SBATCH --array=.*?)^```$", GUIDE.read_text(), re.MULTILINE | re.DOTALL)[1]
        for written, here in (("0-15", "0-2"), ("/16", "/3"), ("--cpus-per-task=8", "--cpus-per-task=1"),
                              ("maneuver tag", f"{options.maneuver} tag"), ("/data/recordings", f"{folder}/recordings"),
                              ("town-3", f"{folder}/one"), ("/data/tags", f"{folder}/tags")):
            self.assertIn(written, script)
            script = script.replace(written, here)
        (folder / "tag.sbatch").write_text("#!/bin/sh\n" + script)
        job = self.submit("--output", str(folder / "tag.%a.log"), str(folder / "tag.sbatch"))
        wait_for(lambda: not self.cluster.run("squeue", "-h", "-j", job).strip(), 240, "the array does not end")
        logs = "".join((folder / f"tag.{task}.log").read_text() for task in range(3))
        subprocess.run([options.maneuver, "tag", *sorted((folder / "recordings").iterdir()), "--model", folder / "one",
                        "-o", folder / "alone"], check=True, capture_output=True)
        tags = {file.name: file.read_bytes() for file in (folder / "tags").iterdir()}
        self.assertEqual(tags, {file.name: file.read_bytes() for file in (folder / "alone").iterdir()}, logs)
        self.assertEqual(len(tags), 1 + 2 * 4, logs)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuver", required=True)
    parser.add_argument("--trainer", required=True)
    _, rest = parser.parse_known_args(namespace=options)
    if missing := missing_programs():
        print(f"SKIPPED: {', '.join(missing)} not installed; apt-get install slurmctld slurmd slurm-client munge")
        sys.exit(0)
    if os.geteuid() != 0:
        print("SKIPPED: slurmd needs root")
        sys.exit(0)
    unittest.main(argv=[sys.argv[0], *rest])
