"""Servers that share one PostgreSQL and one folder behind HAProxy, and the faults that befall them.

Each server has a network of its own with two links: one to the database, one to HAProxy and the callers. A link can be
cut: what is sent is lost, and nobody is told. That needs root (network namespaces); `enter` starts the program again in
a network and a mount table that nobody else sees and that are gone when it ends. Without it all use loopback.
"""

import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(REPOSITORY / "tests" / "balancing"))

from replicas import free_port  # noqa: E402
from server_test import POSTGRESQL, SETTINGS, Cluster, check, postgresql_user, store, wait_for  # noqa: E402

INSIDE = "MANEUVER_TEST_NETWORK"
DATABASE_PORT = 5433
LEASE_S = 15


def enter():
    """Starts the program again in a network of its own, where that is possible. Returns whether it is in one."""
    if os.environ.get(INSIDE):
        return True
    unshare = ["unshare", "--net", "--mount", "--propagation", "private"]
    if os.geteuid() != 0 or subprocess.run([*unshare, "true"], capture_output=True).returncode != 0:
        print("no network namespaces here: links are not cut")
        return False
    os.execvpe("unshare", [*unshare, sys.executable, *sys.argv], dict(os.environ, **{INSIDE: "1"}))


def make_certificate(certificate, key, addresses):
    """A certificate that is its own authority."""
    names = ",".join(f"IP:{address}" for address in addresses)
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
                    "-days", "2", "-subj", "/CN=localhost", "-addext", f"subjectAltName={names}", "-keyout", key,
                    "-out", certificate], check=True, capture_output=True)


def ip(*arguments):
    subprocess.run(["ip", *map(str, arguments)], check=True)


class Network:
    """A database's and a balancer's side, and some servers' sides."""

    def __init__(self, servers):
        # Of this program alone, but `ip netns exec` sees what is mounted later.
        subprocess.run(["mount", "--make-rshared", "/"], check=True)
        folder = pathlib.Path("/run/netns")
        folder.mkdir(exist_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "tmpfs", folder], check=True)
        ip("link", "set", "lo", "up")
        for i in range(servers):
            ip("netns", "add", f"s{i}")
            for link in ("db", "edge"):
                ip("link", "add", f"{link}{i}", "type", "veth", "peer", "name", link, "netns", f"s{i}")
                ip("addr", "add", f"{self.near(link, i)}/30", "dev", f"{link}{i}")
                ip("link", "set", f"{link}{i}", "up")
                ip("-n", f"s{i}", "addr", "add", f"{self.far(link, i)}/30", "dev", link)
                ip("-n", f"s{i}", "link", "set", link, "up")
            ip("-n", f"s{i}", "link", "set", "lo", "up")

    @staticmethod
    def near(link, i):
        return f"10.{ {'db': 10, 'edge': 20}[link]}.{i}.1"

    @staticmethod
    def far(link, i):
        return f"10.{ {'db': 10, 'edge': 20}[link]}.{i}.2"

    def command(self, i):
        return ["ip", "netns", "exec", f"s{i}"]

    def set_link(self, link, i, state):
        ip("link", "set", f"{link}{i}", state)


class Loopback:
    """All on one address; no link can be cut."""

    near = far = staticmethod(lambda link, i: "127.0.0.1")

    def command(self, i):
        return []


class NetworkCluster(Cluster):
    """PostgreSQL that listens on all addresses, too, where it wants TLS."""

    def __init__(self, folder, network, servers, *settings):
        self._network = network
        self.authority, key = folder.with_suffix(".crt"), folder.with_suffix(".key")
        make_certificate(self.authority, key, sorted({network.near("db", i) for i in range(servers)}))
        if os.getuid() == 0:
            os.chown(key, postgresql_user().pw_uid, -1)
        key.chmod(0o600)
        self._settings = ("ssl=on", f"ssl_cert_file={self.authority}", f"ssl_key_file={key}", *settings)
        self.port = DATABASE_PORT if isinstance(network, Network) else free_port()
        super().__init__(folder)

    def uri(self, database="postgres", server=None, authority=None):
        tls = ""
        host = self.folder
        if server is not None:
            host = self._network.near("db", server)
            tls = f"&sslmode=verify-full&sslrootcert={authority or self.authority}"
        return f"postgresql://maneuver@/{database}?host={host}&port={self.port}&passfile={self.passfile}{tls}"

    def service(self, server):
        """The same for one server, as a section of a service file."""
        return (f"[server{server}]\nhost={self._network.near('db', server)}\nport={self.port}\nuser=maneuver\n"
                f"dbname=postgres\npassfile={self.passfile}\nsslmode=verify-full\nsslrootcert={self.authority}\n")

    def start(self):
        hba = self.folder / "data" / "pg_hba.conf"
        if "0.0.0.0/0" not in hba.read_text():
            with open(hba, "a", encoding="utf-8") as file:
                file.write("hostssl all all 0.0.0.0/0 scram-sha-256\n")
        flags = [word for setting in (f"listen_addresses=*", f"port={self.port}", *self._settings)
                 for word in ("-c", setting)]
        with open(self.folder / "log", "ab") as log:
            self.process = subprocess.Popen([POSTGRESQL / "postgres", "-D", self.folder / "data", "-k", self.folder,
                                             *flags], stdout=log, stderr=log, cwd="/", **self._as)
        wait_for(lambda: self.sql("SELECT 1").returncode == 0, "PostgreSQL takes connections")

    def stop_immediately(self):
        subprocess.run([POSTGRESQL / "pg_ctl", "stop", "-m", "immediate", "-D", self.folder / "data"], check=True,
                       stdout=subprocess.DEVNULL, cwd="/", **self._as)
        self.process.wait()

    def ask(self, text):
        """The rows of a query, each a list of texts."""
        done = subprocess.run(["psql", "--no-psqlrc", "--tuples-only", "--no-align", "--field-separator=\t", "--command",
                               text, self.uri()], capture_output=True, text=True)
        check(done.returncode == 0, f"{text}: {done.stderr}")
        return [line.split("\t") for line in done.stdout.splitlines() if line]


class SharingServer:
    """A maneuverd --shared, on the same address whenever it is started."""

    def __init__(self, fleet, i, program):
        self.fleet, self.i, self.name = fleet, i, f"replica{i + 1}"
        host = fleet.network.far("edge", i)
        self.address = f"{host}:{free_port()}"
        self.metrics = f"{host}:{free_port()}"
        self.log = fleet.work / f"{self.name}.log"
        self.process = None
        self.starts = 0
        self.start(program)

    def start(self, program):
        self.program = program
        # The first one's address is a URI; those of the others are in a service file.
        store = f"postgresql:///?service=server{self.i}" if self.i else self.fleet.cluster.uri(server=self.i)
        command = [*self.fleet.network.command(self.i), program, "--data-dir", self.fleet.data, "--trainer",
                   self.fleet.options.trainer, "--listen", self.address, "--metrics-listen", self.metrics, "--insecure",
                   "--checkpoint-interval", "0.1", "--workers", "1", "--shutdown-delay", "3", "--shared", "--store",
                   store, *self.fleet.flags]
        self.starts += 1
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=self.fleet.environment)

    def is_running(self):
        return self.process.poll() is None

    def has_open(self, files):
        """Whether it has one of them open."""
        opened = set()
        for descriptor in pathlib.Path(f"/proc/{self.process.pid}/fd").glob("*"):
            try:
                opened.add(descriptor.readlink())
            except FileNotFoundError:
                pass  # closed meanwhile
        return bool(opened & set(files))

    def signal(self, number):
        if self.is_running():
            self.process.send_signal(number)


class SharingBalancer:
    """HAProxy with the configuration that is shipped, for as many servers as there are, which all answer all calls."""

    def __init__(self, fleet):
        work = fleet.work
        self.address = f"127.0.0.1:{free_port()}"
        self.authority = work / "edge.crt"
        key = work / "edge.key"
        make_certificate(self.authority, key, ["127.0.0.1"])
        certificate = work / "edge.pem"
        certificate.write_bytes(self.authority.read_bytes() + key.read_bytes())
        self._admin = work / "admin.sock"
        text = (REPOSITORY / "deploy" / "balancing" / "haproxy.cfg").read_text()
        predictions, management = text.split("\nbackend management\n")
        last = '    server replica2 "${MANEUVER_REPLICA_2}"\n'
        check(last in predictions, "haproxy.cfg names replica2")
        names = [server.name for server in fleet.servers]
        line = '    server {0} "${{MANEUVER_{1}}}"{2}\n'
        variables = {server.name: f"REPLICA_{server.i + 1}" for server in fleet.servers}
        predictions = predictions.replace(last, "".join(line.format(name, variables[name], "") for name in names[1:]))
        # As docs/guides/sharing.md says: any of them answers the other calls, too.
        kept = re.sub(r"    server replica\d.*\n", "", management, count=0)
        shared = "    balance leastconn\n" + "".join(
            line.format(name, variables[name], f" proto h2 track predictions/{name}") for name in names)
        configuration = work / "haproxy.cfg"
        configuration.write_text(predictions + "\nbackend management\n" + shared + kept)
        environment = dict(os.environ, MANEUVER_EDGE=self.address, MANEUVER_CERTIFICATE=str(certificate),
                           MANEUVER_ADMIN=str(self._admin), MANEUVER_METRICS=f"127.0.0.1:{free_port()}",
                           **{f"MANEUVER_{variables[server.name]}": server.address for server in fleet.servers})
        if os.geteuid() != 0:
            environment["MANEUVER_UNPRIVILEGED"] = "1"
        with open(work / "haproxy.log", "ab") as log:
            self.process = subprocess.Popen(["haproxy", "-db", "-f", configuration], env=environment, stdout=log,
                                            stderr=log)

    def states(self):
        """What HAProxy thinks of each server: {"replica1": "UP", ...}; nothing while it does not listen."""
        import socket
        with socket.socket(socket.AF_UNIX) as connection:
            try:
                connection.connect(str(self._admin))
            except OSError:
                return {}
            connection.sendall(b"show stat predictions 4 -1\n")
            lines = connection.makefile().read().splitlines()
        return {row[1]: row[17] for row in (line.split(",") for line in lines if line.startswith("predictions,"))}


class SharingFleet:
    """The database, the servers, HAProxy, and clients of it."""

    def __init__(self, options, work, in_network, servers=3, flags=(), settings=(), environment=None):
        self.options, self.work, self.flags = options, work, flags
        self.environment = dict(os.environ, PGSERVICEFILE=str(work / "services"), **(environment or {}))  # of servers
        self.data = work / "data"
        self.network = Network(servers) if in_network else Loopback()
        self.servers, self.balancer, self._clients = [], None, []
        self.cluster = NetworkCluster(work / "postgresql", self.network, servers, *settings)
        try:
            (work / "services").write_text("".join(self.cluster.service(i) for i in range(servers)))
            made = self.migrate(options.maneuverd)
            check(made.returncode == 0, made.stderr)
            for version in (1, 2):
                folder = self.data / "models" / "small" / str(version)
                folder.parent.mkdir(parents=True, exist_ok=True)
                subprocess.run([options.small_model, folder, str(version)], check=True)
            for i in range(servers):
                self.servers.append(SharingServer(self, i, options.maneuverd))
            self.balancer = SharingBalancer(self)
            first = self.client(self.servers[0].address)
            self.patiently(lambda: first.set_model_alias("models/small/aliases/serving", "models/small/versions/1"))
            for server in self.servers:
                self.wait_until_up(server)
        except BaseException:
            self.stop()
            raise

    def check_sessions(self):
        """Each server has a session that works and one that listens, by TLS, and trusts only the authority it is given."""
        ask = lambda what: int(self.cluster.ask(
            "SELECT count(*) FROM pg_stat_activity JOIN pg_stat_ssl USING (pid) WHERE application_name = 'maneuverd'"
            f" AND client_addr IS NOT NULL AND {what}")[0][0])
        wait_for(lambda: ask("query = 'LISTEN maneuver_models'") == len(self.servers), "each server listens")
        wait_for(lambda: ask("ssl") == 2 * len(self.servers), "the sessions of each server use TLS")
        check(ask("NOT ssl") == 0, "no session is without TLS")
        other = self.cluster.uri(server=0, authority=self.balancer.authority)
        (self.work / "empty").mkdir()
        refused = subprocess.run([self.options.maneuverd, "store", "check", "--data-dir", self.work / "empty", "--store",
                                  other], capture_output=True, text=True)
        check(refused.returncode != 0 and "certificate verify failed" in refused.stderr, refused.stderr)

    def migrate(self, program):
        return subprocess.run([program, "store", "migrate", "--store", self.cluster.uri()], capture_output=True,
                              text=True)

    def client(self, address=None, **options):
        import maneuver
        tls = None
        if address is None:
            address, tls = self.balancer.address, maneuver.Tls(root_certificates=str(self.balancer.authority))
        self._clients.append(maneuver.Client(address, tls=tls, **options))
        return self._clients[-1]

    @staticmethod
    def patiently(call, patience_s=120, pause_s=0.2):
        """Calls as a caller with retries does: again after UNAVAILABLE, and after an attempt that took too long."""
        import maneuver
        give_up = time.monotonic() + patience_s
        while True:
            try:
                return call()
            except (maneuver.errors.UnavailableError, maneuver.errors.DeadlineExceededError) as error:
                if time.monotonic() > give_up:
                    raise
                time.sleep(max(pause_s, min(error.retry_delay or 0, 2)))

    def is_up(self, server):
        return self.balancer.states().get(server.name) == "UP"

    def wait_until_up(self, server):
        def up():
            check(server.is_running(), f"{server.name} runs: {server.log.read_text()[-2000:]}")
            return self.is_up(server)
        wait_for(up, f"HAProxy has {server.name} up")

    def make_dataset(self, name, recordings):
        folder = self.work / name
        self.maneuver("synthesize", folder, "--recordings", recordings)
        return folder

    def maneuver(self, *arguments):
        done = subprocess.run([self.options.maneuver, *map(str, arguments)], capture_output=True, text=True)
        check(done.returncode == 0, f"maneuver {arguments}: {done.stderr}")
        return done.stdout

    def make_scene(self, folder):
        scene = self.work / "scene.json"
        name = re.search('"([^"]*)"', self.maneuver("--output", "json", "scenario", "list", folder).split('"scenarioId"')[1])
        self.maneuver("scenario", "extract", folder, name[1], "--out", scene)
        return scene

    def stop(self):
        for client in self._clients:
            client.close()
        if self.balancer:
            self.balancer.process.terminate()
            self.balancer.process.wait()
        for server in self.servers:
            server.signal(signal.SIGCONT)
            server.signal(signal.SIGKILL)
            server.process.wait()
        if self.cluster.process.poll() is None:
            self.cluster.stop_at_once()

    def last_lines(self):
        for log in (*(server.log for server in self.servers), self.work / "haproxy.log", self.cluster.folder / "log"):
            if log.exists():
                print(f"--- {log.name}, last lines:\n{log.read_text(errors='replace')[-3000:]}", file=sys.stderr)


def add_programs(parser):
    parser.add_argument("--maneuverd", required=True, type=pathlib.Path)
    parser.add_argument("--trainer", required=True, type=pathlib.Path)
    parser.add_argument("--maneuver", required=True, type=pathlib.Path)
    parser.add_argument("--small-model", required=True, type=pathlib.Path, help="program that writes one")
    parser.add_argument("--python", required=True, type=pathlib.Path, help="folder of the Python package")


def prepare(options):
    """Ends the program with 77 where something is missing. Lets `import maneuver` find the package."""
    if not (POSTGRESQL / "initdb").exists() or not shutil.which("haproxy"):
        print("skipped: PostgreSQL 15 or HAProxy is not installed; deploy/install-deps.sh --tests installs them")
        sys.exit(77)
    sys.path.insert(0, str(options.python))
