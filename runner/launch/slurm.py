"""hydra/launcher=slurm: a few Slurm jobs, each with its share of the runs of a sweep.

submitit, an extra that is imported where it is used, submits them as one array. Not through
hydra-submitit-launcher: it asks for a Slurm job a run, which costs the seconds of starting Python
each time, and one lost job ends the sweep.
"""

from __future__ import annotations

import hashlib
import json
import shlex
import subprocess
import sys
import time
from getpass import getuser
from pathlib import Path
from typing import Any

from data.whole_file import write_text
from runner.launch.launcher import SweepLauncher, Worker
from runner.launch.processes import run_side_by_side


class Share:
    """The work of one Slurm job. A job that Slurm starts again goes on where it was stopped."""

    def __init__(self, worker: Worker, processes: int) -> None:
        self.worker, self.processes = worker, processes

    def __call__(self, jobs: list[list[str]], lost: Path) -> None:
        reasons = run_side_by_side(self.worker, [[words] for words in jobs], self.processes)
        write_text(lost, json.dumps(reasons))

    def checkpoint(self, jobs: list[list[str]], lost: Path) -> Any:
        """The work that submitit queues again when the time of the job is up."""
        from submitit.helpers import DelayedSubmission

        return DelayedSubmission(self, jobs, lost)


class SlurmLauncher(SweepLauncher):
    """`cpus`, `gpus`, `memory_gb` and `hours` of a job; `restarts` of one whose time was up."""

    def __init__(
        self,
        folder: str,
        jobs: int = 4,
        cpus: int = 1,
        gpus: int = 0,
        memory_gb: float | None = None,
        hours: float = 24,
        partition: str | None = None,
        account: str | None = None,
        restarts: int = 10,
    ) -> None:
        self.folder, self.jobs, self.processes = Path(folder).absolute(), jobs, cpus
        self.restarts = restarts
        self.name = f"sweep-{hashlib.sha256(str(self.folder).encode()).hexdigest()[:10]}"
        needs = {
            "cpus_per_task": cpus,
            "gpus_per_node": gpus or None,
            "mem": None if memory_gb is None else f"{round(memory_gb * 1024)}M",
            "time": max(1, round(hours * 60)),
            "partition": partition,
            "account": account,
        }
        self.needs = {name: value for name, value in needs.items() if value is not None}

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        executor = self._executor(worker)
        _stop(self.name)  # Slurm's jobs outlive a command that was killed; two would meet
        shares = [jobs[first :: self.jobs] for first in range(min(self.jobs, len(jobs)))]
        files = [self.folder / f"lost{number}.json" for number in range(len(shares))]
        for file in files:
            file.unlink(missing_ok=True)
        self._submit(executor, Share(worker, self.processes), shares, files)
        try:
            _wait_for(self.name)
        except KeyboardInterrupt:
            _stop(self.name)
            raise
        if not all(file.exists() for file in files):
            print(f"lost: Slurm jobs; their logs are in {self.folder}", file=sys.stderr)
        lost = [json.loads(file.read_text("utf-8")) for file in files if file.exists()]
        return {name: reason for reasons in lost for name, reason in reasons.items()}

    def _submit(self, executor: Any, *work: Any) -> None:
        from submitit.core.utils import FailedJobError

        try:
            executor.map_array(*work)
        except FailedJobError as error:
            raise ValueError(f"Slurm does not take the sweep: {error}") from None

    def _executor(self, worker: Worker) -> Any:
        try:
            from submitit import SlurmExecutor
        except ModuleNotFoundError:
            raise ValueError(
                "hydra/launcher=slurm needs submitit; pip install -c constraints.txt -e '.[slurm]'"
            ) from None
        if SlurmExecutor.affinity() <= 0:
            raise ValueError(
                "hydra/launcher=slurm finds no srun; give the command where Slurm's are installed"
            )
        if (answer := _queue("squeue", self.name)).returncode:
            raise ValueError(f"Slurm does not answer: {answer.stderr.strip()}")
        executor = SlurmExecutor(self.folder, max_num_timeout=self.restarts)
        exports = [f"export {k}={shlex.quote(v)}" for k, v in worker.environment.items()]
        executor.update_parameters(job_name=self.name, setup=exports, **self.needs)
        return executor


def _queue(command: str, name: str) -> subprocess.CompletedProcess[str]:
    """Slurm's answer about the jobs of a sweep. squeue and not sacct, which needs a data base."""
    words = [command, f"--user={getuser()}", f"--name={name}"]
    words += ["--noheader"] if command == "squeue" else []
    return subprocess.run(words, check=False, capture_output=True, text=True)


def _stop(name: str) -> None:
    _queue("scancel", name)
    _wait_for(name)


def _wait_for(name: str) -> None:
    while (answer := _queue("squeue", name)).returncode or answer.stdout:
        time.sleep(1.0)
