"""A SLURM cluster of this machine alone, on the loopback address and without systemd or cgroups."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tex_lightning.errors import UserError

SETTINGS = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/filetxt
JobCompLoc={folder}/completed
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
JobRequeue=1
KillWait=5
ReturnToService=2
SchedulerParameters=batch_sched_delay=0,sched_interval=2
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmdSpoolDir={folder}/spool
StateSaveLocation={folder}/state
NodeName=localhost NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cores}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
DAEMONS = (
    "munged --foreground --force --key-file={folder}/key --socket={folder}/munge.socket"
    " --pid-file={folder}/munged.pid --log-file={folder}/munged.log --seed-file={folder}/seed",
    "slurmctld -D -f {folder}/slurm.conf",
    "slurmd -D -N localhost -f {folder}/slurm.conf",
)


@contextmanager
def cluster(folder: Path) -> Iterator[None]:
    """Start SLURM, for the programs below this one too; end it, with all of its jobs.

    Args:
        folder: Of the settings, the logs and the state; made.

    Raises:
        UserError: If it is not there and cannot be installed, or does not start.
    """
    _install()
    folder.mkdir(mode=0o755)
    for name in ("spool", "state"):
        (folder / name).mkdir()
    (folder / "key").write_bytes(os.urandom(128))
    (folder / "key").chmod(0o600)
    host, cores = socket.gethostname(), os.cpu_count()
    conf = folder / "slurm.conf"
    conf.write_text(SETTINGS.format(host=host, cores=cores, folder=folder, ports=_free_ports()))
    with ExitStack() as stack:
        for command in DAEMONS:
            stack.enter_context(_daemon(command.format(folder=folder).split(), folder))
            time.sleep(1)
        os.environ["SLURM_CONF"] = str(conf)
        stack.callback(os.environ.pop, "SLURM_CONF")
        if not until(lambda: "idle" in asked("sinfo", "-h", "-o", "%T"), 30):
            raise UserError(f"SLURM does not start; its logs say why: {_last_lines(folder)}.")
        stack.callback(until, lambda: not asked("squeue", "-h"), 30)
        stack.callback(asked, "scancel", "--me")
        yield


def _install() -> None:
    """Install SLURM from Debian's packages, unless it is there.

    Raises:
        UserError: If that does not work.
    """
    if all(shutil.which(command.split()[0]) for command in DAEMONS):
        return
    install = ["apt-get", "install", "-qqy", "--no-install-recommends", "slurm-wlm", "munge"]
    unasked = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        for command in (["apt-get", "update", "-qq"], install):
            subprocess.run(command, env=unasked, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise UserError(
            f"SLURM is not installed, and {' '.join(install)} fails ({error}); run this as root on "
            "Debian."
        ) from error


def _free_ports() -> list[int]:
    """Return two ports that nothing listens on."""
    with socket.socket() as one, socket.socket() as two:
        for each in (one, two):
            each.bind(("127.0.0.1", 0))
        return [one.getsockname()[1], two.getsockname()[1]]


@contextmanager
def _daemon(command: list[str], folder: Path) -> Iterator[None]:
    with (folder / f"{command[0]}.out").open("wb") as out:
        process = subprocess.Popen(command, stdout=out, stderr=out)
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
