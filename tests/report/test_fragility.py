"""Fragility curves: planted ones come back, intervals hold the truth, limits are what was said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr, stdtrit

from models.linear import EquivalentLinear
from report.prediction.fragility import (
    curves_of,
    fragility,
    intensities_of,
    limits_of,
    lognormal_fit,
    peaks_of_runs,
    quantiles,
)
from report.prediction.motions import Motion
from report.prediction.runs import Prediction, Signal

THETA, BETA, SCALES = 0.3, 0.4, np.array([0.15, 0.3, 0.6])
TRUE = (("theta", THETA), ("beta", BETA))


def planted(
    rng: np.random.Generator, motions: int, draws: int = 1, spread: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Intensities (M, K), and exceedances (S, M, K) of structures about the true one."""
    x = np.exp(0.3 * rng.standard_normal(motions))[:, None] * SCALES
    about = spread * (rng.standard_normal() + rng.standard_normal(draws))
    capacity = THETA * np.exp(about[:, None] + BETA * rng.standard_normal(motions))
    return x, x > capacity[..., None]


def without_one(motions: int) -> np.ndarray:
    return np.vstack([np.ones(motions), 1.0 - np.eye(motions)])


def test_the_fit_is_the_largest_binomial_likelihood():
    rng = np.random.default_rng(0)
    x, exceeded = planted(rng, 400)
    logs, shares = np.log(x).ravel(), exceeded.reshape(1, -1).astype(float)
    found = lognormal_fit(logs, shares, np.ones_like(shares))[:, 0]

    def likelihood(middle: float, width: float) -> float:
        p = ndtr((logs - middle) / np.exp(width))
        return float(np.log(np.where(shares[0] > 0.5, p, 1.0 - p)).sum())

    steps = [(a, b) for a in (-0.01, 0.0, 0.01) for b in (-0.01, 0.0, 0.01)]
    best = max(steps, key=lambda step: likelihood(found[0] + step[0], found[1] + step[1]))
    assert best == (0.0, 0.0)
    np.testing.assert_allclose(np.exp(found), [THETA, BETA], rtol=0.1)


@pytest.mark.parametrize(("motions", "draws", "spread"), [(44, 1, 0.0), (8, 1, 0.0), (44, 40, 0.2)])
def test_intervals_hold_the_truth_in_95_of_100_cases(motions, draws, spread):
    """Of those that have one: with few motions a fit without one of them may be a step."""
    rng, inside = np.random.default_rng(1), []
    for _ in range(60):
        x, exceeded = planted(rng, motions, draws, spread)
        fits, grid = fragility(x, exceeded, without_one(motions))
        if fits["beta_low"] is not None:
            truth = ndtr(np.log(grid[:, 0] / THETA) / BETA)
            k = int(np.abs(grid[:, 0] - 0.35).argmin())
            within = [fits[f"{name}_low"] <= true <= fits[f"{name}_high"] for name, true in TRUE]
            inside.append([*within, grid[k, 2] <= truth[k] <= grid[k, 3]])
    cases = len(inside)
    assert cases >= 40
    assert (np.mean(inside, axis=0) >= 0.95 - 3.0 * (0.95 * 0.05 / cases) ** 0.5).all()


def test_what_no_run_shows_is_not_stated():
    """None exceeds the limit, or all do; one intensity parts them; the weaker motions exceed it."""
    x = np.outer(np.linspace(0.8, 1.2, 10), SCALES)
    for exceeded in (x > 9.0, x > 0.0, x > 0.3, x < 0.3):
        fits, grid = fragility(x, exceeded[None], without_one(10))
        assert fits["beta"] is fits["beta_low"] is None
        assert grid.shape[1] == 4
    assert fragility(x, (x > 0.3)[None], without_one(10))[0]["theta"] == pytest.approx(0.3, 0.05)


def test_an_interval_is_that_of_a_jackknife_with_student_s_t():
    x, exceeded = planted(np.random.default_rng(4), 8)
    counted = without_one(8)
    each = lognormal_fit(
        np.log(x).ravel(), np.tile(exceeded.reshape(1, -1), (9, 1)).astype(float),
        np.repeat(counted, len(SCALES), axis=1),
    )  # fmt: skip
    deviation = (7 / 8 * ((each[:, 1:] - each[:, 1:].mean(1, keepdims=True)) ** 2).sum(1)) ** 0.5
    fits, _ = fragility(x, exceeded, counted)
    for i, (name, _) in enumerate(TRUE):
        half = 0.5 * np.log(fits[f"{name}_high"] / fits[f"{name}_low"])
        assert half == pytest.approx(stdtrit(7, 0.975) * deviation[i], rel=0.1)


COLUMNS = [
    Signal("deformation", "y", "m", ["1", "2"], np.zeros((1, 2))),
    Signal("loop", "r", "N", ["1", "2"], np.zeros((1, 2))),
    Signal("acceleration", "a", "m/s^2", ["1", "2"], np.zeros((1, 2))),
]
RUN = Prediction("a", 1.0, 0.01, "linear", COLUMNS, [], None)


@pytest.mark.parametrize(
    ("asked", "columns", "sizes"),
    [
        ({"drift": 0.03}, [0, 1], [0.03, 0.03]),
        ({"drift2": "30 mm"}, [1], [0.03]),
        ({"drift": "1 %"}, [0, 1], [0.04, 0.03]),
        ({"force1": "2 kN"}, [2], [2000.0]),
        ({"acceleration": "0.5 g"}, [4, 5], [4.903325, 4.903325]),
    ],
)
def test_a_limit_is_of_the_peaks_and_in_the_unit_that_are_said(asked, columns, sizes):
    (limit,) = limits_of(asked, RUN, [4.0, 3.0])
    assert limit.columns.tolist() == columns
    np.testing.assert_allclose(limit.sizes, sizes, rtol=1e-12)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"drft2": 0.03}, "limits.drft2: the model has no such peak; did you mean limits.drift2?"),
        ({"drift3": 0.03}, "limits.drift3: the model has no such peak"),
        ({"drift": "3 kN"}, "limits.drift=3 kN: unit='kN' has another dimension"),
        ({"drift": "1 %"}, "knows no heights of storeys"),
        ({"force": "2 %"}, "limits.force=2 %"),
        *[({"drift": bad}, "expected a positive size in m") for bad in (-1, True, [], "nan")],
        ({"drift": "x"}, "unit='x' is not known"),
    ],
)
def test_a_limit_that_means_nothing_is_one_line(asked: dict[str, Any], words):
    with pytest.raises(ValueError, match=r"^limits\.") as raised:
        limits_of(asked, RUN, None)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)


def test_any_column_may_exceed_its_limit_and_a_diverged_run_does():
    runs = [replace(RUN, signals=COLUMNS, left=at) for at in (None, 1.0, None, None)]
    peaks = peaks_of_runs(runs, 2, [1.0, 2.0])
    assert peaks.diverged.tolist() == [[[False, True], [False, False]]]
    assert np.isinf(peaks.values[0, 0, 1]).all()
    peaks.values[0, 1, 0, 1] = 0.05  # the second storey alone
    limits = limits_of({"drift": 0.03, "drift1": 0.03}, RUN, None)
    intensity = [("PGA", "g", np.array([0.1, 0.2]))]
    rows = [curve.row for curve in curves_of(peaks, limits, intensity, ["1", "2"])]
    assert [row["exceeded"] for row in rows] == [2, 1]
    assert [row["outside_of_exceeded"] for row in rows] == [0.5, 1.0]


def test_an_intensity_is_of_what_is_scaled():
    """A temperature beside an imposed deformation is not."""
    one = Motion("a", 0.01, {"s1": np.array([0.0, -0.02]), "u1": np.array([20.0, 20.0])})
    ((_, _, sizes),) = intensities_of([one], EquivalentLinear(1, 1, 0.01), ["u1"])
    assert sizes.tolist() == [0.02]


def test_quantiles_lie_between_sizes_and_may_be_infinite():
    sizes = np.array([1.0, 2.0, 3.0, np.inf])
    np.testing.assert_allclose(quantiles(sizes[:3]), [1.32, 2.0, 2.68])
    np.testing.assert_allclose(quantiles(sizes), [1.48, 2.5, np.inf])
    np.testing.assert_allclose(quantiles(np.full(3, np.inf)), np.inf)
