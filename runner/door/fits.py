"""Runs of candidates side by side, each in a process that starts once, within a budget of time.

A run may take half of the time that is left for it, so that something is left for those behind it;
the last ones take all. What a run says meanwhile is in the log.txt of its folder.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from runner.launch.launcher import environment_of
from runner.launch.processes import fresh_process

LOG = "log.txt"
CLOSING = 2.0  # s for the scores of a run whose fit was ended, and to begin the next


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
            metrics = identify(composed(*words), Path(folder))
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

    def _process(self) -> Any:
        pool = fresh_process(environment_of(1))
        pool.submit(warm_up)
        return pool

    def run(
        self,
        jobs: Sequence[tuple[int, list[str], str]],
        end: float,
        begun: Callable[[int], None],
        done: Callable[[int, dict[str, Any]], None],
        look: Callable[[dict[int, float]], None],
        wanted: Callable[[int], bool],
    ) -> None:
        """Do jobs (number, words, folder) until the time `end` of the monotonic clock.

        done: with what `fit` returns; look: twice a second, with the seconds each running job has
        taken; wanted: whether a job is still worth its time when its turn comes.
        """
        waiting, idle = deque(jobs), list(self.pools)
        busy: dict[Future[dict[str, Any]], tuple[Any, int, float]] = {}
        while waiting or busy:
            while waiting and idle:
                number, words, folder = waiting.popleft()
                left = end - time.monotonic() - CLOSING
                if left <= CLOSING or not wanted(number):
                    continue
                share = left if len(waiting) < len(self.pools) else left / 2.0
                pool = idle.pop()
                begun(number)
                task = pool.submit(fit, [*words, f"budget={share:.3g}"], folder)
                busy[task] = pool, number, time.monotonic()
            if not busy:
                break
            finished = wait(busy, timeout=0.5, return_when=FIRST_COMPLETED).done
            for future in finished:
                pool, number, _ = busy.pop(future)
                lost = future.exception()
                if lost is not None:
                    self.pools.remove(pool)
                    self.pools.append(pool := self._process())
                idle.append(pool)
                why = {"failed": "its process was lost (not enough memory?)", "seconds": 0.0}
                done(number, why if lost is not None else future.result())
            now = time.monotonic()
            look({number: now - start for _, number, start in busy.values()})
            if now > end + 30.0:
                break

    def close(self) -> None:
        """End all processes."""
        for pool in self.pools:
            pool.shutdown(kill_workers=True)
