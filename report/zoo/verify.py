"""Every published model is unchanged: its files, its golden motion, its numbers."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import torch

from models.estimator import Estimator
from models.experiment import Experiment
from models.zoo import Pretrained, load_pretrained
from models.zoo.golden import difference
from models.zoo.index import ROOT, Entry, entries
from report.run.rescore import ROUNDING, record_gone, scores_of
from report.zoo.card import ERROR, over_seeds, tested
from report.zoo.publish import RECORDS, with_records

GOLDEN = 1e-12  # largest relative difference of a motion
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
    """Largest relative difference of the published numbers. Raises ValueError for a larger one.

    A free run may be chaotic, so that its last digits depend on the processor: a number may differ
    as far as it does where the last digit of the weights rises or falls.
    """
    seeds = "over_seeds" in pretrained.metrics
    then, now = _published(pretrained.metrics), _scored(pretrained.model, run, seeds)
    differences = {name: _apart(old, now.get(name)) for name, old in then.items()}
    far = [name for name, apart in differences.items() if not apart <= ROUNDING]
    ends = (math.inf, -math.inf) if far else ()
    rounded = [_scored(with_rounded_weights(pretrained.model, end), run, seeds) for end in ends]
    for name in far:
        moved = max(_apart(now.get(name), one.get(name)) for one in rounded)
        if not differences[name] <= moved < math.inf:
            raise ValueError(f"{name} is {now.get(name)}, published is {then[name]}")
    return max(differences.values())


def _scored(model: Estimator, run: Experiment, seeds: bool) -> dict[str, float | None]:
    """The numbers that are published, as the model has them now."""
    scores: dict[str, Any] = dict(scores_of(model, tested(run), ("test",)))
    return _published(scores | ({"over_seeds": over_seeds(model, run)} if seeds else {}))


def _published(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    parts = {key: metrics[key] for key in COMPARED}
    parts |= {f"seed {one['seed']}": one for one in metrics.get("over_seeds", [])}
    return {
        f"{key} of {where}": part[key]
        for where, part in parts.items()
        for key in (ERROR, "free_run_percent", "one_step_percent", "displacement_percent")
        if key in part
    }


def with_rounded_weights(model: Estimator, end: float = math.inf) -> Estimator:
    """A copy whose weights differ in the last digit, towards one end of all numbers."""
    model = deepcopy(model)
    for weights in model.state_dict().values():
        if weights.is_floating_point():
            weights.copy_(torch.nextafter(weights, torch.full_like(weights, end)))
    return model


def _apart(old: float | None, new: float | None) -> float:
    """Relative difference of two numbers; without one of them infinite."""
    if old is None or new is None:
        return 0.0 if old is new else float("inf")
    return abs(new - old) / max(abs(old), 1e-300)
