"""Runs of candidates side by side, each in a process that starts once, within a budget of time.

A run may take all the time that is left while another process goes on with those behind it; of one
process, or the last that is free, it leaves the next as much, unless that were not worth to begin;
and less where only models wait that are seldom the best.
What a run prints is in its folder's log.txt.
"""

from __future__ import annotations

import math
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

from runner.launch.launcher import environment_of
from runner.launch.processes import fresh_process

LOG = "log.txt"
EVEN, MOST = 0.5, 0.75  # of the time left: taken before any model, and before ones seldom best
LOOK = 0.5  # s between two looks at what runs
_LOST = {"failed": "its process was lost (not enough memory?)", "seconds": 0.0}
_shared: dict[tuple[str, ...], Any] = {}  # of runs in this process, by the words of their data


class Job(NamedTuple):
    """The words that train candidate `number`, and the folder of its run."""

    number: int
    words: list[str]
    folder: str
    quick: bool = False
    seldom: bool = False


class Look(NamedTuple):
    """What happened since the last look: jobs that began, what `fit` returned of those that ended.

    running: the seconds that each of the others has taken.
    """

    begun: list[int]
    ended: dict[int, dict[str, Any]]
    running: dict[int, float]


def fit(words: Sequence[str], folder: str) -> dict[str, Any]:
    """One run in this process: {"metrics": …} of a finished one, else {"failed": why}."""
    from runner.config.command_line import EXPECTED, reason_of
    from runner.config.compose import composed
    from runner.job import Shared, identify

    Path(folder).mkdir(parents=True, exist_ok=True)
    begun, found = time.monotonic(), dict[str, Any]()
    shared = _shared.setdefault(tuple(w for w in words if w.startswith("data")), Shared())
    with (
        (Path(folder) / LOG).open("w", encoding="utf-8", buffering=1) as log,
        redirect_stdout(log),
        redirect_stderr(log),
    ):
        try:
            found["metrics"] = identify(composed(*words), Path(folder), shared=shared)
        except EXPECTED as error:
            found["failed"] = reason_of(error)
        except Exception as error:  # a bug of one model is no reason to lose the others
            traceback.print_exc()
            found["failed"] = f"{type(error).__name__}: {error}"
    return {**found, "seconds": time.monotonic() - begun}


def warm_up() -> None:
    """Load what every run needs."""
    from runner.loading import loading

    with loading():
        import runner.job  # noqa: F401


class Fits:
    """Processes that fit candidates; they load what they need while others still read files."""

    def __init__(self, processes: int | None = None) -> None:
        from joblib import effective_n_jobs

        count = effective_n_jobs(-1) if processes is None else processes
        self.pools = [self._process() for _ in range(count)]
        self.others: list[float] = []  # s that runs took for all but their fit
        self.later: list[float] = []  # of those that were not the first of their process
        self.warm: set[Any] = set()  # processes that have done one

    def _process(self) -> Any:
        pool = fresh_process(environment_of(1))
        pool.submit(warm_up)
        return pool

    def run(
        self, jobs: Sequence[Job], end: float, is_wanted: Callable[[int], bool]
    ) -> Iterator[Look]:
        """Do jobs until the time `end` of the monotonic clock; twice a second, what happened.

        is_wanted: whether a job is worth its time when its turn comes. None is begun that would
        take longer for all else than for its fit; for a quick one the first run of a process, which
        loads and reads, does not count. A run that goes on longer than its fit may, and all others
        took beside theirs, is ended. Time or none, quick ones go on until one has been fitted.
        """
        waiting, idle = deque(jobs), list(self.pools)
        busy: dict[Future[dict[str, Any]], tuple[Any, Job, float]] = {}
        whole: set[int] = set()  # jobs that may take all the time that is left
        while waiting or busy:
            look = Look([], {}, {})
            while waiting and idle:
                job = waiting.popleft()
                beside = max(self.later if job.quick else self.others, default=0.0)
                left = end - time.monotonic() - beside
                owed = job.quick and not self.others
                if not (left > beside or owed) or not is_wanted(job.number):
                    continue
                if not waiting or (not job.quick and len(whole) < len(self.pools) - 1):
                    whole.add(job.number)
                part = MOST if all(one.seldom for one in waiting) else EVEN
                own = part * (left - beside)  # the next one, too, takes time beside its fit
                share = left if job.number in whole or left - beside - own <= beside else own
                limit = [f"budget={share:.3g}"] if 0.0 < share < math.inf else []
                pool = idle.pop()
                task = pool.submit(fit, [*job.words, *limit], job.folder)
                busy[task] = pool, job, time.monotonic()
                look.begun.append(job.number)
            for future in wait(busy, timeout=LOOK, return_when=FIRST_COMPLETED).done:
                pool, job, _ = busy.pop(future)
                whole.discard(job.number)
                if lost := future.exception():
                    self.pools.remove(pool)
                    self.pools.append(pool := self._process())
                idle.append(pool)
                result: dict[str, Any] = _LOST if lost else future.result()
                if "metrics" in result:
                    self.others.append(result["seconds"] - result["metrics"]["fit_seconds"])
                    self.later += self.others[-1:] if pool in self.warm else []
                    self.warm.add(pool)
                look.ended[job.number] = result
            now = time.monotonic()
            look.running.update({job.number: now - start for _, job, start in busy.values()})
            yield look
            owed = any(job.quick for job in [*waiting, *(job for _, job, _ in busy.values())])
            if now > end + max(self.others, default=0.0) and (self.others or not owed):
                return

    def close(self) -> None:
        """End all processes."""
        for pool in self.pools:
            pool.shutdown(kill_workers=True)
