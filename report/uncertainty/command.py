"""python evaluate.py run=FOLDER uncertainty=laplace|profile|smc: how sure a finished run is."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text

from data.record import Record
from data.terminal import terminal
from models.estimator import Estimator
from models.fit.trainable import Trainable
from models.stored.run import StoredRun, read_run
from models.uncertainty.intervals import Interval, intervals_of
from models.uncertainty.laplace import Laplace, laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.posterior import Likelihood
from models.uncertainty.profile import THRESHOLD, Profile, most_likely, profile_of
from report.output import Section, printed, save_figure
from report.run.evaluation import said_alone
from report.run.rescore import require_record
from report.run.table import print_verdict
from report.style import ESTIMATED, MEASURED, one_legend, panels
from report.uncertainty.intervals import (
    beyond_training,
    print_criticism,
    print_intervals,
    which_to_believe,
)
from report.uncertainty.samples import Finished, corner_figure, print_samples, sampled
from report.uncertainty.storeys import print_drifts
from runner.config.settings import Conditions, Question
from runner.folder.run import restore
from runner.folder.run_folder import results_folder, write_json
from runner.scores.headline import headline
from runner.scores.uncertainty import uncertainty_of

MOST_PROFILED = 40  # free parameters of a model
PROFILED = 4  # parameters, where none is named


def evaluate_uncertainty(folder: Path, asked: Question, conditions: Conditions) -> dict[str, Any]:
    """Print how sure a run is, in the way asked for; saved with figures in its `evaluation/`.

    Raises ValueError for a run whose model has no physical parameters or no exact derivatives, for
    names that it does not have, and for settings that do not go with `uncertainty`.
    """
    data = said_alone(conditions.data)
    if conditions.scenario is not None or conditions.seeds is not None or data:
        raise ValueError(
            "uncertainty= uses the records that a run was trained on; leave out scenario, "
            "seeds and data"
        )
    finished = finished_of(read_run(folder))
    _require_known(asked.names, finished.model)
    console = terminal()
    print_verdict(console, finished.metrics)
    output = results_folder(folder) / "evaluation" / f"uncertainty_{asked.uncertainty}"
    of_kind = {"laplace": _laplace, "profile": _profile, "smc": _smc}[str(asked.uncertainty)]
    results = of_kind(asked, finished, console, output)
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "uncertainty.json", results)
    console.print(f"saved in {output}", soft_wrap=True)
    return results


def finished_of(run: StoredRun) -> Finished:
    """Raises ValueError for a run that has no intervals, and where its records are missing."""
    model, name, metrics = restore(run), run.experiment.model.name, run.metrics
    require_record(run.experiment, "intervals need")
    if not model.physical_parameters():
        raise ValueError(
            f"{name} is a black box: it has no physical parameter that could have an interval; "
            "choose a model of elements, such as element_network"
        )
    if not isinstance(model, Trainable) or not any(p.requires_grad for p in model.parameters()):
        raise ValueError(_without(name, model))
    data = run.experiment.set_up_data()
    prior = metrics.get("training", {}).get("prior")
    found = laplace(model, data.loader("train"), prior)
    if found is None:
        raise ValueError(_without(name, model))
    return Finished(model, data, metrics, found, intervals_of(model, found), prior)


def _without(name: str, model: Estimator) -> str:
    return (
        f"{name} ({type(model).__name__}) is fitted in closed form or has no exact derivatives of "
        "its free run, from which intervals come; choose a model of elements, such as "
        "element_network"
    )


def _require_known(names: Sequence[str], model: Trainable) -> None:
    """Raise ValueError for a name that no parameter has, with those that are near."""
    known = [p.name for p in model.physical_parameters()]
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=3) or known[:4]
            raise ValueError(f"parameter={name}: there is none; did you mean {', '.join(near)}?")


def _laplace(asked: Question, run: Finished, console: Console, output: Path) -> dict[str, Any]:
    """Both kinds of intervals side by side, which to use, what the residual suggests."""
    if asked.names:
        raise ValueError("parameter= is for uncertainty=profile and smc; laplace has all of them")
    content = uncertainty_of(run.model, run.found, run.data, [])
    print_intervals(console, content, both=True)
    print_drifts(console, content)
    beyond = beyond_training(run.metrics, content)
    if not which_to_believe(headline(content)):
        believe = "" if beyond else ": use ± noise"
        console.print(
            f"both kinds agree within a factor of 2 where parameters are determined{believe}"
        )
    if beyond:
        console.print(Text(beyond, style="yellow"))
    print_criticism(console, content)
    return content


def _profile(asked: Question, run: Finished, console: Console, output: Path) -> dict[str, Any]:
    free = len(free_vector(run.model))
    if free > MOST_PROFILED:
        raise ValueError(
            f"a profile fits all other parameters again at every step, which does not converge for "
            f"{free}; the limit is {MOST_PROFILED}: train a smaller model (such as "
            "model.units=1 model.hinges=0), or take uncertainty=laplace"
        )
    chosen = asked.names or _open(run.intervals, run.model)
    profiles = profiles_of(run.model, run.data.loader("train"), run.found, chosen)
    print_profiles(console, profiles, run.intervals)
    save_figure(profile_figure(profiles, run.intervals), output, "profile")
    return {"parameters": [profile.content() for profile in profiles]}


def _open(intervals: Sequence[Interval], model: Trainable) -> list[str]:
    """Parameters that the fit did not determine, or else those known least, at most `PROFILED`."""
    own = {p.name for p in model.physical_parameters() if not p.derived}
    learned = [i for i in intervals if i.half == i.half and i.name in own]
    unclear = [i for i in learned if i.status != "determined"]
    by_width = sorted(learned, key=lambda i: -i.half / max(abs(i.value), 1e-300))
    return [i.name for i in (unclear or by_width)[:PROFILED]]


def _smc(asked: Question, run: Finished, console: Console, output: Path) -> dict[str, Any]:
    samples = sampled(asked, run, console)
    print_samples(console, samples, run.intervals)
    save_figure(corner_figure(samples), output, "corner")
    return samples.content()


# Profile likelihoods of a run's parameters: table and figure.

OPEN = "–"


def profiles_of(
    model: Trainable, batches: Iterable[Record], found: Laplace, names: Sequence[str]
) -> list[Profile]:
    """Profiles of physical parameters by name. Leaves the model as it was."""
    theta = free_vector(model)
    likelihood = Likelihood(model, batches, found)
    try:
        best, point = most_likely(likelihood, theta.numpy())
        return [profile_of(likelihood, name, best, point) for name in names]
    finally:
        set_free_vector(model, theta)


def print_profiles(
    console: Console, profiles: Sequence[Profile], intervals: Sequence[Interval]
) -> None:
    """Best value, ends of the 95 % interval, the interval of the fit, and what that means."""
    fitted = {i.name: i for i in intervals}
    lines = []
    for p in profiles:
        ends = [f"{end:.5g}" if math.isfinite(end) else OPEN for end in (p.low, p.high)]
        own = fitted[p.name]
        name = f"{p.name} [{p.unit}]" if p.unit else p.name
        lines.append([name, f"{p.best:.5g}", *ends, f"{own.value:.5g} ± {own.half:.2g}", p.verdict])
    head = ["parameter", "likeliest", "from", "to", "by the fit", "status"]
    console.print(printed(Section(head, lines), left=(0, 5)))
    for p in profiles:
        if p.verdict != "determined":
            reach = f"{p.values.min():.4g} to {p.values.max():.4g}"
            line = (
                f"{p.name} is {p.verdict}: from {reach} the other parameters compensate for it, "
                f"up to {p.deviance.max():.2g} in 2 log likelihood ({THRESHOLD:.3g} would bound it)"
                if p.verdict == "not identifiable"
                else f"{p.name} is {p.verdict} (searched from {reach})"
            )
            console.print(Text(line, style="yellow"))


def profile_figure(profiles: Sequence[Profile], intervals: Sequence[Interval]) -> Figure:
    """D against every parameter, with the threshold, and the parabola of the fit's interval."""
    fitted = {i.name: i for i in intervals}
    figure, drawn = panels(len(profiles), 3.4, 2.7, more=(0.0, 0.3), layout="constrained")
    for place, (axes, p) in enumerate(zip(drawn, profiles, strict=True)):
        axes.axhline(THRESHOLD, color="#777777", linewidth=0.8, linestyle=":", label="95 %")
        axes.plot(p.values, p.deviance, "o", color=MEASURED, markersize=3, label="fitted")
        own = fitted[p.name]
        grid = np.linspace(p.values.min(), p.values.max(), 200)
        root = np.sqrt(p.deviance) * np.sign(p.values - p.best)  # straight where D is a parabola
        axes.plot(grid, np.interp(grid, p.values, root) ** 2, color=MEASURED, linewidth=1.0)
        if own.half > 0.0:
            parabola = (1.96 * (grid - own.value) / own.half) ** 2
            axes.plot(grid, parabola, "--", color=ESTIMATED, linewidth=0.9, label="by the fit")
        ends = [e if math.isfinite(e) else edge for e, edge in
                ((p.low, p.values.min()), (p.high, p.values.max()))]  # fmt: skip
        axes.axvspan(*ends, color="#56B4E9", alpha=0.15, linewidth=0, label="interval")
        axes.set_ylim(0.0, max(2.0 * THRESHOLD, 1.0))
        axes.set_xlabel(f"{p.name} [{p.unit}]" if p.unit else p.name)
        axes.set_title(p.verdict, fontsize="medium")
        axes.locator_params(axis="x", nbins=4)
        if place % 3 == 0:
            axes.set_ylabel("2 × loss of log-likelihood")
    one_legend(figure, figure.axes, loc="outside lower center", ncols=4, fontsize="small")
    return figure
