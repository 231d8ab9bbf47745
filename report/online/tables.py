"""Tables of on-line models, as lines of Markdown. Median (smallest – largest) over the seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from report.online.cases import OnlineRun, cases
from report.output import markdown
from runner.scores.spread import Spread

ENOUGH = 1.2  # times the error of the batch fit
WAYS = ("adapting", "from_nothing")


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median (smallest – largest); one number where the three are the same."""
    return Spread(tuple(values)).text(lambda value: f"{value:.{digits}f}")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    return markdown(head, list(rows), left=None).splitlines()


def learning_table(runs: Sequence[OnlineRun]) -> list[str]:
    """Errors of the next record [%] beside those of the batch fit of the same seed."""
    batch = {(r.system, r.estimator, r.seed): r.error() for r in runs if not r.law}
    rows = []
    for case, of_case in cases(runs).items():
        pairs = [(r, batch.get((r.system, r.estimator, r.seed))) for r in of_case]
        paired = [(r, base) for r, base in pairs if base is not None]
        if not paired:
            continue
        ratios = [r.error("frozen") / base for r, base in paired]
        within = f"{sum(u <= ENOUGH for u in ratios)} of {len(ratios)}"
        frozen, adapting = ([r.error(way) for r, _ in paired] for way in ("frozen", ""))
        bases = [base for _, base in paired]
        columns = (spread(bases), spread(frozen), spread(ratios, 2), within, spread(adapting))
        rows.append((*case, *columns))
    ways = ("batch fit", "frozen after one pass", "frozen / batch", f"≤ {ENOUGH}", "adapting")
    return table(("system", "estimator", "law", *ways), rows)


def settling_tables(runs: Sequence[OnlineRun]) -> list[str]:
    """Two tables: how soon the error stays below a level, and what frozen weights are worth.

    Seconds from nothing; error [%] of the next record after some seconds of training.
    """
    times, worth = [], []
    for case, of_case in cases(runs).items():
        online = [r.metrics["online"] for r in of_case]
        nothing = [o["ways"]["from_nothing"]["settle_s"] for o in online]
        times.append((*case, *(_settle([s[level] for s in nothing]) for level in nothing[0])))
        curves = [o["learnt_percent"] for o in online]
        worth.append((*case, *(_learnt([c[s] for c in curves]) for s in curves[0])))
    if not times:
        raise ValueError("these are runs of batch fits alone; choose an on-line estimator")
    head = ("system", "estimator", "law")
    return [
        *table((*head, *(f"{level} %" for level in nothing[0])), times),
        "",
        *table((*head, *(f"{seconds} s" for seconds in curves[0])), worth),
    ]


def _settle(times: Sequence[float | None]) -> str:
    reached = [t for t in times if t is not None]
    if len(reached) == len(times):
        return spread(reached)
    return f"{len(reached)} of {len(times)}" if reached else "never"


def _learnt(errors: Sequence[float | None]) -> str:
    return spread([math.inf if e is None else e for e in errors], 0)


def stability_table(runs: Sequence[OnlineRun]) -> list[str]:
    """How many runs were lost, by law, gain and cutoff."""
    grouped: dict[tuple[str, float, float], list[OnlineRun]] = {}
    adapting = [run for run in runs if run.law]
    for run in sorted(adapting, key=lambda r: (r.law.partition(",")[0], r.gain, r.cutoff)):
        grouped.setdefault((run.law, run.gain, run.cutoff), []).append(run)
    rows = []
    for (law, _, cutoff), group in grouped.items():
        ways = [run.metrics["online"]["ways"] for run in group]
        lost = [sum(w[way]["unstable_s"] is not None for w in ways) for way in WAYS]
        worst = [w["from_nothing"]["worst_percent"] for w in ways]
        frozen = [run.error("frozen") for run in group]
        worthless = sum(not e < 100.0 for e in frozen)
        running = spread([math.inf if u is None else u for u in worst], 0)
        counts = (str(len(group)), *map(str, lost), running, str(worthless), spread(frozen, 0))
        rows.append((law, f"{cutoff:g}", *counts))
    head = ("law", "cutoff [rad/s]", "runs", "lost adapting", "lost from nothing")
    errors = ("largest running error [%]", "worthless when frozen", "error when frozen [%]")
    return table((*head, *errors), rows)


TABLES: dict[str, Callable[[Sequence[OnlineRun]], list[str]]] = {
    "learnt": learning_table,
    "settled": settling_tables,
    "stable": stability_table,
}
