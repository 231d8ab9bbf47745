"""Moment frame: hinges, textbook stiffness, order of its steps, planted frames, units, refusals."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from data import MenegottoPinto
from data.record import Drive, Record, stack
from data.simulation.element_test import force
from models import MomentFrame
from models import moment_frame as fit
from models.moment_frame import SHARED, members
from models.moment_frame_compiled import MEMORY, elastic, turn

DT, MASSES, HEIGHTS = 0.01, [3.0e4, 2.5e4], [4.0, 3.0]
KINDS = [8.0, 0.02, 15.0, 0.9, 6.0, 0.04, 10.0, 0.85]
FLOORS = [2.5e6, 2.2e6, 1.5e5, 1.1e5, 9.0e5, 8.0e5, 8.0e4, 8.0e4]


def frame(gamma: float = 2.0, strength: float = 1.0, damping: float = 1.0, **more) -> MomentFrame:
    model = MomentFrame(2, 1, DT, MASSES, HEIGHTS, **more)
    numbers = np.array([0.3 * damping, 2e-3 * damping, gamma, *KINDS, *FLOORS])
    numbers[SHARED:].reshape(2, 2, 2)[:, 1] *= strength
    model.numbers.data.copy_(torch.from_numpy(numbers))
    return model


def shaken(seed: int, size: float, samples: int = 700) -> torch.Tensor:
    """A base whose acceleration (T, 1) is random, below 3 Hz, from rest."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(samples, DT)
    phases = np.exp(2j * np.pi * rng.random(len(frequency)))
    wave = np.fft.irfft(((frequency > 0.2) & (frequency < 3.0)) * phases, samples)
    t = DT * np.arange(samples)
    wave = wave * np.minimum(t / 2.0, 1.0) ** 2
    return torch.from_numpy(size * wave / np.abs(wave).max())[:, None]


def moved(model: MomentFrame, u: torch.Tensor) -> Record:
    still = torch.zeros(2, dtype=torch.float64)
    run = model.free_run(Drive(DT, u, still, still))
    return Record(DT, run.a, u, run.x, run.v)


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [moved(frame(), shaken(seed, size)) for seed, size in ((0, 4.0), (1, 5.0), (2, 4.5))]


@pytest.fixture(scope="module")
def identified(records) -> MomentFrame:
    model = MomentFrame(2, 1, DT, MASSES, HEIGHTS)
    model.identify([stack(records[:2])])
    return model


def error(model: MomentFrame, record: Record) -> float:
    return float((model(record) - record.a).norm() / (record.a - record.f).norm())


def test_a_hinge_is_steel_after_menegotto_and_pinto():
    turns = [0.0, 2.0, -1.0, 0.5, -4.0, 3.0, 2.5, 6.0, -6.0]
    ways = [np.linspace(a, b, 40)[1:] for a, b in pairwise(turns)]
    y = 1e-3 * np.concatenate([[0.0], *ways])
    law = np.array([1.2e-3, 5e6, 0.03, 14.0, 0.9])
    old, new, rows = np.zeros(MEMORY), np.zeros(MEMORY), []
    for at in y:
        rows.append(turn(law, old, at, new))
        old[:] = new
    steel = MenegottoPinto(
        between=["s1", "x1"], yield_displacement=law[0], stiffness=law[1], hardening_ratio=law[2],
        sharpness=law[3], sharpness_loss=law[4],
    )  # fmt: skip
    expected = force(steel, y, 1.0, np.zeros_like(y))
    r, slope = np.array(rows).T
    np.testing.assert_allclose(r, expected, atol=1e-9 * np.abs(expected).max())
    ahead = [turn(law, old, y[-1] + step, new)[0] for step in (-2e-9, -1e-9)]
    assert turn(law, old, y[-1] - 1.5e-9, new)[1] == pytest.approx((ahead[1] - ahead[0]) / 1e-9)
    assert slope.min() > 0.0


def test_elastic_stiffness_is_that_of_slope_and_deflection():
    """Columns EI, h clamped at the base, beams of which a joint turns against 6 EI/L."""
    EI, beam, h = [3.0e7, 2.0e7], [4.0e7, 3.0e7], HEIGHTS
    K = np.zeros((4, 4))  # x1, x2, then rotations
    for i in range(2):
        ends = [i - 1, i, 1 + i, 2 + i]  # x below, x above, rotations below and above
        k, L = EI[i], h[i]
        own = k / L**3 * np.array([[12, -12, 6 * L, 6 * L], [-12, 12, -6 * L, -6 * L],
                                   [6 * L, -6 * L, 4 * L**2, 2 * L**2],
                                   [6 * L, -6 * L, 2 * L**2, 4 * L**2]])  # fmt: skip
        free = [j for j in range(4) if i > 0 or j in (1, 3)]
        K[np.ix_([ends[j] for j in free], [ends[j] for j in free])] += own[np.ix_(free, free)]
        K[2 + i, 2 + i] += beam[i]
    laws = np.empty((2, 2, 6))
    laws[:, 0, 0] = 2.0 * np.array(EI) / np.array(h) ** 3
    laws[:, 1, 0] = np.array(beam) / h[0] ** 2 / 3.0
    laws[..., 1:] = [1.0, 1e16, 0.02, 10.0, 0.9]  # hinges that do not give way
    rho = np.array(h) / h[0]
    to_ours = np.array([1.0, 1.0, 1.0 / h[0], 1.0 / h[0]])
    ours = elastic(laws, np.zeros(2), rho)
    np.testing.assert_allclose(ours, to_ours[:, None] * K * to_ours, rtol=1e-6)


def test_small_motions_are_those_of_the_condensed_frame_to_second_order():
    u, M, rho = shaken(3, 0.05, 400), np.array(MASSES), np.array(HEIGHTS) / HEIGHTS[0]
    still = frame(damping=1e-9)
    parts = members(still.numbers.numpy(), M, rho)
    K = elastic(parts.laws, parts.sag, rho)
    K = (K[:2, :2] - K[:2, 2:] @ np.linalg.solve(K[2:, 2:], K[2:, :2])) / M[:, None]
    squares, modes = np.linalg.eig(K)
    pushed = np.linalg.solve(modes, np.ones(2))
    exact, slopes = np.zeros((2, 400)), np.diff(u[:, 0].numpy()) / DT
    for i, w in enumerate(np.sqrt(squares)):  # under a straight line between samples
        q, rate = 0.0, 0.0
        for k, slope in enumerate(slopes):
            at, lean = pushed[i] * float(u[k, 0]) / w**2, pushed[i] * slope / w**2
            a, b = q - at, (rate - lean) / w
            c, s = np.cos(w * DT), np.sin(w * DT)
            q, rate = a * c + b * s + at + lean * DT, w * (b * c - a * s) + lean
            exact[i, k + 1] = q
    exact = (modes @ exact).T
    errors = []
    for substeps in (2, 4, 8):
        model = frame(damping=1e-9, substeps=substeps)
        errors.append(np.abs(moved(model, u).x.numpy() - exact).max() / np.abs(exact).max())
    assert errors[2] < 2e-3
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2.0, atol=0.1)


def test_a_planted_frame_is_found_where_a_motion_was_not_seen(records, identified):
    elastic_frame = frame(strength=1e3)
    assert error(elastic_frame, records[2]) > 0.2  # it yields
    assert error(identified, records[2]) < 0.01
    farther = moved(frame(), shaken(4, 7.0, 1500))  # than in training
    assert error(identified, farther) < 0.05


def test_other_units_change_no_error(records, monkeypatch):
    monkeypatch.setattr(fit, "ITERATIONS", (2, 2, 1))
    one = stack(records[:2]).window(0, 600)
    mm = {"x": 1e3, "v": 1e3, "a": 1e3, "f": 1e3}
    other = replace(one, **{name: size * getattr(one, name) for name, size in mm.items()})
    facts = [
        MomentFrame(2, 1, DT, [size * m for m in MASSES], [size * h for h in HEIGHTS]).identify([r])
        for r, size in ((one, 1.0), (other, 1e-3))
    ]
    assert facts[1] == pytest.approx(facts[0], rel=1e-6)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"inputs": 2}, "shaken at its base"),
        ({"masses": None}, "masses=None: expected 2 positive numbers"),
        ({"masses": [1.0, -1.0]}, "expected 2 positive"),
        ({"heights": [3.0]}, "heights=.*expected 2 positive"),
        ({"substeps": 0}, "expected at least 1"),
    ],
)
def test_what_is_no_frame_is_refused(words, said):
    words = {"dofs": 2, "inputs": 1, "dt": DT, "masses": MASSES} | words
    with pytest.raises(ValueError, match=said):
        MomentFrame(**words)


def test_it_begins_at_rest_and_drifts(records, identified):
    with pytest.raises(ValueError, match="simulates from rest"):
        identified.free_run(replace(records[0].drive(), v0=torch.ones(2, dtype=torch.float64)))
    stiff = replace(records[0], x=torch.zeros_like(records[0].x))
    with pytest.raises(ValueError, match="does not drift"):
        MomentFrame(2, 1, DT, MASSES).identify([stiff])
