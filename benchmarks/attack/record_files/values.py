"""Clocks and signals, and what may be wrong with them."""

from __future__ import annotations

import random
from collections.abc import Sequence

import numpy as np

from benchmarks.attack.record_files.case import Columns


def random_columns(draw: random.Random, names: Sequence[str]) -> tuple[Columns, dict[str, str]]:
    rows = draw.choice((0, 1, 2, 3, 20, 60, 60, 60, 200, 200, 200, 200, 200, 1000))
    called = ["time", "f1", "a1", *draw.choice((*[[]] * 4, ["x1"], ["u1"], ["u1", "u2"]))]
    mapped: dict[str, str] = {}
    if draw.random() < 0.25:
        odd = draw.sample(list(names), len(called))
        mapped = dict(zip(called, odd, strict=True))
        called = odd
    elif draw.random() < 0.15:
        called[draw.randrange(len(called))] = draw.choice(
            (
                "a0",
                "a1٢",
                "a2",
                "f" + "9" * 5000,
                "r1",
                "s_ddot1",
                "",
                "a1",
                "s1",
                "v1",
                "t",
                "A1",
                "u1",
                "u0",
            )
        )
    clock = _clock(draw, rows)
    columns = {called[0]: clock}
    for name in called[1:]:
        columns[name] = _signal(draw, rows)
    return columns, mapped


def _clock(draw: random.Random, rows: int) -> np.ndarray:
    t = 0.01 * np.arange(rows)
    if rows > 3 and draw.random() < 0.2:
        k = draw.randrange(rows)
        fault = draw.randrange(12)
        if fault == 0:
            t[k] = np.nan
        elif fault == 1:
            t[k:] += draw.choice((0.05, 1.0, 1e6, 1e12, 1e18, 1e300))
        elif fault == 2:
            t[k:] -= draw.choice((0.01, 0.05, 1e9))
        elif fault == 3:
            t[:] = draw.choice((0.0, 5.0, np.nan, np.inf))
        elif fault == 4:
            t[k] = draw.choice((np.inf, -np.inf, 1e308, -1e308))
        elif fault == 5:
            t = t * draw.choice((1e-300, 1e300, 1e-9, 1e9, 5e-324, 1e308))
        elif fault == 6:
            t = np.round(t, 1)
        elif fault == 7:
            t = t[::-1].copy()
        elif fault == 8:
            t = t + np.array([draw.random() * 0.02 for _ in range(rows)])
        elif fault == 9:
            t = t + draw.choice((1.7e9, 1e15, 1e18))
        elif fault == 10:
            t[0] = draw.choice((np.nan, -1e300, 1e300, np.inf))
        else:
            t[-1] = draw.choice((np.nan, -1e300, 1e300, np.inf))
    return t


def _signal(draw: random.Random, rows: int) -> np.ndarray:
    t = 0.01 * np.arange(rows)
    u = np.sin(draw.uniform(1.0, 60.0) * t) * 10.0 ** draw.choice((-3, 0, 0, 0, 2))
    u += np.array([0.1 * draw.gauss(0.0, 1.0) for _ in range(rows)])
    if rows > 3 and draw.random() < 0.12:
        k, fault = draw.randrange(rows), draw.randrange(8)
        if fault == 0:
            u[k : k + draw.choice((1, 5, rows))] = np.nan
        elif fault == 1:
            u[k] = draw.choice((np.inf, -np.inf, 1e308, -1e308, 1e200))
        elif fault == 2:
            u[:] = draw.choice((0.0, 1.0, np.nan, 1e308, 5e-324))
        elif fault == 3:
            u *= draw.choice((1e300, 1e-300, 1e307, 5e-324, 1e160))
        elif fault == 4:
            u = np.clip(u, -0.2, 0.2)
        elif fault == 5:
            u[k] += 1e6
        elif fault == 6:
            u = np.round(u * 1e3)
        else:
            u[0] = draw.choice((0.0, np.nan))
    return u
