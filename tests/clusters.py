"""A Slurm of one node and a Ray cluster of two, on 127.0.0.1, for as long as a test needs them."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

SLURM = """\
ClusterName=loopback
SlurmctldHost=localhost(127.0.0.1)
SlurmUser=root
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
KillWait=2
SlurmdParameters=config_overrides
NodeName=localhost NodeAddr=127.0.0.1 NodeHostname={host} CPUs=2
PartitionName=all Nodes=localhost Default=YES
"""
# `ray start` takes 127.0.0.1 for the address that others see, and would listen everywhere
RAY = """\
import ray._private.services as services
services.get_node_ip_address = lambda *_: "127.0.0.1"
from ray.scripts.scripts import main
main()
"""


def why_no_slurm() -> str | None:
    """What a test of Slurm lacks here."""
    programs = ("munged", "slurmctld", "slurmd", "srun")
    if missing := [name for name in programs if shutil.which(name) is None]:
        return f"{', '.join(missing)} not installed (slurmctld, slurmd, slurm-client, munge)"
    return None if os.geteuid() == 0 else "slurmd runs as root only"


@contextmanager
def slurm() -> Iterator[dict[str, str]]:
    """Slurm with two cores; what its commands want in their environment."""
    folder = Path(tempfile.mkdtemp(prefix="slurm"))
    folder.chmod(0o755)  # munged is another user
    with ExitStack() as stack:
        stack.callback(shutil.rmtree, folder)
        for name in ("munge", "state", "spool"):
            (folder / name).mkdir()
        key = folder / "munge" / "key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o400)
        for path in (key.parent, key):
            shutil.chown(path, "munge", "munge")
        conf = folder / "slurm.conf"
        host = socket.gethostname().partition(".")[0]
        conf.write_text(SLURM.format(folder=folder, ports=_free_ports(2), host=host))
        files = [f"--{name}-file={key.parent / name}" for name in ("key", "pid", "log", "seed")]
        munged = ["munged", "--foreground", f"--socket={key.parent / 'socket'}", *files]
        stack.enter_context(_daemon(munged, user="munge", group="munge", extra_groups=[]))
        _until((key.parent / "socket").exists, "munged")
        stack.enter_context(_daemon(["slurmctld", "-D", "-f", str(conf)]))
        stack.enter_context(_daemon(["slurmd", "-D", "-N", "localhost", "-f", str(conf)]))
        environment = {"SLURM_CONF": str(conf)}
        _until(lambda: "idle" in _output(["sinfo", "-h", "-o", "%T"], environment), "slurmd")
        stack.callback(lambda: _until(lambda: not _jobs(environment), "the end of Slurm's jobs"))
        stack.callback(_output, ["scancel", "--user=root"], environment)
        yield environment


def _jobs(environment: dict[str, str]) -> str:
    return _output(["squeue", "--noheader"], environment)


@contextmanager
def ray_nodes() -> Iterator[tuple[str, dict[str, str], subprocess.Popen]]:
    """Two nodes of one core; their address, the environment to use them in, the second node."""
    folder = Path(tempfile.mkdtemp(prefix="ray"))
    token = folder / "token"
    token.write_text(secrets.token_hex(32))
    environment = {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN_PATH": str(token),
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # for the sweep: its own address is 127.0.0.1
    }
    nodes = environment | {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "1"}
    address = f"127.0.0.1:{_free_ports(1)[0]}"
    start = [sys.executable, "-c", RAY, "start", "--block", "--num-cpus=1"]
    head = [*start, "--head", f"--port={address.partition(':')[2]}", "--include-dashboard=false"]
    with ExitStack() as stack:
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        stack.enter_context(_daemon([*head, f"--temp-dir={folder}"], nodes))
        _until(lambda: _nodes(address, nodes) == 1, "the first node")
        second = stack.enter_context(_daemon([*start, f"--address={address}"], nodes))
        _until(lambda: _nodes(address, nodes) == 2, "the second node")
        yield address, environment, second


def _nodes(address: str, environment: dict[str, str]) -> int:
    words = [sys.executable, "-c", RAY, "status", "--address", address]
    return _output(words, environment).count(" node_")


def processes_of(daemon: subprocess.Popen) -> dict[int, str]:
    """A process and all that came from it, with their command lines."""
    parents, names = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
            names[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
            parents[int(folder.name)] = int(stat[1])
    found = {daemon.pid}
    while new := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= new
    return {pid: names.get(pid, "") for pid in sorted(found)}


def kill(daemon: subprocess.Popen) -> None:
    """End a process and all that came from it, at once."""
    for pid in processes_of(daemon):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    daemon.wait()


@contextmanager
def _daemon(words: list[str], environment: dict[str, str] | None = None, **options) -> Iterator:
    env, nowhere = os.environ | (environment or {}), subprocess.DEVNULL
    process = subprocess.Popen(words, env=env, stdout=nowhere, stderr=nowhere, **options)
    try:
        yield process
    finally:
        kill(process)


def _until(condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"{what} did not start in {seconds} s")
        time.sleep(0.2)


def _output(words: list[str], environment: dict[str, str]) -> str:
    env = os.environ | environment
    return subprocess.run(words, env=env, capture_output=True, text=True, check=False).stdout


def _free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]
