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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from scipy import special

from data.measured.units import GRAVITY, to_si
from export.modes import modes_of
from models.estimator import Estimator
from models.fit.response_spectrum import spectral_peaks
from report.output import Section, printed
from report.prediction.interface import GROUND
from report.prediction.motions import Motion
from report.prediction.peaks import number
from report.prediction.runs import Prediction
from report.style import APART, DASHES, MARKERS, panels, titled

KINDS = {  # of peaks that may have a limit: the word for it, and a signal of its dimension
    "deformation": ("drift", "drift"), "loop": ("force", "r"), "force": ("force", "r"),
    "displacement": ("displacement", "x"), "velocity": ("velocity", "v"),
    "acceleration": ("acceleration", "a"), "output": ("output", "u"),
}  # fmt: skip
QUANTILES = (0.16, 0.5, 0.84)
STEPS, LONGEST, FARTHEST = 25, 2.0, 7.0  # of the fit, in standard deviations of the curve
PAIRS = 2000  # of θ and β that may be, of which intervals are quantiles
FEWEST = 3  # earthquakes: with fewer a jackknife has one degree of freedom
ENDS = 40  # draws: the ends of their 95 % interval are then the least and the largest


@dataclass(frozen=True)
class Limit:
    """A size that none of some columns of peaks should exceed, in SI units or those of `sizes`."""

    name: str  # as a person says it: "drift2 > 30 mm"
    columns: np.ndarray  # numbers of them
    sizes: np.ndarray  # of each


@dataclass(frozen=True)
class Peaks:
    """The largest of every column in all runs (S, M, K, C), infinite where a run diverged.

    outside (S, M, K): whether a run left the trained range, or diverged.
    """

    values: np.ndarray
    outside: np.ndarray
    columns: Sequence[tuple[str, str, str]]  # kind, name such as drift2, unit
    scales: Sequence[float]

    @property
    def diverged(self) -> np.ndarray:
        """Whether each run did (S, M, K)."""
        return np.asarray(np.isinf(self.values).all(axis=-1))

    def rows(self) -> list[dict[str, Any]]:
        """Of each scale and column: median, 16 and 84 % over motions and draws."""
        found = []
        for k, scale in enumerate(self.scales):
            runs = self.values[:, :, k].reshape(-1, len(self.columns))
            each = quantiles(runs).T
            diverged = int(self.diverged[:, :, k].sum())
            for (_, name, unit), (low, middle, high) in zip(self.columns, each, strict=True):
                found.append(
                    {"scale": scale, "peak": name, "unit": unit, "low": low, "median": middle,
                     "high": high, "runs": len(runs), "diverged": diverged}
                )  # fmt: skip
        return found


def quantiles(sizes: np.ndarray) -> np.ndarray:
    """16 %, median and 84 % (3, …) of sizes (N, …), of which some may be infinite."""
    with np.errstate(invalid="ignore"):
        found = np.quantile(sizes, QUANTILES, axis=0)
    return np.where(np.isnan(found), np.inf, found)


@dataclass(frozen=True)
class Curve:
    """The fragility by one limit and intensity.

    row: of the table: θ and β with 95 % intervals, None where the runs do not determine them; the
    same of all draws as if each were another structure; how many runs exceeded the limit, and which
    share of these left the trained range. x, shares (M·K,): intensities, and the share of draws
    that exceed the limit. grid (·, 4): intensities, the probability there and its interval.
    """

    row: dict[str, Any]
    x: np.ndarray
    shares: np.ndarray
    grid: np.ndarray


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
        outside.append(bool(run.outside) or run.left is not None)
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
        for size in (sizes or [None]) if isinstance(sizes, list) else [sizes]:
            found.append(_limit(str(name), size, np.array(own), columns, heights))
    return found


def _limit(
    name: str,
    size: Any,
    own: np.ndarray,
    columns: Sequence[tuple[str, str, str]],
    heights: Sequence[float] | None,
) -> Limit:
    (kind, _, unit), given = columns[own[0]], f"limits.{name}={size}"
    expected = f'{given}: expected a positive size in {unit}, or as in "30 mm"'
    if isinstance(size, bool) or not isinstance(size, str | int | float):
        raise ValueError(expected)
    text, factor = str(size).strip(), np.ones(len(own))
    if text.endswith("%") and kind == "deformation":
        if heights is None:
            raise ValueError(
                f"{given}: the model knows no heights of storeys (model.heights); give m or mm"
            )
        text, unit = text.removesuffix("%").strip(), "%"
        storeys = [int(columns[i][1].removeprefix("drift")) - 1 for i in own]
        factor = 0.01 * np.array(heights)[storeys]
    try:
        value = float(text)
    except ValueError:
        if kind == "output":  # its unit is not converted
            raise ValueError(
                f"{given}: expected a positive number, in {unit or 'its unit'}"
            ) from None
        try:
            value = to_si(text, KINDS[kind][1])
        except ValueError as error:
            raise ValueError(f"{given}: {error}") from None
    if not 0.0 < value < math.inf:
        raise ValueError(expected)
    label = f"{name} > {size}" if isinstance(size, str) else f"{name} > {size:g} {unit}"
    return Limit(label.replace("^2", "²"), own, value * factor)


def intensities_of(
    motions: Sequence[Motion], estimator: Estimator, others: Sequence[str] = ()
) -> list[tuple[str, str, np.ndarray]]:
    """Names, units and sizes (M,) by which motions are told apart, as they are at scale 1.

    Of ground accelerations: PGA and, where the model has a period T1 of small motions, Sa(T1) with
    5 % damping, both in g. Of other motions the largest of their channels, but for other inputs,
    which no scale is for.
    """
    if not all(GROUND in motion.channels for motion in motions):
        driving = ([u for c, u in m.channels.items() if c not in others] for m in motions)
        sizes = [max(float(np.abs(u).max()) for u in channels) for channels in driving]
        return [("largest excitation", "", np.array(sizes))]
    grounds = [motion.channels[GROUND] / GRAVITY for motion in motions]
    found = [("PGA", "g", np.array([float(np.abs(a).max()) for a in grounds]))]
    modes = modes_of(estimator)
    if modes is not None and len(modes.frequencies):
        period = 1.0 / float(modes.frequencies[0])
        steps = [motion.dt for motion in motions]
        own = np.array([period])
        each = zip(grounds, steps, strict=True)
        sa = [spectral_peaks(a[:, None], dt, own).item() for a, dt in each]
        found.append((f"Sa({period:.2g} s)", "g", np.array(sa)))
    return found


def curves_of(
    peaks: Peaks,
    limits: Sequence[Limit],
    intensities: Sequence[tuple[str, str, np.ndarray]],
    earthquakes: Sequence[str],
) -> list[Curve]:
    """A curve for each limit and intensity.

    earthquakes: that of each motion, FEWEST at least; both components of one are left out together.
    """
    places = list(dict.fromkeys(earthquakes))
    left = np.array([[one != place for one in earthquakes] for place in places], dtype=float)
    counted = np.vstack([np.ones(len(earthquakes)), left])
    found = []
    for limit in limits:
        exceeded = np.any(peaks.values[..., limit.columns] > limit.sizes, axis=-1)
        count, runs = int(exceeded.sum()), exceeded.size
        share = float(peaks.outside[exceeded].mean()) if count else None
        for name, unit, sizes in intensities:
            x = np.outer(sizes, np.abs(peaks.scales))
            fits, grid = fragility(x, exceeded, counted)
            row = {"limit": limit.name, "intensity": name, "unit": unit, **fits}
            row |= {"exceeded": count, "runs": runs, "outside_of_exceeded": share}
            found.append(Curve(row, x.ravel(), exceeded.mean(axis=0).ravel(), grid))
    return found


def fragility(
    x: np.ndarray, exceeded: np.ndarray, counted: np.ndarray
) -> tuple[dict[str, float | None], np.ndarray]:
    """θ and β with their intervals, and the curve (·, 4), of exceedances (S, M, K) at x (M, K).

    Medians over the draws: the fragility of the one structure that there is. counted (1 + G, M):
    all motions, then those that are left without one of G earthquakes.
    """
    S, _, K = exceeded.shape
    logs, weights = np.log(x).ravel(), np.repeat(counted, K, axis=1)
    shares = np.tile(exceeded.mean(axis=0).ravel(), (len(counted), 1))
    single = lognormal_fit(logs, exceeded.reshape(S, -1).astype(float), np.ones((S, len(logs))))
    without = lognormal_fit(logs, shares, weights)
    rng, G = np.random.default_rng(0), len(counted) - 1
    heavy = np.sqrt((G - 1) / rng.chisquare(G - 1, PAIRS))
    grid = np.linspace(0.0, x.max(), 61)[1:]
    with np.errstate(all="ignore"):  # what is not determined is infinite
        away = (without[:, 1:] - without[:, 1:].mean(axis=1, keepdims=True)) * ((G - 1) / G) ** 0.5
        of_motions = away @ rng.standard_normal((G, PAIRS)) * heavy
        middle, pairs = np.median(single, axis=1), single[:, np.arange(PAIRS) % S] + of_motions
        lines = [
            special.ndtr((np.log(grid)[:, None] - own[0]) / np.exp(own[1]))
            for own in (middle[:, None], pairs)
        ]
        ends = np.exp(np.column_stack([middle, *_ends(pairs), without[:, 0]]))
    names = ("", "_low", "_high", "_of_all_draws")
    fits = {
        f"{name}{end}": float(value) if 0.0 < value < np.inf else None
        for name, values in zip(("theta", "beta"), ends, strict=True)
        for end, value in zip(names, values, strict=True)
    }
    return fits, np.column_stack([grid, lines[0][:, 0], *_ends(lines[1])])


def _ends(values: np.ndarray) -> np.ndarray:
    """Ends (2, ·) of what holds 95 % of values (·, N)."""
    return np.quantile(values, (0.025, 0.975), axis=-1, method="nearest")


def lognormal_fit(logs: np.ndarray, shares: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """ln θ and ln β (2, B) of the largest binomial likelihood, by Fisher scoring.

    logs (N,): of intensities; shares (B, N) that exceed a limit there, counted `weights` (B, N)
    times. Where one intensity parts what exceeds it, ln β is −∞, and ln θ −∞ or ∞ where all or
    none does; where exceedances do not grow with intensity, ln β is ∞.
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
    far, rises = np.where(mean < 0.5, np.inf, -np.inf), slope > 0.0
    steep = np.where(rises, slope, 1.0)
    theta = np.where(rises, middle - size * level / steep, far)
    width = np.where(rises, np.log(size / steep), np.inf)
    first = np.where(weights * shares > 0.0, logs, np.inf).min(axis=1)  # that exceeds the limit
    last = np.where(weights * (1.0 - shares) > 0.0, logs, -np.inf).max(axis=1)  # that does not
    step_like = first >= last
    return np.where(step_like, [0.5 * (first + last), np.full_like(last, -np.inf)], [theta, width])


# What is printed and drawn.


def print_peaks(console: Console, peaks: Peaks, title: str) -> None:
    """Of each scale the quantiles of the largest peak of a kind, over motions and draws."""
    lines = []
    for kind in dict.fromkeys(kind for kind, _, _ in peaks.columns if kind != "velocity"):
        own = [i for i, c in enumerate(peaks.columns) if c[0] == kind]
        name = f"{KINDS[kind][0]} [{peaks.columns[own[0]][2]}]".replace("^2", "²")
        for k, scale in enumerate(peaks.scales):
            most = peaks.values[:, :, k][..., own].max(axis=-1)
            each = quantiles(most.ravel()).tolist()
            lines.append([name if k == 0 else "", number(scale), *map(number, each)])
    head = ["largest", "scale", "16 %", "median", "84 %"]
    console.print(printed(Section(head, lines, title)))
    S, M, K = peaks.outside.shape
    draws = f" and {S} draws of the parameters" if S > 1 else ""
    beyond, lost = (int(u.sum()) for u in (peaks.outside, peaks.diverged))
    console.print(
        f"over {M} motions{draws}: {S * M * K} runs, {S * M * K - beyond} inside the trained "
        f"range, {beyond - lost} outside, {lost} diverged{' (–: infinite)' if lost else ''}"
    )


def print_curves(console: Console, curves: Sequence[Curve], drawn: bool) -> None:
    """θ and β of each curve with their intervals, and how far it is extrapolated."""
    lines = []
    for before, curve in zip([None, *curves], curves, strict=False):
        row, cells = curve.row, []
        for name in ("theta", "beta"):
            low, high = row[f"{name}_low"], row[f"{name}_high"]
            ends = f" ({number(low, 2)}–{number(high, 2)})" if low and high else ""
            cells.append(number(row[name], 3) + ends)
        new = before is None or before.row["limit"] != row["limit"]
        lines.append([row["limit"] if new else "", row["intensity"], *cells])
    unit = f" [{curves[0].row['unit']}]" if curves[0].row["unit"] else ""
    head = ["limit", "intensity", f"θ{unit} (95 %)", "β (95 %)"]
    console.print(printed(Section(head, lines), left=(1, 0)))
    alone = "" if drawn else ", of the identified model alone (samples=200 adds its uncertainty)"
    console.print(
        f"P(exceeded | intensity x) = Φ(ln(x/θ)/β){alone}; –: the runs do not determine it. "
        "Sa with 5 % damping at T1 of the identified model"
    )
    for row in {curve.row["limit"]: curve.row for curve in curves}.values():
        console.print(_said(row))


def _said(row: Mapping[str, Any]) -> str:
    """How many runs exceed a limit, and what to beware of."""
    if not row["exceeded"]:
        return f"{row['limit']}: no run exceeds it; give larger motions (excitation.scale)"
    share, beyond = 100.0 * row["exceeded"] / row["runs"], 100.0 * row["outside_of_exceeded"]
    exceed = "all runs" if row["exceeded"] == row["runs"] else f"{share:.3g} % of the runs"
    smaller = "; give smaller motions, too" if row["exceeded"] == row["runs"] else ""
    guess = f"; {beyond:.0f} % of these are outside the trained range: an extrapolation"
    return f"{row['limit']}: {exceed} exceed it{guess if beyond >= 0.5 else ''}{smaller}"


def draw_curves(curves: Sequence[Curve], title: str) -> Figure:
    """A panel for each intensity: curves with 95 % bands, shares at tenths of the intensities."""
    names = list(dict.fromkeys((c.row["intensity"], c.row["unit"]) for c in curves))
    figure, drawn = panels(len(names), 4.4, 3.6, more=(0.0, 0.6), layout="constrained")
    for axes, (name, unit) in zip(drawn, names, strict=True):
        for i, c in enumerate(c for c in curves if c.row["intensity"] == name):
            (x, middle, low, high), dash = c.grid.T, DASHES[i % len(DASHES)]
            colour = APART[i % len(APART)]
            axes.plot(x, middle, color=colour, linestyle=dash, label=c.row["limit"])
            axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0.0)
            levels, place = np.unique(np.log(c.x).round(9), return_inverse=True)
            for part in np.array_split(np.arange(len(levels)), min(10, len(levels))):
                share, mark = c.shares[np.isin(place, part)].mean(), MARKERS[i % len(MARKERS)]
                at = np.exp(levels[part].mean())
                axes.plot(at, share, mark, color=colour, ms=4, clip_on=False)
        axes.set_xlabel(f"{name} [{unit}]" if unit else name)
        axes.set_ylim(0.0, 1.0)
        axes.set_xlim(left=0.0)
        axes.grid(alpha=0.25)
    drawn[0].set_ylabel("probability that the limit is exceeded")
    figure.legend(*drawn[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    titled(figure, title)
    return figure
