"""Processes side by side on one machine; a lost one is replaced, its run is tried again.

On joblib's processes, and not through hydra-joblib-launcher: there one lost process (memory) ends
the sweep. joblib is imported where it is used: Hydra imports this file at every start.
"""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

import psutil

from runner.launch.launcher import SweepLauncher, Worker

TRIES = 4  # of a run whose process is lost; more often, and the run itself is the reason
_worker: Worker | None


class JoblibLauncher(SweepLauncher):
    """All cores of this machine, or `n_jobs` processes."""

    def __init__(self, n_jobs: int = -1, **foreign: object) -> None:
        if foreign:  # Hydra mixes the settings of two launchers of one name
            raise ValueError("two launchers named joblib; pip uninstall hydra-joblib-launcher")
        self.n_jobs = n_jobs

    def work(self, worker: Worker, jobs: list[list[str]]) -> dict[str, str]:
        from joblib import effective_n_jobs

        return run_side_by_side(worker, jobs, effective_n_jobs(self.n_jobs))


def _start(worker: Worker | None, parent: int) -> None:
    global _worker
    _worker = worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


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


def _run(words: Sequence[str]) -> str | None:
    assert _worker is not None
    return _worker(words)


def fresh_process(environment: Mapping[str, str], worker: Worker | None = None) -> Any:
    """A pool of one process that starts afresh, so that losing the process breaks no other."""
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    # joblib replaces a process whose memory grew, as that of one that loads models does
    warnings.filterwarnings("ignore", message="A worker stopped", category=UserWarning)
    return ProcessPoolExecutor(
        1, initializer=_start, initargs=(worker, os.getpid()), env=dict(environment)
    )


def run_side_by_side(worker: Worker, jobs: list[list[str]], processes: int) -> dict[str, str]:
    """Do all jobs; {words of a job: why it has no result} of those that were lost."""
    waiting, tries, lost = deque(jobs), Counter[str](), dict[str, str]()
    pools = {fresh_process(worker.environment, worker) for _ in range(min(processes, len(jobs)))}
    idle, busy = list(pools), dict[Future[str | None], tuple[Any, list[str]]]()
    try:
        while waiting or busy:
            while waiting and idle:
                pool, words = idle.pop(), waiting.popleft()
                busy[pool.submit(_run, words)] = pool, words
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                pool, words = busy.pop(future)
                name, broken = " ".join(words), isinstance(future.exception(), BrokenProcessPool)
                if broken:
                    tries[name] += 1
                    pools.remove(pool)
                    pools.add(pool := fresh_process(worker.environment, worker))
                idle.append(pool)
                if broken and tries[name] < TRIES:
                    waiting.append(words)
                elif reason := _reason(future):
                    lost[name] = reason
    finally:
        for pool in pools:
            pool.shutdown(kill_workers=True)
    return lost


def _reason(future: Future[str | None]) -> str | None:
    error = future.exception()
    if isinstance(error, BrokenProcessPool):
        return f"its process was lost {TRIES} times (not enough memory?)"
    return f"{type(error).__name__}: {error}" if error else future.result()
