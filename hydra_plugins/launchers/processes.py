"""Processes side by side on one machine; one that is lost is replaced, its run is tried again."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from hydra_plugins.launchers.launcher import Worker

TRIES = 4  # of a run whose process is lost; more often, and the run itself is the reason
_worker: Worker


def _start(worker: Worker, parent: int) -> None:
    global _worker
    _worker = worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends us
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """Nobody works on after a sweep was killed: it would meet the next one in the same folder."""
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)


def _run(words: Sequence[str]) -> str | None:
    return _worker(words)


def _process(worker: Worker) -> Any:
    """A process that starts afresh. One to a pool, so that losing it breaks no other."""
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    return ProcessPoolExecutor(
        1, initializer=_start, initargs=(worker, os.getpid()), env=worker.environment
    )


def run_side_by_side(worker: Worker, jobs: list[list[str]], processes: int) -> dict[str, str]:
    """Do all jobs, each some words; why a run has no result, by its words."""
    waiting, tries, lost = deque(jobs), Counter[str](), dict[str, str]()
    pools = {_process(worker) for _ in range(min(processes, len(jobs)))}
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
                    pools.add(pool := _process(worker))
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
