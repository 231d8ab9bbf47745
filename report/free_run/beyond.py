"""Identified models on motions unlike those they were identified on. No training.

    python -m report.free_run.beyond                      of the runs in runs/free_run
    python -m report.free_run.beyond FOLDER --output FOLDER

Free runs of the test motions of each run's own seed: under forces half as large again, and at
another time step, where the same forces are sampled more closely or more widely. Each run keeps its
scores in its beyond.json, and what is there is not made again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from omegaconf import DictConfig, OmegaConf

from data.arguments import Parser
from data.record import stack
from data.simulation.motion import EscapedMotionError
from data.terminal import terminal
from models.training.assemble import changed, simulated_from
from models.training.metrics import FreeRunScore
from report.collection.runs import read_runs, results_folder
from report.free_run.rows import Row, case_of, rank, row_of
from report.free_run.tables import COLUMNS, Columns, sections, write_rows
from report.output import printed
from runner.config.command_line import command_errors
from runner.config.identity import RESULTS
from runner.config.plain_data import read_json
from runner.config.schema import ANYTHING, SCORES, require
from runner.folder.run import restore
from runner.folder.run_folder import read_run, write_json
from runner.job import quiet_lightning
from runner.scores.result import FREE_RUN, Result
from runner.scores.spread import ESCAPED

FILE = "beyond.json"
MODELS = (
    "element_network",
    "element_network_tanh",
    "latent_hysteresis_network",
    "vwnn_forward",
    "linear",
)
STD = "excitation.force.std"
KIND = {"origin": {...: ANYTHING}, "scores": {...: {"escaped": str, **SCORES}}}
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


def score_beyond(run: Result) -> None:
    """Write the scores of a run under all changes, unless they are there and of this version."""
    origin = {"run": run.metrics.get("identity"), "results": RESULTS}
    path = run.folder / FILE
    kept = _read(path)
    scores = kept["scores"] if kept.get("origin") == origin else {}
    for change in CHANGES[1:]:
        if change not in scores:
            scores[change] = _score(run, change)
            write_json(path, {"origin": origin, "scores": scores})


def _read(path: Path) -> dict[str, Any]:
    """What `score_beyond` wrote; nothing of a damaged file, which is written anew."""
    try:
        content: dict[str, Any] = read_json(path)
        require(content, KIND)
    except (ValueError, OSError):
        return {}
    return content if "scores" in content else {}


def _score(run: Result, change: str) -> dict[str, Any]:
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


def chosen(runs: Sequence[Result]) -> list[Result]:
    """Finished runs of MODELS, those of the most training records of each, without noise."""
    mine = [run for run in runs if run.model in MODELS and run.free_run is not None]
    mine = [run for run in mine if run.scenario == "full_state"]
    most: dict[str | None, int] = {}
    for run in mine:
        most[run.model] = max(most.get(run.model, 0), run.train_records or 0)
    return [run for run in mine if (run.train_records or 0) == most[run.model]]


def under(run: Result, change: str) -> Result:
    """The run scored under a change, in which the structure itself may have escaped."""
    if change == AS_TRAINED:
        return run
    scores: Mapping[str, Any] = _read(run.folder / FILE).get("scores", {})
    if change not in scores:
        raise ValueError(
            f"{run.folder / FILE} is damaged; python -m report.free_run.beyond mends it"
        )
    if "escaped" in scores[change]:
        return replace(run, status=ESCAPED)
    return replace(run, metrics={**run.metrics, FREE_RUN: scores[change]})


def beyond_rows(runs: Sequence[Result]) -> list[Row]:
    """A row for each system, change and model."""
    rows = []
    for name, change in product(dict.fromkeys(map(case_of, runs)), CHANGES):
        mine = [under(run, change) for run in runs if case_of(run) == name]
        rows.append(replace(row_of(mine, change), one_step_percent=None))
    return sorted(rows, key=lambda row: (rank(row)[0], CHANGES.index(row.varied), rank(row)[1]))


LEFT_OUT = ("model", "setting", "failed", "escaped", "one step", "fit [s]", "parameters")
BEYOND_COLUMNS: Columns = {
    "model": COLUMNS["model"],
    "motion": lambda row: row.varied,
    **{name: text for name, text in COLUMNS.items() if name not in LEFT_OUT},
    "structure escaped": lambda row: str(row.errors.escaped),
}


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("runs/free_run"))
    parser.add_argument("--output", type=Path, help="default: results/ in the folder")
    with command_errors():
        options = parser.parse_args()
        report_beyond(options.folder, options.output or results_folder(options.folder))


def report_beyond(folder: Path, output: Path) -> None:
    """Score what is not scored yet; write and print the rows."""
    runs = chosen(read_runs(folder))
    if not runs:
        raise ValueError(
            f"no finished run of {', '.join(MODELS)} in {folder}; "
            "make some: python train.py -m experiment=free_run"
        )
    Parallel(n_jobs=-1)(delayed(score_beyond)(run) for run in runs)
    rows = beyond_rows(runs)
    parts = sections(rows, BEYOND_COLUMNS)
    paths = write_rows("beyond", rows, parts, output)
    console = terminal(165)
    console.print(*map(printed, parts))
    for note in dict.fromkeys(note for part in parts for note in part.notes):
        console.print(note, markup=False, soft_wrap=True)
    console.print(f"{len(paths)} files in {output}", soft_wrap=True)


if __name__ == "__main__":
    main()
