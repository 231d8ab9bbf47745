"""Identified models on motions unlike those they were identified on. No training.

    python -m report.free_run.beyond                      of the runs in runs/free_run
    python -m report.free_run.beyond FOLDER --output FOLDER

Free runs of the test motions of each run's own seed: under forces half as large again, and at
another time step, where the same forces are sampled more closely or more widely. Each run keeps its
scores in its beyond.json, and what is there is not made again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from data.record import stack
from data.simulation.motion import EscapedMotionError
from models.training.assemble import changed, simulated_from
from models.training.metrics import FreeRunScore
from report.free_run.rows import FREE_RUN, Entry, Row, entries_of, rank, row_of
from report.free_run.tables import COLUMNS, Columns, as_printed, sections, write_rows
from report.paper.cells import Run, read_runs
from runner.command_line import one_line_errors, quiet_lightning
from runner.identity import written_code_version
from runner.run_folder import CONFIG, read_run, restore, write_json

FILE = "beyond.json"
MODELS = (
    "element_network",
    "element_network_tanh",
    "latent_hysteresis_network",
    "vwnn_forward",
    "linear",
)
STD = "excitation.force.std"
LARGER = 1.5
STEPS = (0.005, 0.02)  # [s]
AS_TRAINED = "as trained"
CHANGES = (AS_TRAINED, f"{STD}*{LARGER}", *(f"data.dt={dt}" for dt in STEPS))


def beyond_config(cfg: DictConfig, change: str) -> DictConfig:
    """A run's config with one of CHANGES."""
    if change == CHANGES[1]:
        std = OmegaConf.select(cfg, STD)
        if std is None:
            raise ValueError(f"the run has no {STD}, so its motion cannot be made larger")
        return changed(cfg, {"excitation": {"force": {"std": LARGER * std}}})
    return changed(cfg, {"data": {"dt": float(change.partition("=")[2])}})


def score_beyond(run: Run) -> None:
    """Write the scores of a run under all changes, unless they are there and of this code."""
    assert run.metrics is not None
    origin = {"run": run.metrics.get("identity"), "code": written_code_version(run.folder / CONFIG)}
    path = run.folder / FILE
    kept = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    scores = kept["scores"] if kept.get("origin") == origin else {}
    for change in CHANGES[1:]:
        if change not in scores:
            scores[change] = _score(run, change)
            write_json(path, {"origin": origin, "scores": scores})


def _score(run: Run, change: str) -> dict[str, Any]:
    """A free-run score; {"escaped": …} where the structure's own motion did, {"none": …} where the
    model refuses."""
    quiet_lightning()
    cfg, _ = read_run(run.folder)
    estimator = restore(cfg, run.folder)
    try:
        data = simulated_from(beyond_config(cfg, change))
        records, escapes = data.simulation.records(
            "test", data.test_records, data.seed, data.train_records
        )
    except EscapedMotionError as error:
        return {"escaped": str(error)}
    except ValueError as error:
        return {"none": str(error)}
    score = FreeRunScore()
    try:
        score.update(estimator, replace(stack(records), warmup=cfg.data.warmup))
    except ValueError as error:  # another time step than it was made for
        return {"none": str(error)}
    return score.percent() | ({"lost": len(escapes)} if escapes else {})


def chosen(entries: Sequence[Entry]) -> list[Entry]:
    """Finished runs of MODELS, those of the most training records of each, without noise."""
    mine = [e for e in entries if e.run.model in MODELS and not e.failed and e.no_free_run is None]
    mine = [entry for entry in mine if entry.run.scenario == "full_state"]
    most: dict[str, int] = {}
    for entry in mine:
        most[entry.run.model] = max(most.get(entry.run.model, 0), entry.train_records or 0)
    return [entry for entry in mine if (entry.train_records or 0) == most[entry.run.model]]


def under(entry: Entry, change: str) -> Entry | None:
    """The entry scored under a change; None where the structure itself escaped."""
    assert entry.run.metrics is not None
    if change == AS_TRAINED:
        return entry
    scores: Mapping[str, Any] = json.loads((entry.run.folder / FILE).read_text("utf-8"))["scores"]
    if "escaped" in scores[change]:
        return None
    metrics = {**entry.run.metrics, FREE_RUN: scores[change]}
    return Entry(replace(entry.run, metrics=metrics), entry.choices)


def beyond_rows(entries: Sequence[Entry]) -> list[Row]:
    """A row for each system, change and model. `failed` counts motions of the structure itself that
    escaped: there is nothing to compare a model with, so the errors are those of the others."""
    rows = []
    cases = dict.fromkeys(entry.case for entry in entries)
    for name, change in product(cases, CHANGES):
        mine = [entry for entry in entries if entry.case == name]
        known = [scored for entry in mine if (scored := under(entry, change)) is not None]
        if known:
            row = row_of(known, change)
        else:
            row = replace(row_of(mine, change), diverged=0, **NOT_KNOWN)
        escaped = len(mine) - len(known)
        rows.append(replace(row, runs=len(mine), failed=escaped, one_step_median_percent=None))
    return sorted(rows, key=lambda row: (rank(row)[0], CHANGES.index(row.varied), rank(row)[1]))


NOT_KNOWN: dict[str, Any] = dict.fromkeys(
    f"{name}_percent" for name in ("median", "q25", "q75", "min", "max", "displacement_median")
)
LEFT_OUT = ("model", "setting", "failed", "one step", "fit [s]", "parameters")
BEYOND_COLUMNS: Columns = {
    "model": COLUMNS["model"],
    "motion": lambda row: row.varied,
    **{name: text for name, text in COLUMNS.items() if name not in LEFT_OUT},
    "structure escaped": lambda row: str(row.failed),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs/free_run"))
    parser.add_argument("--output", type=Path, help="default: results/ in the folder")
    options = parser.parse_args()
    with one_line_errors("train"):
        report_beyond(options.folder, options.output or options.folder / "results")


def report_beyond(folder: Path, output: Path) -> None:
    """Score what is not scored yet; write and print the rows."""
    entries = chosen(entries_of(read_runs(folder)))
    if not entries:
        raise ValueError(
            f"no finished run of {', '.join(MODELS)} in {folder}; "
            "make some: python train.py -m experiment=free_run"
        )
    Parallel(n_jobs=-1)(delayed(score_beyond)(entry.run) for entry in entries)
    rows = beyond_rows(entries)
    parts = sections(rows, BEYOND_COLUMNS)
    paths = write_rows("beyond", rows, parts, output)
    console = Console(width=None if Console().is_terminal else 165)
    console.print(*as_printed(parts))
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, markup=False, soft_wrap=True)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)


if __name__ == "__main__":
    main()
