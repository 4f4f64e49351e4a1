"""Starts a Slurm cluster of two nodes on this machine, in a folder of its own, on loopback.

Needs root: slurmd runs the tasks of several nodes, each in a cgroup-free way (proctrack/linuxproc),
and munged wants a key that nobody else reads.
"""

import contextlib
import os
import pathlib
import shutil
import socket
import subprocess
import time

PROGRAMS = ["munged", "slurmctld", "slurmd", "srun", "sbatch", "scontrol", "squeue", "scancel"]
NODES = ["maneuver-a", "maneuver-b"]

CONFIGURATION = """ClusterName=maneuver
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=2
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SlurmdParameters=config_overrides
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=requeue_setup_env_fail,sched_interval=1,batch_sched_delay=0
SchedulerType=sched/builtin
JobRequeue=1
ReturnToService=2
MinJobAge=300
KillWait=10
SlurmdTimeout=60
NodeName={a} NodeHostname={host} NodeAddr=127.0.0.1 Port={port_a} CPUs=4 State=UNKNOWN
NodeName={b} NodeHostname={host} NodeAddr=127.0.0.1 Port={port_b} CPUs=4 State=UNKNOWN
PartitionName=all Nodes={a},{b} Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE:4
"""


def missing_programs():
    """Returns the programs of Slurm and munge that are not installed."""
    path = os.environ.get("PATH", "") + ":/usr/sbin"
    return [name for name in PROGRAMS if shutil.which(name, path=path) is None]


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


def wait_for(condition, seconds, what):
    last = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > last:
            raise TimeoutError(what)
        time.sleep(0.05)


class SlurmCluster:
    """A running cluster. `environment` has what Slurm's commands need."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.environment = dict(os.environ, SLURM_CONF=str(self.folder / "slurm.conf"))
        self.environment["PATH"] = os.environ.get("PATH", "") + ":/usr/sbin:/usr/bin"
        self._daemons = []

    def __enter__(self):
        try:
            self._start()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *unused):
        for daemon in reversed(self._daemons):
            daemon.terminate()
        for daemon in reversed(self._daemons):
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def run(self, *command, **options):
        """Runs a command to its end and returns its output. Raises if it fails."""
        done = subprocess.run(command, env=self.environment, text=True, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, timeout=options.pop("timeout", 120),
                              check=False, **options)
        if done.returncode != 0:
            raise RuntimeError(f"{command}: exit status {done.returncode}\n{done.stdout}")
        return done.stdout

    def _daemon(self, *command):
        with open(self.folder / f"{command[0]}.{len(self._daemons)}.out", "w", encoding="utf-8") as log:
            self._daemons.append(subprocess.Popen(command, env=self.environment, stdout=log,
                                                  stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL))

    def _start(self):
        for name in ["state"] + [f"spool.{node}" for node in NODES]:
            (self.folder / name).mkdir()
        os.chmod(self.folder, 0o755)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        controller, port_a, port_b = free_ports(3)
        (self.folder / "slurm.conf").write_text(CONFIGURATION.format(
            host=socket.gethostname().split(".")[0], folder=self.folder, controller=controller,
            a=NODES[0], b=NODES[1], port_a=port_a, port_b=port_b))
        self._daemon("munged", "--foreground", "--force", f"--key-file={key}",
                     f"--socket={self.folder}/munge.socket", f"--pid-file={self.folder}/munge.pid",
                     f"--log-file={self.folder}/munge.log", f"--seed-file={self.folder}/munge.seed",
                     "--num-threads=2")
        wait_for((self.folder / "munge.socket").exists, 10, "munged does not start")
        self._daemon("slurmctld", "-D", "-f", self.environment["SLURM_CONF"])
        for node in NODES:
            self._daemon("slurmd", "-D", "-N", node, "-f", self.environment["SLURM_CONF"])

        def is_up():
            with contextlib.suppress(RuntimeError):
                return self.run("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == "2"
            return False

        wait_for(is_up, 30, "the nodes do not come up; see " + str(self.folder))
