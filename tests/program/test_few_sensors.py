"""What the model of few sensors is held against is right: on a linear structure, and by algebra."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.drift_filters import show_filters
from benchmarks.few_sensors import Building, building
from benchmarks.usual_drifts import (
    NOISE,
    SPLINES,
    Chain,
    Smoother,
    interpolated,
    of_period,
    shear,
)
from data.simulation.laws.polynomial import Polynomial
from data.simulation.structure import Structure

MASSES, PERIOD, POWER, DAMPING = np.array([3.3e4, 3.0e4, 3.1e4, 2.6e4, 2.0e4]), 0.8, 0.7, 0.03
SENSORS = [3, 5]


@pytest.fixture(scope="module")
def frame() -> Building:
    """A linear chain with 3 % of damping, by its storeys."""
    k = of_period(shear(MASSES) ** POWER, MASSES, PERIOD)
    nodes = ["ground", *(f"x{i + 1}" for i in range(5))]
    springs = {
        f"r{i + 1}": Polynomial(
            between=nodes[i : i + 2], stiffness=k[i], damping=DAMPING * PERIOD / np.pi * k[i]
        )
        for i in range(5)
    }
    return Building("linear", Structure(MASSES.tolist(), springs), np.ones(5), 2.0)


def peaks_off(drifts: np.ndarray, true: np.ndarray) -> float:
    """Largest relative error of the storeys' peak drifts."""
    return float(np.abs(np.abs(drifts).max(axis=0) / np.abs(true).max(axis=0) - 1.0).max())


def test_a_linear_chain_is_found_and_smoothed_from_two_noisy_floors(frame):
    train, test = ([frame.event(seed, SENSORS, 800) for seed in seeds] for seeds in ([1], [3, 4]))
    chain = Chain(MASSES, SENSORS).fitted(train)
    period, power, by_mass, by_stiffness = np.exp(chain.numbers)
    assert period == pytest.approx(PERIOD, rel=0.005)
    assert power == pytest.approx(POWER, rel=0.1)
    assert by_mass + by_stiffness == pytest.approx(DAMPING, rel=0.1)
    channels = np.column_stack([train[0].ground, train[0].floors]).std(axis=0)
    smoother = Smoother(chain, channels).fitted(train)
    assert smoother.size < 0.05  # the chain lacks next to nothing
    for event in test:
        assert peaks_off(chain.drifts(event), event.drifts) < 0.03
        assert peaks_off(smoother.drifts(event), event.drifts) < 0.03


def test_a_linear_chain_moves_like_the_structure(frame):
    chain = Chain(MASSES, SENSORS, np.log([PERIOD, POWER, 1e-9, DAMPING]))
    event = frame.event(1, SENSORS, 1500)
    floors, drifts = frame.shaken(event.ground, SENSORS)
    assert np.abs(chain.drifts(event) - drifts).max() < 1e-5 * np.abs(drifts).max()
    assert np.abs(chain.floors(event.ground) - floors).max() < 1e-5 * np.abs(floors).max()


def test_sensors_on_all_floors_leave_nothing_to_interpolate(frame):
    """Off by noise, and by what is slower than the motion."""
    event = frame.event(1, [1, 2, 3, 4, 5], 1500)
    for name in ("interpolation, linear", "interpolation, cubic"):
        drifts = interpolated(event, [1, 2, 3, 4, 5], 5, SPLINES[name])
        assert peaks_off(drifts, event.drifts) < 0.1
    rigid = interpolated(event, SENSORS, 5, SPLINES["rigid"])
    np.testing.assert_allclose(rigid, rigid[:, :1].repeat(5, axis=1), atol=1e-12)


def test_the_smoother_is_the_mean_of_the_motions_given_the_sensors(frame):
    """Of the joint normal law of all states and measurements, conditioned at once."""
    T, event = 40, frame.event(1, SENSORS, 40)
    smoother = Smoother(Chain(MASSES, SENSORS), np.array([1.0, 2.0, 3.0]))
    F, H, P, L, _ = smoother.gains
    Q = P - F @ (P - L @ H @ P) @ F.T
    driven = np.pad(smoother.chain.driven(event.ground), ((0, 0), (0, 5)))
    mean, covariance = driven.copy(), np.zeros((T, 15, T, 15))
    covariance[0, :, 0] = P
    for k in range(1, T):
        mean[k] += F @ mean[k - 1]
        covariance[k, :, :k] = np.einsum("ij,jkl->ikl", F, covariance[k - 1, :, :k])
        covariance[:k, :, k] = covariance[k, :, :k].transpose(1, 2, 0)
        covariance[k, :, k] = F @ covariance[k - 1, :, k - 1] @ F.T + Q
    joint, seen = covariance.reshape(15 * T, 15 * T), np.kron(np.eye(T), H)
    noise = np.kron(np.eye(T), np.diag((NOISE * smoother.channels[1:]) ** 2))
    left = (event.floors - mean @ H.T).ravel()
    moved = joint @ seen.T @ np.linalg.solve(seen @ joint @ seen.T + noise, left)
    x = (mean + moved.reshape(T, 15))[:, :5]
    expected = np.diff(x, axis=1, prepend=0.0)
    assert np.abs(smoother.drifts(event) - expected).max() < 1e-6 * np.abs(expected).max()


def test_a_filter_is_nearer_than_the_planted_fit_alone(capsys):
    show_filters(2, ["concrete"], building, SENSORS)
    rows = {line[:15].strip(): line[15:].split() for line in capsys.readouterr().out.splitlines()}
    ours, alone = (float(rows[name][0]) for name in ("concrete", "the fit alone"))
    assert ours < 0.7 * alone
    assert "0/2" in rows["concrete"]
