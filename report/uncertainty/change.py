"""python evaluate.py run=BEFORE data.path=after.csv change=true: has the structure changed?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.text import Text

from data.record import Record, singles
from data.terminal import terminal
from export.modes import modes_of
from models.composition.composite import Composite
from models.stored.run import read_run
from models.uncertainty.change import Change, Comparison, compare
from report.output import Section, printed
from report.run.evaluation import new_data, on_grid, require_same_kind, said_alone
from report.run.rescore import require_record
from report.run.table import print_verdict
from runner.config.settings import Conditions
from runner.folder.run import restore
from runner.folder.run_folder import results_folder, write_json
from runner.scores.outcome import each_record


def evaluate_change(folder: Path, asked: Conditions) -> dict[str, Any]:
    """Print and save what changed since a run, by the records of other files.

    Saved in the run's `evaluation/`. Raises ValueError without such files, where the run's records
    are gone, and for models and records that cannot be compared.
    """
    changes = said_alone(asked.data)
    if asked.scenario is not None or asked.seeds is not None or "path" not in changes:
        raise ValueError(
            "change=true compares a run with measured records from after: data.path=after.csv; "
            "leave scenario and seeds out"
        )
    run = read_run(folder)
    require_record(run.experiment, "a comparison needs")
    model, data, new = restore(run), run.experiment.make_data(), new_data(run.experiment, changes)
    data.setup()
    require_same_kind(run.sensors, new.sensors)
    tested = [r for r in singles(data.records["test"]) if r.initial_state != "unknown"]
    after = {name: on_grid(r, model.dt) for name, r in each_record(new, "train").items()}
    found = compare(model, [*data.records["train"], *tested], list(after.values()))
    content = content_of(found, after)
    console = terminal()
    print_verdict(console, run.metrics)
    print_change(console, found, content)
    output = results_folder(folder) / "evaluation" / f"change_{'+'.join(after)}"[:80]
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "change.json", content)
    console.print(f"saved in {output}", markup=False, soft_wrap=True)
    return content


def content_of(found: Comparison, after: Mapping[str, Record]) -> dict[str, Any]:
    """What changed, and what that does, as plain data: frequencies [Hz], largest drifts [m]."""
    both = {"before": found.before, "after": found.after}
    return {
        "places": [_place(found, element) for element in found.places],
        "quantities": [asdict(one) | {"factor": one.factor} for one in found.changes],
        "undetermined": found.undetermined,
        "frequencies_hz": {side: _frequencies(model) for side, model in both.items()},
        "largest_drifts_m": {
            name: {side: _largest(model, record) for side, model in both.items()}
            for name, record in after.items()
        },
    }


def _frequencies(model: Composite) -> list[float]:
    modes = modes_of(model)
    return [] if modes is None else list(map(float, modes.frequencies))


@torch.no_grad()
def _largest(model: Composite, record: Record) -> list[float]:
    """Deformation of each element in a run of a record; none of one that diverges."""
    largest: list[float] = model.element_loops(record)[0].abs().amax(dim=-2).flatten().tolist()
    return largest if all(map(math.isfinite, largest)) else []


def _place(found: Comparison, element: int) -> str:
    """An element by its number and nodes; of a chain its storey, too."""
    nodes = next(one.about for one in found.changes if one.element == element)
    storey = f", storey {element}" if getattr(found.after, "is_chain", False) else ""
    return f"r{element} {nodes}{storey}"


def print_change(console: Console, found: Comparison, content: Mapping[str, Any]) -> None:
    """The answer first; then the quantities, and what their change does."""
    if not found.changed:
        console.print(Text("no change beyond what these records tell", style="bold"))
    for element, place in zip(found.places, content["places"], strict=True):
        own = ", ".join(_words(one) for one in found.changed if one.element == element)
        console.print(Text(f"changed: {place}: {own}", style="bold red"))
    rows = [
        [f"{one.name} [{one.unit}]", f"{one.before:.4g}", f"{one.after:.4g}", _percent(one.factor),
         f"{_percent(one.low)} to {_percent(one.high)}", "changed" if one.changed else ""]
        for one in sorted(found.changes, key=lambda one: (one.element, one.name))
    ]  # fmt: skip
    head = ["quantity", "before", "after", "change [%]", "95 % interval [%]", ""]
    console.print(printed(Section(head, rows), left=(0, 5)))
    unknown = ", ".join(found.undetermined)
    notes = [f"not determined by the records of both: {unknown}"] if unknown else []
    if found.after.scale_is_open:
        notes.append("no mass is known: values are per unit of a mass that is assumed constant")
    words = _pairs(**content["frequencies_hz"])
    notes.append(f"frequencies of small motions [Hz], before → after: {words}")
    for name, sides in content["largest_drifts_m"].items():
        words = _pairs(**{side: [1e3 * y for y in drifts] for side, drifts in sides.items()})
        words = words or "the model of before diverges"
        notes.append(f"largest drifts under {name} [mm], model of before → of after: {words}")
    for note in notes:
        console.print(note, markup=False)


def _pairs(before: Sequence[float], after: Sequence[float]) -> str:
    return ", ".join(f"{old:.3g} → {new:.3g}" for old, new in zip(before, after, strict=False))


def _words(one: Change) -> str:
    way = "lower" if one.factor < 1.0 else "higher"
    least, most = sorted(abs(100.0 * (end - 1.0)) for end in (one.low, one.high))
    name = one.name.partition(".")[2].replace("_", " ")
    return f"{name} {abs(100.0 * (one.factor - 1.0)):.0f} % {way} ({least:.0f} to {most:.0f} %)"


def _percent(factor: float) -> str:
    return f"{100.0 * (factor - 1.0):+.1f}"
