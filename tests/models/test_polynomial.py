"""Polynomial methods: planted restoring forces, equal spans, extents, modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.polynomial import chebyshev as numpy_chebyshev
from torch import nn

from data import Polynomial
from data.record import Record
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.structure import Structure
from models.estimator import weight_matrix
from models.fit.metrics import score
from models.layers.series import chebyshev, double_series, double_series_terms, powers
from models.linear import EquivalentLinear
from models.polynomial import ModalPolynomial, real_modes

FORCE = Excitation(force=BandLimitedGaussian(std=12.0, band=(0.0, 3.4)))
METHODS = {
    "power_series_residual": {"fits": "residual", "basis": "power"},
    "power_series_restoring_force": {"fits": "restoring_force", "basis": "power"},
    "chebyshev_restoring_force": {"fits": "restoring_force", "basis": "chebyshev"},
}


def identified(records: list[Record], **choices) -> ModalPolynomial:
    estimator = ModalPolynomial(records[0].dofs, records[0].dofs, records[0].dt, **choices)
    estimator.identify(records)
    return estimator


@pytest.fixture(scope="module")
def duffing_record(record_of):
    """A mass on a cubic spring: its force is in the space of the series."""
    spring = Polynomial(between=("ground", "x1"), stiffness=40.0, damping=0.5, cubic_stiffness=30.0)
    return record_of(Structure([1.0], {"spring": spring}), FORCE, 20.0)


@pytest.fixture(scope="module")
def polynomial_record(polynomial_structure, record_of):
    return record_of(polynomial_structure, FORCE, 20.0)


@pytest.mark.parametrize("method", METHODS)
def test_a_planted_cubic_spring_is_recovered_to_rounding(duffing_record, method, monkeypatch):
    def true_linear_part(self, batches):
        self.weights.copy_(torch.tensor([[-0.5], [-40.0], [1.0]]).double())

    monkeypatch.setattr(EquivalentLinear, "identify", true_linear_part)
    estimator = identified([duffing_record], **METHODS[method])
    assert score(estimator, [duffing_record])["relative_rms_percent"] < 1e-9
    u, u_dot = duffing_record.x[:, 0], duffing_record.v[:, 0]
    larger = replace(duffing_record.map(lambda signal: 1.2 * signal), truth=None)  # unseen motion
    wanted = larger.f[:, 0] - 40.0 * 1.2 * u - 0.5 * 1.2 * u_dot - 30.0 * (1.2 * u) ** 3
    assert torch.allclose(estimator(larger)[:, 0], wanted, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pairs", [None, [["u1", "u1_dot"], ["u1", "u2"]]])
def test_all_modes_at_once_are_the_modes_one_by_one(polynomial_record, method, pairs):
    estimator = identified([polynomial_record], **METHODS[method], order=3, pairs=pairs)
    x, v, f = polynomial_record.x, polynomial_record.v, polynomial_record.f
    series = zip(estimator._terms(x, v), estimator.coefficients, strict=True)
    h = torch.cat([terms @ weights for terms, weights in series], dim=-1)
    force = torch.linalg.solve(estimator.modes.T, h.T).T  # Φ⁻ᵀ h
    if METHODS[method]["fits"] == "residual":
        wanted = torch.cat([v, x, f], dim=-1) @ estimator.weights - force  # Eq. 9
    else:
        wanted = (f - force) @ estimator.matrices()[2].T  # Eq. 10
    estimate = estimator(polynomial_record)
    assert (estimate - wanted).abs().max() < 1e-11 * wanted.abs().max()


@pytest.mark.parametrize("fits", ["residual", "restoring_force"])
def test_powers_and_chebyshev_polynomials_agree(polynomial_record, fits):
    power = identified([polynomial_record], fits=fits, basis="power")
    cheb = identified([polynomial_record], fits=fits, basis="chebyshev")
    scale = polynomial_record.a.abs().max()
    assert (power(polynomial_record) - cheb(polynomial_record)).abs().max() < 1e-10 * scale


def test_series_hold_all_products_and_know_numpy_chebyshev():
    q, q_dot = torch.linspace(-1.3, 1.3, 9, dtype=torch.float64), torch.full((9,), 0.4).double()
    both = torch.stack([q, q_dot], dim=-1)
    terms = double_series_terms([(0, 1)], 5)
    assert double_series("power", 5, terms, both).shape == (9, 36)
    assert torch.allclose(powers(q, 5)[:, 4], q**4)
    for k in range(6):
        wanted = numpy_chebyshev.chebval(q.numpy(), np.eye(6)[k])
        assert np.allclose(chebyshev(q, 5)[:, k].numpy(), wanted, atol=1e-13)
    product = powers(q, 2)[:, 2] * powers(q_dot, 2)[:, 1]
    column = double_series_terms([(0, 1)], 2).index((0, 2, 1, 1))
    series = double_series("power", 2, double_series_terms([(0, 1)], 2), both)
    assert torch.allclose(series[:, column], product)


def test_the_31_printed_terms_of_eq_22_lack_the_damping(polynomial_record):
    """Without pure powers of the rate the errors are far larger than with the 36 it speaks of."""
    whole = identified([polynomial_record], fits="restoring_force")
    printed = ModalPolynomial(3, 3, 0.01, fits="restoring_force")
    printed.terms = [[t for t in terms if t[1] > 0 or t[3] == 0] for terms in printed.terms]
    printed.coefficients = nn.ParameterList([weight_matrix(31, 1) for _ in range(3)])
    printed.identify([polynomial_record])
    errors = [score(e, [polynomial_record])["relative_rms_percent"] for e in (printed, whole)]
    assert errors[0] > 1.5 * errors[1]


def test_complex_modes_become_a_real_basis_of_the_same_motion():
    turning = torch.tensor([[2.0, -1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 5.0]]).double()
    modes = real_modes(turning)
    assert torch.linalg.cond(modes) < 10.0
    block = torch.linalg.solve(modes, turning @ modes)
    assert torch.allclose(block[2, :2], torch.zeros(2).double(), atol=1e-12)
    assert torch.allclose(block[:2, 2], torch.zeros(2).double(), atol=1e-12)


@pytest.mark.parametrize("fits", ["residual", "restoring_force"])
def test_under_base_excitation_no_mass_need_be_known(fits):
    """ẍ = f ι − M⁻¹(K x + C ẋ), M⁻¹K symmetric so that ΦᵀM⁻¹r decouples: exact on any signals."""
    rng = np.random.default_rng(0)
    x, v, f = (torch.from_numpy(rng.standard_normal((400, c))) for c in (2, 2, 1))
    stiffness = torch.tensor([[50.0, -20.0], [-20.0, 30.0]]).double()
    damping = 0.01 * stiffness
    record = Record(0.01, f - x @ stiffness.T - v @ damping.T, f, x, v)
    model = ModalPolynomial(2, 1, 0.01, fits=fits, order=1, forced="base")
    model.identify([record])
    assert torch.allclose(model(record), record.a, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_the_least_squares_mass_is_what_a_cubic_spring_is_missed_by(duffing_record, method):
    """Eq. 8 takes part of the cubic force for mass, so that the series cannot be exact."""
    estimator = identified([duffing_record], **METHODS[method])
    assert abs(float(estimator.matrices()[2]) - 1.0) > 1e-4
    assert 1e-3 < score(estimator, [duffing_record])["relative_rms_percent"] < 20.0


@pytest.mark.parametrize("method", METHODS)
def test_extents_are_those_of_training_alone(polynomial_record, method):
    estimator = identified([polynomial_record], **METHODS[method])
    before = estimator.scale.reach.clone()
    larger = polynomial_record.map(lambda u: 3.0 * u)
    estimator(larger)
    assert torch.equal(estimator.scale.reach, before)
    scaled = estimator.scale(estimator._modal(polynomial_record.x, polynomial_record.v))
    assert torch.allclose(scaled.amax(dim=0), torch.ones(6).double())
    assert torch.allclose(scaled.amin(dim=0), -torch.ones(6).double())


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        *(({"pairs": [pair]}, "expected two different ones of u1, u2, u3, u1_dot")
          for pair in (["u1", "u4"], ["u1", "u1"], ["u1"], ["x1", "u1"])),
        ({"fits": "mass"}, "fits=mass must be one of residual, restoring_force"),
        ({"basis": "fourier"}, "basis=fourier must be one of power"),
        ({"order": 0}, "order=0 must be a whole number of at least 1"),
        ({"inputs": 1}, "one force per DOF"),
    ],
)  # fmt: skip
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        ModalPolynomial(**{"dofs": 3, "inputs": 3, "dt": 0.01, **wrong})
