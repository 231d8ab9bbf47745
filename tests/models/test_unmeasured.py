"""Bands of signals that no sensor measured: exact slopes, true signals inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data import Polynomial
from data.record import Truth
from data.simulation.structure import Structure
from models.composition.states import MEASURES
from models.physical.truth import forces_of
from models.uncertainty.bands import half_widths
from models.uncertainty.laplace import laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from models.uncertainty.unmeasured import DEFORMATION, DISPLACEMENT, FORCE, unmeasured
from tests.models.test_uncertainty import noisy, planted


def test_the_band_of_a_displacement_is_that_of_the_exact_jacobian():
    model, record = planted()
    found = laplace(model, [noisy(record, 0.03)])
    band = unmeasured(model, found, record)[DISPLACEMENT]
    model.measures.fill_(MEASURES["displacement"])  # now the Jacobian is of the displacements
    exact, _ = half_widths(model, found, replace(record, a=record.x, quantity="displacement"))
    assert torch.allclose(band.half, exact, rtol=1e-3, atol=1e-3 * float(exact.max()))


def test_true_displacements_and_forces_lie_in_the_bands():
    model, record = planted()
    truth, hits = free_vector(model), []
    with torch.no_grad():
        deformation, force = model.element_loops(record)
    known = {DISPLACEMENT: record.x, FORCE: force, DEFORMATION: deformation}
    for seed in range(12):
        set_free_vector(model, truth)
        measured = noisy(record, 0.03, seed)
        for _ in range(3):  # to the minimum, which is near
            step = laplace(model, [measured]).step
            set_free_vector(model, free_vector(model) + torch.from_numpy(step))
        bands = unmeasured(model, laplace(model, [measured]), record)
        hits.append([bands[name].coverage(signal) for name, signal in known.items()])
    assert np.mean(hits, axis=0) == pytest.approx(0.95, abs=0.05)


def test_true_forces_have_the_order_and_the_direction_of_the_models_elements():
    model, record = planted()
    linear = {"stiffness": 80.0, "damping": 0.1}
    elements = {
        "top": Polynomial(between=("x2", "x1"), **linear),  # the model has x1–x2
        "foot": Polynomial(between=("ground", "x1"), **linear),
    }
    r = torch.randn(record.samples, 2, dtype=torch.float64)
    truth = Truth(record.x, record.v, record.a, y=r, r=r)
    forces = forces_of(Structure([1.0, 1.5], elements), model, truth)
    assert torch.equal(forces, torch.stack([r[:, 1], -r[:, 0]], dim=1))
