"""Runs of candidates side by side, each in a process that starts once, within a budget of time.

A run may take all the time that is left while another process goes on with those behind it; of one
process, or the last that is free, it may take half. What a run says is in its folder's log.txt.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from runner.launch.launcher import environment_of
from runner.launch.processes import fresh_process

LOG = "log.txt"
LOOK = 0.5  # s between two looks at what runs
SHORTEST = 1.0  # s: reading, opponents and scores take as long at least
_LOST = {"failed": "its process was lost (not enough memory?)", "seconds": 0.0}


_opponents: dict[str, Any] = {}  # that a process identified: all its runs have the same data


class Job(NamedTuple):
    """The words that train candidate `number`, and the folder of its run."""

    number: int
    words: list[str]
    folder: str
    quick: bool = False


@dataclass(frozen=True)
class Callbacks:
    """Who is told: when a job begins, with what `fit` returned, of the seconds that running jobs
    have taken; who is asked whether a job is still worth its time when its turn comes."""

    begun: Callable[[int], None]
    done: Callable[[int, dict[str, Any]], None]
    looked: Callable[[dict[int, float]], None]
    wanted: Callable[[int], bool]


def fit(words: Sequence[str], folder: str) -> dict[str, Any]:
    """One run in this process: {"metrics": …} of a finished one, else {"failed": why}."""
    from runner.config.command_line import EXPECTED, reason_of
    from runner.config.compose import composed
    from runner.job import identify

    Path(folder).mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    with (
        (Path(folder) / LOG).open("w", encoding="utf-8", buffering=1) as log,
        redirect_stdout(log),
        redirect_stderr(log),
    ):
        try:
            metrics = identify(composed(*words), Path(folder), known=_opponents)
        except EXPECTED as error:
            return {"failed": reason_of(error), "seconds": time.monotonic() - begun}
        except Exception as error:  # a bug of one model is no reason to lose the others
            import traceback

            traceback.print_exc()
            return {"failed": f"{type(error).__name__}: {error}"[:300],
                    "seconds": time.monotonic() - begun}  # fmt: skip
    return {"metrics": metrics, "seconds": time.monotonic() - begun}


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

    def _process(self) -> Any:
        pool = fresh_process(environment_of(1))
        pool.submit(warm_up)
        return pool

    def run(self, jobs: Sequence[Job], end: float, watch: Callbacks) -> None:
        """Do jobs until the time `end` of the monotonic clock; what cannot be done is not begun.

        A run that goes on longer than its fit may, and all others take beside theirs, is ended.
        """
        waiting, idle = deque(jobs), list(self.pools)
        busy: dict[Future[dict[str, Any]], tuple[Any, Job, float]] = {}
        endless: set[int] = set()  # jobs that may take all the time that is left
        while waiting or busy:
            while waiting and idle:
                job = waiting.popleft()
                left = end - time.monotonic() - min(self.others, default=SHORTEST)
                if left <= max(self.others, default=0.0) or not watch.wanted(job.number):
                    continue  # it would take longer for all else than for its fit
                whole = not waiting or (not job.quick and len(endless) < len(self.pools) - 1)
                share = left if whole else left / 2.0
                endless |= {job.number} if whole else set()
                pool = idle.pop()
                watch.begun(job.number)
                limit = [f"budget={share:.3g}"] if math.isfinite(share) else []
                task = pool.submit(fit, [*job.words, *limit], job.folder)
                busy[task] = pool, job, time.monotonic()
            for future in wait(busy, timeout=LOOK, return_when=FIRST_COMPLETED).done:
                pool, job, _ = busy.pop(future)
                endless.discard(job.number)
                if lost := future.exception():
                    self.pools.remove(pool)
                    self.pools.append(pool := self._process())
                idle.append(pool)
                result: dict[str, Any] = _LOST if lost else future.result()
                if "metrics" in result:
                    self.others.append(result["seconds"] - result["metrics"]["fit_seconds"])
                watch.done(job.number, result)
            now = time.monotonic()
            watch.looked({job.number: now - start for _, job, start in busy.values()})
            if now > end + max(self.others, default=SHORTEST):
                return

    def close(self) -> None:
        """End all processes."""
        for pool in self.pools:
            pool.shutdown(kill_workers=True)
