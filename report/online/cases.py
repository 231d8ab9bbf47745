"""Finished runs of on-line models → the tables of docs/online.md. No training.

    python -m report.online learnt runs/online            one pass beside the batch fit
    python -m report.online settled runs/online           how soon, and what is learnt when
    python -m report.online stable runs/online_stability  which gains lose the motion

Median (smallest–largest) over the seeds.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from omegaconf import DictConfig, OmegaConf

from runner.command_line import one_line_errors
from runner.progress import read_metrics
from runner.run_folder import CONFIG, METRICS

SETTING = {  # of each law, the one that a study varies
    "RecursiveLeastSquares": ("least squares", "forgetting", "λ"),
    "NormalisedGradient": ("gradient", "gain", "γ"),
    "RandomWalk": ("random walk", "walk", "Q"),
    "Frozen": ("frozen", "", ""),
}
ENOUGH = 1.2  # times the error of the batch fit


@dataclass(frozen=True)
class OnlineRun:
    """A run of an on-line model or, without a law, of the batch fit of one."""

    system: str
    estimator: str
    law: str
    gain: float
    cutoff: float
    seed: int
    motion: str
    metrics: dict[str, Any]

    def error(self, way: str = "") -> float:
        """Relative RMS error of the test motion [%]; infinite where the estimate overflowed."""
        test = self.metrics["test"]
        value = (test[way] if way else test)["relative_rms_percent"]
        return math.inf if value is None else value


def read_online(folder: Path, estimator: str | None = None) -> list[OnlineRun]:
    """The finished runs below a folder, of one estimator or all. Raises ValueError for none."""
    runs = [_read(path.parent) for path in sorted(folder.rglob(METRICS))]
    chosen = [run for run in runs if estimator in (None, run.estimator)]
    if not chosen:
        raise ValueError(
            f"no finished runs {f'of {estimator} ' if estimator else ''}in {folder}; "
            "python train.py -m experiment=online"
        )
    return chosen


def _read(folder: Path) -> OnlineRun:
    cfg = OmegaConf.load(folder / CONFIG)
    assert isinstance(cfg, DictConfig)
    inner = cfg.model.get("estimator")
    law, gain = "", math.nan
    if inner is not None:
        law, name, symbol = SETTING[cfg.adaptation._target_.rpartition(".")[2]]
        gain = float(cfg.adaptation[name]) if name else math.nan
        law = f"{law}, {symbol} = {gain:g}" if name else law
    node = inner or cfg.model
    force = cfg.excitation.get("force")
    motion = "none" if force is None else force._target_.rpartition(".")[2]
    case = (cfg.system.name, node.name, law, gain, float(node.get("cutoff", math.nan)))
    return OnlineRun(*case, cfg.seed, motion, read_metrics(folder))


def spread(values: Sequence[float], digits: int = 1) -> str:
    """Median (smallest–largest)."""
    told = [f"{v:.{digits}f}" if math.isfinite(v) else "∞" for v in _three(values)]
    return told[0] if len(set(told)) == 1 else f"{told[0]} ({told[1]}–{told[2]})"


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    return median(values), min(values), max(values)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    lines = [list(head), ["---"] * len(head), *map(list, rows)]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def cases(runs: Sequence[OnlineRun]) -> dict[tuple[str, str, str], list[OnlineRun]]:
    """On-line runs by system, estimator and law, in this order."""
    grouped: dict[tuple[str, str, str], list[OnlineRun]] = {}
    for run in sorted(runs, key=lambda r: (r.system, r.estimator, r.law)):
        if run.law:
            grouped.setdefault((run.system, run.estimator, run.law), []).append(run)
    return grouped


def learnt(runs: Sequence[OnlineRun]) -> list[str]:
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


def settled(runs: Sequence[OnlineRun]) -> list[str]:
    """Seconds from nothing to stay below an error, and what the weights are worth by then."""
    times, worth = [], []
    for case, of_case in cases(runs).items():
        online = [r.metrics["online"] for r in of_case]
        nothing = [o["ways"]["from_nothing"]["settle_s"] for o in online]
        times.append((*case, *(_settle([s[level] for s in nothing]) for level in nothing[0])))
        curves = [o["learnt_percent"] for o in online]
        worth.append((*case, *(_learnt([c[s] for c in curves]) for s in curves[0])))
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


def stable(runs: Sequence[OnlineRun]) -> list[str]:
    """Runs that were lost, by law, gain and cutoff."""
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
        told = spread([math.inf if u is None else u for u in worst], 0)
        counts = (str(len(group)), *map(str, lost), told, str(worthless), spread(frozen, 0))
        rows.append((law, f"{cutoff:g}", *counts))
    head = ("law", "cutoff [rad/s]", "runs", "lost adapting", "lost from nothing")
    errors = ("largest running error [%]", "worthless when frozen", "error when frozen [%]")
    return table((*head, *errors), rows)


WAYS = ("adapting", "from_nothing")
TABLES: dict[str, Callable[[Sequence[OnlineRun]], list[str]]] = {
    "learnt": learnt,
    "settled": settled,
    "stable": stable,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", choices=TABLES)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--estimator", help="such as vwnn; all of them without it")
    options = parser.parse_args()
    with one_line_errors("train"):
        runs = read_online(options.folder, options.estimator)
        print("\n".join(TABLES[options.table](runs)))
