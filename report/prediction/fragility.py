"""How likely a limit is exceeded, by the intensity of the motion: lognormal fragility curves.

P(exceeded | x) = Φ((ln x − ln θ)/β)

θ and β are the likeliest for the share of exceedances at each motion and intensity (binomial;
Baker 2015, Efficient analytical fragility function fitting using dynamic structural analysis,
Earthquake Spectra 31). Runs of one motion at several scales, or of several draws of the model's
parameters, are not independent: motions are. Intervals come from leaving out one motion after the
other (jackknife with Student's t; Tukey 1958) together with the spread over the draws.
S draws, M motions, K scales, C columns of peaks, x intensity.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from scipy import signal, special

from data.measured.units import to_si
from data.simulation.earthquake import GRAVITY
from export.modes import modes_of
from models.estimator import Estimator
from report.output import Section, printed
from report.prediction.interface import GROUND
from report.prediction.motions import Motion
from report.prediction.peaks import number
from report.prediction.runs import Prediction
from report.style import DASHES, MARKERS, SERIES, panels, titled

DAMPING = 0.05  # of the oscillator whose peak is Sa(T1)
KINDS = {  # of peaks that may have a limit: the word for it, and a signal of its dimension
    "deformation": ("drift", "drift"), "loop": ("force", "r"), "force": ("force", "r"),
    "displacement": ("displacement", "x"), "velocity": ("velocity", "v"),
    "acceleration": ("acceleration", "a"), "output": ("output", "u"),
}  # fmt: skip
QUANTILES = (0.16, 0.5, 0.84)
STEPS, LONGEST, FARTHEST = 25, 2.0, 7.0  # of the fit, in standard deviations of the curve
PAIRS = 4000  # of θ and β that may be, of which intervals are quantiles
FEWEST = 3  # earthquakes: with fewer an interval says nothing


@dataclass(frozen=True)
class Limit:
    """A size that none of some columns of peaks should exceed, in SI units or those of `sizes`."""

    name: str  # as a person says it: "drift2 > 30 mm"
    columns: np.ndarray  # numbers of them
    sizes: np.ndarray  # of each


@dataclass(frozen=True)
class Peaks:
    """The largest of every column in all runs (S, M, K, C), infinite where a run diverged.

    outside (S, M, K): whether a run left the trained range. The first draw is the identified model;
    there are no others where S is 1.
    """

    values: np.ndarray
    outside: np.ndarray
    columns: Sequence[tuple[str, str, str]]  # kind, name such as drift2, unit
    scales: Sequence[float]

    @property
    def drawn(self) -> slice:
        """The draws of the parameters, or else the identified model."""
        return slice(1 if len(self.values) > 1 else 0, None)

    @property
    def diverged(self) -> np.ndarray:
        """Whether each run did (S, M, K)."""
        return np.asarray(np.isinf(self.values).all(axis=-1))

    def exceeded(self, limit: Limit) -> np.ndarray:
        """Whether each run did (S, M, K)."""
        own = self.values[..., limit.columns] > limit.sizes
        return np.asarray(own.any(axis=-1))

    def rows(self) -> list[dict[str, Any]]:
        """Of each scale and column: median, 16 and 84 % over motions and draws."""
        found = []
        for k, scale in enumerate(self.scales):
            runs = self.values[self.drawn, :, k].reshape(-1, len(self.columns))
            each = np.quantile(runs, QUANTILES, axis=0, method="lower").T
            diverged = int(self.diverged[self.drawn, :, k].sum())
            for (_, name, unit), (low, middle, high) in zip(self.columns, each, strict=True):
                found.append(
                    {"scale": scale, "peak": name, "unit": unit, "low": low, "median": middle,
                     "high": high, "runs": len(runs), "diverged": diverged}
                )  # fmt: skip
        return found


@dataclass(frozen=True)
class Curve:
    """The fragility by one limit and intensity; a row of the table.

    low, high: ends of 95 % intervals. share: of the runs that exceed the limit, how many left the
    trained range. grid: intensities, and the probability there with its interval.
    """

    limit: str
    intensity: str
    unit: str
    theta: tuple[float, float, float]  # with its low and high
    beta: tuple[float, float, float]
    exceeded: int
    runs: int
    share: float
    x: np.ndarray  # (M·K,) intensities, and the share of draws that exceed the limit
    shares: np.ndarray
    grid: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))

    def row(self) -> dict[str, Any]:
        ends = ("", "_low", "_high")
        found: dict[str, Any] = {"limit": self.limit, "intensity": self.intensity}
        found |= {"unit": self.unit}
        for name, values in (("theta", self.theta), ("beta", self.beta)):
            pairs = zip(ends, values, strict=True)
            found |= {f"{name}{end}": v if math.isfinite(v) else None for end, v in pairs}
        counts = {"exceeded": self.exceeded, "runs": self.runs}
        return {**found, **counts, "outside_of_exceeded": self.share if self.exceeded else None}

    def points(self) -> list[dict[str, Any]]:
        """The curve as rows, and the share of draws that exceed the limit at each intensity."""
        own = {"limit": self.limit, "intensity": self.intensity, "unit": self.unit}
        names = ("x", "probability", "low", "high", "share")
        lines = [*([*line, None] for line in self.grid.tolist())]
        lines += [[x, None, None, None, s] for x, s in zip(self.x, self.shares, strict=True)]
        return [own | dict(zip(names, line, strict=True)) for line in lines]


def columns_of_peaks(run: Prediction) -> list[tuple[str, str, str]]:
    """Kind, name and unit of every peak that may have a limit: ("deformation", "drift2", "m")."""
    signals = [s for s in run.signals if s.kind in KINDS]
    return [(s.kind, f"{KINDS[s.kind][0]}{n}", s.unit) for s in signals for n in s.names]


def peaks_of_runs(runs: Iterable[Prediction], motions: int, scales: Sequence[float]) -> Peaks:
    """Of runs, draw by draw, motion by motion, scale by scale."""
    values, outside, columns = [], [], list[tuple[str, str, str]]()
    for run in runs:
        columns = columns or columns_of_peaks(run)
        sizes = [np.abs(s.values).max(axis=0) for s in run.signals if s.kind in KINDS]
        values.append(np.concatenate(sizes) if run.left is None else np.full(len(columns), np.inf))
        outside.append(bool(run.outside))
    shape = -1, motions, len(scales)
    return Peaks(
        np.reshape(values, (*shape, len(columns))), np.reshape(outside, shape), columns, scales
    )


def limits_of(
    asked: Mapping[str, Any], run: Prediction, heights: Sequence[float] | None
) -> list[Limit]:
    """The limits that a person states: {"drift2": "30 mm", "drift": "1 %", "force": [1e3, 2e3]}.

    A quantity without a number is the largest of all. Numbers are in SI units, texts have a unit, %
    is of the height of a storey. Raises ValueError, naming the key, for what the model does not
    have and for what is no positive size of that dimension.
    """
    found, columns = [], columns_of_peaks(run)
    for name, sizes in asked.items():
        own = [i for i, c in enumerate(columns) if name in (c[1], KINDS[c[0]][0])]
        if not own:
            known = list(dict.fromkeys(w for c in columns for w in (KINDS[c[0]][0], c[1])))
            near = difflib.get_close_matches(str(name), known, n=1)
            hint = f"did you mean limits.{near[0]}?" if near else f"there are {', '.join(known)}"
            raise ValueError(f"limits.{name}: the model has no such peak; {hint}")
        for size in sizes if isinstance(sizes, list) else [sizes]:
            found.append(_limit(str(name), size, np.array(own), columns, heights))
    return found


def _limit(
    name: str,
    size: Any,
    own: np.ndarray,
    columns: Sequence[tuple[str, str, str]],
    heights: Sequence[float] | None,
) -> Limit:
    kind, _, unit = columns[own[0]]
    given = f"limits.{name}={size}"
    parts = re.fullmatch(r"\s*([\d.]+(?:[eE][+-]?\d+)?)\s*(.*?)\s*", str(size))
    try:
        value = float(parts[1]) if parts and not isinstance(size, bool) else math.nan
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ValueError(
            f"{given}: expected a positive size in {unit or 'the unit of the output'}, or with a "
            'unit, such as "30 mm"'
        )
    said = parts[2] if parts else ""
    factor: Any = 1.0
    if said == "%" and kind == "deformation":
        if heights is None:
            raise ValueError(
                f"{given}: the model knows no heights of storeys (model.heights); give the drift "
                "in m or mm"
            )
        numbers = [int(columns[i][1].removeprefix("drift")) for i in own]
        factor = 0.01 * np.array([heights[n - 1] for n in numbers])
    elif said:
        try:
            factor = to_si(said, KINDS[kind][1])
        except ValueError as error:
            raise ValueError(f"{given}: {error}") from None
    label = f"{name} > {value:g} {said or unit}".replace("^2", "²").strip()
    return Limit(label, own, np.broadcast_to(value * factor, own.shape))


def intensities_of(
    motions: Sequence[Motion], estimator: Estimator
) -> list[tuple[str, str, np.ndarray]]:
    """Names, units and sizes (M,) by which motions are told apart, as they are at scale 1.

    Of ground accelerations: PGA and, where the model has a period T1 of small motions, Sa(T1) with
    5 % damping, both in g. Of other motions the largest of their channels.
    """
    if not all(GROUND in motion.channels for motion in motions):
        sizes = [max(float(np.abs(u).max()) for u in m.channels.values()) for m in motions]
        return [("largest excitation", "", np.array(sizes))]
    grounds = [motion.channels[GROUND] / GRAVITY for motion in motions]
    found = [("PGA", "g", np.array([float(np.abs(a).max()) for a in grounds]))]
    modes = modes_of(estimator)
    if modes is not None and len(modes.frequencies):
        period = 1.0 / float(modes.frequencies[0])
        steps = [motion.dt for motion in motions]
        sa = [spectral_acceleration(a, dt, period) for a, dt in zip(grounds, steps, strict=True)]
        found.append((f"Sa({period:.3g} s)", "g", np.array(sa)))
    return found


def spectral_acceleration(ground: np.ndarray, dt: float, period: float) -> float:
    """ω² max |x| of an oscillator with 5 % damping, exact for a ground linear between samples.

    In the unit of `ground` (T,).
    """
    w = 2.0 * np.pi / period
    oscillator = ([-(w**2)], [1.0, 2.0 * DAMPING * w, w**2])
    b, a, _ = signal.cont2discrete(oscillator, dt, method="foh")
    return float(np.abs(signal.lfilter(np.ravel(b), a, ground)).max())


def curves_of(
    peaks: Peaks,
    limits: Sequence[Limit],
    intensities: Sequence[tuple[str, str, np.ndarray]],
    groups: Sequence[str],
) -> list[Curve]:
    """A curve for each limit and intensity. groups: motions of one name, such as both components of
    an earthquake, are left out together; FEWEST at least."""
    places = list(dict.fromkeys(groups))
    left = np.array([[group != place for group in groups] for place in places], dtype=float)
    counted = np.vstack([np.ones(len(groups)), left])
    found = []
    for limit in limits:
        own = peaks.exceeded(limit)[peaks.drawn]
        for name, unit, sizes in intensities:
            x = np.outer(sizes, np.abs(peaks.scales))
            curve = _curve(x, own, counted)
            beyond = peaks.outside[peaks.drawn][own]
            share = float(beyond.mean()) if len(beyond) else 0.0
            found.append(
                Curve(limit.name, name, unit, *curve[:2], int(own.sum()), own.size, share,
                      x.ravel(), own.mean(axis=0).ravel(), curve[2])
            )  # fmt: skip
    return found


def _curve(
    x: np.ndarray, own: np.ndarray, counted: np.ndarray
) -> tuple[tuple[float, float, float], tuple[float, float, float], np.ndarray]:
    """θ and β with intervals, and the curve (·, 4), of exceedances (S, M, K) at x (M, K).

    counted (1 + G, M): all motions, then those that are left without one of G groups.
    """
    S, _, K = own.shape
    logs, shares = np.log(x).ravel(), own.mean(axis=0).ravel()
    weights = np.repeat(counted, K, axis=1)
    without = lognormal_fit(logs, np.tile(shares, (len(counted), 1)), weights)
    single = lognormal_fit(logs, own.reshape(S, -1).astype(float), np.ones((S, len(logs))))
    rng, G = np.random.default_rng(0), len(counted) - 1
    heavy = np.sqrt((G - 1) / rng.chisquare(G - 1, PAIRS))
    grid = np.linspace(0.0, x.max(), 101)[1:]
    with np.errstate(invalid="ignore", over="ignore"):
        away = (without[:, 1:] - without[:, 1:].mean(axis=1, keepdims=True)) * ((G - 1) / G) ** 0.5
        of_motions = away @ rng.standard_normal((G, PAIRS)) * heavy
        of_draws = (single - np.median(single, axis=1, keepdims=True))[:, np.arange(PAIRS) % S]
        pairs = np.column_stack([without[:, 0], without[:, :1] + of_motions + of_draws])
        both = [(np.exp(u[0]), *_ends(np.exp(u[1:]))) for u in pairs]
        line = special.ndtr((np.log(grid)[:, None] - pairs[0]) / np.exp(pairs[1]))
    return *both, np.column_stack([grid, line[:, 0], *_ends(line[:, 1:])])


def _ends(values: np.ndarray) -> np.ndarray:
    return np.quantile(values, (0.025, 0.975), axis=-1, method="nearest")


def lognormal_fit(logs: np.ndarray, shares: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """ln θ and ln β (2, B) of the largest binomial likelihood, by Fisher scoring.

    logs (N,): of intensities; shares (B, N) that exceed a limit there, counted `weights` (B, N)
    times. Infinite where exceedances do not grow with intensity: ln θ is −∞ or ∞ then.
    """
    middle, size = logs.mean(), max(float(logs.std()), np.finfo(float).tiny)
    u = (logs - middle) / size
    mean = (weights * shares).sum(axis=1) / weights.sum(axis=1)
    edge = 0.5 / len(logs)
    level, slope = special.ndtri(mean.clip(edge, 1.0 - edge)), np.zeros(len(shares))
    for _ in range(STEPS):
        eta = (level[:, None] + slope[:, None] * u).clip(-FARTHEST, FARTHEST)
        p, density = special.ndtr(eta), np.exp(-0.5 * eta**2) / np.sqrt(2.0 * np.pi)
        information = weights * density / (p * (1.0 - p))
        score = information * (shares - p)
        information *= density
        H0, H1, H2 = (information.sum(axis=1), information @ u, information @ u**2)
        g0, g1 = score.sum(axis=1), score @ u
        scale = 1.0 / (H0 * H2 - H1**2).clip(min=np.finfo(float).tiny)
        step = np.array([(H2 * g0 - H1 * g1) * scale, (H0 * g1 - H1 * g0) * scale])
        step *= np.minimum(1.0, LONGEST / np.hypot(*step).clip(min=np.finfo(float).tiny))
        level, slope = level + step[0], slope + step[1]
        if np.abs(step).max() < 1e-9:
            break
    rises = (slope > 0.0) & (mean > 0.0) & (mean < 1.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        theta = np.where(
            rises, middle - size * level / slope, np.where(mean < 0.5, np.inf, -np.inf)
        )
        return np.array([theta, np.where(rises, np.log(size / slope), np.inf)])


# What is printed and drawn.


def print_peaks(console: Console, peaks: Peaks) -> None:
    """Of each scale the quantiles of the largest peak of a kind, over motions and draws."""
    lines = []
    for kind in dict.fromkeys(kind for kind, _, _ in peaks.columns if kind != "velocity"):
        own = [i for i, c in enumerate(peaks.columns) if c[0] == kind]
        name = f"{KINDS[kind][0]} [{peaks.columns[own[0]][2]}]".replace("^2", "²")
        for k, scale in enumerate(peaks.scales):
            most = peaks.values[peaks.drawn, :, k][..., own].max(axis=-1)
            each = np.quantile(most, QUANTILES, method="lower").tolist()
            lines.append([name if k == 0 else "", number(scale), *map(number, each)])
    console.print(printed(Section(["largest", "scale", "16 %", "median", "84 %"], lines)))
    S, M, K = peaks.outside[peaks.drawn].shape
    draws = f" and {S} draws of the parameters" if len(peaks.values) > 1 else ""
    beyond, lost = (100.0 * u[peaks.drawn].mean() for u in (peaks.outside, peaks.diverged))
    console.print(
        f"over {M} motions{draws}: {S * M * K} runs, {beyond:.3g} % outside the trained range, "
        f"{lost:.3g} % diverged (counted as infinite)"
    )


def print_curves(console: Console, curves: Sequence[Curve], drawn: bool) -> None:
    """θ and β of each curve with their intervals, and how far it is extrapolated."""
    lines, before = [], ""
    for c in curves:
        pairs = []
        for middle, low, high in (c.theta, c.beta):
            sure = math.isfinite(low) and math.isfinite(high)
            ends = f" ({number(low, 2)}–{number(high, 2)})" if sure else ""
            pairs.append(number(middle, 3) + ends)
        beyond = f", {100.0 * c.share:.0f} % outside" if c.exceeded else ""
        share = f"{100.0 * c.exceeded / c.runs:.3g} %{beyond}"
        lines.append([c.limit if c.limit != before else share, c.intensity, *pairs])
        before = c.limit
        if c.intensity == curves[-1].intensity == curves[0].intensity:  # a line for each limit
            lines.append([share, "", "", ""])
    unit = f" [{curves[0].unit}]" if curves[0].unit else ""
    head = ["limit", "x", f"θ{unit} (95 %)", "β (95 %)"]
    console.print(printed(Section(head, lines), left=(1, 0)))
    alone = "" if drawn else "; of the identified model alone: samples=200 adds its uncertainty"
    console.print(
        "fragility Φ(ln(x/θ)/β): below a limit, the runs that exceed it and how many of these are "
        f"outside the trained range, an extrapolation{alone}"
    )


def draw_curves(curves: Sequence[Curve], title: str) -> Figure:
    """A panel for each intensity: curves with 95 % bands, and shares at each tenth of the runs."""
    names = list(dict.fromkeys((c.intensity, c.unit) for c in curves))
    figure, drawn = panels(len(names), 4.4, 3.6, more=(0.0, 0.6), layout="constrained")
    for axes, (name, unit) in zip(drawn, names, strict=True):
        for i, c in enumerate(c for c in curves if c.intensity == name):
            colour = SERIES[(3, 0, 4, 5, 2, 1, 6, 7)[i % 8]]
            x, middle, low, high = c.grid.T
            axes.plot(x, middle, color=colour, linestyle=DASHES[i % len(DASHES)], label=c.limit)
            axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
            for part in np.array_split(np.argsort(c.x), 10):
                place = np.exp(np.log(c.x[part]).mean()), c.shares[part].mean()
                axes.plot(
                    *place, MARKERS[i % len(MARKERS)], color=colour, markersize=4, clip_on=False
                )
        axes.set_xlabel(f"{name} [{unit}]" if unit else name)
        axes.set_ylim(0.0, 1.0)
        axes.set_xlim(left=0.0)
        axes.grid(alpha=0.25)
    drawn[0].set_ylabel("probability that the limit is exceeded")
    figure.legend(*drawn[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    titled(figure, title)
    return figure
