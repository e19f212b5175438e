"""A SLURM cluster of two nodes on this machine, on loopback addresses, without systemd or cgroups.

Each node is a ``slurmd`` with an address of its own, which is its name too: it resolves without an
entry in ``/etc/hosts``, and the list of both is as SLURM writes it, ``127.0.0.[1-2]``.
"""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tex_lightning.errors import UserError

NODES = ("127.0.0.1", "127.0.0.2")
URGENT = "urgent"  # partition whose jobs preempt those of the others
WARNED = "warned"  # whose jobs are told so half a minute before
SETTINGS = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={ports[0]}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
JobRequeue=1
KillWait=5
ReturnToService=2
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
SchedulerParameters=batch_sched_delay=0,sched_interval=2
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmdSpoolDir={folder}/spool-%n
StateSaveLocation={folder}/state
NodeName={nodes[0]} NodeHostname={host} NodeAddr={nodes[0]} Port={ports[1]} CPUs={cores}
NodeName={nodes[1]} NodeHostname={host} NodeAddr={nodes[1]} Port={ports[2]} CPUs={cores}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP PriorityTier=1
PartitionName={warned} Nodes=ALL MaxTime=INFINITE State=UP PriorityTier=1 GraceTime=30
PartitionName={urgent} Nodes=ALL MaxTime=INFINITE State=UP PriorityTier=2 PreemptMode=OFF
"""
WITHOUT = """\
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc={folder}/completed
"""
ACCOUNTING = """\
JobAcctGatherType=jobacct_gather/linux
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=127.0.0.1
AccountingStoragePort={ports[3]}
AccountingStoragePass={folder}/munge.socket
"""
SLURMDBD = """\
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
DbdHost=localhost
DbdAddr=127.0.0.1
DbdPort={ports[3]}
SlurmUser=root
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort={ports[4]}
StorageUser=slurm
StoragePass=slurm
StorageLoc=slurm_acct_db
PidFile={folder}/slurmdbd.pid
"""
DATABASE = """\
CREATE DATABASE slurm_acct_db;
CREATE USER slurm@localhost IDENTIFIED BY 'slurm';
GRANT ALL ON slurm_acct_db.* TO slurm@localhost;
"""
MUNGED = (
    "munged --foreground --force --key-file={folder}/key --socket={folder}/munge.socket"
    " --pid-file={folder}/munged.pid --log-file={folder}/munged.log --seed-file={folder}/seed"
)
MARIADBD = (
    "mariadbd --no-defaults --user=root --datadir={folder}/database"
    " --socket={folder}/mariadb.socket --port={ports[4]} --bind-address=127.0.0.1"
    " --pid-file={folder}/mariadbd.pid"
    " --init-file={folder}/init.sql --innodb-lock-wait-timeout=900"
)
MAKE_DATABASE = "mariadb-install-db --no-defaults --user=root --datadir={folder}/database"
PACKAGES = {False: ("slurm-wlm", "munge"), True: ("slurmdbd", "mariadb-server")}


@contextmanager
def cluster(folder: Path, *, accounting: bool = False) -> Iterator[None]:
    """Start SLURM, for the programs below this one too; end it, with all of its jobs.

    Args:
        folder: Of the settings, the logs and the state; made.
        accounting: Whether ``slurmdbd`` notes all jobs in a database of its own.

    Raises:
        UserError: If it is not there and cannot be installed, or does not start.
    """
    _install(accounting)
    folder.mkdir(mode=0o755)
    for name in ("state", *(f"spool-{node}" for node in NODES)):
        (folder / name).mkdir()
    (folder / "key").write_bytes(os.urandom(128))
    (folder / "key").chmod(0o600)
    settings = SETTINGS + (ACCOUNTING if accounting else WITHOUT)
    facts = {
        "folder": folder, "host": socket.gethostname(), "cores": os.cpu_count(), "nodes": NODES,
        "warned": WARNED, "urgent": URGENT, "ports": _free_ports(5),
    }  # fmt: skip
    conf = folder / "slurm.conf"
    conf.write_text(settings.format(**facts))
    with ExitStack() as stack:
        stack.enter_context(_daemon(MUNGED.format(**facts), folder, "munged"))
        os.environ["SLURM_CONF"] = str(conf)
        stack.callback(os.environ.pop, "SLURM_CONF")
        if accounting:
            _start_accounting(stack, folder, facts)
        time.sleep(1)
        stack.enter_context(_daemon("slurmctld -D", folder, "slurmctld"))
        for node in NODES:
            stack.enter_context(_daemon(f"slurmd -D -N {node}", folder, f"slurmd-{node}"))
        if not until(lambda: asked("sinfo", "-hN", "-p", "all", "-o", "%T") == "idle\nidle", 60):
            raise UserError(f"SLURM does not start; its logs say why: {_last_lines(folder)}.")
        stack.callback(until, lambda: not asked("squeue", "-h"), 30)
        stack.callback(asked, "scancel", "--me")
        yield


def _start_accounting(stack: ExitStack, folder: Path, facts: Mapping[str, object]) -> None:
    """Start a database and the daemon that notes jobs in it.

    Raises:
        UserError: If one does not start.
    """
    (folder / "init.sql").write_text(DATABASE)
    (folder / "slurmdbd.conf").write_text(SLURMDBD.format(**facts))
    (folder / "slurmdbd.conf").chmod(0o600)  # it has the password, and slurmdbd insists
    asked(*MAKE_DATABASE.format(**facts).split())
    stack.enter_context(_daemon(MARIADBD.format(**facts), folder, "mariadbd"))
    ready = until(lambda: b"ready for connections" in (folder / "mariadbd.out").read_bytes(), 60)
    stack.enter_context(_daemon("slurmdbd -D", folder, "slurmdbd"))
    if not (ready and until(lambda: asked("sacctmgr", "-n", "show", "qos"), 60)):
        raise UserError(f"Accounting does not start; logs say why: {_last_lines(folder)}.")


def _install(accounting: bool) -> None:
    """Install SLURM from Debian's packages, unless it is there.

    Raises:
        UserError: If that does not work.
    """
    programs = ("munged", "slurmctld", "slurmd", *(("slurmdbd", "mariadbd") if accounting else ()))
    if all(map(shutil.which, programs)):
        return
    packages = [*PACKAGES[False], *(PACKAGES[True] if accounting else ())]
    install = ["apt-get", "install", "-qqy", "--no-install-recommends", *packages]
    unasked = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        for command in (["apt-get", "update", "-qq"], install):
            subprocess.run(command, env=unasked, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise UserError(
            f"SLURM is not installed, and {' '.join(install)} fails ({error}); run this as root on "
            "Debian."
        ) from error


def _free_ports(count: int) -> list[int]:
    """Return ports that nothing listens on."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


@contextmanager
def _daemon(command: str, folder: Path, name: str) -> Iterator[None]:
    with (folder / f"{name}.out").open("wb") as out:
        process = subprocess.Popen(command.split(), stdout=out, stderr=out)
        try:
            yield
        finally:
            process.terminate()
            process.wait()


def _last_lines(folder: Path) -> str:
    return "; ".join(line for path in folder.glob("*.out")
                     for line in path.read_text(errors="replace").splitlines()[-2:])  # fmt: skip


def asked(*command: str) -> str:
    """What a command of SLURM prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip()


def until(condition: Callable[[], object], seconds: float) -> bool:
    """Wait until a condition holds, at most so many seconds; return whether it does."""
    end = time.monotonic() + seconds
    while not (holds := bool(condition())) and time.monotonic() < end:
        time.sleep(0.2)
    return holds
