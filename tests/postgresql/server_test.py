#!/usr/bin/python3
"""A server moves from its embedded store to PostgreSQL, and loses the database while it predicts and learns.

Jobs, aliases and answers are the same after the move. While the database is away predictions go on, changes say
UNAVAILABLE, and the job that learns ends with one version once the database is back. A back-up of both halves is
restored to another folder and another database. The database's password is in a file and is seen nowhere else.

Needs PostgreSQL 15 of Debian, rsync; skips (77) without the former.
"""

import argparse
import json
import os
import pathlib
import pwd
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request

DEPLOY = pathlib.Path(__file__).resolve().parent.parent.parent / "deploy"
POSTGRESQL = pathlib.Path("/usr/lib/postgresql/15/bin")
PATIENCE_S = 400
SETTINGS = {
    "preset": "compact",
    "model": {
        "raster": {"height": 48, "width": 48, "meters_per_pixel": 2, "history_frames": 3, "frame_interval": "0.5s"},
        "backbone": {"convolutions": [{"channels": 16, "stride": 2}, {"channels": 24, "stride": 2},
                                      {"channels": 24, "stride": 2}], "features": 64},
        "trajectory": {"waypoints": 10, "waypoint_interval": "0.4s"},
        "actions": 12,
        "latent_dimensions": 3,
    },
    "optimization": {"pretraining_epochs": 1, "mixture_epochs": 1, "joint_epochs": 1, "posterior_epochs": 1},
    "examples": {"max_examples": 300},
    "seed": 7,
    "threads": 1,
}


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def wait_for(condition, what):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > give_up:
            raise RuntimeError(f"{what}: not within {PATIENCE_S} s")
        time.sleep(0.05)


def postgresql_user():
    """Who runs PostgreSQL if this program is root."""
    names = [user.pw_name for user in pwd.getpwall()]
    return pwd.getpwnam("postgres" if "postgres" in names else "nobody")


class Cluster:
    """PostgreSQL on a Unix socket of its own, as an unprivileged user."""

    def __init__(self, folder):
        self.folder = folder
        self.password = secrets.token_hex(16)
        self._as = {}
        folder.mkdir(mode=0o755)
        if os.getuid() == 0:
            user = postgresql_user()
            self._as = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
            os.chown(folder, user.pw_uid, user.pw_gid)
        (folder / "password").write_text(self.password + "\n")
        self.passfile = folder / "pgpass"
        self.passfile.write_text(f"*:*:*:maneuver:{self.password}\n")
        self.passfile.chmod(0o600)
        subprocess.run([POSTGRESQL / "initdb", "--no-locale", "--encoding=UTF8", "--username=maneuver",
                        "--auth=scram-sha-256", f"--pwfile={folder}/password", f"--pgdata={folder}/data"],
                       check=True, stdout=subprocess.DEVNULL, cwd="/", **self._as)
        (folder / "password").unlink()
        self.start()

    def uri(self, database="postgres"):
        return f"postgresql://maneuver@/{database}?host={self.folder}&passfile={self.passfile}"

    def start(self):
        with open(self.folder / "log", "ab") as log:
            self.process = subprocess.Popen([POSTGRESQL / "postgres", "-D", self.folder / "data", "-k", self.folder, "-c",
                                             "listen_addresses="], stdout=log, stderr=log, cwd="/", **self._as)
        wait_for(lambda: self.sql("SELECT 1").returncode == 0, "PostgreSQL takes connections")

    def sql(self, text, database="postgres"):
        return subprocess.run(["psql", "--no-psqlrc", "--tuples-only", "--command", text, self.uri(database)],
                              capture_output=True, text=True)

    def stop_at_once(self):
        self.process.send_signal(signal.SIGQUIT)  # pg_ctl stop -m immediate
        self.process.wait(PATIENCE_S)


class Server:
    def __init__(self, options, data, *flags, name=""):
        self.data = data
        self._maneuver = options.maneuver
        ports = data.with_suffix(f".{name}ports")
        ports.unlink(missing_ok=True)
        self.log = data.with_suffix(f".{name}log")
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(command(options, data, ports, *flags), stdout=log, stderr=log)
        wait_for(lambda: ports.exists() or self.process.poll() is not None, "the server listens")
        check(ports.exists(), self.log.read_text()[-2000:])
        addresses = json.loads(ports.read_text())
        self.address, self.metrics = addresses["grpc"], addresses["metrics"]

    def ask(self, *arguments):
        return subprocess.run([self._maneuver, "--server", self.address, "--output", "json", *map(str, arguments)],
                              capture_output=True, text=True)

    def maneuver(self, *arguments):
        done = self.ask(*arguments)
        check(done.returncode == 0, f"maneuver {arguments}: {done.stderr}")
        return done.stdout

    def json(self, *arguments):
        """An answer that can be compared: maps have no order."""
        return json.loads(self.maneuver(*arguments))

    def job(self, name):
        return self.json("job", "show", name)

    def serves(self):
        return self.ask("health").returncode == 0

    def metrics_page(self):
        return urllib.request.urlopen(f"http://{self.metrics}/metrics").read().decode()

    def store_available(self):
        return re.search(r"^maneuver_store_available (\d)", self.metrics_page(), re.MULTILINE)[1] == "1"

    def stop(self):
        self.process.terminate()
        self.process.wait(PATIENCE_S)


def command(options, data, ports, *flags):
    interval = () if "--checkpoint-interval" in flags else ("--checkpoint-interval", "0.1")
    return [options.maneuverd, "--data-dir", data, "--trainer", options.trainer, "--listen", "127.0.0.1:0",
            "--metrics-listen", "127.0.0.1:0", "--port-file", ports, *interval, *flags]


def refusal(options, data, *flags):
    done = subprocess.run(command(options, data, data.with_suffix(".refused"), *flags), capture_output=True, text=True,
                          timeout=PATIENCE_S)
    check(done.returncode == 1, f"the server was to refuse {flags}: {done.returncode} {done.stderr}")
    return done.stderr


def store(options, what, *flags):
    return subprocess.run([options.maneuverd, "store", what, *map(str, flags)], capture_output=True, text=True)


def move(options, work, server, cluster):
    """From the embedded store to PostgreSQL."""
    data, uri = server.data, cluster.uri()
    server.stop()
    flags = ("--data-dir", data, "--store", uri)
    check("maneuverd store copy" in refusal(options, data, "--store", uri), "a folder with jobs is not served yet")
    check("maneuverd store migrate" in store(options, "copy", *flags).stderr, "tables have to be made first")
    made = store(options, "migrate", "--store", uri)
    check(made.stdout == "made a store with schema version 4\n", made.stdout + made.stderr)
    again = store(options, "migrate", "--store", uri)
    check(again.stdout == "the store has schema version 4 already\n", again.stdout + again.stderr)
    copied = store(options, "copy", *flags)
    check(copied.returncode == 0 and copied.stdout.startswith("copied 1 job (1 succeeded), "),
          copied.stdout + copied.stderr)
    checked = store(options, "check", *flags)
    check(checked.stdout.startswith("the store is sound: 1 job (1 succeeded), "), checked.stdout + checked.stderr)
    check("name the database with --store" in refusal(options, data), "the old store is out of use")
    wrong = store(options, "check", "--data-dir", data, "--store", "postgresql://maneuver:hunter2@/postgres")
    check(wrong.returncode == 2 and "hunter2" not in wrong.stderr, wrong.stderr)
    return Server(options, data, "--store", uri)


def away(server, cluster, scene, outage_s):
    """Stops the database; predictions go on, changes are refused and say why."""
    cluster.stop_at_once()
    end = time.monotonic() + outage_s
    predictions = 0
    while predictions == 0 or time.monotonic() < end:
        server.maneuver("predict", scene, "--model", "small")
        predictions += 1
        for change in (["job", "list"], ["model", "promote", "small/1"], ["train", "town", "--dataset", "town"]):
            refused = server.ask(*change)
            check(refused.returncode != 0 and "STORE_UNAVAILABLE" in refused.stdout + refused.stderr,
                  f"{change}: {refused.stdout}{refused.stderr}")
        check(server.serves(), "health does not depend on the database")
        check(not server.store_available(), "the metric says that the database is away")
    cluster.start()
    wait_for(lambda: server.ask("job", "list").returncode == 0, "the server finds the database again")
    check(server.store_available(), "the metric says that the database is back")
    return predictions


def has_row_of(backup, dataset):
    rows = subprocess.run(["pg_restore", "--data-only", "--table=datasets", "--file=-", backup / "maneuver.dump"],
                          check=True, capture_output=True, text=True).stdout
    return re.search(rf"^{dataset}\t", rows, re.MULTILINE) is not None


def run(options, work, servers, cluster):
    data = work / "data"
    (data / "models" / "small").mkdir(parents=True)
    for version in (1, 2):
        subprocess.run([options.small_model, data / "models" / "small" / str(version), str(version)], check=True)
    (work / "settings.json").write_text(json.dumps(SETTINGS))
    server = Server(options, data)
    servers.append(server)
    server.maneuver("model", "promote", "small/2")
    server.maneuver("synthesize", work / "town", "--recordings", 8)
    server.maneuver("dataset", "upload", work / "town", "town")
    scene = work / "scene.json"
    name = re.search('"(town-[^"]*)"', server.maneuver("scenario", "list", work / "town"))[1]
    server.maneuver("scenario", "extract", work / "town", name, "--out", scene)
    train = ("train", "town", "--dataset", "town", "--settings", work / "settings.json", "--detach")
    first = json.loads(server.maneuver(*train))["name"]
    server.maneuver("job", "watch", first)
    wait_for(lambda: server.job(first)["state"] == "JOB_STATE_SUCCEEDED", "the first job ends")
    ask = ("predict", scene, "--model", "small", "--min-probability", "0")
    questions = (ask, ("job", "show", first), ("model", "list"), ("dataset", "list"))
    before = [server.json(*question) for question in questions]

    server = move(options, work, server, cluster)
    servers.append(server)
    wait_for(server.serves, "the moved server serves")
    for question, expected in zip(questions, before):
        check(server.json(*question) == expected, f"{question[0]} is the same after the move")

    # A second server, with a folder of its own, over the same database.
    refused = refusal(options, work / "second", "--store", cluster.uri())
    check("another maneuverd uses this store" in refused, refused)
    job = json.loads(server.maneuver(*train, "--set", "optimization.joint_epochs=20"))["name"]
    folder = data / "jobs" / job.removeprefix("jobs/")
    wait_for(lambda: any(folder.glob("checkpoints/*")), "the job has a checkpoint")
    predictions = away(server, cluster, scene, options.outage)
    server.maneuver("job", "watch", job)
    wait_for(lambda: server.job(job)["state"] == "JOB_STATE_SUCCEEDED", "the job ends")
    versions = sorted(path.name for path in (data / "models" / "town").iterdir() if path.name.isdigit())
    check(versions == ["1", "2"], f"one version of each job: {versions}")

    uri = cluster.uri("restored")
    check(cluster.sql("CREATE DATABASE restored").returncode == 0, "a second database")
    check(script("backup.sh", data, work / "backup").returncode == 2, "a back-up needs both halves")
    expect_done(script("backup.sh", data, work / "backup", "--store", cluster.uri()))
    check(script("restore.sh", work / "backup", work / "restored").returncode == 2, "and so does restoring")
    full = script("restore.sh", work / "backup", work / "restored", "--store", cluster.uri())
    check(full.returncode == 1 and "--folder-only" in full.stderr, "nothing is restored over a database that is in use")
    expect_done(script("backup.sh", data, work / "small-backup", "--store", cluster.uri(), "--without-datasets"))
    check([has_row_of(work / folder, "town") for folder in ("backup", "small-backup")] == [True, False],
          "a back-up without datasets lists none")
    expect_done(script("restore.sh", work / "backup", work / "restored", "--store", uri))
    other = Server(options, work / "restored", "--store", uri)
    servers.append(other)
    wait_for(other.serves, "the restored server serves")
    for question in (*questions, ("job", "show", job)):
        check(other.json(*question) == server.json(*question), f"{question[0]} is the same after the restore")

    for each in (server, other):
        check(cluster.password not in each.log.read_text(), "the log has no password")
        line = pathlib.Path(f"/proc/{each.process.pid}/cmdline").read_text()
        check(cluster.password not in line, "the command line has no password")
    libraries = pathlib.Path(f"/proc/{server.process.pid}/maps").read_text()
    check("libpq" in libraries, "this server has loaded libpq")
    linked = subprocess.run(["readelf", "--dynamic", options.maneuverd], capture_output=True, text=True, check=True)
    check("libpq" not in linked.stdout, "a server that does not need libpq does not load it")

    # Only the folder is lost. The database still has all jobs and aliases.
    server.stop()
    expect_done(script("restore.sh", work / "backup", work / "anew", "--folder-only"))
    anew = Server(options, work / "anew", "--store", cluster.uri())
    servers.append(anew)
    wait_for(anew.serves, "a server over the restored folder and its database serves")
    for question in (*questions, ("job", "show", job)):
        check(anew.json(*question) == other.json(*question), f"{question[0]} is the same with the restored folder")
    print(f"Moved, lost its database for {options.outage} s ({predictions} predictions meanwhile), backed up and restored")


def script(name, *arguments):
    return subprocess.run([DEPLOY / name, *map(str, arguments)], capture_output=True, text=True)


def expect_done(done):
    check(done.returncode == 0, f"{done.args}: {done.returncode}\n{done.stdout}{done.stderr}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maneuverd", required=True, type=pathlib.Path)
    parser.add_argument("--trainer", required=True, type=pathlib.Path)
    parser.add_argument("--maneuver", required=True, type=pathlib.Path)
    parser.add_argument("--small-model", required=True, type=pathlib.Path, help="program that writes one")
    parser.add_argument("--outage", type=float, default=3.0, help="seconds without the database")
    options = parser.parse_args()
    if not (POSTGRESQL / "initdb").exists():
        print("skipped: PostgreSQL 15 is not installed; deploy/install-deps.sh --tests installs it")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as name:
        work = pathlib.Path(name)
        work.chmod(0o755)  # for PostgreSQL's user
        servers = []
        cluster = Cluster(work / "postgresql")
        try:
            run(options, work, servers, cluster)
        except BaseException:
            print("PostgreSQL's last lines:", (cluster.folder / "log").read_text()[-3000:], file=sys.stderr)
            raise
        finally:
            for server in servers:
                server.stop()
            cluster.stop_at_once()


if __name__ == "__main__":
    main()
