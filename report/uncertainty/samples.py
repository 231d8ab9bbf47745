"""Samples of a run's parameters by sequential Monte Carlo: what is asked for, table and figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text

from data.datamodule import Data
from data.parallel import take_threads
from data.parallel import threads as cores_of
from models.composition.many_runs import positive_of
from models.composition.priors import dotted, numbers_of
from models.fit.trainable import Trainable
from models.uncertainty.intervals import Interval
from models.uncertainty.laplace import CONTRADICTED, Laplace
from models.uncertainty.parameters import free_vector, set_free_vector, slopes, values_of
from models.uncertainty.posterior import Likelihood, Posterior, Prior
from models.uncertainty.profile import most_likely, support_of
from models.uncertainty.smc import Agreement, Sampled, Stage, Wide, agreement_of, tempered
from report.output import Section, printed
from report.style import ESTIMATED, MEASURED, one_legend
from runner.config.settings import Question
from runner.scores.headline import HEADLINE

MOST = 30  # parameters that particles can follow
FEWEST = 10  # samples for each of them
DRAWN = 1000  # particles whose physical parameters are kept
AS_PRIOR = 0.5  # of the prior's standard deviation: the records say little of a parameter
SHOWN = 6  # parameters of a corner figure


@dataclass(frozen=True)
class Finished:
    """A finished run with its training records, and the intervals of its fit."""

    model: Trainable
    data: Data
    metrics: dict[str, Any]
    found: Laplace
    intervals: list[Interval]
    prior: float | None


@dataclass(frozen=True)
class Samples:
    """Physical parameters of particles, and a Normal distribution about the mode.

    values (D, Q): of draws; mode, deviation (Q,): of Laplace's approximation of the same posterior.
    """

    names: list[str]
    units: list[str]
    values: np.ndarray
    mode: np.ndarray
    deviation: np.ndarray
    told: list[str]
    derived: list[bool]
    agreement: Agreement
    runs: list[Sampled]
    fixed: int

    def content(self) -> dict[str, Any]:
        """As plain data."""
        rows = []
        for q, name in enumerate(self.names):
            low, high = np.nanpercentile(self.values[:, q], [2.5, 97.5])
            rows.append(
                {
                    "name": name, "unit": self.units[q],
                    "mean": float(np.nanmean(self.values[:, q])),
                    "deviation": float(np.nanstd(self.values[:, q])),
                    "low": float(low), "high": float(high), "status": self.told[q],
                    "laplace": float(self.mode[q]), "laplace_deviation": float(self.deviation[q]),
                }
            )  # fmt: skip
        return {
            "parameters": rows,
            "fixed_parameters": self.fixed,
            "log_evidence": [run.log_evidence for run in self.runs],
            "r_hat": self.agreement.r_hat,
            "difference_of_means": self.agreement.apart,
            "runs_of_the_model": sum(run.runs for run in self.runs),
            "temperatures": [
                [(s.temperature, s.counting, s.acceptance, s.moves) for s in run.stages]
                for run in self.runs
            ],
        }


def sampled(asked: Question, run: Finished, console: Console) -> Samples:
    """Two runs of the sampler, and the parameters of their particles. Leaves the model as it was.

    asked: names of the physical parameters whose θ are sampled, the others held at the fit (none:
    all); priors by name, [value, relative standard deviation]; begin: "fit", or "prior", from
    which other places than the fit are sought too. Raises ValueError for too many
    parameters, for priors that are none, and where the two runs do not agree.
    """
    model, theta = run.model, free_vector(run.model)
    chosen = _sampled_numbers(model, asked.names, run.found.samples)
    prior = stated_prior(model, dict(dotted(asked.priors)), chosen)
    likelihood = Likelihood(model, run.data.loader("train"), run.found)
    posterior = Posterior(likelihood, prior, chosen)
    if len(chosen) < len(theta):
        console.print(
            f"{len(chosen)} of {len(theta)} parameters are sampled; the others stay at the fit, "
            "which makes intervals too narrow where they are correlated"
        )
    try:
        best, point = most_likely(posterior, theta.numpy()[chosen])
        covariance = np.linalg.inv(point.matrix)
        set_free_vector(model, theta)
        compiled = likelihood.compile()
        take_threads(asked.threads)
        cores, count = cores_of(), asked.particles
        console.print(
            f"two runs of {count} particles of {len(chosen)} parameters on {cores} "
            f"core{'s' if cores > 1 else ''}"
            f"{'' if compiled else ', a run at a time: its runs cannot be compiled together'}"
        )
        start = Wide.about(best, covariance) if asked.begin == "fit" else None
        like, prior, note = posterior.log_likelihood, posterior.prior, partial(_note, console)
        seeds = np.random.SeedSequence(asked.seed).spawn(2)
        draws = [np.random.default_rng(own) for own in seeds]
        runs = [tempered(like, prior, count, draw, start, note) for draw in draws]
        return _summary(model, posterior, runs, best, covariance)
    finally:
        set_free_vector(model, theta)


def _note(console: Console, stage: Stage) -> None:
    if console.is_terminal:
        console.print(
            f"temperature {stage.temperature:.2g}, accepted {100 * stage.acceptance:.0f} % of "
            f"{stage.moves} moves",
            end="\r",
        )


def _sampled_numbers(model: Trainable, names: Sequence[str], samples: int) -> np.ndarray:
    """Numbers (p,) of the free parameters that are sampled."""
    P = len(free_vector(model))
    if names:
        chosen = np.unique(np.concatenate([support_of(model, name) for name in names]))
    else:
        chosen = np.arange(P)
    if len(chosen) > MOST:
        raise ValueError(
            f"{len(chosen)} parameters are more than the {MOST} that particles can follow; name "
            "some of them (parameter=r1.stiffness,r1.damping: the others stay at the fit), or "
            "train a smaller model (such as model.units=1 model.hinges=0)"
        )
    if samples < FEWEST * len(chosen):
        raise ValueError(
            f"{samples} samples are too few for {len(chosen)} parameters; name fewer "
            "(parameter=…), or train on a longer record"
        )
    return chosen


def stated_prior(model: Trainable, stated: Mapping[Any, Any], chosen: np.ndarray) -> Prior:
    """The prior of all free parameters, with those that a person states of physical ones.

    stated: {name: [value, relative standard deviation]}. Raises ValueError for numbers that make
    no prior and for parameters that are not one coefficient, or not sampled.
    """
    prior, theta = Prior.of(model), free_vector(model).numpy()
    known = {p.name: p.value for p in model.physical_parameters()}
    positive = positive_of(model)
    for name, pair in stated.items():
        if name not in known:
            raise ValueError(f"priors.{name}: there is no such parameter; see metrics.json")
        value, share = numbers_of(f"priors.{name}", pair)
        support = support_of(model, name)
        if len(support) != 1 or support[0] not in chosen:
            why = "it follows from several" if len(support) != 1 else "it is not sampled"
            raise ValueError(f"priors.{name}: {why}; state a prior of those it follows from")
        j = support[0]
        slope = float(slopes(model, partial(values_of, model, [name]))[0, j])
        now = known[name]
        if positive[j] and value > 0.0:
            prior.mean[j] = theta[j] + now * np.log(value / now) / slope
            prior.width[j] = share
        elif positive[j]:
            raise ValueError(f"priors.{name}: {value:g} must be positive")
        else:
            prior.mean[j] = theta[j] + (value - now) / slope
            prior.width[j] = abs(share * value / slope)
    return prior


def _summary(
    model: Trainable,
    posterior: Posterior,
    runs: list[Sampled],
    best: np.ndarray,
    covariance: np.ndarray,
) -> Samples:
    """What the particles say of physical parameters."""
    agreement = agreement_of(runs)
    agreement.require()
    every = max(1, -(-sum(len(run.particles) for run in runs) // DRAWN))
    particles = np.concatenate([run.particles for run in runs])
    set_free_vector(model, torch.from_numpy(posterior.whole(best)))
    parameters = model.physical_parameters()
    values = partial(values_of, model, [p.name for p in parameters])
    gradients = np.nan_to_num(slopes(model, values).numpy()[:, posterior.chosen])
    rows = np.flatnonzero(np.abs(gradients).sum(axis=1))
    drawn = []
    for theta in particles[::every]:
        set_free_vector(model, torch.from_numpy(posterior.whole(theta)))
        drawn.append(np.array(values())[rows])
    deviation = np.sqrt(np.einsum("qi,ij,qj->q", gradients, covariance, gradients))
    return Samples(
        [parameters[q].name for q in rows],
        [parameters[q].unit for q in rows],
        np.array(drawn),
        np.array([parameters[q].value for q in rows]),
        deviation[rows],
        [_word(gradients[q], particles, posterior.prior) for q in rows],
        [parameters[q].derived for q in rows],
        agreement,
        runs,
        len(posterior.rest) - len(posterior.chosen),
    )


def _word(gradient: np.ndarray, particles: np.ndarray, prior: Prior) -> str:
    """Whether the records tell a parameter, or are against its prior."""
    along = particles @ gradient
    wide = float(np.sqrt(((gradient * prior.width) ** 2).sum()))
    if along.std() > AS_PRIOR * wide:
        return "as the prior"
    if abs(along.mean() - prior.mean @ gradient) > CONTRADICTED * wide:
        return "against its prior"
    return ""


def print_samples(console: Console, samples: Samples, intervals: Sequence[Interval]) -> None:
    """Print marginals, Laplace's approximation, the evidence, and how well two runs agree."""
    lines = []
    fitted = {i.name: i for i in intervals}
    for q, name in enumerate(samples.names):
        if samples.derived[q] and name.partition(".")[2] not in HEADLINE:
            continue
        own = samples.values[:, q]
        low, high = np.nanpercentile(own, [2.5, 97.5])
        label = f"{name} [{samples.units[q]}]" if samples.units[q] else name
        normal = f"{samples.mode[q]:.4g} ± {1.96 * samples.deviation[q]:.2g}"
        fit = fitted[name]
        lines.append(
            [label, f"{np.nanmean(own):.4g}", f"{low:.4g}", f"{high:.4g}", normal,
             f"{fit.value:.4g} ± {fit.half:.2g}", samples.told[q]]
        )  # fmt: skip
    head = ["parameter", "mean", "2.5 %", "97.5 %", "Laplace", "by the fit", "status"]
    console.print(printed(Section(head, lines), left=(0, 6)))
    if "against its prior" in samples.told:
        console.print(Text("the records contradict a stated prior", style="yellow"))
    one, other = (run.log_evidence for run in samples.runs)
    console.print(
        f"log evidence {0.5 * (one + other):.2f} ± {0.5 * abs(one - other):.2f} (two runs); it "
        "holds for these priors and this noise, and compares models of the same records"
    )
    total = sum(run.runs for run in samples.runs)
    last = [run.stages[-1] for run in samples.runs]
    console.print(
        f"{len(samples.runs[0].stages)} and {len(samples.runs[1].stages)} temperatures, {total} "
        f"free runs; accepted {100 * last[0].acceptance:.0f} and {100 * last[1].acceptance:.0f} %; "
        f"means of both runs agree within {samples.agreement.apart:.2f} standard deviations "
        f"(R-hat {samples.agreement.r_hat:.3f})"
    )


def corner_figure(samples: Samples) -> Figure:
    """Marginals and pairs of some parameters, with Laplace's Normal distributions."""
    own = [q for q, derived in enumerate(samples.derived) if not derived][:SHOWN]
    n = len(own)
    figure = Figure(figsize=(1.7 * n + 0.8, 1.7 * n + 0.4), layout="constrained")
    for row, q in enumerate(own):
        for column, p in enumerate(own[: row + 1]):
            axes = figure.add_subplot(n, n, row * n + column + 1)
            if row == column:
                axes.hist(
                    samples.values[:, q], bins=30, density=True, color="#BBBBBB", label="particles"
                )
                low, high = np.nanmin(samples.values[:, q]), np.nanmax(samples.values[:, q])
                grid = np.linspace(low, high, 200)
                away = (grid - samples.mode[q]) / samples.deviation[q]
                peak = 1.0 / (samples.deviation[q] * math.sqrt(2.0 * math.pi))
                density = peak * np.exp(-0.5 * away**2)
                axes.plot(grid, density, color=ESTIMATED, linewidth=1.0, label="Laplace's Normal")
                axes.set_yticks([])
            else:
                axes.plot(
                    samples.values[:, p], samples.values[:, q], ".", color=MEASURED, markersize=1.2,
                    alpha=0.5, rasterized=True,
                )  # fmt: skip
            axes.locator_params(nbins=3)
            axes.tick_params(labelsize=6)
            if row == n - 1:
                axes.set_xlabel(_label(samples, p), fontsize=7)
            if column == 0 and row > 0:
                axes.set_ylabel(_label(samples, q), fontsize=7)
            elif row != column or row == 0:
                axes.tick_params(labelleft=row > 0 and column == 0)
    one_legend(figure, figure.axes[:1], loc="upper right", fontsize="small")
    return figure


def _label(samples: Samples, q: int) -> str:
    unit = samples.units[q]
    return f"{samples.names[q]}\n[{unit}]" if unit else samples.names[q]
