"""Time histories of a page, thinned to what a screen shows, and what follows from them.

T samples, n channels.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv  # type: ignore[import-untyped]
import torch
from matplotlib.figure import Figure
from scipy.signal import welch

from data.datamodule import Data
from data.record import QUANTITIES, Record
from data.whole_file import whole_file
from models.estimator import Estimator
from models.fit.trained_range import loops_of, names_of
from models.online.scores import WINDOW, running_error
from models.stored.run import StoredRun
from report.output import spreadsheet
from report.run.figures import (
    LEFT,
    first_of,
    identified_loops,
    imposed_loops,
    strong_motion,
    within,
)
from report.run.true_loops import true_loops
from report.style import placed
from runner.scores.conformal import FREE_RUN, ONE_STEP, WAYS
from runner.scores.outcome import each_record
from runner.scores.verdict import CANNOT, OPPONENTS

POINTS = 280_000  # of all lines of a page together: 0.75 MB, half of what can be mailed anywhere
SCREEN = 1000  # points of a line that a small screen shows; with fewer a record is left out
LINES = 4 + 5 / 4  # of a channel: signals and error, and five of a quarter of their points
SEGMENTS = 8  # of a record, over which its spectrum is averaged
POWER = 0.999  # of a motion, up to half of the highest frequency that is drawn
CODES = 65_534  # steps from the lowest to the highest point of a line; one more is a gap
TEXT_BYTES = 150_000  # of the estimates in the page, and of the C source


@dataclass(frozen=True)
class Motion:
    """An unseen record (1, T, ·), the model's estimate of it and a plain model's (T, n)."""

    name: str
    record: Record
    own: np.ndarray
    plain: np.ndarray | None

    @property
    def measured(self) -> np.ndarray:
        return first_of(self.record.a)


def motions_of(
    run: StoredRun, estimator: Estimator, data: Data, way: str, plain: str | None
) -> list[Motion]:
    """All test records. way: "free run" or "one step"; plain: an opponent's name, if any.

    Raises ValueError for a model that cannot simulate.
    """
    estimate = WAYS[FREE_RUN if way == "free run" else ONE_STEP]
    other = None
    if plain is not None:
        try:
            make = OPPONENTS.get(plain)
            own = (data.dofs, data.inputs, data.dt)
            other = make(*own) if make else run.experiment.baselines[plain].estimator(data)
            other.identify(data.loader("train"))
        except (*CANNOT, KeyError):
            other = None
    motions = []
    with torch.no_grad():
        for name, record in each_record(data, "test").items():
            seen = record.measured()
            beside = None if other is None else first_of(estimate(other, seen))
            motions.append(Motion(name, record, first_of(estimate(estimator, seen)), beside))
    return motions


def fit_percent(motions: Sequence[Motion], estimates: Sequence[np.ndarray]) -> list[float]:
    """MATLAB's fit (n,) of the System Identification Toolbox: 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖)."""
    first = [m.record.warmup for m in motions]
    y = np.concatenate([m.measured[k:] for m, k in zip(motions, first, strict=True)])
    own = np.concatenate([u[k:] for u, k in zip(estimates, first, strict=True)])
    left, size = (np.linalg.norm(u, axis=0) for u in (y - own, y - y.mean(axis=0)))
    return [float(v) for v in 100.0 * (1.0 - left / np.where(size > 0.0, size, np.nan))]


def charts_of(motions: Sequence[Motion], names: Sequence[str], labels: Mapping[str, str]) -> Any:
    """For the page's script: by record and channel, the charts and their lines.

    names: of the n channels; labels: "own" and "plain", what the lines are called. A record that
    has more samples than points is followed by its strongest part, of which all samples are there.
    """
    share = POINTS / (len(names) * LINES)
    shown = list(motions[: max(1, int(share / SCREEN / 2))])
    points = max(2, int(share / sum(1 + (m.record.samples > share / len(shown)) for m in shown)))
    records = []
    for motion in shown:
        T, dt, before = motion.record.samples, motion.record.dt, motion.record.warmup
        spans = {motion.name: slice(before, T)}
        if points < T - before:
            name = f"{motion.name}, drawn by {points:,} of {T - before:,} samples"
            spans[name] = spans.pop(motion.name)
            strong = strong_motion(motion.measured[before:], dt, points * dt)
            strong = slice(before + strong.start, before + strong.stop)
            words = f"{dt * strong.start:.4g} to {dt * strong.stop:.4g} s, every sample"
            spans[f"{motion.name}, {words}"] = strong
        records += [
            {"name": name, "channels": [_channel(motion, i, span, points, names[i], labels)
                                        for i in range(len(names))]}
            for name, span in spans.items()
        ]  # fmt: skip
    return records


def _channel(
    motion: Motion, i: int, span: slice, points: int, name: str, labels: Mapping[str, str]
) -> dict[str, Any]:
    """Four charts of a channel: the signals, the error, its course over time, the spectra."""
    record, dt = motion.record, motion.record.dt
    unit = QUANTITIES[record.quantity][1]
    y = motion.measured[:, i]
    limit = LEFT * float(np.abs(y).max()) or 1.0
    given = {"plain": motion.plain, "own": motion.own}  # the last one is drawn on top
    others = {role: within(u[:, i], limit) for role, u in given.items() if u is not None}
    label = {"measured": "measured", **labels}
    alone = replace(record, a=record.a[..., [i]], x=None, v=None, truth=None, numbers=())
    running = {
        role: running_error(torch.from_numpy(u)[:, None], alone).numpy()
        for role, u in others.items()
    }
    compared = {"measured": y, **{role: u - y for role, u in others.items()}}
    spectra = _spectra({role: u[record.warmup :] for role, u in compared.items()}, dt)
    start, quarter = span.start * dt, max(2, points // 4)
    time = (start, dt, "time [s]")

    def lines(found: Mapping[str, np.ndarray], words: str, most: int) -> list[dict[str, Any]]:
        said = {r: label[r] if r == "measured" else words + label[r] for r in found}
        return [{"role": r, "label": said[r], **coded(u, most)} for r, u in found.items()]

    signals = {"measured": y, **others}
    part = {role: u[span] for role, u in signals.items()}
    error = {"own": others["own"][span] - y[span]}
    course = {role: _decades(u[span]) for role, u in running.items()}
    frequencies = (0.0, 1.0 / (dt * _segment(len(y) - record.warmup)), "frequency [Hz]")
    charts = [
        (time, f"{name} [{unit}]", lines(part, "", points), False),
        (time, f"error [{unit}]", lines(error, "error of ", points), False),
        (time, f"error of {WINDOW:g} s [%]", lines(course, "", quarter), True),
        (frequencies, f"density [({unit})²/Hz]", lines(spectra, "error of ", quarter), True),
    ]
    return {
        "name": name,
        "charts": [
            {"start": first, "step": step * found[0]["each"], "x": x, "y": words, "lines": found,
             "time": x == time[2], "log": log}
            for (first, step, x), words, found, log in charts
        ],
    }  # fmt: skip


def _segment(samples: int) -> int:
    return max(2, 2 * samples // (SEGMENTS + 1))


def _spectra(signals: Mapping[str, np.ndarray], dt: float) -> dict[str, np.ndarray]:
    """Logarithms of power spectral densities, from zero on, to twice where the first has its power.

    NaN of a signal with gaps.
    """
    found = {}
    for role, u in signals.items():
        whole = np.isfinite(u).all()
        density = welch(np.nan_to_num(u), 1.0 / dt, nperseg=_segment(len(u)))[1]
        found[role] = density if whole else np.full(len(density), np.nan)
    power = np.cumsum(next(iter(found.values())))
    last = 2 + 2 * int(np.searchsorted(power, POWER * power[-1]))
    return {role: _decades(density[:last]) for role, density in found.items()}


def _decades(signal: np.ndarray) -> np.ndarray:
    """Logarithms to base 10 of what is positive; NaN elsewhere."""
    return np.log10(np.where(signal > 0.0, signal, np.nan))


def coded(signal: np.ndarray, points: int) -> dict[str, Any]:
    """A line (T,) as text: least and largest of `points`/2 equal parts, in steps of its range.

    each: samples per point. All samples where they are no more than `points`.
    """
    part = 1 if len(signal) <= points else -(-2 * len(signal) // points)
    if part > 1:
        rows = np.pad(signal, (0, -len(signal) % part), mode="edge").reshape(-1, part)
        filled = np.isfinite(rows).any(axis=1)
        ends = np.full((len(rows), 2), np.nan)
        ends[filled] = np.column_stack(
            [np.nanmin(rows[filled], axis=1), np.nanmax(rows[filled], axis=1)]
        )
        falls = np.zeros(len(rows), dtype=bool)
        known = np.nan_to_num(rows[filled])
        falls[filled] = known.argmax(axis=1) < known.argmin(axis=1)
        ends[falls] = ends[falls, ::-1]
        signal = ends.ravel()
    finite = signal[np.isfinite(signal)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
    steps = (signal - low) / ((high - low) or 1.0) * CODES
    codes = np.where(np.isfinite(signal), np.rint(np.nan_to_num(steps)), CODES + 1)
    text = base64.b64encode(codes.astype("<u2").tobytes()).decode()
    return {"low": low, "high": high, "codes": text, "each": 0.5 * part if part > 1 else 1}


def table_of(motions: Sequence[Motion], names: Sequence[str]) -> pa.Table:
    """Time, measured and estimated signals of all records, in single precision."""
    counts = [m.record.samples for m in motions]
    columns: dict[str, Any] = {
        "record": np.repeat([spreadsheet(m.name) for m in motions], counts),
        "time_s": np.concatenate([m.record.dt * np.arange(m.record.samples) for m in motions]),
    }
    y, own = (np.concatenate(u) for u in zip(*((m.measured, m.own) for m in motions), strict=True))
    with np.errstate(over="ignore"):  # a model that diverges
        for i, name in enumerate(names):
            for what, signal in (("measured", y), ("model", own)):
                columns[spreadsheet(f"{name} {what}")] = signal[:, i].astype(np.float32)
    return pa.table(columns)


def csv_of(table: pa.Table, folder: Path) -> tuple[str, str]:
    """The text for the page, and what to say of it; a longer one is whole in the folder only."""
    out = io.BytesIO()
    pa.csv.write_csv(table, out)
    text = out.getvalue().decode()
    if len(text) <= TEXT_BYTES:
        return text, f"{table.num_rows:,} samples"
    with whole_file(folder / "estimates.csv") as aside:
        aside.write_text(text, encoding="utf-8")
    head = text[: text.rindex("\n", 0, TEXT_BYTES) + 1]
    rows = head.count("\n") - 1
    return head, (
        f"the first {rows:,} of {table.num_rows:,} samples; all: estimates.csv in the run's folder"
    )


def loops_figure(
    estimator: Estimator, data: Data, motion: Motion, way: str
) -> tuple[Figure, str] | None:
    """Force over deformation: the model's and, where they are known, the measured or true ones."""
    record = motion.record
    if record.quantity == "force" and record.s is not None:
        own = torch.from_numpy(motion.own)[None]
        return placed(imposed_loops(record, own)), "grey: measured; red: the model"
    loops = loops_of(estimator, record)
    if loops is None or way != "free run" or not all(torch.isfinite(u).all() for u in loops):
        return None
    if (drawn := true_loops(estimator, data, record, loops, motion.name)) is not None:
        return drawn, "grey: true, of the simulated structure; red: the model in free run"
    words = "the model in free run; no sensor measured the force of an element"
    return placed(identified_loops(*loops, names_of(estimator))), words
