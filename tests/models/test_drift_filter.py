"""Drifts of all storeys on line, from a posterior that is planted: laws scattered about a fit."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch

from data.record import Record
from data.sample import Sample
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.element import Element
from data.simulation.laws.menegotto_pinto import MenegottoPinto
from data.simulation.laws.polynomial import Polynomial
from data.simulation.laws.takeda import Takeda
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.named_laws.free_run import blend
from models.online.drift_filter import DriftFilter, DriftSmoother
from models.online.drift_stream import DriftStream, smoothed
from tests.models.test_hidden_floors import (
    DT,
    MASSES,
    SAMPLES,
    YIELDS,
    identified,
    network,
    shaken,
    structure,
)  # fmt: skip

NOISE, ROOF = 0.05, [2]
NONE = np.zeros(0)


def scattered(of: Structure, size: float, rng: np.random.Generator) -> Structure:
    """The same structure with stiffnesses and strengths that are a little off."""
    parts = {}
    for name, element in of.elements.items():
        assert isinstance(element, Bilinear)
        k, y = np.exp(size * rng.standard_normal(2)).tolist()
        parts[name] = replace(
            element,
            stiffness=k * element.stiffness,
            post_yield_stiffness=k * element.post_yield_stiffness,
            yield_displacement=y * element.yield_displacement,
        )
    return Structure(of.masses.tolist(), parts)


class Case:
    """A planted chain under a noisy ground, its fit and what its sensor has; x in other units."""

    def __init__(self, seed: int, longer: float = 1.0, heavier: float = 1.0) -> None:
        rng, true = np.random.default_rng(seed), structure(heavier, longer)
        f, a, self.drifts = shaken(true, seed, longer)
        self.ground, self.roof = (NOISE * float(u.std()) for u in (f, a[:, 2] - f[:, 0]))
        noise = rng.standard_normal((SAMPLES, 2)) * [self.ground, self.roof]
        self.f = f[:, 0].numpy() + noise[:, 0]
        self.a = (a[:, 2].numpy() + noise.sum(axis=1))[:, None]
        self.fit = scattered(true, 0.03, rng)
        self.laws = [self.fit, *(scattered(self.fit, 0.03, rng) for _ in range(32))]

    def filter(self, lost: float = 4.0, kind: type[DriftFilter] = DriftFilter) -> Any:
        noise = np.array([self.roof])
        return kind(self.laws, range(3), ROOF, noise, self.ground, DT, lost)

    def followed(self, a: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, DriftFilter]:
        """Drifts and halves (T, 2, E), predictions (T,) of the roof, and the filter at the end."""
        found, rows, predicted = self.filter(), [], []
        for u, row in zip(self.f, self.a if a is None else a, strict=True):
            predicted.append(found.predict(u * self.fit.masses, NONE, NONE)[0])
            found.correct(row)
            rows.append(found.drifts)
        return np.array(rows), np.array(predicted), found


@cache
def usual(seed: int) -> tuple[Case, np.ndarray, np.ndarray, DriftFilter]:
    """A case and what `followed` says of it, which nobody changes."""
    case = Case(seed)
    return case, *case.followed()


def error(drifts: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(drifts - true) / np.linalg.norm(true))


@pytest.mark.parametrize("wire", [False, True])
def test_filter_of_a_linear_chain_is_the_regression_on_all_samples_so_far(wire: bool) -> None:
    """Whose regressors are simulated: runs of other laws, and answers to noise in one sample.

    wire: a drift with an unknown zero, too, which misses its first samples and one more.
    """
    rng, T, dt = np.random.default_rng(0), 80, 0.005

    def chain(k: float) -> Structure:
        pairs = (("ground", "x1"), ("x1", "x2"), ("x2", "x3"))
        parts = {
            f"r{i}": Polynomial(between=pair, stiffness=s * k, damping=3e-3 * s * k)
            for i, (pair, s) in enumerate(zip(pairs, (1.0, 0.8, 0.6), strict=True))
        }
        return Structure(list(MASSES), parts)

    laws = [chain(1e7 * k) for k in (1.0, 1.1, 0.95)]
    f = np.convolve(rng.standard_normal(T), np.hanning(12), mode="same")
    a, ground, noise = rng.standard_normal((T, 1)), 0.2, np.array([0.1, 1e-4])[: 1 + wire]
    of_wire = np.array([[-1.0, 1.0, 0.0]])[: int(wire)]
    drift = (0.02 + 1e-4 * rng.standard_normal((T, 1)))[:, : int(wire)]
    drift[[0, 1, 40]] = np.nan
    found = DriftFilter(laws, range(3), ROOF, noise, ground, dt, np.inf, of_wire)
    for u, *rows in zip(f, a, drift, strict=True):
        found.predict(u * laws[0].masses, NONE, NONE)
        found.correct(*rows)

    def run(law: Structure, u: np.ndarray, pulse: bool = False) -> tuple[np.ndarray, np.ndarray]:
        motion = simulate(law, u[:, None] * law.masses, dt)
        seen = motion.a[:, 2:] - u[:, None] * pulse  # measured against the noisy ground
        return np.hstack([seen, motion.x @ of_wire.T]).ravel(), motion.y[-1]

    own, others = run(laws[0], f), [run(law, f) for law in laws[1:]]
    pulses = [run(laws[0], pulse, True) for pulse in np.eye(T)]
    H = np.stack([u - own[0] for u, _ in others] + [u for u, _ in pulses], axis=1)
    D = np.stack([y - own[1] for _, y in others] + [y for _, y in pulses], axis=1)
    prior = np.array([2.0, 2.0] + [ground**-2] * T)
    if wire:  # its zero, of which nothing is known
        H = np.column_stack([H, np.tile([0.0, 1.0], T)])
        D, prior = np.column_stack([D, np.zeros(3)]), np.append(prior, 0.0)
    left = np.hstack([a, drift]).ravel() - own[0]
    known, sigma = np.isfinite(left), np.tile(noise, T)
    H, left = (H / sigma[:, None])[known], (left / sigma)[known]
    C = np.linalg.inv(H.T @ H + np.diag(prior))
    drifts = own[1] + D @ C @ H.T @ left
    halves = 1.96 * np.sqrt(np.einsum("ei,ij,ej->e", D, C, D) * found.ratio)
    np.testing.assert_allclose(found.drifts, [drifts, halves], rtol=5e-4)


def test_a_sensor_that_never_speaks_hides_no_innovation_that_is_too_large() -> None:
    case = Case(7)
    noise, of_wire = np.array([case.roof, 1e-4]), np.array([[-1.0, 1.0, 0.0]])
    alone, silent = case.filter(), DriftFilter(
        case.laws, range(3), ROOF, noise, case.ground, DT, 4.0, of_wire
    )  # fmt: skip
    for u, row in zip(case.f[:100], case.a[:100], strict=True):
        for found, rows in ((alone, (row,)), (silent, (row, np.array([math.nan])))):
            found.predict(u * case.fit.masses, NONE, NONE)
            found.correct(*rows)
    assert silent.ratio == pytest.approx(alone.ratio, rel=1e-6)


def test_innovations_of_a_planted_chain_are_white_and_as_large_as_expected() -> None:
    ratios, products, held = [], [], []
    for seed in (7, 8, 9):
        case, rows, predicted, found = usual(seed)
        e = case.a[:, 0] - predicted
        ratios.append(np.mean(found.misses))
        products.append((e[1:] * e[:-1]).sum() / (e**2).sum())
        held.append((np.abs(rows[50:, 0] - case.drifts[50:]) <= rows[50:, 1]).mean())
        assert not found.diverged
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(products)) < 0.1
    assert np.mean(held) > 0.8  # three times 1,800 values, of few independent ones


@pytest.mark.parametrize("seed", [7, 8, 9])
def test_drifts_are_nearer_than_those_of_the_fit_alone(seed: int) -> None:
    case, rows, _, _ = usual(seed)
    alone = simulate(case.fit, case.f[:, None] * case.fit.masses, DT).y
    assert error(rows[:, 0], case.drifts) < 0.7 * error(alone, case.drifts)


def test_estimates_know_no_sample_that_comes_later() -> None:
    (case, rows, predicted, _), k = usual(7), 300
    changed = case.a.copy()
    changed[k:] += 1.0
    others, different, _ = case.followed(changed)
    np.testing.assert_array_equal(rows[:k], others[:k])
    np.testing.assert_array_equal(predicted[: k + 1], different[: k + 1])
    assert (rows[k] != others[k]).any()


def test_other_units_change_nothing() -> None:
    _, rows, _, found = usual(7)
    others, _, same = Case(7, longer=1000.0, heavier=1e-3).followed()
    np.testing.assert_allclose(others / 1000.0, rows, atol=1e-6 * np.abs(rows).max())
    assert same.ratio == pytest.approx(found.ratio, rel=1e-4)


def test_a_stream_of_another_structure_is_told_and_the_fit_runs_alone() -> None:
    case = Case(7)
    alone = simulate(case.fit, case.f[:, None] * case.fit.masses, DT).y
    rows, _, found = case.followed(3.0 * case.a)
    assert found.diverged
    assert np.isnan(rows[-1, 1]).all()
    np.testing.assert_allclose(rows[-1, 0], alone[-1], atol=1e-4 * np.abs(alone).max())
    np.testing.assert_allclose(found.peaks[0], found.peaks[2])
    np.testing.assert_allclose(np.abs(found.peaks[2]), np.abs(alone).max(axis=0), rtol=1e-3)


def test_a_base_pulls_at_the_masses_of_every_law() -> None:
    case = Case(0)
    heavy = Structure([1.3, 0.8, 1.1] * case.fit.masses, case.laws[1].elements)
    case.laws[1] = heavy
    found = case.filter()
    for u in case.f[:200]:
        found.predict(u * case.fit.masses, NONE, NONE)
    run = simulate(heavy, np.ascontiguousarray(case.f[:200, None] * heavy.masses), DT)
    np.testing.assert_allclose(found.a[1], run.a[-1], rtol=1e-3, atol=1e-3)


def test_a_smoother_runs_other_masses_on_the_same_ground() -> None:
    """Once about other laws, and then where it simulates what is not linear."""
    model, case = identified(), Case(7)
    fit, (others, _) = model.found_laws(), model.about()
    about = np.array([3.0] + [0.0] * (len(others) - 1))
    laws = blend(fit, others, about)
    assert np.ptp(laws.masses / fit.masses) > 1e-3
    run = simulate(laws.structure(), np.ascontiguousarray(case.f[:, None] * laws.masses), DT)
    stream = DriftStream(model, kind=DriftSmoother, about=about)
    for sample in samples(7):
        stream.step(sample)
    np.testing.assert_allclose(stream.filter.a[0], run.a[-1], rtol=1e-3, atol=1e-3)
    heavy = Structure([1.3, 0.8, 1.1] * laws.masses, laws.structure().elements)
    run = simulate(heavy, np.ascontiguousarray(case.f[:, None] * heavy.masses), DT)
    stream.filter.grounds = [np.zeros(1)] * len(case.f)
    stream.filter.answers = [y[stream.filter.storeys, None] for y in run.y[::-1]]
    left = stream.filter.nonlinearity(heavy)
    assert np.sqrt(left.max()) < 1e-3 * np.abs(run.y).max()


def test_a_law_that_escapes_says_nothing() -> None:
    case = Case(7)
    first = case.fit.elements["r1"]
    assert isinstance(first, Bilinear)
    soft = replace(first, post_yield_stiffness=-0.5 * first.stiffness)
    case.laws = [case.fit, Structure(list(MASSES), {**case.fit.elements, "r1": soft}), case.fit]
    rows, _, found = case.followed()
    steps = found.states.at[:, 0].tolist()
    assert steps == pytest.approx([steps[0], 0.0, steps[2]])
    assert np.isfinite(rows).all()
    assert not found.of_drifts[:, -2:].any()


def samples(seed: int) -> list[Sample]:
    case = Case(seed)
    f, a = torch.from_numpy(case.f)[:, None], torch.from_numpy(case.a)
    return [Sample(f=u, a=row, time=DT * k) for k, (u, row) in enumerate(zip(f, a, strict=True))]


def test_a_stream_begins_at_the_posterior_of_the_fit() -> None:
    stream, true = identified().stream(), Case(7).drifts
    assert isinstance(stream, DriftStream)
    now = []
    for k, sample in enumerate(samples(7)):
        if k == 200:
            sample = replace(sample, a=torch.full((1,), torch.nan, dtype=torch.float64))
        stream.step(sample)
        now.append(stream.drifts[0])
    assert stream.watch.kinds == {"not_finite": 1}
    assert error(np.array(now), true) < 0.1
    np.testing.assert_allclose(np.abs(stream.drifts[2]), np.abs(true).max(axis=0), rtol=0.1)
    assert set(stream.numbers) >= {"drift3", "half1", "innovations"}
    assert len(stream.weights[0]) == len(list(identified().about()[0])) < 32


def test_a_stream_begins_with_a_deviation_in_each_direction_or_with_draws() -> None:
    """As draws leave weights to chance where data determine many; older models have these alone."""
    older = copy.deepcopy(identified())
    older.off.zero_()
    for model, variance, count in ((identified(), 1.0, 22), (older, 1.0 / 32.0, 32)):
        found = model.stream().filter
        assert len(found.c) == count
        np.testing.assert_allclose(found.C.diagonal()[-count:], variance)
        if variance == 1.0:
            own = model.about()[0][0].structure().parameters
            np.testing.assert_array_equal(found.states.p[1], own)


def test_a_stream_tells_that_it_lost_the_structure() -> None:
    stream = identified().stream()
    for sample in samples(7):
        stream.step(replace(sample, a=None if sample.a is None else 3.0 * sample.a))
    assert stream.watch.kinds["diverged"] == 1
    assert stream.numbers["watch"] == 2.0
    assert np.isnan(stream.drifts[1]).all()


@pytest.mark.parametrize(("missing", "lost"), [(3, False), (round(2.0 / DT), True)])
def test_a_ground_that_did_not_come_is_bridged_for_some_samples(missing: int, lost: bool) -> None:
    stream, true, outside = identified().stream(), Case(7).drifts, []
    for k, sample in enumerate(samples(7)):
        if 100 <= k < 100 + missing:
            sample = replace(sample, f=torch.full((1,), torch.nan, dtype=torch.float64))
        stream.step(sample)
        now, half = stream.drifts[:2]
        if k >= 100 and not stream.filter.diverged:
            outside.append(np.abs(now - true[k]) > half)
    assert stream.filter.diverged == lost
    assert lost or np.mean(outside) < 0.2  # 0.15 where all came


def test_the_largest_drifts_outlast_a_gap_after_which_all_begins_at_rest() -> None:
    stream = identified().stream()
    for k, sample in enumerate(samples(7)[:360]):
        stream.step(replace(sample, time=k * DT))
    before = stream.drifts[2:].copy()
    stream.step(replace(samples(7)[0], time=1000.0 * DT))
    assert (stream.drifts[0] == 0.0).all()
    assert (stream.drifts[2:] == before).all()


def test_a_model_without_likely_laws_has_no_stream_of_drifts() -> None:
    with pytest.raises(ValueError, match="identify it again"):
        network([1, 2, 3], "Bilinear").stream()


def of_law(law: type[Element], **own: float) -> Structure:
    """The chain of test_hidden_floors with storeys of another law."""
    parts = {}
    for name, element in structure().elements.items():
        assert isinstance(element, Bilinear)
        k, y = element.stiffness, element.yield_displacement
        sizes = {"stiffness": k, "yield_displacement": y, "damping": element.damping}
        parts[name] = law(between=element.between, **sizes, **own)
    return Structure(list(MASSES), parts)


@pytest.mark.parametrize(
    "chain",
    [
        structure(),
        of_law(Takeda, hardening_ratio=0.05, unloading_exponent=0.4),
        of_law(MenegottoPinto, hardening_ratio=0.05),
    ],
)
def test_what_noise_does_to_drifts_is_simulated_past_yielding_and_turns(chain: Structure) -> None:
    """Noise in the first sample, against the difference of two motions."""
    T, small, dt = 300, 1e-2, 0.01
    f = np.convolve(np.random.default_rng(3).standard_normal(T), np.hanning(20), mode="same")
    f *= 6.0 / np.abs(f).max()
    found, deltas = DriftFilter([chain, chain], range(3), ROOF, np.array([1.0]), 0.0, dt, 4.0), []
    for k in range(T):
        a = found.predict(f[k] * chain.masses, NONE, NONE)
        if k == 0:
            found.s[len(found.A)] = small
        deltas.append(found.of_drifts @ found.s)
        found.correct(a)
    pulse = small * (np.arange(T) == 0)
    own, other = (simulate(chain, (f + u)[:, None] * chain.masses, dt).y for u in (0.0, pulse))
    assert (np.abs(own).max(axis=0) > np.array(YIELDS)).sum() >= 2
    true = other - own
    off = np.abs(np.array(deltas) - true).max(axis=1) / np.abs(true).max()
    assert off.max() < 0.25  # where one yields, and the other in the next sample
    assert off[-1] < 0.05


def test_smoothed_drifts_are_nearer_than_on_line_and_as_sure_as_they_say() -> None:
    near, far, held = [], [], []
    for seed in (1, 2, 3):
        case = Case(seed)
        rows, _, _ = case.followed()
        found = case.filter(kind=DriftSmoother)
        for u, row in zip(case.f, case.a, strict=True):
            found.predict(u * case.fit.masses, NONE, NONE)
            found.correct(row)
        y, half = found.smoothed()
        np.testing.assert_allclose(y[-1], rows[-1, 0], rtol=1e-9)
        near.append(error(y, case.drifts))
        far.append(error(rows[:, 0], case.drifts))
        held.append((np.abs(y - case.drifts) <= half).mean())
    assert np.mean(near) < 0.9 * np.mean(far)
    assert np.mean(held) > 0.8  # three times 1,800 values, of few independent ones


@pytest.mark.parametrize("others", [0, 1])
def test_smoothed_drifts_of_a_linear_chain_are_those_of_all_samples_at_once(others: int) -> None:
    """Weights of laws, noise of the ground and the zero of a wire by linear least squares."""
    T, rng = 40, np.random.default_rng(0)
    of = [scattered(structure(longer=1e3), 0.02, rng) for _ in range(4)]  # far from yielding
    f = 0.1 * rng.standard_normal(T)
    noise, ground = np.array([0.01, 1e-4][: 1 + others]), 0.02
    wire = np.array([[0.0, 1.0, -1.0]])[:others]

    def response(one: Structure, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Drifts (T, 3), and what the sensors have (T, ·)."""
        motion = simulate(one, u[:, None] * one.masses, DT)
        return motion.y, np.hstack([motion.a[:, ROOF], motion.x @ wire.T])

    drawn = ground * rng.standard_normal(T)
    base, measured = response(of[0], f)
    columns = [np.hstack(response(one, f)) - np.hstack([base, measured]) for one in of[1:]]
    for row in np.eye(T):  # linear: by superposition; sensors have what stands against the base
        y, seen = response(of[0], row)
        seen[:, 0] -= row
        columns.append(np.hstack([y, seen]))
    columns += [np.tile(np.eye(4 + others)[4 + j], (T, 1)) for j in range(others)]
    A = np.array(columns)
    widths = np.array([3.0**-0.5] * 3 + [ground] * T + [1e3] * others)
    true = np.array([0.3, -0.2, 0.1, *drawn, *[0.05] * others])
    z = measured + np.einsum("p,ptc->tc", true, A[:, :, 3:])
    z += noise * rng.standard_normal(z.shape)
    J = (A[:, :, 3:] / noise).reshape(len(A), -1).T
    C = np.linalg.inv(J.T @ J + np.diag(widths**-2.0))
    expected = base + np.einsum("p,ptc->tc", C @ J.T @ ((z - measured) / noise).ravel(), A[..., :3])
    variances = np.einsum("ptc,pq,qtc->tc", A[..., :3], C, A[..., :3])
    found = DriftSmoother(of, range(3), ROOF, noise, ground, DT, np.inf, wire)
    for u, row in zip(f, z, strict=True):
        found.predict(u * of[0].masses, NONE, NONE)
        found.correct(row[:1], row[1:])
    y, half = found.smoothed()
    np.testing.assert_allclose(y, expected, atol=0.02 * float(np.abs(expected).max()))
    np.testing.assert_allclose(half[5:], 1.96 * np.sqrt(variances[5:]), rtol=0.03)


def smoothed_by(found: DriftSmoother, f: np.ndarray, z: np.ndarray) -> np.ndarray:
    for u, row in zip(f, z, strict=True):
        found.predict(u * found.fit.masses, NONE, NONE)
        found.correct(row[: len(found.sensors)], row[len(found.sensors) :])
    return found.smoothed()


@pytest.mark.parametrize("wires", [0, 1])
def test_drawn_grounds_are_those_that_all_samples_leave_open(wires: int) -> None:
    """In a linear chain of known laws runs on these have the drifts, and the spread, of s.

    wires: that measure x1, with a zero that is not known.
    """
    T, rng, of = 300, np.random.default_rng(0), structure(longer=1e3)
    f, ground, noise = 0.1 * rng.standard_normal(T), 0.02, np.array([0.01, 1e-4])[: 1 + wires]
    w = ground * rng.standard_normal(T)
    motion, wire = simulate(of, (f + w)[:, None] * of.masses, DT), np.eye(wires, 3)
    seen = np.hstack([motion.a[:, ROOF] - w[:, None], motion.x @ wire.T + 0.05])
    z = seen + noise * rng.standard_normal(seen.shape)
    found = DriftSmoother([of, of], range(3), ROOF, noise, ground, DT, np.inf, wire)
    y, half = smoothed_by(found, f, z)
    answers = np.array(found.answers[::-1])
    spread = np.square(answers - y[:, :, None])[10:].mean()
    assert spread == pytest.approx(np.square(half[10:] / 1.96).mean(), rel=0.15)
    assert found.nonlinearity(of)[10:].mean() < 1e-4 * spread


def test_what_a_structure_has_beside_linear_drifts_is_counted_where_it_yields() -> None:
    shares = []
    for size in (1.0, 0.01):
        case, true = Case(1), structure()
        noise, ground = size * np.array([case.roof]), size * case.ground
        found = DriftSmoother([true, true], range(3), ROOF, noise, ground, DT, np.inf)
        _, half = smoothed_by(found, size * case.f, size * case.a)
        shares.append(found.nonlinearity(true)[50:].mean() / np.square(half[50:] / 1.96).mean())
    assert shares[0] > 0.05
    assert shares[1] < 1e-3


def test_intervals_by_the_sensors_have_what_is_not_linear(monkeypatch: pytest.MonkeyPatch) -> None:
    case, model = Case(7), identified()
    f, a = torch.from_numpy(case.f)[:, None], torch.from_numpy(case.a)
    wider = smoothed(model, Record(DT, a, f))
    monkeypatch.setattr(DriftSmoother, "nonlinearity", lambda *_: 0.0)
    linear = smoothed(model, Record(DT, a, f))
    assert wider is not None
    assert linear is not None
    np.testing.assert_array_equal(wider[0], linear[0])
    assert (wider[1] >= linear[1]).all()
    assert np.mean(wider[1] / linear[1].clip(1e-12)) > 1.05


def test_innovations_that_are_too_large_widen_all_of_an_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    case, model, halves = Case(7), identified(), []
    f, a = torch.from_numpy(case.f[:200])[:, None], torch.from_numpy(case.a[:200])
    for times in (1.0, 4.0):
        monkeypatch.setattr(DriftSmoother, "wide", times)
        found = smoothed(model, Record(DT, a, f))
        assert found is not None
        halves.append(found[1])
    np.testing.assert_allclose(halves[1], 2.0 * halves[0])
