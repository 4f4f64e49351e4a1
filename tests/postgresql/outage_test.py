#!/usr/bin/python3
"""Three servers lose their database, and then their data folder, while callers predict at a steady rate.

While the database is away (--outage seconds) predictions go on at the same rate, changes are answered UNAVAILABLE with
a delay after which to try again, and health stays SERVING. A training that runs meanwhile goes on by itself once it is
back, and ends with the weights of an undisturbed one.

Then the folder's file system hangs (a FUSE mount whose server is frozen) and fails (one whose server is gone): models
that are loaded answer, and health stays SERVING. While it fails, calls that need it are UNAVAILABLE and say which folder.
Once it is mounted again all is well by itself. Last, every write in it ends with EIO (fault_shim.cc).

Prints rates and latencies of predictions before, during and after. Needs PostgreSQL 15 and HAProxy of Debian; skips (77)
without them. The second half needs root and bindfs; it is left out without them, and that is said.
"""

import argparse
import contextlib
import errno
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "histories"))

from sharing import SETTINGS, SharingFleet, add_programs, check, enter, prepare, wait_for

RATE_HZ = 20
ANSWER_S = 30.0  # far more than an answer takes, on a busy machine too


class Pulse:
    """Predictions at a steady rate, whether or not those of before have been answered; each is tried once."""

    def __init__(self, client, scene):
        self._client, self._scene = client, scene
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._answers = []  # (when it began, seconds)
        self.failures = []
        self._threads = [threading.Thread(target=self._run, args=(i / RATE_HZ,)) for i in range(8)]
        self._begun = time.monotonic()
        for thread in self._threads:
            thread.start()

    def _run(self, offset):
        due = self._begun + offset
        while not self._stop.wait(max(0, due - time.monotonic())):
            begun = time.monotonic()
            try:
                self._client.predict(self._scene, model="models/small", timeout=ANSWER_S)
            except Exception as error:  # pylint: disable=broad-except
                self.failures.append(f"{begun - self._begun:.1f} s: {error}")
            with self._lock:
                self._answers.append((begun, time.monotonic() - begun))
            due += len(self._threads) / RATE_HZ

    def report(self, what, begun, ended):
        """Rate and latency of the calls that began then."""
        with self._lock:
            seconds = sorted(taken for when, taken in self._answers if begun <= when < ended)
        check(seconds, f"predictions {what}")
        rate = len(seconds) / (ended - begun)
        at = lambda share: 1000 * seconds[min(int(share * len(seconds)), len(seconds) - 1)]
        print(f"{what:32} {rate:6.1f} a second, p50 {at(0.5):6.1f} ms, p99 {at(0.99):6.1f} ms, "
              f"slowest {1000 * seconds[-1]:6.0f} ms", flush=True)

    def end(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()


class Window:
    """Time that a report is of."""

    def __init__(self, pulse, what):
        self._pulse, self._what, self._begun = pulse, what, time.monotonic()

    def end(self):
        self._pulse.report(self._what, self._begun, time.monotonic())


def store_available(server):
    page = urllib.request.urlopen(f"http://{server.metrics}/metrics", timeout=10).read().decode()
    return re.search(r"^maneuver_store_available (\d)", page, re.MULTILINE)[1] == "1"


def check_health(fleet, what):
    for server in fleet.servers:
        fleet.client(server.address, retries=0).check_health("maneuver.v1.PredictionService", timeout=5)
        check(fleet.is_up(server), f"HAProxy keeps {server.name} {what}")


def check_refused(client, job, ended, errors):
    """Every change says that the store is away, and when to come back."""
    changes = {
        "train": lambda: client.train("models/town", ["datasets/town"], timeout=10),
        "cancel": lambda: client.cancel_job(job, timeout=10),
        "resume": lambda: client.resume_job(ended, timeout=10),
        "delete": lambda: client.delete_job(ended, timeout=10),
        "list": lambda: list(client.list_jobs(timeout=10)),
        "promote": lambda: client.set_model_alias("models/small/aliases/serving", "models/small/versions/2", timeout=10),
        "remove an alias": lambda: client.delete_model_alias("models/small/aliases/serving", timeout=10),
        "delete a version": lambda: client.delete_model_version("models/small/versions/2", timeout=10),
        "list datasets": lambda: list(client.list_datasets(timeout=10)),
        "get a dataset": lambda: client.get_dataset("datasets/town", timeout=10),
        "delete a dataset": lambda: client.delete_dataset("datasets/town", timeout=10),
    }
    for name, change in changes.items():
        try:
            change()
        except errors.UnavailableError as error:
            check(error.reason == "STORE_UNAVAILABLE", f"{name}: {error} ({error.reason})")
            check(error.retry_delay and error.retry_delay > 0, f"{name} says when to come back")
        else:
            check(False, f"{name} was to be refused")


def lose_database(options, fleet, pulse, settings, calm, errors):
    direct = [fleet.client(server.address, retries=0) for server in fleet.servers]
    weights = (fleet.data / "models" / "calm" / "1" / "weights.safetensors").read_bytes()
    job = direct[0].train("models/outlived", ["datasets/town"], settings).name
    wait_for(lambda: any((fleet.data / job).glob("attempts/[0-9]*/checkpoints/checkpoint-*")), "a checkpoint")
    fleet.cluster.stop_immediately()
    window = Window(pulse, "while the database is away")
    end = time.monotonic() + options.outage
    rounds = 0
    while rounds == 0 or time.monotonic() < end:
        for client in direct:
            check_refused(client, job, calm, errors)
        check_health(fleet, "while the database is away")
        for server in fleet.servers:
            check(not store_available(server), "the metric says that the database is away")
        rounds += 1
        time.sleep(1)
    window.end()
    fleet.cluster.start()
    window = Window(pulse, "after it came back")
    for client, server in zip(direct, fleet.servers):
        wait_for(lambda: list_or_nothing(client, errors), f"{server.name} finds the database again")
        check(store_available(server), "the metric says that the database is back")
    ended = fleet.client().wait_for_job(job)
    check(ended.model_version == "models/outlived/versions/1", f"the training goes on by itself: {ended}")
    there = (fleet.data / "models" / "outlived" / "1" / "weights.safetensors").read_bytes()
    check(there == weights, "the weights are those of an undisturbed run")
    direct[1].set_model_alias("models/small/aliases/serving", "models/small/versions/2")
    follow_alias(fleet, pulse, 2)
    window.end()
    print(f"database away for {options.outage} s: {rounds * 33} changes refused, each UNAVAILABLE with a delay")


def list_or_nothing(client, errors):
    try:
        return list(client.list_jobs(timeout=10))
    except errors.UnavailableError:
        return None


def follow_alias(fleet, pulse, version):
    for server in fleet.servers:
        client = fleet.client(server.address)
        wait_for(lambda: client.predict(pulse._scene, model="models/small").model_version ==
                 f"models/small/versions/{version}", f"{server.name} serves version {version}")


class Volume:
    """A file system over a folder, that can hang and fail."""

    def __init__(self, folder, place):
        self._folder, self._place = folder, place
        place.mkdir(parents=True)
        self.mount()

    def mount(self):
        self._process = subprocess.Popen(["bindfs", "-f", self._folder, self._place])
        wait_for(lambda: os.path.ismount(self._place), "the file system is mounted")

    def hang(self):
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self):
        self._process.send_signal(signal.SIGCONT)

    def fail(self):
        self._process.kill()
        self._process.wait()

    def mount_again(self):
        subprocess.run(["umount", "--lazy", self._place], check=True)
        self.mount()

    def end(self):
        self.go_on()
        self._process.kill()
        subprocess.run(["umount", "--lazy", self._place], check=False)


def upload_once(client, upload):
    """Sends all of an upload in one call."""
    return upload._send([0] * len(upload._files), client._connection.deadline(10, 10))


def upload_dataset(fleet, client):
    return upload_once(client, DatasetUpload(client._connection, fleet.work / "town", "datasets/lost", None))


def upload_model(fleet, client):
    return upload_once(client, ModelUpload(client._connection, fleet.work / "small", "models/lost", None))


def check_folder_away(calls, errors):
    """Each call says that a folder is away, which one, and when to come back."""
    for folder, name, call in calls:
        try:
            call()
        except errors.UnavailableError as error:
            check(error.reason == "FOLDER_UNAVAILABLE", f"{name}: {error} ({error.reason})")
            check(error.metadata["folder"] == folder and f"folder {folder}" in str(error), f"{name} names {folder}: {error}")
            check(error.retry_delay and error.retry_delay > 0, f"{name} says when to come back")
        else:
            check(False, f"{name} was to be refused")


def check_folder_fails(fleet, errors):
    """Nothing is said to be gone, full or damaged that only cannot be reached now. The database knows the datasets."""
    for server in fleet.servers:
        client = fleet.client(server.address, retries=0)
        check([dataset.name for dataset in client.list_datasets(timeout=10)] == ["datasets/town"], "datasets are listed")
        check(client.get_dataset("datasets/town", timeout=10).recordings == 8, "a dataset is known")
        check_folder_away([
            ("datasets", "upload", lambda: upload_dataset(fleet, client)),
            ("datasets", "describe", lambda: client.describe_dataset("datasets/town", timeout=10)),
            ("datasets", "delete", lambda: client.delete_dataset("datasets/town", timeout=10)),
            ("datasets", "train", lambda: client.train("models/lost", ["datasets/town"], timeout=10)),
            ("models", "upload a model", lambda: upload_model(fleet, client)),
            # No server has loaded it: those that are loaded need no file.
            ("models", "promote", lambda: client.set_model_alias("models/spare/aliases/serving", "models/spare/versions/1",
                                                                 timeout=10)),
        ], errors)


def check_pages(fleet):
    """A page that asks the disk may hang, but not those after it: nobody would see the outage, nor a probe an answer."""
    for server in fleet.servers:
        answered = 0
        for _ in range(3):
            with contextlib.suppress(OSError), urllib.request.urlopen(f"http://{server.metrics}/metrics", timeout=2) as page:
                answered += b"maneuver_build_info" in page.read()
        print(f"{answered} of 3 pages of {server.name} while the folder hangs")
        check(answered >= 2, "a page after the one that hangs is answered")


def lose_volume(options, fleet, pulse, volume, errors):
    client = fleet.client()
    for what, lose, mend in (("while the folder hangs", volume.hang, volume.go_on),
                             ("while the folder fails", volume.fail, volume.mount_again)):
        lose()
        window = Window(pulse, what)
        end = time.monotonic() + options.volume_outage
        # Calls that need the folder wait or fail; they do not keep others from being answered.
        asking = [threading.Thread(target=ask_folder, args=(fleet.client(server.address, retries=0),))
                  for server in fleet.servers]
        for thread in asking:
            thread.start()
        if lose == volume.fail:
            check_folder_fails(fleet, errors)
        else:
            check_pages(fleet)
        while time.monotonic() < end:
            check_health(fleet, what)
            list(client.list_jobs(timeout=20))
            time.sleep(0.5)
        window.end()
        mend()
        window = Window(pulse, "after it is back")
        for thread in asking:
            thread.join()
        for server in fleet.servers:
            direct = fleet.client(server.address)
            check([dataset.name for dataset in direct.list_datasets()] == ["datasets/town"], "the dataset is there")
        job = client.train("models/after", ["datasets/town"], fleet.settings)
        check(client.wait_for_job(job).model_version, "a training works again")
        window.end()
    print(f"folder away for {options.volume_outage} s, hanging and failing: loaded models answered")


def fail_writes(fleet, faults, errors):
    """A soft NFS mount whose server is away, or a disk that breaks, says EIO."""
    client = fleet.client(fleet.servers[0].address, retries=0)
    faults.arm(errno.EIO, 0, 10**9)
    check_folder_away([
        ("datasets", "upload", lambda: upload_dataset(fleet, client)),
        ("models", "upload a model", lambda: upload_model(fleet, client)),
        ("data", "train", lambda: client.train("models/lost", ["datasets/town"], timeout=10)),
    ], errors)
    faults.heal()
    upload_dataset(fleet, client)
    client.delete_dataset("datasets/lost")
    print("writes that ended with EIO were refused as UNAVAILABLE, and worked again afterwards")


def ask_folder(client):
    for call in (lambda: client.describe_dataset("datasets/town", timeout=5),
                 lambda: client.train("models/lost", ["datasets/town"], validate_only=True, timeout=5)):
        try:
            call()
        except Exception:  # pylint: disable=broad-except
            pass


def main():
    import importlib
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_programs(parser)
    parser.add_argument("--outage", type=float, default=12.0, help="seconds without the database: longer than the lease")
    parser.add_argument("--volume-outage", type=float, default=4.0, help="seconds without the data folder")
    parser.add_argument("--fault-shim", type=pathlib.Path, help="library that makes writes fail")
    parser.add_argument("--before", type=float, default=3.0, help="seconds to measure before")
    options = parser.parse_args()
    in_network = enter()
    prepare(options)
    global DatasetUpload, ModelUpload  # pylint: disable=global-variable-undefined
    maneuver = importlib.import_module("maneuver")
    from maneuver.model_transfers import ModelUpload
    from maneuver.uploads import DatasetUpload
    has_volume = in_network and shutil.which("bindfs") and pathlib.Path("/dev/fuse").exists()
    work = pathlib.Path(tempfile.mkdtemp(prefix="maneuver-outage-"))
    work.chmod(0o755)  # for PostgreSQL's user
    fleet = pulse = volume = None
    try:
        if has_volume:
            (work / "disk").mkdir()
            volume = Volume(work / "disk", work / "data")
        environment, faults = {}, None
        if options.fault_shim:
            from histories import Faults
            faults = Faults(work / "faults")
            environment = {"LD_PRELOAD": str(options.fault_shim), "MANEUVER_FAULTS": str(work / "faults"),
                           "MANEUVER_FAULT_ROOT": str(work / "data")}
        fleet = SharingFleet(options, work, in_network, environment=environment)
        fleet.check_sessions()
        subprocess.run([options.small_model, work / "small", "3"], check=True)
        fleet.settings = dict(SETTINGS, optimization=dict(SETTINGS["optimization"], joint_epochs=20))
        dataset = fleet.make_dataset("town", 8)
        scene = maneuver.load_scenario(fleet.make_scene(dataset))
        client = fleet.client()
        client.upload_dataset(dataset, "datasets/town")
        client.upload_model_version(work / "small", "models/spare")
        calm = client.wait_for_job(client.train("models/calm", ["datasets/town"], fleet.settings)).name
        pulse = Pulse(fleet.client(retries=0), scene)
        window = Window(pulse, "before")
        time.sleep(options.before)
        window.end()
        lose_database(options, fleet, pulse, fleet.settings, calm, maneuver.errors)
        if has_volume:
            lose_volume(options, fleet, pulse, volume, maneuver.errors)
        else:
            print("the data folder was not taken away: that needs root and bindfs")
        if faults:
            fail_writes(fleet, faults, maneuver.errors)
        pulse.end()
        check(not pulse.failures, f"{len(pulse.failures)} predictions failed:\n" + "\n".join(pulse.failures[:10]))
        print("no prediction failed")
    except BaseException:
        if fleet:
            fleet.last_lines()
        raise
    finally:
        if volume:
            volume.go_on()
        if pulse:
            pulse.end()
        if fleet:
            fleet.stop()
        if volume:
            volume.end()
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    main()
