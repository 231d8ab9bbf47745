"""The hysteretic unit: continuous in start, way and parameters; slopes, order and scale."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from data.record import Record
from models.composition.laws import LINEAR
from models.composition.laws_compiled import unit_step
from models.element_network import ElementNetwork
from tests.reference_networks import units

DT = 0.01
CASES = [  # z, dy, limit, b₊, b₋
    (-0.3, 0.5, 10.0, -2.0, 1.5),  # z crosses zero
    (0.3, -0.5, 10.0, -2.0, 1.5),
    (-0.3, 0.5, 10.0, 0.0, 0.0),
    (-0.003, 0.005, 10.0, -2.0, 1.5),  # by the series
    (-0.3, 0.5, 10.0, 3.0, -2.0),
    (-0.3, 0.1, 10.0, -2.0, 1.5),  # before zero
    (0.3, 0.4, 10.0, -2.0, 1.5),  # beyond
    (0.3, -0.2, 10.0, 2.0, -1.5),
    (-0.9, 0.5, 1.0, 0.5, 2.0),  # 1 + b₋ w < 0: it does not rise, and ends on its limit
    (-0.3, 2.0, 1.0, 0.5, 1.5),  # across zero onto the limit
]


def moved(case: tuple[float, ...]) -> float:
    return unit_step.py_func(*case)[0] if hasattr(unit_step, "py_func") else unit_step(*case)[0]


def exact(z: float, delta: float, limit: float, up: float, down: float) -> float:
    """The law by an integrator of its own that stops where z changes its sign."""
    sign = np.sign(delta)

    def slope(_: float, w: np.ndarray) -> np.ndarray:
        return 1.0 + (up if w > 0.0 else down) * w

    def zero(_: float, w: np.ndarray) -> float:
        return w[0]

    zero.terminal, w, way = True, sign * z, abs(delta)
    part = solve_ivp(slope, (0.0, way), [w], events=zero if w < 0.0 else None, rtol=1e-12,
                     atol=1e-14)  # fmt: skip
    w, gone = part.y[0, -1], part.t[-1]
    if gone < way:
        w = solve_ivp(slope, (0.0, way - gone), [1e-300], rtol=1e-12, atol=1e-14).y[0, -1]
    return float(sign * np.clip(w, -limit, limit))


@pytest.mark.parametrize("case", CASES)
def test_a_step_solves_the_law_exactly_across_zero(case):
    assert moved(case) == pytest.approx(exact(*case), abs=1e-10)


@pytest.mark.parametrize("case", CASES)
def test_the_compiled_unit_and_its_slopes_are_those_of_pytorch(case):
    z, delta, limit, up, down = (torch.tensor(v, dtype=torch.float64) for v in case)
    leaves = [t.requires_grad_() for t in (z, delta, up, down)]
    one = torch.ones_like(up)
    table = torch.cat(
        [torch.zeros(1, LINEAR).double(), torch.stack([one, limit, up, down])[None]], 1
    )
    new = units(table, (0, 0, 1), z.reshape(1, 1), delta.reshape(1))
    slopes = torch.autograd.grad(new.sum(), leaves, allow_unused=True)
    got, _, *ours = unit_step(*case)
    assert got == pytest.approx(float(new.detach()), abs=1e-15)
    for mine, theirs in zip(ours, slopes, strict=True):
        assert mine == pytest.approx(0.0 if theirs is None else float(theirs), abs=1e-13)


def test_nothing_jumps_where_the_memory_passes_zero():
    """The way ends at zero: a hair before and a hair beyond, z differs by that hair."""
    way = float(np.log1p(0.3 * 1.5 / (1.0 - 0.3 * 1.5)) / 1.5)  # from −0.3 to 0 with b₋ = 1.5
    hair = 1e-9
    for place in range(5):
        ends = []
        for sign in (1.0, -1.0):
            there = [-0.3, way, 10.0, -2.0, 1.5]
            there[place] += sign * hair
            ends.append(moved(tuple(there)))
        assert abs(ends[0] - ends[1]) < 10.0 * hair, place
    assert moved((-0.3, way, 10.0, -2.0, 1.5)) == pytest.approx(0.0, abs=1e-15)
    far = moved((-1e-14, 0.3, 10.0, -2.0, 1.5)) - moved((1e-14, 0.3, 10.0, -2.0, 1.5))
    assert abs(far) < 1e-13  # the start on either side of zero


def test_a_coarse_motion_gives_the_memory_of_a_fine_one():
    """The solution is exact: at any number of steps along a way the same memory, on Bouc–Wen."""
    turns, law = [0.5, -0.7, 0.2, -0.1, 0.6], (10.0, -1.8, -0.4)
    ends = []
    for steps in (1, 3, 50):
        z, at = 0.0, 0.0
        for turn in turns:
            for _ in range(steps):
                z = moved((z, (turn - at) / steps, *law))
            at = turn
        ends.append(z)
    assert ends == pytest.approx([ends[0]] * 3, abs=1e-14)


# Loss and scale


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_run_is_lost_at_the_same_sample_in_any_unit_of_the_motion(scale):
    t = DT * torch.arange(400, dtype=torch.float64)[:, None]
    x = torch.sin(5.0 * t) + 0.4 * torch.sin(11.0 * t)
    v = 5.0 * torch.cos(5.0 * t) + 4.4 * torch.cos(11.0 * t)
    a = -25.0 * torch.sin(5.0 * t) - 48.4 * torch.sin(11.0 * t)
    f = 2.0 * a + 3.0 * v + 80.0 * x
    record = Record(DT, *(scale * part for part in (a, f, x, v)))
    model = ElementNetwork(1, 1, DT, hinges=0, units=0)
    model.identify([record])
    model.laws.cubic.theta.data.fill_(-40.0)
    with torch.no_grad():
        run = model.free_run(record.drive()).a
    first = int(torch.isnan(run[:, 0]).nonzero()[0])
    assert 5 < first < 200
    assert torch.isnan(run[first:]).all()
    assert float(run[:first].abs().max()) < 1e6 * float(record.a.abs().max())
    if scale == 1.0:
        return
    assert first == lost_in_metres(record, scale)


def lost_in_metres(record: Record, scale: float) -> int:
    again = record.map(lambda u: u / scale)
    model = ElementNetwork(1, 1, DT, hinges=0, units=0)
    model.identify([again])
    model.laws.cubic.theta.data.fill_(-40.0)
    with torch.no_grad():
        return int(torch.isnan(model.free_run(again.drive()).a[:, 0]).nonzero()[0])
