"""The forward VWNN, and the paper's in a free run: planted structures, symmetry, stability."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.linalg import expm

from data.record import Drive, Record, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from models.layers.filters import SlowCascades
from models.layers.least_squares import LeastSquares
from models.vwnn import VWNN, integrated
from models.vwnn_forward import ForwardVWNN

DT = 0.01
CUTOFFS = (0.3, 0.4, 2.0, 20.0, 100.0)


def small(**choices) -> ForwardVWNN:
    return ForwardVWNN(3, 3, DT, **{"cutoffs": CUTOFFS, "factors": 3, "refinements": 0, **choices})


def relative(estimate: torch.Tensor, expected: torch.Tensor) -> float:
    return float((estimate - expected).norm() / expected.norm())


@pytest.fixture(scope="module")
def forward(bilinear_records) -> ForwardVWNN:
    estimator = small(ridge=1e-6)
    estimator.identify(bilinear_records[:2])
    return estimator


@pytest.fixture(scope="module", params=[1, 3])
def paper(request, bilinear_records) -> VWNN:
    estimator = VWNN(3, 3, DT, order=request.param, ridge=1e-6, unfiltered_excitation=True)
    estimator.identify(bilinear_records[:2])
    return estimator


# --- filters ---


def test_slow_cascades_equal_the_exact_response_to_an_extrapolated_input():
    a = np.random.default_rng(0).standard_normal(60)
    filters = SlowCascades([0.3, 2.0, 100.0], DT)
    ours = (filters.outputs @ filters.states(torch.from_numpy(a)[:, None]))[..., 0].numpy()
    p, poles = 0.3, np.array([2.0, 100.0])
    A = np.zeros((5, 5))  # v, two u, the input and its slope per sample
    A[:3, :3] = np.diag([-p, *-poles])
    A[1:3, 0], A[0, 3], A[3, 4] = 1.0, 1.0, 1.0 / DT
    step = expm(A * DT)[:3]
    state = np.zeros(3)
    for k in range(1, 60):
        before = a[k - 2] if k > 1 else 0.0
        state = step[:, :3] @ state + step[:, 3] * a[k - 1]
        predicted = state + step[:, 4] * (a[k - 1] - before)
        if k > 1:  # the input before the record is zero, at once and not by a ramp
            assert np.abs(ours[k] - (predicted + decayed(step, a[0], k))).max() < 1e-12
        state = state + step[:, 4] * (a[k] - a[k - 1])


def decayed(step: np.ndarray, first: float, k: int) -> np.ndarray:
    """What a ramp from zero to the first input leaves k samples later."""
    return np.linalg.matrix_power(step[:, :3], k) @ step[:, 4] * first


# --- free runs ---


def test_integration_is_exact_for_accelerations_that_are_linear_between_samples():
    t = DT * torch.arange(100.0, dtype=torch.float64)[:, None]
    start = torch.tensor([0.5], dtype=torch.float64)
    response = integrated(2.0 + 6.0 * t, Drive(DT, t, start, 2.0 * start))
    assert torch.allclose(response.v, 1.0 + 2.0 * t + 3.0 * t**2, rtol=1e-12)
    assert torch.allclose(response.x, 0.5 + t + t**2 + t**3, rtol=1e-12)


def test_the_papers_free_run_is_a_fixed_point_of_its_one_step_estimate(paper, bilinear_record):
    record = bilinear_record.window(0, 300)
    run = paper.free_run(record.drive())
    assert relative(paper(Record(DT, run.a, record.f)), run.a) < 1e-9


def test_the_forward_free_run_is_a_fixed_point_of_its_one_step_estimate(forward, bilinear_record):
    run = forward.free_run(bilinear_record.drive())
    assert relative(forward(Record(DT, run.a, bilinear_record.f)), run.a) < 1e-9


@pytest.mark.parametrize("kind", ["paper", "forward"])
def test_a_linear_structure_runs_free_on_forces_it_never_saw(
    linear_structure, record_of, linear_record, kind
):
    """Two filters of each channel hold all states; what is left is the force's first jump."""
    excitation = Excitation(BandLimitedGaussian(2.0, (0.0, 4.5)))
    other = record_of(linear_structure, excitation, 20.0, 7)
    estimator = (
        VWNN(3, 3, DT, sigmoid_weight=1e-6, order=1, bias=False, unfiltered_excitation=True)
        if kind == "paper"
        else small(cutoffs=(5.0, 50.0), factors=1, sigmoid_weight=1e-3, order=[3], ridge=1e-12)
    )
    estimator.identify([linear_record])
    run = estimator.free_run(other.drive())
    assert relative(run.a, other.a) < 0.01
    assert relative(run.v, other.v) < 0.02


# --- identification ---


def test_sensitivities_are_those_of_automatic_differentiation(forward, bilinear_record):
    u = bilinear_record.f[None, :30]
    states = forward.run(u)[1]
    driven, ones = forward.driven_features(u), torch.ones(len(forward.weights)).double()
    S = list(forward.sensitivities(states, driven, forward.slopes(states), ones))
    kept = forward.weights.data

    def last(weights: torch.Tensor) -> torch.Tensor:
        forward.weights.data = weights
        return forward.run(u)[0][0, -1]

    direction = 1e-4 * kept * torch.randn(kept.shape, generator=torch.Generator().manual_seed(0))
    expected = (last(kept + direction) - last(kept - direction)) / 2.0
    forward.weights.data = kept
    assert relative(S[-1][0] @ direction.T.flatten(), expected) < 1e-4


def test_refinements_lower_the_error_of_the_free_run(bilinear_records):
    estimator = small(refinements=2, cutoffs=(0.3, 0.4, 4.0, 50.0), factors=2)
    records = [record.window(0, 500) for record in bilinear_records[:2]]
    facts = estimator.identify(records)
    assert facts["refinements"] >= 1
    assert facts["free_run_percent"] < facts["free_run_percent_before_refinement"]
    batch = stack(records)
    error = 100.0 * relative(estimator.free_run(batch.drive()).a, batch.a)
    assert error == pytest.approx(facts["free_run_percent"], rel=1e-6)


def test_a_free_run_that_diverges_raises_the_ridge_and_says_so(monkeypatch, bilinear_records):
    solved, solve = [], LeastSquares.solve

    def explosive(fit: LeastSquares):
        solution = solve(fit)
        solved.append(fit.ridge)
        return replace(solution, weights=solution.weights * (10.0 if fit.ridge < 1e-5 else 1.0))

    monkeypatch.setattr(LeastSquares, "solve", explosive)
    estimator = small(ridge=1e-8)
    facts = estimator.identify(bilinear_records[:1])
    assert 1e-8 in solved
    assert facts["ridge"] > 0.99e-5
    assert 0.0 < facts["free_run_percent"] < 100.0


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"cutoffs": (1.0, 400.0)}, "cutoffs=400 rad/s lies above the Nyquist frequency"),
        ({"cutoffs": (0.0, 1.0)}, "cutoffs=0 rad/s must lie between 0 and"),
        ({"cutoffs": (1.0,)}, "expected at least two, from slow to fast"),
        ({"cutoffs": (1.0, 1.0)}, "from slow to fast, none twice"),
        ({"factors": 6}, r"model\.factors=6: expected 1 to 5"),
        ({"refinements": -1}, "refinements=-1 must be"),
        ({"order": [3, 1]}, r"model\.order=\[3, 1\]: choose 1, 2 or 3"),
        ({"sigmoid_weight": 0.0}, "above 0"),
    ],
)
def test_settings_that_cannot_be_are_refused(choices, message):
    choices = {"factors": 1, **choices} if "cutoffs" in choices else choices
    with pytest.raises(ValueError, match=message):
        small(**choices)


def test_slow_poles_give_velocity_and_displacement():
    t = DT * torch.arange(2000.0, dtype=torch.float64)[:, None]
    x, v, a = torch.sin(6.0 * t), 6.0 * torch.cos(6.0 * t), -36.0 * torch.sin(6.0 * t)
    filters = SlowCascades([1e-4, 2e-4], DT)
    ours = filters.outputs @ filters.states(a)  # from v = 0, where the sine begins with v = 6
    assert (ours[:, 0] - (v - 6.0)).abs().max() < 0.02
    assert (ours[:, 1] - (x - 6.0 * t))[:500].abs().max() < 0.05


def test_odd_orders_alone_are_an_odd_map(forward, bilinear_records, bilinear_record):
    odd = VWNN(3, 3, DT, order=[1, 3], bias=False, ridge=1e-6, unfiltered_excitation=True)
    odd.identify(bilinear_records[:2])
    drive = bilinear_record.drive()
    for estimator in (odd, forward):
        run, mirrored = (estimator.free_run(replace(drive, u=s * drive.u)) for s in (1.0, -1.0))
        assert torch.equal(mirrored.a, -run.a)
