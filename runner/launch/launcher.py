"""What launchers share: runs in processes that start afresh, and the reasons of lost runs.

A run's folder says whether the run is done; nothing but the reason of a lost run comes back.
"""

from __future__ import annotations

import os
import pickle
from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import cloudpickle
from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, JobStatus, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

from runner.config.compose import prepare_hydra
from runner.folder.run_folder import FAILED, METRICS

ROOT = Path(__file__).parent.parent.parent
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


def environment_of(threads: int) -> dict[str, str]:
    """Variables of a process that does runs on so many threads."""
    # libraries read these when they are loaded, before a run can say threads=
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    path = os.pathsep.join(dict.fromkeys(filter(None, paths)))
    return dict.fromkeys(THREADS, str(threads)) | {"PYTHONPATH": path}


class Worker:
    """Does runs of a sweep, one after another, in any process that sees the same folders."""

    def __init__(self, context: HydraContext, config: DictConfig, task: TaskFunction) -> None:
        self.context, self.config = context, config
        self.task = cloudpickle.dumps(task)  # by value: the program is no module of the workers
        self.singletons = Singleton.get_state()
        self.folder = Path.cwd()
        self.environment = environment_of(config.threads or 1)

    def __call__(self, words: Sequence[str]) -> str | None:
        """Do one run from the words typed for it; why the run left no result, if it cannot say."""
        try:
            os.chdir(self.folder)
            prepare_hydra()
            setup_globals()
            Singleton.set_state(self.singletons)
            cfg = self.context.config_loader.load_sweep_config(self.config, list(words))
            HydraConfig.instance().set_config(cfg)
            folder = Path(cfg.hydra.sweep.dir) / cfg.hydra.sweep.subdir
            if has_ended(folder):
                return None  # done by a worker that was lost before it could say so
            done = run_job(self._task, cfg, "hydra.sweep.dir", "hydra.sweep.subdir", self.context)
        except Exception as error:
            return reason_of(error)
        return reason_of(done._return_value) if done.status == JobStatus.FAILED else None

    def do(self, batch: Sequence[list[str]]) -> dict[str, str]:
        """Do all runs; {words of a run: why it has no result, if it cannot say}."""
        reasons = {" ".join(words): self(words) for words in batch}
        return {name: reason for name, reason in reasons.items() if reason}

    @cached_property
    def _task(self) -> TaskFunction:
        return pickle.loads(self.task)  # made by this sweep


def has_ended(folder: Path) -> bool:
    """Whether the run of a folder is done, or has failed."""
    return any((folder / name).is_file() for name in (METRICS, FAILED))


def reason_of(error: Exception) -> str:
    """An error in one line, the same for all runs that a full disk stopped."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    name = "" if type(error) is RuntimeError else f"{type(error).__name__}: "
    return " ".join(f"{name}{error}".split())


class SweepLauncher(Launcher):
    """Gives the runs to workers and returns those that were lost. Subclasses implement `work`."""

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        self.context, self.task_function, self.config = hydra_context, task_function, config

    def launch(
        self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int
    ) -> Sequence[JobReturn]:
        worker = Worker(self.context, self.config, self.task_function)
        lost = self.work(worker, [list(words) for words in job_overrides])
        return [
            JobReturn(words.split(), status=JobStatus.FAILED, _return_value=RuntimeError(reason))
            for words, reason in lost.items()
        ]

    @abstractmethod
    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        """Let `worker` do all jobs; {words of a job: why it has no result} of the lost ones."""
