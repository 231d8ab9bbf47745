"""python evaluate.py run=FOLDER uncertainty=laplace|profile|smc: how sure a finished run is."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from rich.console import Console
from rich.text import Text

from data.datamodule import Data
from data.terminal import terminal
from models.composition.stated import dotted
from models.estimator import Estimator
from models.physical.parameters import parameters_of
from models.training.assemble import data_from
from models.training.trainable import Trainable
from models.uncertainty.intervals import Interval, intervals_of
from models.uncertainty.laplace import Laplace, laplace
from models.uncertainty.parameters import free_vector
from report.output import save_figure
from report.run.criticism import print_criticism
from report.run.intervals import beyond_training, print_intervals, which_to_believe
from report.run.rescore import record_gone
from report.run.table import WIDTH, print_verdict
from report.uncertainty.profiles import print_profiles, profile_figure, profiles_of
from report.uncertainty.samples import corner_figure, print_samples, sampled
from runner.folder.run import restore
from runner.folder.run_folder import read_run, write_json
from runner.scores.headline import headline
from runner.scores.uncertainty import uncertainty_of

MOST_PROFILED = 40  # free parameters of a model
PROFILED = 4  # parameters, where none is named


@dataclass(frozen=True)
class Finished:
    """A finished run with its training records, and the intervals of its fit."""

    model: Trainable
    data: Data
    metrics: dict[str, Any]
    found: Laplace
    intervals: list[Interval]
    prior: float | None


def evaluate_uncertainty(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Print how sure a run is, in the way asked for; saved with figures in its `evaluation/`.

    Raises ValueError for a run whose model has no physical parameters or no exact derivatives, for
    names that it does not have, and for settings that do not go with `uncertainty`.
    """
    _require_as_trained(cfg)
    run, metrics = read_run(folder)
    finished = _finished(run, metrics, folder)
    names = [cfg.parameter] if isinstance(cfg.parameter, str) else list(cfg.parameter or [])
    _require_known(names, finished.model)
    console = terminal(WIDTH)
    print_verdict(console, metrics)
    output = folder / "evaluation" / f"uncertainty_{cfg.uncertainty}"
    of_kind = {"laplace": _laplace, "profile": _profile, "smc": _smc}[cfg.uncertainty]
    results = of_kind(cfg, finished, names, console, output)
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "uncertainty.json", results)
    console.print(f"saved in {output}", markup=False)
    return results


def _require_as_trained(cfg: DictConfig) -> None:
    """Raise ValueError for settings that ask for other motions."""
    data = OmegaConf.to_container(cfg.data, resolve=True)
    if cfg.get("scenario") is not None or cfg.seeds is not None or _said(data):
        raise ValueError(
            "uncertainty= speaks of the records that a run was trained on; leave out scenario, "
            "seeds and data"
        )


def _said(values: Any) -> bool:
    if isinstance(values, dict):
        return any(_said(value) for value in values.values())
    return values is not None


def _finished(run: DictConfig, metrics: dict[str, Any], folder: Path) -> Finished:
    model, name = restore(run, folder), str(run.model.name)
    if (gone := record_gone(run)) is not None:
        raise ValueError(f"the record {gone} is gone, and intervals come from it; put it back")
    if not parameters_of(model):
        raise ValueError(
            f"{name} is a black box: it has no physical parameter that could have an interval; "
            "choose a model of elements, such as element_network"
        )
    if not isinstance(model, Trainable) or not any(p.requires_grad for p in model.parameters()):
        raise ValueError(_without(name, model))
    data = data_from(run)
    data.setup()
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
    known = [p.name for p in parameters_of(model)]
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=3) or known[:4]
            raise ValueError(f"parameter={name}: there is none; did you mean {', '.join(near)}?")


def _laplace(
    cfg: DictConfig, run: Finished, names: Sequence[str], console: Console, output: Path
) -> dict[str, Any]:
    """Both kinds of intervals side by side, which is to be believed, what the residual asks for."""
    if names:
        raise ValueError("parameter= is for uncertainty=profile and smc; laplace tells all of them")
    content = uncertainty_of(run.model, run.found, run.data, [])
    print_intervals(console, content, both=True)
    beyond = beyond_training(run.metrics, content)
    if not which_to_believe(headline(content)):
        believe = "" if beyond else ": believe those of noise alone"
        console.print(
            f"both kinds agree within a factor of 2 where parameters are determined{believe}",
            markup=False,
        )
    if beyond:
        console.print(Text(beyond, style="yellow"))
    print_criticism(console, content)
    return content


def _profile(
    cfg: DictConfig, run: Finished, names: Sequence[str], console: Console, output: Path
) -> dict[str, Any]:
    free = len(free_vector(run.model))
    if free > MOST_PROFILED:
        raise ValueError(
            f"a profile fits all other parameters anew at every step; of {free} that does not "
            f"converge, {MOST_PROFILED} are possible: train a smaller model (such as "
            "model.units=1 model.hinges=0), or take uncertainty=laplace"
        )
    chosen = list(names) or _open(run.intervals, run.model)
    profiles = profiles_of(run.model, run.data.loader("train"), run.found, chosen)
    print_profiles(console, profiles, run.intervals)
    save_figure(profile_figure(profiles, run.intervals), output, "profile")
    return {"parameters": [profile.content() for profile in profiles]}


def _open(intervals: Sequence[Interval], model: Trainable) -> list[str]:
    """Parameters that the fit did not determine, or else those known least, at most `PROFILED`."""
    own = {p.name for p in parameters_of(model) if not p.derived}
    learned = [i for i in intervals if i.half == i.half and i.name in own]
    unclear = [i for i in learned if i.status != "determined"]
    by_width = sorted(learned, key=lambda i: -i.half / max(abs(i.value), 1e-300))
    return [i.name for i in (unclear or by_width)[:PROFILED]]


def _smc(
    cfg: DictConfig, run: Finished, names: Sequence[str], console: Console, output: Path
) -> dict[str, Any]:
    stated: Any = OmegaConf.to_container(cfg.priors, resolve=True)
    samples = sampled(
        run.model,
        run.data.loader("train"),
        run.found,
        names,
        dict(dotted(stated)),
        cfg.particles,
        cfg.seed,
        cfg.threads,
        cfg.begin,
        console,
    )
    print_samples(console, samples, run.intervals)
    save_figure(corner_figure(samples), output, "corner")
    return samples.content()
