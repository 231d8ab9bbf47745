"""Every published model is unchanged: its files, its golden motion, its numbers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from models.experiment import Experiment
from models.zoo import Pretrained, load_pretrained
from models.zoo.golden import difference
from models.zoo.index import ROOT, Entry, entries
from report.run.rescore import record_gone, scores_of
from report.zoo.card import ERROR, over_seeds, tested
from report.zoo.publish import RECORDS, with_records

GOLDEN, NUMBERS = 1e-12, 1e-9  # largest relative differences
COMPARED = ("test", "free_run")


def verify(chosen: Sequence[Entry], records: Path | None = None, root: Path = ROOT) -> None:
    """Print a line for each entry. Raises ValueError, at the end, where one has changed.

    records: the folder that holds the folders of measured records; without it the numbers of such
    models are not recomputed, which its line says.
    """
    wrong = 0
    for entry in chosen or entries(root):
        began = time.perf_counter()
        try:
            facts = ", ".join(facts_of(entry, records, root))
        except ValueError as error:
            wrong, facts = wrong + 1, f"WRONG: {error}"
        print(f"{entry.name:48s} {facts}  ({time.perf_counter() - began:.1f} s)", flush=True)
    if wrong:
        raise ValueError(f"{wrong} published models are not what they were; see above")


def facts_of(entry: Entry, records: Path | None, root: Path) -> Iterator[str]:
    """What was held against what was published, and how well it agreed. Raises ValueError."""
    pretrained = load_pretrained(entry.name, root)
    yield f"{len(entry.facts['files'])} files as published"
    yield f"golden {_golden(entry, pretrained):.1e}"
    values = pretrained.config
    run = Experiment.of(values if records is None else with_records(values, records.resolve()))
    if not run.simulated and record_gone(run) is not None:
        yield f"numbers not recomputed: say records=FOLDER, see {RECORDS} in its config.yaml"
        return
    yield f"numbers {_numbers(pretrained, run):.1e}"


def _golden(entry: Entry, pretrained: Pretrained) -> float:
    apart = difference(pretrained.model, entry.folder / "golden.npz")
    if not apart <= GOLDEN:
        raise ValueError(f"its golden motion differs by {apart:.1e}, at most {GOLDEN:g}")
    return apart


def _numbers(pretrained: Pretrained, run: Experiment) -> float:
    own = scores_of(pretrained.model, tested(run), ("test",))
    pairs = [(pretrained.metrics[key], own[key], key) for key in COMPARED]
    if "over_seeds" in pretrained.metrics:
        rows = zip(pretrained.metrics["over_seeds"], over_seeds(pretrained.model, run), strict=True)
        pairs += [(then, now, f"seed {then['seed']}") for then, now in rows]
    worst = 0.0
    for then, now, where in pairs:
        for key in (ERROR, "free_run_percent", "one_step_percent", "displacement_percent"):
            if key in then:
                worst = max(worst, _apart(then, now, key, where))
    return worst


def _apart(then: Mapping[str, Any], now: Mapping[str, Any], key: str, where: str) -> float:
    """Relative difference of a number. Raises ValueError where it is too large."""
    old, new = then[key], now.get(key)
    if old is None or new is None:
        apart = 0.0 if old is new else float("inf")
    else:
        apart = abs(new - old) / max(abs(old), 1e-300)
    if not apart <= NUMBERS:
        raise ValueError(f"{key} of {where} is {new}, published is {old}")
    return apart
