"""Filters, features, scaling, least squares and states from accelerations, each by itself."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pytest
import torch
from scipy.signal import bilinear, lfilter

from data.record import Record
from models.layers.features import SigmoidProducts
from models.layers.filters import LowPassCascade
from models.layers.least_squares import LeastSquares, RankDeficientError
from models.layers.reconstructed import (
    corner_of,
    high_passed,
    passed,
    reconstructed,
    state_variables,
)
from models.layers.scaling import Extents
from models.mlp import GlobalMLP, ResidualMLP

DT = 0.01


def noise(*shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(0).standard_normal(shape))


@pytest.mark.parametrize(("samples", "cutoff"), [(1, 50.0), (3, 300.0), (1000, 0.5)])
def test_the_cascade_equals_scipy(samples, cutoff):
    u, decay = noise(samples, 3), math.exp(-cutoff * DT)
    expected, stage = [], u.numpy()
    for _ in range(3):
        stage = lfilter([0.0, 1.0 - decay], [1.0, -decay], stage, axis=0)
        expected.append(stage)
    ours, _ = LowPassCascade(cutoff, 3, DT)(u)
    assert np.abs(ours.numpy() - np.concatenate(expected, axis=1)).max() < 1e-12


def test_the_impulse_response_is_a_delayed_exponential_and_its_convolution():
    impulse = torch.zeros(200, 1).double()
    impulse[0] = 1.0
    xi, _ = LowPassCascade(50.0, 2, DT)(impulse)
    k, decay = torch.arange(200.0).double(), math.exp(-0.5)
    once = torch.where(k > 0, (1 - decay) * decay ** (k - 1), 0.0)
    twice = torch.where(k > 1, (k - 1) * (1 - decay) ** 2 * decay ** (k - 2), 0.0)
    assert torch.allclose(xi, torch.stack([once, twice], dim=1), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("k", [0, 50])
def test_no_output_at_k_sees_the_input_at_k(k):
    u = noise(100, 2)
    other = u.clone()
    other[k] += 1.0
    cascade = LowPassCascade(50.0, 2, DT)
    one, two = cascade(u)[0], cascade(other)[0]
    assert torch.equal(one[: k + 1], two[: k + 1])
    assert (one[k + 1, :2] != two[k + 1, :2]).all()


@pytest.mark.parametrize("cuts", [[1, 2, 3], [7, 500]])
def test_chunks_that_hand_over_their_state_equal_the_whole(cuts):
    u, cascade = noise(1000, 3), LowPassCascade(2.0, 3, DT)
    whole, last = cascade(u)
    state, parts = None, []
    for chunk in torch.tensor_split(u, cuts):
        xi, state = cascade(chunk, state)
        parts.append(xi)
    assert torch.allclose(torch.cat(parts), whole, rtol=0, atol=1e-13)
    assert torch.allclose(state, last, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("cutoff", "stages", "message"),
    [
        (400.0, 2, "cutoff=400 rad/s lies above the Nyquist frequency 314 rad/s"),
        (0.0, 2, "cutoff=0 rad/s"),
        (-5.0, 2, "cutoff=-5 rad/s"),
        (math.nan, 2, "cutoff=nan"),
        (50.0, 0, "stages=0 must be a whole number from 1 to"),
    ],
)
def test_filters_that_cannot_be_are_refused(cutoff, stages, message):
    with pytest.raises(ValueError, match=message):
        LowPassCascade(cutoff, stages, DT)


def test_a_held_input_gives_the_exact_solution_of_the_differential_equation():
    xi, _ = LowPassCascade(50.0, 1, DT)(torch.ones(100, 1).double())
    t = DT * torch.arange(100.0).double()[:, None]
    assert torch.allclose(xi, 1.0 - torch.exp(-50.0 * t), rtol=1e-12, atol=1e-15)


# Sigmoids and their products: how many, which, and their symmetry


XI = torch.randn(50, 12, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize(
    ("order", "squares", "bias", "count"),
    [
        (1, True, True, 13),
        (2, True, False, 90),
        (2, False, False, 78),
        (3, True, True, 455),
        (3, False, False, 298),
    ],
)
def test_the_number_of_features_is_that_of_the_unique_products(order, squares, bias, count):
    phi = SigmoidProducts(12, 0.1, order, squares, bias)
    assert phi.features == count
    assert phi(XI).shape == (50, count)
    assert torch.unique(phi(XI), dim=1).shape[1] == count


def test_first_order_terms_are_eq_6():
    h = SigmoidProducts(12, 0.3, 1, bias=False)(XI)
    assert torch.allclose(h, 2.0 / (1.0 + torch.exp(-2.0 * 0.3 * XI)) - 1.0, rtol=0, atol=1e-15)
    assert torch.allclose(h, torch.tanh(0.3 * XI), rtol=0, atol=1e-15)


def test_products_are_those_of_the_first_order_terms():
    phi, h = SigmoidProducts(3, 0.7, 3)(XI[:, :3]), torch.tanh(0.7 * XI[:, :3])
    by_hand = [
        math.prod(h[:, i] for i in factors)
        for count in (1, 2, 3)
        for factors in combinations_with_replacement(range(3), count)
    ]
    by_hand.append(torch.ones(50).double())
    assert torch.allclose(phi, torch.stack(by_hand, dim=1), rtol=1e-14)


def test_odd_orders_turn_with_the_motion_and_even_orders_do_not():
    features = SigmoidProducts(12, 0.3, 3)
    one, mirrored = features(XI), features(-XI)
    first, second, third = slice(0, 12), slice(12, 90), slice(90, 454)
    assert torch.equal(mirrored[:, first], -one[:, first])
    assert torch.equal(mirrored[:, second], one[:, second])
    assert torch.equal(mirrored[:, third], -one[:, third])
    assert torch.equal(one[:, 454], torch.ones(50).double())


@pytest.mark.parametrize(
    ("weight", "order", "message"),
    [
        (0.0, 2, r"weight=0\.0 must be a number above 0 or null"),
        (-0.1, 2, "above 0"),
        (math.nan, 2, "is not finite"),
        (math.inf, 2, "is not finite"),
        (0.1, 0, r"model\.order=0: choose 1, 2 or 3"),
        (0.1, 4, r"model\.order=4"),
    ],
)
def test_features_that_cannot_be_are_refused(weight, order, message):
    with pytest.raises(ValueError, match=message):
        SigmoidProducts(3, weight, order)


@pytest.mark.parametrize(
    "settings", [{}, {"order": 1}, {"order": [1, 3], "bias": False}, {"order": 3, "squares": False}]
)
def test_compiled_features_are_those_of_torch_to_the_bit(settings):
    activation = SigmoidProducts(5, 0.7, **settings)
    xi = torch.randn(2, 3, 50, 5, generator=torch.Generator().manual_seed(0)).double()
    assert torch.equal(activation.products_of(xi), activation(xi))
    strided = xi.transpose(1, 2)
    assert torch.equal(activation.products_of(strided), activation(strided))


# Scaling to [−1, 1]: extents of the training motion, its inverse, constant channels


def signal(*shape: int, seed: int = 0) -> torch.Tensor:
    """Noise whose channels differ in size and mean; never symmetric about zero."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** np.arange(-2, shape[-1] - 2)
    return torch.from_numpy(size * (0.7 + rng.standard_normal(shape)))


def motion(samples: int = 80, seed: int = 1) -> Record:
    """Two masses that move at random; nothing here solves an equation of motion."""
    rng = np.random.default_rng(seed)
    x, v, f, a = torch.from_numpy(0.7 + rng.standard_normal((4, samples, 2)))
    return Record(dt=0.01, a=a, f=3.0 * f, x=0.1 * x, v=v)


def scale_of(u: torch.Tensor, *shape: int) -> Extents:
    scale = Extents(*(shape or u.shape[-1:]))
    scale.fit([u])
    return scale


def test_the_inverse_undoes_the_scaling_both_ways():
    u = signal(30, 4)
    scale, other = scale_of(u), 2.0 * signal(30, 4, seed=3)
    assert torch.allclose(scale.inverse(scale(other)), other, rtol=1e-13, atol=1e-15)
    assert torch.allclose(scale(scale.inverse(other)), other, rtol=1e-12, atol=1e-12)
    assert not torch.allclose(scale(other), other)


def test_a_constant_channel_keeps_its_unit_and_loses_its_mean():
    u = signal(20, 3)
    u[:, 1] = -4.25
    scale = scale_of(u)
    assert float(scale.reach[1]) == 1.0
    assert torch.equal(scale(u)[:, 1], torch.zeros(20).double())
    assert torch.allclose(scale(u + 0.5)[:, 1], torch.full((20,), 0.5).double())


@pytest.mark.parametrize("model", [GlobalMLP, ResidualMLP])
def test_samples_that_only_warm_up_are_not_scaled_by(model):
    """Wild first samples; the delayed residual of the last of them is a counted input."""
    calm, wild = motion(), motion().map(lambda u: u.clone())
    for u in wild.signals().values():
        u[:5] *= 50.0
    estimators = [model(2, 2, 0.01) for _ in range(2)]
    estimators[0].identify([replace(calm, warmup=6)])
    wild.a[5], wild.x[5], wild.v[5], wild.f[5] = calm.a[5], calm.x[5], calm.v[5], calm.f[5]
    estimators[1].identify([replace(wild, warmup=6)])
    for one, other in zip(*(e.network.buffers() for e in estimators), strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12)


# Closed-form solutions: planted weights, rank, condition and scale


RNG = np.random.default_rng(0)
PHI = torch.from_numpy(RNG.standard_normal((200, 7)))
Y = torch.from_numpy(RNG.standard_normal((200, 3)))


def solve(phi, y, ridge=0.0):
    fit = LeastSquares(ridge)
    fit.add(phi, y)
    return fit.solve()


def ill_conditioned(condition: float) -> torch.Tensor:
    """Features of unit length and about this condition, (300, 6)."""
    rng = np.random.default_rng(1)
    left = np.linalg.qr(rng.standard_normal((300, 6)))[0]
    right = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    features = left * np.geomspace(1.0, 1.0 / condition, 6) @ right
    return torch.from_numpy(features / np.linalg.norm(features, axis=0))


def test_the_solution_is_that_of_numpy():
    weights, _, rank, _ = np.linalg.lstsq(PHI.numpy(), Y.numpy())
    solution = solve(PHI, Y)
    assert np.abs(solution.weights.numpy() - weights).max() < 1e-13
    assert solution.rank == rank
    assert 1.0 < solution.condition < 3.0


@pytest.mark.parametrize("cuts", [[3, 5, 100], list(range(1, 30))])
def test_chunks_of_any_length_equal_the_whole(cuts):
    fit = LeastSquares()
    for phi, y in zip(torch.tensor_split(PHI, cuts), torch.tensor_split(Y, cuts), strict=True):
        fit.add(phi, y)
    solution, whole = fit.solve(), solve(PHI, Y)
    assert torch.allclose(solution.weights, whole.weights, rtol=0, atol=1e-13)
    assert solution.condition == pytest.approx(whole.condition, rel=1e-10)
    assert fit.samples == 200


def test_ill_conditioned_features_lose_their_condition_and_not_its_square():
    phi, planted = ill_conditioned(1e10), torch.ones(6, 2).double()
    solution = solve(phi, phi @ planted)
    assert 1e9 < solution.condition < 1e11
    assert solution.rank == 6
    assert (solution.weights - planted).abs().max() < 1e-4
    normal = torch.linalg.pinv(phi.T @ phi, rtol=0.0) @ (phi.T @ (phi @ planted))
    assert (normal - planted).abs().max() > 100 * (solution.weights - planted).abs().max()


def test_weights_follow_the_units_of_the_features():
    scale = torch.logspace(-12, 12, 7, dtype=torch.float64)
    one, scaled = solve(PHI, Y), solve(PHI * scale, Y)
    assert torch.allclose(scaled.weights * scale[:, None], one.weights, rtol=1e-10)
    assert scaled.condition == pytest.approx(one.condition, rel=1e-6)
    assert scaled.rank == 7


def test_a_duplicated_channel_is_named_as_rank_deficiency():
    with pytest.raises(RankDeficientError, match=r"7 of 8 are independent in 200 samples") as error:
        solve(torch.cat([PHI, 2.0 * PHI[:, :1]], dim=1), Y)
    assert "duplicate or silent channel" in str(error.value)
    assert "model.ridge=1e-8" in str(error.value)


def test_a_ridge_solves_what_is_rank_deficient_and_shares_between_duplicates():
    planted = torch.ones(8, 1).double()
    phi = torch.cat([PHI, PHI[:, :1]], dim=1)
    solution = solve(phi, phi @ planted, 1e-10)
    assert solution.rank == 7
    assert torch.allclose(solution.weights, planted, atol=1e-6)
    silent = solve(torch.cat([PHI, torch.zeros(200, 1).double()], dim=1), Y, 1e-10)
    assert silent.weights[7].abs().max() == 0.0
    assert torch.allclose(silent.weights[:7], solve(PHI, Y).weights, atol=1e-8)


BROKEN = PHI.clone()
BROKEN[3, 2] = float("nan")


@pytest.mark.parametrize(
    ("phi", "y", "ridge", "message"),
    [
        *((PHI, Y, ridge, r"ridge=") for ridge in (-1e-8, float("nan"), float("inf"))),
        (BROKEN, Y, 0.0, "NaN or infinite"),
        (Y, BROKEN / 0.0, 0.0, "NaN or infinite"),
        (PHI, Y[1:], 0.0, "200 samples of features, 199 of targets"),
    ],
)
def test_what_has_no_solution_is_refused(phi, y, ridge, message):
    with pytest.raises(ValueError, match=message):
        solve(phi, y, ridge)
    with pytest.raises(ValueError, match="no samples"):
        LeastSquares().solve()


# State-variable filters: one linear equation of motion holds for the filtered signals


def oscillator(force: np.ndarray, mass: float, damping: float, stiffness: float) -> np.ndarray:
    """Acceleration of a single mass from rest, integrated by the trapezoidal rule."""
    b, a = bilinear([1.0, 0.0, 0.0], [mass, damping, stiffness], fs=1.0 / DT)
    return lfilter(b, a, force)


def force_of(samples: int = 3000, seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).standard_normal(samples)) / 10.0


def column(signal: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(signal)[:, None]


@pytest.mark.parametrize("corner", [0.5, 20.0])
def test_of_a_linear_oscillator_mass_damper_and_spring_follow_exactly(corner):
    """From accelerations alone, at rest at first: m a + c v + k x = f for the filtered signals."""
    planted = [2.0, 0.7, 60.0]
    force = force_of()
    x, v, a = state_variables(column(oscillator(force, *planted)), corner, DT)
    f = state_variables(column(force), corner, DT)[2]
    found = torch.linalg.lstsq(torch.cat([a, v, x], dim=1), f).solution[:, 0]
    assert torch.allclose(found, torch.tensor(planted).double(), rtol=1e-8)


def test_a_filtered_signal_knows_nothing_of_what_is_to_come():
    signal = column(force_of(300))
    changed = signal.clone()
    changed[200:] += 1.0
    for one, other in zip(
        state_variables(signal, 4.0, DT), state_variables(changed, 4.0, DT), strict=True
    ):
        assert torch.equal(one[:200], other[:200])
        assert not torch.equal(one[200], other[200])


def test_an_offset_of_the_accelerometer_does_not_drift():
    """Where twice integrating it would grow with the square of time."""
    x, v, a = state_variables(torch.ones(20_000, 1).double(), 2.0, DT)
    assert float(x[-1, 0]) == pytest.approx(0.25, rel=1e-9)
    assert v[-1].abs().max() < 1e-9
    assert a[-1].abs().max() < 1e-9


@pytest.mark.parametrize(
    ("which", "numerator"), [(0, [1.0]), (1, [1.0, 0.0]), (2, [1.0, 0.0, 0.0])]
)
def test_the_filters_are_those_of_scipy(which, numerator):
    """1, s and s² over (s + ω₀)²."""
    corner, signal = 4.0, force_of(500)
    b, a = bilinear(numerator, [1.0, 2.0 * corner, corner**2], fs=1.0 / DT)
    ours = state_variables(column(signal), corner, DT)[which][:, 0].numpy()
    wanted = lfilter(b, a, signal)
    assert np.abs(ours - wanted).max() < 1e-9 * np.abs(wanted).max()


# Displacement and velocity of a motion from its acceleration, off line


def swelling(drift: float, noise: float) -> tuple[torch.Tensor, ...]:
    """x, v, a of two modes that swell and fade, and their force; the sensor drifts and is noisy."""
    t = torch.arange(4000, dtype=torch.float64) * DT
    swell = torch.sin(torch.pi * t / t[-1]) ** 2
    x = torch.stack([swell * torch.sin(9.0 * t), swell * torch.sin(15.0 * t + 1.0)], dim=1)
    v, a = (torch.gradient(s, spacing=DT, dim=0)[0] for s in (x, x))
    a = torch.gradient(v, spacing=DT, dim=0)[0]
    u = a + 2.0 * v + torch.tensor([81.0, 200.0]) * x
    generator = torch.Generator().manual_seed(1)
    error = torch.randn(a.shape, generator=generator, dtype=a.dtype)
    return x, v, a + drift + noise * a.std() * error, u


def error(found: torch.Tensor, true: torch.Tensor) -> float:
    return float((found - true).norm() / true.norm())


@pytest.mark.parametrize(("drift", "noise", "limit"), [(0.0, 0.0, 0.01), (0.5, 0.05, 0.1)])
def test_x_and_v_are_those_of_the_motion(drift, noise, limit):
    x, v, a, u = swelling(drift, noise)
    found = reconstructed(a, u, DT)
    assert error(found[0], x) < limit
    assert error(found[1], v) < limit


@pytest.mark.parametrize("order", [0, 1])
def test_so_they_are_from_noisy_displacements_and_velocities(order):
    x, v, _, u = swelling(0.0, 0.0)
    measured = (x, v)[order]
    generator = torch.Generator().manual_seed(2)
    error_ = torch.randn(x.shape, generator=generator, dtype=x.dtype)
    found = reconstructed(measured + 0.02 * measured.std() * error_, u, DT, order)
    assert error(found[0], x) < 0.03
    assert error(found[1], v) < 0.03


def test_supports_lose_what_a_motion_that_was_integrated_has_lost():
    """Ends at which the support neither rests nor stands at zero do no harm."""
    x, v, a, u = swelling(0.0, 0.0)
    cut = slice(300, 3500)
    x, v, a, u = (s[cut] for s in (x, v, a, u))
    corner = corner_of(a, u, DT)
    for found, integrated in zip(high_passed(x, v, DT, corner), passed(a, DT, corner), strict=True):
        assert error(found[200:-200], integrated[200:-200]) < 0.02
