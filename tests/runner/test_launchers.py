"""The same sweep by each launcher: the same results, whatever is lost on the way."""

from __future__ import annotations

import importlib.util
import json
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

import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate

import train
from runner.config.compose import CONF, prepare_hydra
from runner.launch import batched, processes
from runner.launch.launcher import THREADS
from runner.launch.processes import run_side_by_side
from tests.program.test_train import run
from tests.runner.test_sweep import QUICK, results

# A Slurm of one node and a Ray cluster of two, on 127.0.0.1
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


def _until(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        if time.monotonic() > end:
            raise RuntimeError(f"{what} did not start in a minute")
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


ROOT = Path(__file__).parents[2]
SWEEP = [sys.executable, "train.py", "-m", *QUICK, "model=two_point,vwnn", "seed=range(0,3)"]
needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="no Ray: '.[ray]'")
needs_slurm = pytest.mark.skipif(bool(why_no_slurm()), reason=str(why_no_slurm()))


def sweep(folder: Path, *words: str, **environment: str) -> subprocess.Popen:
    """Six cheap runs, started."""
    env = {name: value for name, value in os.environ.items() if name not in THREADS}
    return subprocess.Popen(
        [*SWEEP, f"hydra.sweep.dir={folder}", *words],
        cwd=ROOT,
        env=env | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def wait_until(condition: Callable[[], object], process: subprocess.Popen) -> None:
    until = time.monotonic() + 180.0
    while not condition():
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> dict[str, dict]:
    """What one process, this one, finds run after run."""
    folder = tmp_path_factory.mktemp("undisturbed")
    words = [*SWEEP[2:], "hydra/launcher=basic", f"hydra.sweep.dir={folder}"]
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert run(train, monkeypatch, *words) == 0
    assert len(results(folder)) == 6
    return results(folder)


@pytest.mark.parametrize("launcher", ["joblib", "ray", "slurm"])
def test_each_launcher_is_one_word(launcher):
    prepare_hydra()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", [f"hydra/launcher={launcher}"], return_hydra_config=True)
    cfg.hydra.runtime.cwd = str(ROOT)
    instantiate(cfg.hydra.launcher)
    assert (CONF / f"hydra/launcher/{launcher}.yaml").read_text("utf-8").startswith("# ")


def test_a_lost_process_is_replaced_and_costs_no_other_run(tmp_path, monkeypatch):
    class Fatal:
        """Its run `die` kills the process; the others leave a file."""

        environment = {"OMP_NUM_THREADS": "3"}  # noqa: RUF012

        def do(self, batch):
            for words in batch:
                if words == ["die"]:
                    os.kill(os.getpid(), signal.SIGKILL)
                if words == ["raise"]:
                    raise MemoryError("of this run")
                (tmp_path / words[0]).write_text(os.environ["OMP_NUM_THREADS"])
            return {"5": "said so"} if ["5"] in batch else {}

    monkeypatch.setattr(processes, "TRIES", 2)  # a process each
    jobs = [[["0"], ["die"], ["1"]], [["raise"]], [["2"], ["3"]], [["4"]], [["5"]]]
    lost = run_side_by_side(Fatal(), jobs, 2)
    assert {path.name for path in tmp_path.iterdir()} == {str(n) for n in range(6)}
    assert {path.read_text() for path in tmp_path.iterdir()} == {"3"}
    assert lost.keys() == {"die", "raise", "5"}
    assert lost["5"] == "said so"
    assert "of this run" in lost["raise"]
    assert "lost 2 times" in lost["die"]


def test_a_sweep_loses_a_process_and_no_run(tmp_path, undisturbed, monkeypatch, capsys):
    """Batches on joblib's processes: what a lost batch had not done is done run by run."""

    class Fatal(batched.Batches):
        """Two runs of a batch kill the process."""

        def do(self, batch):
            done = super().do(batch[:2])
            if len(batch) > 1:
                os.kill(os.getpid(), signal.SIGKILL)
            return done

    monkeypatch.setattr(batched, "Batches", Fatal)
    monkeypatch.setattr(batched, "BATCHES", 1)  # with all runs
    words = [*SWEEP[2:], "model=vwnn", "hydra/launcher=batched", "hydra.launcher.n_jobs=1"]
    assert run(train, monkeypatch, *words, f"hydra.sweep.dir={tmp_path}") == 0
    assert "3 done, 0 failed" in capsys.readouterr().out
    once = {"simulation_error": None}  # which a process measures for all its runs
    found, expected = (
        {name: metrics | once for name, metrics in each.items() if metrics["model"] == "vwnn"}
        for each in (results(tmp_path), undisturbed)
    )
    assert len(expected) == 3
    assert found == expected


WORKERS = """
import os, time
from pathlib import Path
from runner.launch.processes import run_side_by_side

class Long:
    environment = {}

    def do(self, batch):
        (Path(FOLDER) / batch[0][0]).write_text(str(os.getpid()))
        time.sleep(600)

run_side_by_side(Long(), [[["0"]], [["1"]]], 2)
"""


def test_nobody_works_on_after_a_sweep_was_killed(tmp_path):
    words = [sys.executable, "-c", WORKERS.replace("FOLDER", repr(str(tmp_path)))]
    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)

    def started() -> bool:
        texts = [path.read_text() for path in tmp_path.iterdir()]
        return len(texts) == 2 and all(texts)

    wait_until(started, process)
    workers = [int(path.read_text()) for path in tmp_path.iterdir()]
    assert all(map(command_line, workers))
    process.kill()
    process.communicate()
    until = time.monotonic() + 2.0
    while any(map(command_line, workers)) and time.monotonic() < until:
        time.sleep(0.02)
    assert not any(map(command_line, workers))


def command_line(pid: int) -> str:
    """Empty where it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


@needs_ray
def test_a_ray_cluster_loses_a_node_and_no_run(tmp_path, undisturbed):
    with ray_nodes() as (address, environment, second):
        words = ["hydra/launcher=ray", f"hydra.launcher.address={address}"]
        process = sweep(tmp_path, *words, **environment)
        wait_until(lambda: len(results(tmp_path)) >= 3, process)
        wait_until(lambda: busy(second), process)
        kill(second)
        assert len(results(tmp_path)) < 5
        printed = process.communicate()[0]
    assert process.returncode == 0, printed
    assert "6 done, 0 failed" in printed
    assert results(tmp_path) == undisturbed


def busy(node: subprocess.Popen) -> bool:
    """Whether a Ray node does a run now: its processes are renamed then."""
    names = processes_of(node).values()
    return any(
        name.startswith("ray::") and "IDLE" not in name and "Agent" not in name for name in names
    )


@needs_slurm
def test_slurm_does_a_sweep_whose_command_was_killed(tmp_path, undisturbed):
    with slurm() as environment:
        words = ["hydra/launcher=slurm", "hydra.launcher.jobs=2", "hydra.launcher.hours=1"]
        process = sweep(tmp_path, *words, **environment)
        wait_until(lambda: len(results(tmp_path)) >= 3, process)
        process.kill()
        process.communicate()
        assert len(results(tmp_path)) < 6
        printed = (process := sweep(tmp_path, *words, **environment)).communicate()[0]
    assert process.returncode == 0, printed
    assert "6 done (" in printed
    assert results(tmp_path) == undisturbed
    assert all(json.loads(path.read_text()) == {} for path in tmp_path.glob("slurm/lost*.json"))
