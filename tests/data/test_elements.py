"""Restoring forces under a prescribed deformation against loops worked out by hand.

The element joins a support, which moves, to a mass too heavy to follow.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from data import Bilinear, BoucWen, LimitedSlip, Polynomial
from data.simulation.motion import Motion, simulate
from data.simulation.structure import Structure

DT = 0.01
BETWEEN = ("s1", "x1")
A = 4.0 * np.pi**2


def bilinear(**damping: float) -> Bilinear:
    return Bilinear(
        between=BETWEEN, yield_displacement=0.02, stiffness=40.0, post_yield_stiffness=20.0,
        **damping,
    )  # fmt: skip


def limited_slip(**damping: float) -> LimitedSlip:
    return LimitedSlip(
        between=BETWEEN, yield_displacement=0.01, stiffness=40.0, gap_stiffness=30.0, gap=0.03,
        **damping,
    )  # fmt: skip


def bouc_wen(sign: int, **more: float) -> BoucWen:
    return BoucWen(between=BETWEEN, stiffness=A, beta=A / 4, gamma=sign * A / 3, **more)


UNDAMPED = {
    "bilinear": bilinear(),
    "limited_slip": limited_slip(),
    "bouc_wen_hardening": bouc_wen(1),
    "bouc_wen_softening": bouc_wen(-1, exponent=2.0, eta=1.3, nu_rate=0.2),
}


def deform(element, y, rate) -> Motion:
    """The element's response to a deformation history y [m] with its rate [m/s]."""
    structure = Structure([1e12], {"r": element})
    s, w = -np.reshape(y, (-1, 1)), -np.reshape(rate, (-1, 1))
    return simulate(structure, np.zeros_like(s), DT, s, w)


def eased(*turns: float, samples: int = 100):
    """From 0 to each turning point in turn, at rest there; `samples` per leg."""
    u = np.arange(1, samples + 1) / samples
    y, rate, last = [0.0], [0.0], 0.0
    for turn in turns:
        y.extend(last + (turn - last) * 0.5 * (1.0 - np.cos(np.pi * u)))
        rate.extend((turn - last) * 0.5 * np.pi * np.sin(np.pi * u) / (samples * DT))
        rate[-1], last = 0.0, turn
    return np.array(y), np.array(rate)


def steady(end: float, samples: int = 200):
    """From 0 to `end` at constant rate."""
    return np.linspace(0.0, end, samples + 1), np.full(samples + 1, end / (samples * DT))


def slider(y: np.ndarray, yield_displacement: float) -> np.ndarray:
    """Elastoplastic slider by return mapping."""
    z = np.zeros_like(y)
    for k in range(1, y.size):
        z[k] = np.clip(z[k - 1] + y[k] - y[k - 1], -yield_displacement, yield_displacement)
    return z


def test_bilinear_loop_equals_return_mapping():
    y, rate = eased(0.07, -0.03, 0.01, -0.09, 0.005)
    assert_allclose(
        deform(bilinear(), y, rate).r[:, 0], 20.0 * y + 20.0 * slider(y, 0.02), atol=1e-7
    )


def test_bilinear_loop_encloses_the_energy_of_a_parallelogram():
    work = deform(bilinear(), *eased(0.05, -0.05, 0.05)).work[:, 0]
    assert_allclose(work[300] - work[100], 4 * (40 - 20) * 0.02 * (0.05 - 0.02), rtol=1e-6)


def test_limited_slip_loop_equals_return_mapping():
    y, rate = eased(0.06, -0.02, 0.035, -0.08, 0.029, -0.031)
    gap_spring = 30.0 * np.sign(y) * np.maximum(np.abs(y) - 0.03, 0.0)
    by_hand = 40.0 * slider(y, 0.01) + gap_spring
    assert_allclose(deform(limited_slip(), y, rate).r[:, 0], by_hand, atol=1e-7)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bilinear_damping_changes_at_yield(side):
    y, rate = steady(side * 0.1)
    motion = deform(bilinear(damping=0.5, post_yield_damping=0.3), y, rate)
    damping = motion.r[:, 0] - 20.0 * y - 20.0 * slider(y, 0.02)
    stuck = np.abs(y) < 0.0199
    assert_allclose(damping[stuck], side * 0.5 * 0.05, atol=1e-9)
    assert_allclose(damping[np.abs(y) > 0.0201], side * 0.3 * 0.05, atol=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_limited_slip_damping_changes_at_slip_and_not_at_the_gap(side):
    y, rate = steady(side * 0.1)
    motion = deform(limited_slip(damping=0.5, slip_damping=0.3), y, rate)
    gap_spring = 30.0 * np.sign(y) * np.maximum(np.abs(y) - 0.03, 0.0)
    damping = motion.r[:, 0] - 40.0 * slider(y, 0.01) - gap_spring
    assert_allclose(damping[np.abs(y) < 0.0099], side * 0.5 * 0.05, atol=1e-9)
    assert_allclose(damping[np.abs(y) > 0.0101], side * 0.3 * 0.05, atol=1e-8)


@pytest.mark.parametrize("cubic", [20.0, -20.0])
def test_polynomial_force_is_eq_19(cubic):
    y, rate = eased(0.5, -0.8, 0.3)
    element = Polynomial(between=BETWEEN, stiffness=40.0, damping=0.6, cubic_stiffness=cubic)
    by_hand = 40.0 * y + 0.6 * rate + cubic * y**3
    assert_allclose(deform(element, y, rate).r[:, 0], by_hand, atol=1e-11)


def test_bouc_wen_with_positive_gamma_loads_along_slope_a_times_one_plus_r_over_12():
    y, rate = steady(0.1)
    r = deform(bouc_wen(1), y, rate).r[:, 0]
    assert_allclose(r, 12.0 * np.expm1(A * y / 12.0), atol=1e-6)


def test_bouc_wen_with_negative_gamma_is_capped_at_12_sevenths():
    y, rate = steady(1.0)
    r = deform(bouc_wen(-1), y, rate).r[:, 0]
    assert_allclose(r, -12.0 / 7.0 * np.expm1(-7.0 * A * y / 12.0), atol=1e-6)
    assert_allclose(r[-1], 12.0 / 7.0, rtol=1e-6)


@pytest.mark.parametrize(("sign", "rate_of_slope"), [(1, 7.0 / 12.0), (-1, -1.0 / 12.0)])
def test_bouc_wen_unloads_along_its_own_slope(sign, rate_of_slope):
    y, rate = eased(0.05, 0.03)
    r = deform(bouc_wen(sign), y, rate).r[:, 0]
    peak, after = r[100], slice(101, None)
    assert r[-1] > 0.0
    slope_ratio = (1.0 + rate_of_slope * r[after]) / (1.0 + rate_of_slope * peak)
    assert_allclose(slope_ratio, np.exp(rate_of_slope * A * (y[after] - 0.05)), atol=1e-6)


def test_bouc_wen_of_second_power_loads_as_a_hyperbolic_tangent():
    element = BoucWen(between=BETWEEN, stiffness=A, beta=6.0, gamma=2.0, exponent=2.0)
    y, rate = steady(0.3)
    cap = np.sqrt(A / (6.0 - 2.0))
    assert_allclose(deform(element, y, rate).r[:, 0], cap * np.tanh(A * y / cap), atol=1e-6)


def test_bouc_wen_stiffness_degrades_with_the_energy_taken_up():
    element = BoucWen(between=BETWEEN, stiffness=A, beta=0.0, gamma=0.0, eta_rate=0.8)
    motion = deform(element, *steady(0.6))
    r, work = motion.r[:, 0], motion.work[:, 0]
    assert work[-1] > 1.0
    assert_allclose(r**2, 2.0 * A / 0.8 * np.log1p(0.8 * work), rtol=1e-6, atol=1e-9)


def test_bouc_wen_strength_degrades_with_the_energy_taken_up():
    fixed = BoucWen(between=BETWEEN, stiffness=A, beta=5.0, gamma=0.0)
    weaker = BoucWen(between=BETWEEN, stiffness=A, beta=5.0, gamma=0.0, nu_rate=0.5)
    y, rate = steady(2.0, samples=400)
    motion = deform(weaker, y, rate)
    assert_allclose(deform(fixed, y, rate).r[-1, 0], A / 5.0, rtol=1e-4)
    slowly = A / (5.0 * (1.0 + 0.5 * motion.work[-1, 0]))
    assert_allclose(motion.r[-1, 0], slowly, rtol=0.05)


PLAIN = {
    Bilinear: {"yield_displacement": 0.02, "stiffness": 40.0, "post_yield_stiffness": 20.0},
    LimitedSlip: {"yield_displacement": 0.01, "stiffness": 40.0, "gap_stiffness": 30.0, "gap": 0.1},
    Polynomial: {"stiffness": 40.0},
    BoucWen: {"stiffness": 40.0, "beta": 10.0, "gamma": 13.0},
}
MEANINGLESS = {
    Bilinear: {"yield_displacement": 0.0, "stiffness": np.nan, "post_yield_stiffness": np.inf,
               "damping": -0.1, "between": ("x1", "x1")},
    LimitedSlip: {"yield_displacement": -0.1, "gap_stiffness": -1.0, "gap": 0.0,
                  "slip_damping": -0.1},
    Polynomial: {"stiffness": np.nan, "damping": -0.1, "cubic_stiffness": np.inf},
    BoucWen: {"stiffness": 0.0, "gamma": np.nan, "exponent": 0.5, "eta": 0.0, "nu_rate": -0.1},
}  # fmt: skip


@pytest.mark.parametrize("law", PLAIN)
def test_parameters_without_physical_meaning_are_refused(law):
    valid = {"between": BETWEEN, **PLAIN[law]}
    law(**valid)
    for name, value in MEANINGLESS[law].items():
        with pytest.raises(ValueError, match=name):
            law(**{**valid, name: value})
