"""Profile likelihoods of a run's parameters: table and figure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text

from data.record import Record
from models.training.trainable import Trainable
from models.uncertainty.intervals import Interval
from models.uncertainty.laplace import Laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.posterior import Likelihood
from models.uncertainty.profile import THRESHOLD, Profile, most_likely, profile_of
from report.output import Section, printed
from report.style import ESTIMATED, MEASURED, one_legend

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
        lines.append([name, f"{p.best:.5g}", *ends, f"{own.value:.5g} ± {own.half:.2g}", p.told])
    head = ["parameter", "likeliest", "from", "to", "by the fit", "told"]
    console.print(printed(Section(head, lines), left=(0, 5)))
    for p in profiles:
        if p.told != "determined":
            reach = f"{p.values.min():.4g} to {p.values.max():.4g}"
            line = (
                f"{p.name} is {p.told}: from {reach} the other parameters make up for it, all but "
                f"{p.deviance.max():.2g} of the likelihood (2 log; {THRESHOLD:.3g} would bound it)"
                if p.told == "not identifiable"
                else f"{p.name} is {p.told} (searched from {reach})"
            )
            console.print(Text(line, style="yellow"))


def profile_figure(profiles: Sequence[Profile], intervals: Sequence[Interval]) -> Figure:
    """D against every parameter, with the threshold, and the parabola of the fit's interval."""
    fitted = {i.name: i for i in intervals}
    columns = min(3, len(profiles))
    rows = -(-len(profiles) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.7 * rows + 0.3), layout="constrained")
    for place, p in enumerate(profiles, start=1):
        axes = figure.add_subplot(rows, columns, place)
        axes.axhline(THRESHOLD, color="#777777", linewidth=0.8, linestyle=":", label="95 %")
        axes.plot(p.values, p.deviance, "o", color=MEASURED, markersize=3, label="fitted anew")
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
        axes.set_title(p.told, fontsize="medium")
        axes.locator_params(axis="x", nbins=4)
        if (place - 1) % columns == 0:
            axes.set_ylabel("2 × loss of log-likelihood")
    one_legend(figure, figure.axes, loc="outside lower center", ncols=4, fontsize="small")
    return figure
