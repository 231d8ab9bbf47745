"""What evaluate.py does: a finished run scored again or on other records, or many compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from data.datamodule import Data
from data.plain_data import as_config
from data.record import QUANTITIES, Record
from data.sample import Sensors
from data.terminal import terminal
from data.whole_file import write_text
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS, free_run_score, score
from models.fit.trained_range import outside, range_of, worst_of
from models.linear_motion import LinearMotion
from models.training.assemble import changed, data_from
from report.collection.report import report_by, report_collection
from report.collection.runs import folders_of
from report.output import as_csv, save_figure, spreadsheet
from report.run.rescore import (
    draw_figures,
    draw_record,
    print_evaluation,
    print_stored,
    record_gone,
    require_scores,
    score_seeds,
)
from report.run.table import (
    WIDTH,
    merged_rows,
    print_errors,
    print_outside,
    print_verdict,
    titled,
    why_no_free_run,
)
from report.uncertainty.intervals import bands_of_run, over_seeds, print_bands
from runner.config.command_line import absolute
from runner.config.compose import composed
from runner.folder.run import restore, sensors_of
from runner.folder.run_files import results_folder
from runner.folder.run_folder import read_run, write_json
from runner.scores.conformal import covered
from runner.scores.outcome import each_record, per_record
from runner.scores.verdict import CANNOT


def evaluate(cfg: DictConfig, folder: Path, label: str) -> dict[str, Any]:
    """Scores of a run under the changes in `cfg`, saved with figures in its `evaluation/`."""
    run, metrics = read_run(folder)
    estimator = restore(run, folder)
    require_scores(metrics, estimator.dofs)
    changes = _typed(OmegaConf.to_container(cfg.data, resolve=True))
    held_back = changes.pop("calibration_records", None)
    as_trained = run.copy()
    if cfg.get("scenario") is not None:
        run.scenario = cfg.scenario
    if "path" in changes:
        return _on_new_records(cfg, run, metrics, folder, estimator, changes, label)
    run = changed(run, {"data": as_config(changes)})
    seeds = [run.seed] if cfg.seeds is None else list(cfg.seeds)
    altered = cfg.get("scenario") is not None or bool(changes) or cfg.seeds is not None
    require_scores(metrics, estimator.dofs)
    gone = record_gone(run)
    if gone is not None and not altered:
        print_stored(metrics, gone)
        return metrics

    sure = bands_of_run(estimator, as_trained, metrics, held_back)
    results = score_seeds(estimator, run, seeds, not changes, sure)
    print_evaluation(results, metrics, altered)
    print_bands(terminal(WIDTH), metrics, over_seeds(sure, results))
    output = results_folder(folder) / "evaluation" / label
    prior = metrics.get("training", {}).get("prior")
    output.mkdir(parents=True, exist_ok=True)
    if cfg.figures:
        draw_figures(estimator, run, seeds[0], output, prior, sure)
    write_json(output / "scores.json", results)
    print(f"{'figures and ' if cfg.figures else ''}scores in {output}")
    return results


def _typed(values: Any) -> dict[str, Any]:
    """The settings that have a value."""
    kept = {key: _typed(v) if isinstance(v, dict) else v for key, v in values.items()}
    return {key: value for key, value in kept.items() if value is not None and value != {}}


def _on_new_records(
    cfg: DictConfig,
    run: DictConfig,
    metrics: dict[str, Any],
    folder: Path,
    estimator: Estimator,
    changes: dict[str, Any],
    label: str,
) -> dict[str, Any]:
    """Scores on the records of other files, saved in the run's `evaluation/`."""
    if cfg.seeds is not None:
        raise ValueError("seeds= draws motions, and data.path= names measured ones; leave one out")
    files = [changes["path"]] if isinstance(changes["path"], str) else list(changes["path"])
    changes["path"] = [str(absolute(file)) for file in files]
    stems = "+".join(Path(file).stem for file in files).replace("*", "all")
    label = stems[:80] if "data.path=" in label else label
    output = results_folder(folder) / "evaluation" / label
    results = evaluate_records(estimator, run, metrics, folder, changes, output, cfg.figures)
    print(f"{'figures and ' if cfg.figures else ''}scores in {output}")
    return results


def report_runs(cfg: DictConfig) -> None:
    """All numbers of many runs, or a comparison of them."""
    output = absolute(cfg.output) if cfg.output else None
    typed = [cfg.runs] if isinstance(cfg.runs, str) else list(cfg.runs or [])
    if not typed:
        asked = (
            "by= compares the runs of runs=FOLDER"
            if cfg.by is not None
            else ("run=FOLDER scores a run again, runs=FOLDER compares many")
        )
        raise ValueError(f"{asked}; say which")
    folders = folders_of([str(absolute(name)) for name in typed])
    if cfg.by is None:
        report_collection(folders, output)
    else:
        keys = [cfg.by] if isinstance(cfg.by, str) else list(cfg.by)
        report_by(folders, keys, cfg.metric, cfg.split, output)


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
    estimator: Estimator,
    run: DictConfig,
    metrics: Mapping[str, Any],
    folder: Path,
    typed: Mapping[str, Any],
    output: Path,
    figures: bool = True,
) -> dict[str, Any]:
    """Scores of a run's model on new records, printed and saved in `output`, with pictures or not.

    typed: settings of the records. Raises ValueError for records that do not fit the model.
    """
    data = new_data(run, typed)
    require_same_kind(sensors_of(run, folder), data.sensors)
    records = {name: _on_grid(r, estimator.dt) for name, r in each_record(data, "train").items()}
    trained = metrics.get("trained_range", {})
    left = {n: outside(trained, range_of(estimator, [r])) for n, r in records.items()}
    scores = {
        "all_records": _together(estimator, records),
        "records": per_record(estimator, records),
        "baselines": _opponents(run, data, records),
        "outside_trained_range": left,
    }
    sure = metrics.get("uncertainty", {})
    held = covered(estimator, sure, records.values())
    scores |= {"uncertainty": held} if held else {}
    output.mkdir(parents=True, exist_ok=True)
    _print(metrics, records, scores, data)
    write_json(output / "scores.json", scores)
    unit = QUANTITIES[data.sensors.quantity][1]
    write_text(output / "scores.csv", as_csv(table_of(scores["records"], unit)))
    for name, record in records.items() if figures else ():
        words = metrics["model"], name, worst_of(left[name])
        drawn = draw_record(estimator, record, *words, uncertainty=sure)
        place = output if len(records) == 1 else output / spreadsheet(name).replace("/", "_")
        for title, figure in drawn.items():
            save_figure(figure, place, title)
    return scores


def new_data(run: DictConfig, typed: Mapping[str, Any]) -> Data:
    """The records of other files under "train", read as those of the run, except for `typed`."""
    if odd := [key for key in OF_SIMULATIONS if key in typed]:
        raise ValueError(
            f"data.{odd[0]} is of simulated motions, data.path of measured ones; leave one out"
        )
    if run.data._target_.endswith("MeasuredData"):
        base = run
    else:
        measured = composed("data=measured", "data.path=", "model=linear")
        base = changed(run, {"excitation": None, "damage": None})
        base.data, base.system = measured.data, {**measured.system, "name": run.system.name}
    if "channels" in typed:
        base.data.channels = None  # those of the run are not mixed with new ones
    new = changed(base, {"data": {**WHOLE, **typed}})
    data = data_from(new)
    data.setup()
    return data


def require_same_kind(run: Sensors, new: Sensors) -> None:
    """Raise ValueError where a model was made for another excitation or for another quantity."""
    if run.quantity != new.quantity:
        raise ValueError(
            f"the run estimates {run.quantity}, the records hold {new.quantity}; name their "
            "channels (data.channels)"
        )
    if run.forced != new.forced and "base" in (run.forced, new.forced):
        words = {"base": "the acceleration of its base (s_ddot1)"}
        theirs = [words.get(str(s.forced), "forces or support motions") for s in (run, new)]
        raise ValueError(
            f"the run was driven by {theirs[0]}, the records by {theirs[1]}; name the channels "
            "(data.channels)"
        )


def _on_grid(record: Record, dt: float) -> Record:
    """The record with the model's time step, where it differs by the rounding of a clock."""
    return replace(record, dt=dt) if abs(record.dt / dt - 1.0) < 1e-6 else record


def _together(estimator: Estimator, records: Mapping[str, Record]) -> dict[str, Any]:
    every = list(records.values())
    return {"test": score(estimator, every), FREE_RUNS["test"]: free_run_score(estimator, every)}


def _opponents(run: DictConfig, data: Data, records: Mapping[str, Record]) -> dict[str, Any]:
    """Free runs of the plain opponents: no motion, and the run's linear system."""
    name = "rigid" if data.forced == "base" else "zero"
    still = {"relative_rms_percent": 100.0, "per_dof_percent": [100.0] * data.dofs}
    beside: dict[str, Any] = {name: dict.fromkeys(records, still)}
    try:
        own = data_from(run)
        own.setup()
        linear = LinearMotion(own.dofs, own.inputs, own.dt)
        linear.identify(own.loader("train"))
        beside["linear"] = {n: free_run_score(linear, [r]) for n, r in records.items()}
    except (*CANNOT, OSError):  # its training records are gone, say
        pass
    return beside


def _print(
    metrics: Mapping[str, Any],
    records: Mapping[str, Record],
    scores: Mapping[str, Any],
    data: Data,
) -> None:
    console = terminal(WIDTH)
    about = f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}"
    rows = list(_rows(scores))
    quantity = data.sensors.quantity
    print_errors(console, titled(metrics, about), rows, data.dofs, quantity, ("test",))
    first = next(iter(scores["records"].values()))
    for line in why_no_free_run({metrics["model"]: first}):
        console.print(line)
    print_verdict(console, metrics)
    if held := scores.get("uncertainty"):
        print_bands(console, metrics, {k: metrics["uncertainty"][k] | v for k, v in held.items()})
    _print_range(console, scores["outside_trained_range"], "trained_range" in metrics)
    for name, notes in data.notes.items():
        console.print(f"{name.removeprefix('train: ')}: {'; '.join(notes) or 'read as it is'}")


def _print_range(console: Console, left: Mapping[str, Any], known: bool) -> None:
    for name, found in left.items():
        print_outside(console, f"{name}: ", found)
    if not known:
        console.print("this older run has no trained range to compare with; repeat it")


def _rows(scores: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """By record: estimates and free run, one row where both agree; then the plain opponents."""
    together = {"all records": scores["all_records"]} if len(scores["records"]) > 1 else {}
    for name, of_record in {**scores["records"], **together}.items():
        yield from merged_rows(name, of_record)
        for opponent, of_each in scores["baselines"].items():
            if name in of_each and "no_free_run" not in of_each[name]:
                yield f"  {opponent}, free run", {"test": of_each[name]}


def table_of(records: Mapping[str, Any], unit: str) -> list[dict[str, Any]]:
    """A row per record, estimate and DOF ("all" of them together); None where a run left."""
    rows = []
    for name, of_record in records.items():
        for estimate, scores in zip(("one step", "free run"), of_record.values(), strict=True):
            if "no_free_run" in scores:
                continue
            left = min(scores.get("diverged_after_s") or [None])
            percent = [scores["relative_rms_percent"], *scores["per_dof_percent"]]
            rms = [None, *scores["per_dof_rms"]]
            for dof, values in enumerate(zip(percent, rms, strict=True)):
                cells = (name, estimate, dof or "all", *values, unit, left)
                rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return rows
