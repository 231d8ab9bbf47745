"""Planted models that each estimator recovers, and the baselines it has to be better than."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data.datamodule import Data
from data.record import Record
from data.simulation.excitation import BandLimitedGaussian, Excitation
from models.baselines import FilteredExtrapolation, NotApplicableError, Rigid, Zero
from models.fit.metrics import free_run_score, score
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion
from models.vwnn import VWNN
from runner.scores.outcome import compare_baselines
from tests.models.zoo import DT


def test_ten_times_the_signals_with_a_tenth_of_lambda_is_the_same_problem(bilinear_records):
    tenfold = [record.map(lambda u: 10.0 * u) for record in bilinear_records]
    errors = []
    for records, weight in ((bilinear_records, 0.05), (tenfold, 0.005)):
        estimator = VWNN(3, 3, DT, sigmoid_weight=weight)
        estimator.identify(records[:2])
        errors.append(score(estimator, records)["relative_rms_percent"])
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)


def test_equivalent_linear_recovers_the_matrices_of_a_linear_structure(
    linear_structure, linear_record
):
    estimator = EquivalentLinear(3, 3, DT)
    report = estimator.identify([linear_record])
    M, C, K = linear_structure.linearised()
    inverse = np.linalg.inv(M)
    for ours, planted in zip(
        estimator.matrices(), (inverse @ C, inverse @ K, inverse), strict=True
    ):
        assert np.abs(ours.numpy() - planted).max() < 1e-6 * np.abs(planted).max()
    assert report["rank"] == 9
    assert 1.0 < report["condition"] < 1e3
    assert score(estimator, [linear_record])["relative_rms_percent"] < 1e-8


def test_equivalent_linear_recovers_how_supports_drive_the_structure(linear_structure, record_of):
    shaken = Excitation(
        BandLimitedGaussian(2.0, (0.0, 4.5)), BandLimitedGaussian(0.05, (0.0, 4.5)), dofs=[1]
    )
    estimator = EquivalentLinear(3, 7, DT)
    estimator.identify([record_of(linear_structure, shaken, 10.0)])
    M, _, _ = linear_structure.linearised()
    B, B_s = linear_structure.incidence()
    stiffness, damping = np.array([e.tangent() for e in linear_structure.elements.values()]).T
    force = np.array([[1.0], [0.0], [0.0]])
    by_hand = np.hstack([force, -(B.T * stiffness) @ B_s, -(B.T * damping) @ B_s])
    inputs = estimator.matrices()[2].numpy()
    assert np.abs(inputs - np.linalg.inv(M) @ by_hand).max() < 1e-6


def planted_motion(vwnn: VWNN, f: torch.Tensor) -> Record:
    """A motion that obeys the network exactly: sample by sample, from past samples alone."""
    a = torch.zeros(len(f), 1, dtype=torch.float64)
    state = torch.zeros(vwnn.filters.stages, 2, dtype=torch.float64)
    for k in range(len(f)):
        zeta = torch.cat([a[k : k + 1], f[k : k + 1]], dim=1)
        xi, _ = vwnn.filters(zeta, state)
        a[k] = (vwnn.activation(xi) @ vwnn.weights)[0]
        zeta = torch.cat([a[k : k + 1], f[k : k + 1]], dim=1)
        state = vwnn.filters(zeta, state)[1]
    return Record(DT, a, f)


@pytest.mark.parametrize("order", [1, 3])
def test_a_vwnn_recovers_the_weights_of_a_planted_network(order):
    generator = torch.Generator().manual_seed(order)
    planted, ours = (VWNN(1, 1, DT, sigmoid_weight=0.8, order=order) for _ in range(2))
    features = planted.activation.features
    planted.weights.copy_(0.3 * torch.randn(features, 1, generator=generator, dtype=torch.float64))
    record = planted_motion(planted, 2.0 * torch.randn(1500, 1, generator=generator).double())
    assert 0.1 < record.a.std() < 10.0
    report = ours.identify([record])
    assert report["rank"] == features
    assert torch.allclose(ours.weights, planted.weights, rtol=0, atol=1e-6)
    assert torch.allclose(ours(record), record.a, rtol=0, atol=1e-9)


def test_with_the_force_itself_a_linear_structure_is_within_reach(linear_chain, record_of):
    excitation = Excitation(force=BandLimitedGaussian(1.7, (0.0, 4.5)))
    train, test = (record_of(linear_chain(3), excitation, 10.0, seed) for seed in range(2))
    errors = {}
    for unfiltered in (False, True):
        estimator = VWNN(3, 3, DT, sigmoid_weight=1e-4, order=1, unfiltered_excitation=unfiltered)
        estimator.identify([train])
        errors[unfiltered] = score(estimator, [test])["relative_rms_percent"]
    assert errors[True] < 0.1
    assert errors[False] > 1.0


def test_filtered_extrapolation_misses_a_sinusoid_by_one_less_h_squared():
    t = DT * torch.arange(2000.0, dtype=torch.float64)[:, None]
    record = Record(DT, torch.sin(2 * np.pi * 2.0 * t), torch.zeros_like(t))
    missed = (FilteredExtrapolation(1, 1, DT)(record) - record.a)[500:]
    decay, z = np.exp(-50.0 * DT), np.exp(2j * np.pi * 2.0 * DT)
    gain = abs(1.0 - (1.0 - decay) / (z - decay)) ** 2
    assert float(missed.abs().max()) == pytest.approx(gain, rel=1e-2)


# no motion, or that of the base


@pytest.mark.parametrize(("kind", "forced"), [(Zero, [1, 2, 3]), (Rigid, "base")])
def test_no_motion_errs_by_all_of_it(kind, forced, bilinear_record):
    model = kind(3, 3, bilinear_record.dt, forced)
    model.identify([bilinear_record])
    assert score(model, [bilinear_record])["relative_rms_percent"] == 100.0
    assert free_run_score(model, [bilinear_record])["per_dof_percent"] == [100.0] * 3


@pytest.mark.parametrize(("kind", "forced"), [(Rigid, [1]), (Zero, "base"), (Rigid, None)])
def test_one_of_both_is_the_word_for_it(kind, forced, bilinear_record):
    with pytest.raises(NotApplicableError, match="relative to a base"):
        kind(3, 3, bilinear_record.dt, forced).identify([bilinear_record])


def test_a_baseline_that_cannot_run_stops_nothing(bilinear_record):
    class Given(Data):
        dt, dofs, inputs = bilinear_record.dt, 3, 3

        def make_records(self):
            return {"train": [bilinear_record], "test": [bilinear_record]}

    data = Given()
    data.setup()

    class Broken(Zero):
        def identify(self, batches):
            raise RuntimeError("the matrix is singular")

    baselines = {
        "broken": Broken(3, 3, bilinear_record.dt),
        "unbuilt": ValueError("too many channels"),
        "rigid": Rigid(3, 3, bilinear_record.dt),
        "zero": Zero(3, 3, bilinear_record.dt),
        "linear": LinearMotion(3, 3, bilinear_record.dt),
    }
    results = compare_baselines(baselines, data)
    assert list(results) == ["broken", "unbuilt", "zero", "linear"]
    assert results["broken"] == {"failed": "the matrix is singular"}
    assert results["unbuilt"] == {"failed": "too many channels"}
    assert 0.0 < results["linear"]["free_run"]["relative_rms_percent"] < 100.0
