"""A finished run scored again: rebuilt from its folder, on its own or on other motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from glob import has_magic
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure
from rich.console import Console
from torch import Tensor

from data.datamodule import Data
from data.record import Record
from data.simulation.datamodule import SimulatedData
from data.simulation.motion import EscapedMotionError
from data.terminal import terminal
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.identification import SPLITS
from models.fit.metrics import (
    FREE_RUNS,
    FreeRunScore,
    Scores,
    displacement_of,
    free_run_score,
    score,
)
from models.fit.trained_range import loops_of, names_of
from models.uncertainty.bands import DISPLACEMENT, FORCE, Signal
from models.uncertainty.laplace import Laplace
from report.run.figures import (
    acceleration,
    element_forces,
    element_loops,
    error_over_time,
    finish,
    free_run_acceleration,
    free_run_displacement,
    identified_loops,
    imposed_loops,
    online_figures,
)
from report.run.table import print_again, print_outside, rows_of, why_no_free_run
from report.run.true_loops import true_loops
from runner.scores.conformal import FREE_RUN, ONE_STEP, covered, half_widths_of
from runner.scores.outcome import each_record
from runner.scores.spread import DIVERGED, Spread, percent

ROUNDING = 1e-9  # by which other code, libraries or machines may differ


def require_scores(metrics: dict[str, Any], dofs: int) -> None:
    """Raise ValueError where metrics.json lacks names, or errors of each of the model's `dofs`."""
    names = ("model", "system", "scenario")
    lacking = [name for name in names if name not in metrics]
    per_dof = metrics.get("test", {}).get("per_dof_percent", ())
    if lacking or len(per_dof) != dofs:
        what = lacking[0] if lacking else f"test.per_dof_percent of {dofs} DOFs"
        raise ValueError(f"metrics.json has no {what}; repeat the run")


def score_seeds(
    estimator: Estimator,
    run: Experiment,
    seeds: list[int],
    same_motions: bool,
    uncertainty: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """{seed: {split: scores}}: the test motions; for the run's own, the training motions too.

    A seed whose motion escapes is kept, with the reason under `failed`. `uncertainty`
    of a seed is the coverage of the bands of `uncertainty`, as `metrics.json` has them.
    """
    results: dict[str, Any] = {}
    for seed in seeds:
        try:
            data = replace(run, seed=seed).set_up_data()
            splits = SPLITS if same_motions and seed == run.seed else ("test",)
            scores = scores_of(estimator, data, splits)
            tested = each_record(data, "test").values()
            held = covered(estimator, uncertainty, tested) if uncertainty else {}
            results[str(seed)] = scores | ({"uncertainty": held} if held else {})
        except EscapedMotionError as error:
            if len(seeds) == 1:
                raise
            results[str(seed)] = {"failed": str(error)}
    return results


def scores_of(estimator: Estimator, data: Data, splits: tuple[str, ...]) -> dict[str, Any]:
    """Errors in percent under the keys of `metrics.json`."""
    results: dict[str, Any] = {}
    for split in splits:
        records = data.loader(split)
        results[split] = score(estimator, records)
        results[FREE_RUNS[split]] = free_run_score(estimator, records)
    return results


def print_evaluation(results: dict[str, Any], metrics: dict[str, Any], altered: bool) -> None:
    """Print the scores and the run's own, or that both are equal."""
    rows = [row for seed, scores in results.items() for row in rows_of(f"seed {seed}", scores)]
    if altered:
        rows += rows_of("as trained", metrics)
    console = terminal()
    print_again(console, metrics, rows)
    for line in why_no_free_run({metrics["model"]: next(iter(results.values()))}):
        console.print(line, markup=False)
    if not altered:
        (scores,) = results.values()
        if metrics.get("simulation_error", 0.0) is None:  # measured
            print_outside(console, "test motion ", metrics.get("outside_trained_range", []))
        _print_equality(scores, metrics, console)
    elif len(results) > 1:
        _print_medians(results, console)


def record_gone(run: Experiment) -> Path | None:
    """Where a run's measured record was, if it is not there any more."""
    data = run.data.values
    typed = [data[key] for key in ("path", "folder") if data.get(key)]
    each = [one for names in typed for one in ([names] if isinstance(names, str) else names)]
    return next((Path(one) for one in each if not (Path(one).exists() or has_magic(one))), None)


def require_record(run: Experiment, need: str) -> None:
    """Raise ValueError, which begins with the need, where a run's measured record is missing."""
    if (gone := record_gone(run)) is not None:
        raise ValueError(f"{need} the record {gone}, which is missing; put it back")


def print_stored(metrics: dict[str, Any], gone: Path) -> None:
    """Table of the scores in `metrics.json`, and what cannot be done without the record."""
    console = terminal()
    print_again(console, metrics, rows_of("as stored", metrics))
    console.print(
        f"not scored again: the record {gone} is missing; put it back, or name another one to "
        "score the model on (data.path=FILE)",
        markup=False,
        soft_wrap=True,  # a path is never broken
    )


def _print_medians(results: dict[str, Any], console: Console) -> None:
    """Over the seeds; one whose motion escaped has nothing to score."""
    for key, name in (("test", "test"), (FREE_RUNS["test"], "free run")):
        scores = [r[key] for r in results.values() if key in r and "no_free_run" not in r[key]]
        errors = [s["relative_rms_percent"] for s in scores]
        spread = Spread(
            tuple(math.inf if error is None else error for error in errors),
            escaped=sum("failed" in r for r in results.values()),
        )
        if errors:
            console.print(f"{name}: median {spread.text()} %, seeds: {spread.counts()}")


def agree(some: Any, others: Any) -> bool:
    """The same numbers, up to `ROUNDING`, relative, under the same names."""
    if isinstance(some, dict) and isinstance(others, dict):
        return some.keys() == others.keys() and all(agree(some[k], others[k]) for k in some)
    if isinstance(some, list) and isinstance(others, list):
        return len(some) == len(others) and all(map(agree, some, others))
    if isinstance(some, float) and isinstance(others, float):
        return math.isclose(some, others, rel_tol=ROUNDING)
    return bool(some == others)


def _print_equality(scores: dict[str, Any], metrics: dict[str, Any], console: Console) -> None:
    """Raises ValueError unless the scores are those of the run, up to rounding."""
    ours = {key: value for key, value in scores.items() if key != "uncertainty"}
    shared = [key for key in ours if key in metrics]  # runs of older code have no free run
    exact = all(ours[key] == metrics[key] for key in shared)
    if not exact and not all(agree(ours[key], metrics[key]) for key in shared):
        raise ValueError(
            "the scores differ from metrics.json; the code or the libraries changed since the run "
            f"(made with {metrics.get('versions')})"
        )
    console.print(f"equal to metrics.json to {'the last digit' if exact else f'{ROUNDING:g}'}")
    if len(shared) < len(ours):
        console.print("metrics.json has no free run to compare with; repeat the run to add it")


def draw_figures(
    estimator: Estimator,
    run: Experiment,
    seed: int,
    prior: float | None,
    uncertainty: Mapping[str, Any] | None = None,
) -> dict[str, Figure]:
    """The run's figures for one seed, by name.

    prior: the weight that training ended with. uncertainty: with bands, as `metrics.json` has it.
    """
    data = replace(run, seed=seed).set_up_data()
    trained = data if seed == run.seed else run.set_up_data()
    found = None
    with suppress(ValueError, MemoryError):
        from runner.scores.uncertainty import minimum_of  # loads every model

        found = minimum_of(estimator, trained, prior)
    drawn = draw_test(estimator, data, found, run.model.name, run.system.name, uncertainty)
    return drawn | _over_truth(estimator, data, f"{run.model.name} on {run.system.name}")


def draw_test(
    estimator: Estimator,
    data: Data,
    found: Laplace | None,
    model: str,
    system: str,
    uncertainty: Mapping[str, Any] | None,
    remark: str = "",
    device: torch.device | str = "cpu",
) -> dict[str, Figure]:
    """Pictures of a model on the first test motion, by name.

    found: the minimum of its training, of a model that has intervals: bands are about it. remark:
    what else the title says. device: of the estimator.
    """
    name, record = next(iter(each_record(data, "test").items()))
    name = f"{system}, {name}" if isinstance(data, SimulatedData) else name
    band: Tensor | None = None
    unmeasured: Mapping[str, Signal] = {}
    with suppress(ValueError, MemoryError):
        if found is not None:
            from runner.scores.uncertainty import band_of, unmeasured_of  # loads every model

            band = band_of(estimator, found, record)
            unmeasured = unmeasured_of(estimator, found, record, data)
    names, seen = list(data.elements), record.to(device)
    return draw_record(estimator, seen, model, name, remark, names, band, uncertainty, unmeasured)


def _over_truth(estimator: Estimator, data: Data, on: str) -> dict[str, Figure]:
    """A network's loops over the true ones, where these are known."""
    record = next(iter(each_record(data, "test").values()))
    if (loops := loops_of(estimator, record)) is None:
        return {}
    figure = true_loops(estimator, data, record, loops, f"{on}, free run of unseen motion")
    return {} if figure is None else {"element_loops": figure}


def draw_record(
    estimator: Estimator,
    record: Record,
    model: str,
    name: str,
    remark: str = "",
    elements: Sequence[str] = (),
    band: Tensor | None = None,
    uncertainty: Mapping[str, Any] | None = None,
    unmeasured: Mapping[str, Signal] | None = None,
) -> dict[str, Figure]:
    """Pictures of a model on one record, by name; they say which, and how far it errs.

    remark: what else the title says. elements: names of the structure's, where they are known.
    band: half widths (T, n) of the 95 % band about the free run; None: that of `uncertainty`, as
    `metrics.json` has it, where it has one. unmeasured: signals without a sensor, with bands.
    """
    one_step, free_run = Scores(), FreeRunScore()
    estimate = one_step.update(estimator, record)[""]
    free_run.update(estimator, record)
    title = titled_picture(model, name, one_step.percent(), free_run.percent(), remark)
    own = None if free_run.example is None else free_run.example[1]
    errors = {"one step": one_step.over_time()}
    if (over_time := free_run.over_time()) is not None:
        errors["free run"] = over_time
    known, signals, joined = uncertainty or {}, unmeasured or {}, names_of(estimator)
    about = half_widths_of(known, ONE_STEP, estimate, record.dt)
    drawn = {
        "acceleration": acceleration(record, estimate, band=about),
        "error_over_time": error_over_time(errors, record.dt, record.warmup),
    }
    if record.quantity == "force" and record.s is not None:
        drawn["element_loops"] = imposed_loops(record, estimate if own is None else own.a)
    if own is not None:
        band = half_widths_of(known, FREE_RUN, own.a, record.dt) if band is None else band
        drawn["free_run_acceleration"] = free_run_acceleration(record, own, band)
        if record.quantity == "acceleration" and displacement_of(record) is not None:
            half = signals[DISPLACEMENT].half if DISPLACEMENT in signals else None
            drawn["free_run_displacement"] = free_run_displacement(record, own, half)
    if FORCE in signals and torch.isfinite(signals[FORCE].half[record.warmup :]).all():
        drawn["free_run_element_forces"] = element_forces(record, signals[FORCE], joined)
    if record.truth is not None:
        drawn["element_loops"] = element_loops(record, list(elements))
    elif "element_loops" not in drawn:
        loops = loops_of(estimator, record)
        if loops is not None and torch.isfinite(loops[1]).all():
            drawn["element_loops"] = identified_loops(*loops, joined)
    finish(drawn, title)
    return drawn | online_figures(estimator, record, f"{model} on {name}")


def titled_picture(
    model: str, record: str, one_step: dict[str, Any], free_run: dict[str, Any], remark: str = ""
) -> str:
    """Model, record and errors in a line."""
    same = free_run.get("per_dof_percent") == one_step["per_dof_percent"]
    scores = {"free run": free_run} if same else {"one step": one_step, "free run": free_run}
    errors = []
    for way, of_way in scores.items():
        if "no_free_run" not in of_way:
            error = of_way["relative_rms_percent"]
            errors.append(f"{way} {DIVERGED if error is None else percent(error) + ' %'}")
    return "; ".join(filter(None, (f"{model} on {record}: {', '.join(errors)}", remark)))
