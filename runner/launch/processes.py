"""Processes side by side on one machine; a lost one is replaced, its run is tried again.

On joblib's processes, and not through hydra-joblib-launcher: there one lost process (memory) ends
the sweep. joblib is imported where it is used: Hydra imports this file at every start.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Protocol

import cloudpickle
import psutil

from runner.launch.launcher import SweepLauncher, Worker
from runner.loading import loading

TRIES = 4  # of a run whose process is lost; more often, and the run itself is the reason
Batch = list[list[str]]  # the words of each of its runs


class RunWorker(Protocol):
    """What a process is given to do batches with."""

    @property
    def environment(self) -> Mapping[str, str]:
        """Variables of the process."""
        ...

    def do(self, batch: Batch) -> dict[str, str]:
        """Do all runs; {words of a run: why it has no result, if it cannot say}."""
        ...


_worker: RunWorker | None


class JoblibLauncher(SweepLauncher):
    """All cores of this machine, or `n_jobs` processes."""

    def __init__(self, n_jobs: int = -1, **foreign: object) -> None:
        if foreign:  # Hydra mixes the settings of two launchers of one name
            raise ValueError("two launchers named joblib; pip uninstall hydra-joblib-launcher")
        self.n_jobs = n_jobs

    @property
    def processes(self) -> int:
        from joblib import effective_n_jobs

        return effective_n_jobs(self.n_jobs)

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        return run_side_by_side(worker, [[words] for words in jobs], self.processes)


def _start(worker: bytes | None, parent: int) -> None:
    """worker: pickled; unpickling it imports the models, which `loading` makes faster."""
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if worker is not None:
        with loading():
            _worker = pickle.loads(worker)


def _end_with(parent: int) -> None:
    """End this process when its parent ended: two sweeps must not meet in one folder.

    Asked of the parent itself, by number and time of its start: only Unix reports a lost parent by
    another number of the parent.
    """
    try:
        sweep = psutil.Process(parent)
        while sweep.is_running() and sweep.status() != psutil.STATUS_ZOMBIE:
            time.sleep(0.2)
    except psutil.NoSuchProcess:
        pass
    os._exit(1)


def _run(batch: Batch) -> dict[str, str]:
    assert _worker is not None
    return _worker.do(batch)


def fresh_process(environment: Mapping[str, str], worker: RunWorker | None = None) -> Any:
    """A pool of one process that starts afresh, so that losing the process breaks no other."""
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    # joblib replaces a process whose memory grew, as that of one that loads models does
    warnings.filterwarnings("ignore", message="A worker stopped", category=UserWarning)
    of_process = None if worker is None else cloudpickle.dumps(worker), os.getpid()
    return ProcessPoolExecutor(1, initializer=_start, initargs=of_process, env=dict(environment))


def run_side_by_side(worker: RunWorker, batches: list[Batch], processes: int) -> dict[str, str]:
    """Do all batches of runs; {words of a run: why it has no result} of those that were lost.

    The runs of a batch whose process is lost are done one by one, for the fault is one run's.
    """
    waiting, tries, lost = deque(batches), Counter[str](), dict[str, str]()
    pools = {fresh_process(worker.environment, worker) for _ in range(min(processes, len(batches)))}
    idle, busy = list(pools), dict[Future[dict[str, str]], tuple[Any, Batch]]()
    try:
        while waiting or busy:
            while waiting and idle:
                pool, batch = idle.pop(), waiting.popleft()
                busy[pool.submit(_run, batch)] = pool, batch
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                pool, batch = busy.pop(future)
                error = future.exception()
                broken = isinstance(error, BrokenProcessPool)
                if broken:
                    pools.remove(pool)
                    pools.add(pool := fresh_process(worker.environment, worker))
                idle.append(pool)
                lost |= future.result() if error is None else {}
                for words in batch if error is not None else ():
                    name = " ".join(words)
                    tries[name] += 1
                    if broken and tries[name] < TRIES:
                        waiting.append([words])
                    else:
                        lost[name] = _reason(error)
    finally:
        for pool in pools:
            pool.shutdown(kill_workers=True)
    return lost


def _reason(error: BaseException | None) -> str:
    if isinstance(error, BrokenProcessPool):
        return f"its process was lost {TRIES} times (not enough memory?)"
    return f"{type(error).__name__}: {error}"
