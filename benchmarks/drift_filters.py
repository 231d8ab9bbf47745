"""Filters of drifts on line, from posteriors that are planted: how near, how sure, how fast.

For `python -m benchmarks.few_sensors --filter RECORDS`. The fit is the structure with stiffness,
strength, hardening, damping and the rest scattered by 1 and 3 %, and so are laws about the fit. The
opponent is the unscented filter of the package filterpy, where that is installed: a chain of
Bouc–Wen storeys that begins at the fit, with textbook settings.   E storeys, T samples; m, s, kg
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.table import show
from benchmarks.unplanted import DT
from benchmarks.usual_drifts import NOISE, Event
from data.simulation.laws.element import Element
from data.simulation.structure import Structure
from models.online.drift_filter import DriftFilter, DriftSmoother

SIZES = {  # standard deviations of what a fit knows of a storey
    "stiffness": 0.01, "yield_displacement": 0.01, "damping": 0.03, "hardening_ratio": 0.03,
    "post_yield_ratio": 0.03, "unloading_exponent": 0.03, "sharpness": 0.03,
}  # fmt: skip
STATED = 0.1  # of the opponent's stiffnesses and strengths, as textbooks have it
SAMPLES, MOTIONS = 500, 10  # of a record; of a building, each with a fit of its own
SLOW = 2  # records of the opponent, which takes some twenty times as long
NONE = np.zeros(0)


def scattered(of: Structure, rng: np.random.Generator) -> Structure:
    def other(element: Element) -> Element:
        known = {name: size for name, size in SIZES.items() if getattr(element, name, 0.0)}
        own = {n: getattr(element, n) * np.exp(s * rng.standard_normal()) for n, s in known.items()}
        if hasattr(element, "beta"):
            weaker = np.exp(SIZES["yield_displacement"] * rng.standard_normal())
            own |= {name: weaker * getattr(element, name) for name in ("beta", "gamma")}
        return replace(element, **own)

    parts = {name: other(element) for name, element in of.elements.items()}
    return Structure(of.masses.tolist(), parts)


class Followed:
    """A record followed by the filter: drifts (T, E) and their halves, of the fit alone as well.

    by_all: as the smoother has them of all samples.
    """

    def __init__(self, laws: Sequence[Structure], event: Event, sensors: Sequence[int]) -> None:
        storeys = [i for i, name in enumerate(laws[0].elements) if name.startswith("r")]
        noise, ground = (NOISE * u.std(axis=0) for u in (event.floors, event.ground))
        seen = [floor - 1 for floor in sensors]
        settings = laws, storeys, seen, noise, float(ground), DT, 4.0
        found, back = DriftFilter(*settings), DriftSmoother(*settings)
        rows, alone = [], []
        begin = time.thread_time()
        for s_ddot, row in zip(event.ground, event.floors - event.ground[:, None], strict=True):
            found.predict(-s_ddot * laws[0].masses, NONE, NONE)
            found.correct(row)
            rows.append(found.drifts)
            alone.append(found.own)
        self.seconds = (time.thread_time() - begin) / len(rows)
        self.drifts, self.halves = np.array(rows).transpose(1, 0, 2)
        self.alone, self.diverged = np.array(alone), found.diverged
        for s_ddot, row in zip(event.ground, event.floors - event.ground[:, None], strict=True):
            back.predict(-s_ddot * laws[0].masses, NONE, NONE)
            back.correct(row)
        self.by_all, self.narrower = back.smoothed()


def unscented(fit: Structure, event: Event, sensors: Sequence[int]) -> np.ndarray:
    """Drifts (T, E) by filterpy, of x, v, z, ln k and ln of the strength; NaN where it failed."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    storeys = [e for name, e in fit.elements.items() if name.startswith("r")]
    n, masses, seen = len(storeys), fit.masses, np.array(sensors) - 1
    k = np.array([e.tangent()[0] for e in storeys])
    y = np.array([getattr(e, "yield_displacement", 1.0 / getattr(e, "beta", 1.0)) for e in storeys])
    damping = fit.linearised()[1]

    def rates(u: np.ndarray, s_ddot: float) -> np.ndarray:
        x, v, z, ln_k, ln_y = u.reshape(5, n)
        rate = np.diff(v, prepend=0.0)
        drift = np.diff(x, prepend=0.0)
        r = np.exp(ln_k) * k * (0.05 * drift + 0.95 * z)
        z_dot = rate - (0.6 * np.abs(rate) * z + 0.4 * rate * np.abs(z)) / (np.exp(ln_y) * y)
        a = -(r - np.append(r[1:], 0.0) + damping @ v) / masses - s_ddot
        return np.concatenate([v, a, z_dot, np.zeros(2 * n)])

    def moved(u: np.ndarray, dt: float, before: float, now: float) -> np.ndarray:
        one = rates(u, before)
        two = rates(u + 0.5 * dt * one, 0.5 * (before + now))
        three = rates(u + 0.5 * dt * two, 0.5 * (before + now))
        four = rates(u + dt * three, now)
        return u + dt / 6.0 * (one + 2.0 * two + 2.0 * three + four)

    ground, floors = (NOISE * part.std(axis=0) for part in (event.ground, event.floors))
    points = MerweScaledSigmaPoints(5 * n, alpha=1e-3, beta=2.0, kappa=0.0)
    found = UnscentedKalmanFilter(
        5 * n, len(seen), DT, hx=lambda u: rates(u, 0.0)[n : 2 * n][seen], fx=moved, points=points
    )
    stated = np.repeat([1e-6, 1e-6, 1e-6, STATED**2, STATED**2], n)
    found.x, found.P, found.R = np.zeros(5 * n), np.diag(stated), np.diag(floors**2)
    push = np.repeat([0.5 * DT**2, DT, 0.0, 0.0, 0.0], n)
    found.Q = float(ground) ** 2 * np.outer(push, push) + 1e-12 * np.eye(5 * n)
    drifts, before = np.full((len(event.ground), n), np.nan), 0.0
    for row, (s_ddot, measured) in enumerate(zip(event.ground, event.floors, strict=True)):
        try:
            found.predict(before=before, now=s_ddot)
            found.update(measured)
        except (np.linalg.LinAlgError, ValueError):
            break
        drifts[row], before = np.diff(found.x[:n], prepend=0.0), s_ddot
    return drifts


def error(drifts: np.ndarray, true: np.ndarray) -> float:
    """RMS [%] of that of the true drifts, over the last half of a record."""
    half = len(true) // 2
    return 100.0 * float(np.sqrt(np.mean((drifts - true)[half:] ** 2) / np.mean(true[half:] ** 2)))


def filtered(
    kind: str, records: int, building: Any, sensors: Sequence[int], samples: int = SAMPLES
) -> Iterator[list[str]]:
    """Rows of a table: of the filter, and of the opponent where it is installed."""
    errors, opponent, held, seconds, diverged, first = [], [], [], [], 0, []
    for number in range(records):
        place, motion = divmod(number, MOTIONS)
        if motion == 0:
            case = building(kind, place, samples)
        rng = np.random.default_rng(number)
        event = case.event(1000 * place + 101 + motion, sensors, samples)
        fit = scattered(case.structure, rng)
        laws = [fit, *(scattered(fit, rng) for _ in range(32))]
        run = Followed(laws, event, sensors)
        found = (run.drifts, run.alone, run.by_all)
        errors.append([error(drifts, event.drifts) for drifts in found])
        if not run.diverged:
            pairs = (run.drifts, run.halves), (run.by_all, run.narrower)
            held.append([np.mean(np.abs(u - event.drifts) <= half) for u, half in pairs])
        seconds.append(run.seconds)
        diverged += run.diverged
        if number < SLOW:
            first.append((fit, event))
    own, alone, by_all = np.median(errors, axis=0)
    worst, _, worst_by_all = np.quantile([u / np.array(u[1]) for u in errors], 0.9, axis=0)
    inside, inside_by_all = np.mean(held, axis=0)
    numbers = (f"{own:.1f}", f"{worst:.2f}", f"{inside:.2f}", f"{diverged}/{records}")
    yield [kind, *numbers, f"{1e6 * np.median(seconds):.0f}"]
    smoothed = (f"{by_all:.1f}", f"{worst_by_all:.2f}", f"{inside_by_all:.2f}")
    yield ["  by all samples", *smoothed, "", ""]
    yield ["  the fit alone", f"{alone:.1f}", "1.00", "", "", ""]
    try:
        begin = time.thread_time()
        opponent = [error(unscented(fit, e, sensors), e.drifts) for fit, e in first]
        taken = (time.thread_time() - begin) / len(first) / samples
    except ImportError:
        yield ["  unscented: filterpy is not installed", *[""] * 5]
        return
    lost = int(np.sum(~(np.array(opponent) < 100.0)))
    yield [
        f"  unscented, {len(first)} records", f"{np.nanmedian(opponent):.1f}", "", "",
        f"{lost}/{len(first)}", f"{1e6 * taken:.0f}",
    ]  # fmt: skip


def show_filters(records: int, kinds: Sequence[str], building: Any, sensors: Sequence[int]) -> None:
    """Print errors of drifts [%] over the last half of records, intervals and times."""
    head = ("drifts on line", "error [%]", "90 % over the fit's", "in 95 %", "diverged", "µs")
    count = -(-records // len(kinds))
    rows = [line for kind in kinds for line in filtered(kind, count, building, sensors)]
    show("planted posteriors", head, rows)
