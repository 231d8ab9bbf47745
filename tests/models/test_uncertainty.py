"""Intervals and bands cover the truth whatever the noise's colour; what no data determine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from data import Polynomial
from data.record import Record, Truth
from data.simulation.structure import Structure
from models.composition.states import MEASURES
from models.element_network import ElementNetwork
from models.physical.parameters import forces_of
from models.uncertainty.bands import DEFORMATION, DISPLACEMENT, FORCE, half_widths, unmeasured
from models.uncertainty.drifts import drifts, residual_of
from models.uncertainty.intervals import (
    COMBINATION,
    DETERMINED,
    UNEXCITED,
    between_blocks,
    intervals_of,
)
from models.uncertainty.laplace import NORMAL, Laplace, about, laplace
from models.uncertainty.parameters import free_vector, set_free_vector
from tests.models.planted import planted, under_forces

T, DRAWS = 1500, 300


def yielding(known: bool = False) -> tuple[ElementNetwork, Record]:
    """Two masses, that are known or not, whose springs yield, and their motion; none is fitted."""
    m = [1.0, 1.5]
    model = planted(m, [80.0, 50.0], yielding=0.6, masses=m if known else None, cubic=False)
    return model, under_forces(model, np.random.default_rng(0), T)


def slow_columns(rng: np.random.Generator) -> np.ndarray:
    """Derivatives (T, 1, 3) by three parameters: as of a structure, most of it at low frequency."""
    return lfilter([1.0], [1.0, -1.6, 0.8], rng.standard_normal((T, 1, 3)), axis=0)


def coverage(colour: float) -> tuple[float, float]:
    """Shares of 95 % intervals that hold the truth: by the residual's spectrum, as if white."""
    rng = np.random.default_rng(3)
    hits = []
    for _ in range(DRAWS):
        J = slow_columns(rng)
        noise = lfilter([1.0], [1.0, -colour], rng.standard_normal((T + 200, 1)), axis=0)[200:]
        error = np.linalg.lstsq(J[:, 0], noise[:, 0], rcond=None)[0]  # θ̂ − θ
        residual = noise - J @ error
        found = about([residual], [J], np.zeros(3), np.zeros(3))
        hits.append(
            [np.abs(error) < NORMAL * np.sqrt(c.diagonal()) for c in (found.coloured, found.white)]
        )
    colour_blind = np.mean(hits, axis=(0, 2))
    return float(colour_blind[0]), float(colour_blind[1])


def test_intervals_cover_under_coloured_noise_where_plain_ones_do_not():
    assert coverage(0.0) == pytest.approx((0.95, 0.95), abs=0.02)
    coloured, white = coverage(0.9)
    assert 0.92 < coloured < 0.975
    assert white < 0.85


@pytest.mark.parametrize("lengths", [(T,), (T, T // 3)])
def test_intervals_by_blocks_cover_where_errors_follow_a_motion_that_decays(lengths):
    """As those of a wrong law do under an earthquake, most of which is over after a tenth of it."""
    rng, hits = np.random.default_rng(4), []
    for _ in range(DRAWS // 3):
        decays = [np.exp(-10.0 * np.arange(k) / k)[:, None, None] for k in lengths]
        J = [d * slow_columns(rng)[: len(d)] for d in decays]
        errors = [d[..., 0] * slow_columns(rng)[: len(d), :, 0] for d in decays]
        error = np.linalg.lstsq(np.concatenate(J)[:, 0], np.concatenate(errors)[:, 0])[0]
        left = [e - part @ error for e, part in zip(errors, J, strict=True)]
        found = about(left, J, np.zeros(3), np.zeros(3))
        hits.append(np.abs(error) < between_blocks(found.blocks))
    assert np.mean(hits) > 0.85


def noisy(record, level: float, seed: int = 0):
    noise = torch.from_numpy(np.random.default_rng(seed).standard_normal(record.a.shape))
    return replace(record, a=record.a + level * record.a.std() * noise)


def to_minimum(model: ElementNetwork, measured: Record, truth: torch.Tensor) -> Laplace:
    """The fit to a record, which is near the truth."""
    set_free_vector(model, truth)
    for _ in range(3):
        step = laplace(model, [measured]).step
        set_free_vector(model, free_vector(model) + torch.from_numpy(step))
    return laplace(model, [measured])


def test_intervals_of_a_network_and_bands_cover_what_was_planted():
    """Parameters, and displacements, forces and deformations that no sensor measured."""
    model, record = yielding()
    truth, hits, inside = free_vector(model), [], []
    values = {p.name: p.value for p in model.physical_parameters()}
    with torch.no_grad():
        deformation, force = model.element_loops(record)
    signals = {DISPLACEMENT: record.x, FORCE: force, DEFORMATION: deformation}
    for seed in range(12):
        found = to_minimum(model, noisy(record, 0.03, seed), truth)
        for i in intervals_of(model, found):
            if i.status == DETERMINED:
                hits.append(abs(i.value - values[i.name]) <= i.half)
        bands = unmeasured(model, found, record)
        inside.append([bands[name].coverage(signal) for name, signal in signals.items()])
    assert len(hits) > 100
    assert np.mean(hits) > 0.9
    assert np.mean(inside, axis=0) == pytest.approx(0.95, abs=0.05)


def test_what_the_motion_does_not_move_is_not_excited():
    model, record = yielding()
    far = 50.0 * float(model.trace(record.drive()).deformations.abs().max())
    model.laws.unit_limit.unit.fill_(far)  # no motion yields it
    model.laws.unit_limit.theta.data.zero_()
    with torch.no_grad():
        record = replace(record, a=model.free_run(record.drive()).a)
    found = {i.name: i for i in intervals_of(model, laplace(model, [noisy(record, 0.02)]))}
    of_units = [i.status for name, i in found.items() if "unit_1.yield" in name]
    assert set(of_units) == {UNEXCITED}
    assert {found[f"r{e}.stiffness"].status for e in (1, 2)} == {DETERMINED}


def test_springs_in_parallel_are_told_in_a_combination():
    model, record = yielding()
    model.laws.unit_limit.unit.fill_(1e-9)  # yields at once: its spring and the element's are one
    model.laws.unit_stiffness.theta.data.fill_(0.3)
    with torch.no_grad():
        record = replace(record, a=model.free_run(record.drive()).a)
    found = {i.name: i for i in intervals_of(model, laplace(model, [noisy(record, 0.02)]))}
    assert found["r1.stiffness"].status == COMBINATION
    assert found["r1.stiffness"].combined_with == ("r1.unit_1.stiffness",)
    assert found["r1.post_yield_stiffness"].status == DETERMINED


# signals that no sensor measured


def test_the_band_of_a_displacement_is_that_of_the_exact_jacobian():
    model, record = yielding()
    found = laplace(model, [noisy(record, 0.03)])
    band = unmeasured(model, found, record)[DISPLACEMENT]
    model.measures.fill_(MEASURES["displacement"])  # now the Jacobian is of the displacements
    exact, _ = half_widths(model, found, replace(record, a=record.x, quantity="displacement"))
    assert torch.allclose(band.half, exact, rtol=1e-3, atol=1e-3 * float(exact.max()))


def test_drifts_are_as_sure_as_parameters_and_as_what_the_model_leaves_out():
    """Each part alone: a fit to noise under a run without any; a sure fit beside a wrong motion."""
    model, record = yielding(known=True)
    truth, peaks, posterior = free_vector(model), [], []
    for seed in range(8):
        found = to_minimum(model, noisy(record, 0.03, seed), truth)
        with torch.no_grad():
            exact = replace(record, a=model.free_run(record.drive()).a)
        rows = drifts(model, found, exact)
        peaks.append([row["peak"] for row in rows])
        posterior.append([row["peak_half"] for row in rows])
    ratio = np.mean(posterior, axis=0) / (1.96 * np.std(peaks, axis=0, ddof=1))
    assert ((ratio > 0.5) & (ratio < 3.0)).all()  # eight draws know it to a quarter
    set_free_vector(model, truth)
    sure = laplace(model, [noisy(record, 1e-6)])
    halves = [
        np.array([row["peak_half"] for row in drifts(model, sure, noisy(record, level))])
        for level in (1e-3, 2e-3)
    ]
    assert (halves[0] > 0.0).all()
    assert halves[1] == pytest.approx(2.0 * halves[0], rel=0.1)


def test_true_drifts_lie_in_their_intervals_and_such_as_hold_zero_do_not_tell_them(monkeypatch):
    """Peaks and what stays, of springs that yield, from accelerations with noise."""
    model, record = yielding(known=True)
    truth, hits, halves = free_vector(model), [], []
    with torch.no_grad():
        y = model.element_loops(record)[0].numpy()
    known = np.stack([np.abs(y).max(axis=0), residual_of(y)])
    for level, seed in [(0.03, seed) for seed in range(8)] + [(3.0, 0)]:
        measured = noisy(record, level, seed)
        set_free_vector(model, truth)  # of much noise, whose minimum is not near
        near = to_minimum(model, measured, truth) if level < 1.0 else laplace(model, [measured])
        rows = drifts(model, near, measured)
        assert [row["element"] for row in rows] == ["r1 ground–x1", "r2 x1–x2"]
        own, half = (
            np.array([[row[f"{key}{end}"] for row in rows] for key in ("peak", "residual")])
            for end in ("", "_half")
        )
        hits.append(np.abs(own - known) <= half)
        halves.append(half)
    assert np.mean(hits) >= 0.9
    assert (halves[0][0] < 0.1 * known[0]).all()  # little noise: peaks are known
    assert (halves[-1][1] > np.abs(known[1])).all()  # much of it: what stays is not
    found = laplace(model, [measured])
    assert drifts(model, found, replace(record, initial_state="unknown")) == []
    away = torch.tensor([[torch.inf, 0.0]])  # a run that is as likely diverges
    monkeypatch.setattr("models.uncertainty.drifts._put_back", lambda *_: [away])
    assert [row["element"] for row in drifts(model, found, record)] == ["r2 x1–x2"]


def test_true_forces_have_the_order_and_the_direction_of_the_models_elements():
    model, record = yielding()
    linear = {"stiffness": 80.0, "damping": 0.1}
    elements = {
        "top": Polynomial(between=("x2", "x1"), **linear),  # the model has x1–x2
        "foot": Polynomial(between=("ground", "x1"), **linear),
    }
    r = torch.randn(record.samples, 2, dtype=torch.float64)
    truth = Truth(record.x, record.v, record.a, y=r, r=r)
    forces = forces_of(Structure([1.0, 1.5], elements), model, truth)
    assert torch.equal(forces, torch.stack([r[:, 1], -r[:, 0]], dim=1))
