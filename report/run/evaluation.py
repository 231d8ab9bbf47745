"""What evaluate.py does: a finished run scored again or on other records, or many compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from data.datamodule import Data
from data.record import QUANTITIES, Record
from data.sample import Sensors
from data.terminal import terminal
from data.whole_file import write_text
from models.choice import Choice
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.metrics import free_run_score
from models.fit.trained_range import outside, range_of, worst_of
from models.stored.run import StoredRun, read_run
from report.collection.report import report_by, report_collection
from report.collection.runs import folders_of
from report.output import as_csv, save_figure, spreadsheet
from report.run.building import write_storeys
from report.run.rescore import (
    draw_figures,
    draw_record,
    print_evaluation,
    print_stored,
    record_gone,
    require_record,
    require_scores,
    score_seeds,
)
from report.run.table import (
    merged_rows,
    print_errors,
    print_outside,
    print_verdict,
    titled,
    why_no_free_run,
)
from report.uncertainty.intervals import bands_of_run, over_seeds, print_bands
from report.uncertainty.storeys import print_drifts
from runner.config.choices import plain
from runner.config.command_line import absolute
from runner.config.compose import composed
from runner.config.settings import Conditions
from runner.folder.run import restore
from runner.folder.run_folder import results_folder, write_json
from runner.scores.conformal import covered
from runner.scores.outcome import both_scores, each_record, per_record
from runner.scores.verdict import CANNOT, OPPONENTS


def evaluate(folder: Path, label: str, asked: Conditions) -> dict[str, Any]:
    """Scores of a run under some conditions, saved with figures in its `evaluation/`."""
    run = read_run(folder)
    metrics, as_trained = run.metrics, run.experiment
    estimator = restore(run)
    require_scores(metrics, estimator.dofs)
    changes = said_alone(asked.data)
    held_back = changes.pop("calibration_records", None)
    altered = asked.scenario is not None or bool(changes) or asked.seeds is not None
    scenario = as_trained.scenario
    if asked.scenario is not None:
        scenario = Choice("scenario", asked.scenario)
    if "path" in changes:
        under = replace(as_trained, scenario=scenario)
        return evaluate_records(asked, run, under, estimator, changes, label)
    require_unseen(as_trained, changes)
    under = replace(as_trained, scenario=scenario, data=as_trained.data.with_values(changes))
    seeds = [under.seed] if asked.seeds is None else list(asked.seeds)
    gone = record_gone(under)
    if gone is not None and not altered:
        print_stored(metrics, gone)
        return metrics

    sure = bands_of_run(estimator, as_trained, metrics, held_back)
    results = score_seeds(estimator, under, seeds, not changes, sure)
    print_evaluation(results, metrics, altered)
    print_bands(terminal(), metrics, over_seeds(sure, results))
    output = results_folder(folder) / "evaluation" / label[:80]
    prior = metrics.get("training", {}).get("prior")
    output.mkdir(parents=True, exist_ok=True)
    storeys = metrics.get("uncertainty", {}).get("drifts", [])
    scored = [seed for seed in seeds if "failed" not in results[str(seed)]]
    if altered and scored and next(estimator.likely(), None) is not None:
        data = replace(under, seed=scored[0]).set_up_data()
        storeys = _storeys(estimator, each_record(data, "test"))
    _report_storeys(storeys, estimator, output, asked.figures)
    if asked.figures and scored:
        for title, figure in draw_figures(estimator, under, scored[0], prior, sure).items():
            save_figure(figure, output, title)
    write_json(output / "scores.json", results)
    print(f"{'figures and ' if asked.figures else ''}scores in {output}")
    return results


def require_unseen(run: Experiment, changes: Mapping[str, Any]) -> None:
    """Raise ValueError for settings that would cut test motion out of what was trained on."""
    driven = {} if run.excitation is None else run.excitation.values
    waves = [driven.get(part) or {} for part in ("force", "support")]
    given = any(wave.get("_target_") == "data.Given" for wave in waves)
    anew = ("train_records", "duration", "dt") if given else () if run.simulated else ("stop",)
    if cut := [key for key in anew if key in changes]:
        raise ValueError(
            f"data.{cut[0]} cuts the histories of this run anew, and would test on motion that was "
            f"trained on; leave it out{'' if given else ', or name the records: data.path=FILE'}"
        )


def figures_of(run: StoredRun, estimator: Estimator) -> dict[str, Figure]:
    """The pictures of a run as it was trained. Raises ValueError where its record is gone."""
    require_record(run.experiment, "pictures need")
    sure = bands_of_run(estimator, run.experiment, run.metrics, None)
    prior = run.metrics.get("training", {}).get("prior")
    return draw_figures(estimator, run.experiment, run.experiment.seed, prior, sure)


def _storeys(estimator: Estimator, records: Mapping[str, Record]) -> list[dict[str, Any]]:
    """Responses of storeys in records; [] of most models."""
    from runner.scores.uncertainty import storeys_of_each  # loads every model that has intervals

    return storeys_of_each(estimator, records.items())


def _report_storeys(
    rows: list[dict[str, Any]], estimator: Estimator, output: Path, figures: bool
) -> None:
    """Print responses of storeys or elements; write those of storeys as a table and a drawing."""
    print_drifts(terminal(), {"drifts": rows})
    write_storeys(rows, estimator, output, figures)


def said_alone(values: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that have a value."""
    kept = {key: said_alone(v) if isinstance(v, dict) else v for key, v in values.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}


def report_runs(
    runs: str | Sequence[str] | None,
    by: str | Sequence[str] | None,
    metric: str,
    split: str,
    output: str | None,
) -> Any:
    """All numbers of many runs, a table, or a comparison; arguments as in conf/evaluate.yaml."""
    place = absolute(output) if output else None
    if not runs and by is not None:
        raise ValueError("by= compares the runs of runs=FOLDER; say which")
    if not runs:
        raise ValueError("run=FOLDER scores a run again, runs=FOLDER compares many; say which")
    folders = folders_of(runs)
    if by is None:
        return report_collection(folders, place)
    return report_by(folders, [by] if isinstance(by, str) else list(by), metric, split, place)


# A finished run on records of other files: errors by record and DOF, warnings, pictures.
#
# `python evaluate.py run=FOLDER data.path=other.csv`. The files are read as data=measured reads
# them; what the command does not say of them is as it was for the run, or as in
# conf/data/measured.yaml for a run on simulated motions. Every record is scored whole; none is
# split.

WHOLE = {  # nothing is held back and nothing is cut out
    "_target_": "data.WholeRecords",
    **dict.fromkeys(("train", "test", "window", "stride", "batch")),
    "validation": 0.0,
}
OF_SIMULATIONS = ("duration", "train_records", "test_records")
COLUMNS = ("record", "estimate", "dof", "relative_rms_percent", "rms", "unit", "diverged_after_s")


def evaluate_records(
    asked: Conditions,
    run: StoredRun,
    under: Experiment,
    estimator: Estimator,
    typed: Mapping[str, Any],
    label: str,
) -> dict[str, Any]:
    """Scores of a run's model on new records, printed and saved in the run's `evaluation/`.

    under: the run's choices, or others in their place; typed: settings of the records. Raises
    ValueError for records that do not fit the model.
    """
    if asked.seeds is not None:
        raise ValueError("seeds= draws motions, and data.path= names measured ones; leave one out")
    files = [typed["path"]] if isinstance(typed["path"], str) else typed["path"]
    stems = "+".join(Path(file).stem for file in files).replace("*", "all")
    label = stems if "data.path=" in label else label
    output = results_folder(run.folder) / "evaluation" / label[:80]
    data, metrics = new_data(under, typed), run.metrics
    require_same_kind(run.sensors, data.sensors)
    records = {name: on_grid(r, estimator.dt) for name, r in each_record(data, "train").items()}
    trained = metrics.get("trained_range", {})
    left = {n: outside(trained, range_of(estimator, [r])) for n, r in records.items()}
    scores: dict[str, Any] = {
        "all_records": both_scores(estimator, list(records.values())),
        "records": per_record(estimator, records),
        "baselines": _opponents(under, data, records),
        "outside_trained_range": left,
    }
    sure = metrics.get("uncertainty", {})
    held = covered(estimator, sure, records.values())
    scores |= {"uncertainty": held} if held else {}
    output.mkdir(parents=True, exist_ok=True)
    _print(metrics, scores, data, estimator)
    storeys = _storeys(estimator, records)
    _report_storeys(storeys, estimator, output, asked.figures)
    scores |= {"drifts": storeys} if storeys else {}
    write_json(output / "scores.json", scores)
    unit = QUANTITIES[data.sensors.quantity][1]
    table = table_of(scores["records"], unit, data.numbers)
    write_text(output / "scores.csv", as_csv(table))
    for name, record in records.items() if asked.figures else ():
        words = metrics["model"], name, worst_of(left[name])
        drawn = draw_record(estimator, record, *words, uncertainty=sure)
        place = output if len(records) == 1 else output / spreadsheet(name).replace("/", "_")
        for title, figure in drawn.items():
            save_figure(figure, place, title)
    print(f"{'figures and ' if asked.figures else ''}scores in {output}")
    return scores


def new_data(run: Experiment, typed: Mapping[str, Any]) -> Data:
    """The records of other files under "train", read as those of the run, except for `typed`."""
    return read_as_the_run(run, typed).set_up_data()


def read_as_the_run(run: Experiment, typed: Mapping[str, Any]) -> Experiment:
    """The run with the settings by which it reads other files: its own, except for `typed`.

    Paths are from where they were typed.
    """
    if odd := [key for key in OF_SIMULATIONS if key in typed]:
        raise ValueError(
            f"data.{odd[0]} is of simulated motions, data.path of measured ones; leave one out"
        )
    if not run.data.target.endswith("MeasuredData"):
        measured = Experiment.of(plain(composed("data=measured", "data.path=", "model=linear")))
        system = measured.system.with_values({"name": run.system.name})
        run = replace(run, data=measured.data, system=system, excitation=None, damage=None)
    records, own = run.data, {**WHOLE, **typed}
    if "channels" in typed:
        records = records.with_values({"channels": None})  # those of the run are not mixed in
    if "path" in typed:
        files = [typed["path"]] if isinstance(typed["path"], str) else typed["path"]
        own["path"] = [str(absolute(file)) for file in files]
    return replace(run, data=records.with_values(own))


def require_same_kind(run: Sensors, new: Sensors) -> None:
    """Raise ValueError where a model was made for another excitation or for another quantity."""
    if run.quantity != new.quantity:
        raise ValueError(
            f"the run estimates {run.quantity}, the records hold {new.quantity}; name their "
            "channels (data.channels)"
        )
    new.require_dofs_of(run)


def on_grid(record: Record, dt: float) -> Record:
    """The record with the model's time step, where it differs by the rounding of a clock."""
    return replace(record, dt=dt) if abs(record.dt / dt - 1.0) < 1e-6 else record


def _opponents(run: Experiment, data: Data, records: Mapping[str, Record]) -> dict[str, Any]:
    """Free runs of the plain opponents: no motion, and the linear models of the run's training."""
    name = "rigid" if data.forced == "base" else "zero"
    still = {"relative_rms_percent": 100.0, "per_dof_percent": [100.0] * data.dofs}
    beside: dict[str, Any] = {name: dict.fromkeys(records, still)}
    try:
        own = run.set_up_data()
    except (*CANNOT, OSError):  # its training records are gone, say
        return beside
    for opponent, make in OPPONENTS.items():
        try:
            linear = make(own.dofs, own.inputs, own.dt)
            linear.identify(own.loader("train"))
            beside[opponent] = {n: free_run_score(linear, [r]) for n, r in records.items()}
        except CANNOT:
            continue
    return beside


def _print(
    metrics: Mapping[str, Any], scores: Mapping[str, Any], data: Data, estimator: Estimator
) -> None:
    console = terminal()
    about = f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}"
    rows = list(_rows(scores))
    quantity = data.sensors.quantity
    title = titled(metrics, about)
    print_errors(console, title, rows, data.dofs, quantity, ("test",), data.numbers)
    first = next(iter(scores["records"].values()))
    for line in why_no_free_run({metrics["model"]: first}):
        console.print(line)
    print_verdict(console, metrics)
    if held := scores.get("uncertainty"):
        print_bands(console, metrics, {k: metrics["uncertainty"][k] | v for k, v in held.items()})
    for name, left in scores["outside_trained_range"].items():
        print_outside(console, f"{name}: ", left)
    if "trained_range" not in metrics:
        console.print("this older run has no trained range to compare with; repeat it")
    for name, notes in (data.notes | data.sensors.unread(estimator)).items():
        console.print(f"{name.removeprefix('train: ')}: {'; '.join(notes) or 'read as it is'}")


def _rows(scores: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """By record: estimates and free run, one row where both agree; then the plain opponents."""
    together = {"all records": scores["all_records"]} if len(scores["records"]) > 1 else {}
    for name, of_record in {**scores["records"], **together}.items():
        yield from merged_rows(name, of_record)
        for opponent, of_each in scores["baselines"].items():
            if name in of_each and "no_free_run" not in of_each[name]:
                yield f"  {opponent}, free run", {"test": of_each[name]}


def table_of(records: Mapping[str, Any], unit: str, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """A row per record, estimate and DOF ("all" of them together); None where a run left."""
    rows = []
    for name, of_record in records.items():
        for estimate, scores in zip(("one step", "free run"), of_record.values(), strict=True):
            if "no_free_run" in scores:
                continue
            left = min(scores.get("diverged_after_s") or [None])
            percent = [scores["relative_rms_percent"], *scores["per_dof_percent"]]
            rms = [None, *scores["per_dof_rms"]]
            parts = ("all", *numbers)
            for dof, values in zip(parts, zip(percent, rms, strict=True), strict=True):
                cells = (name, estimate, dof, *values, unit, left)
                rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows
