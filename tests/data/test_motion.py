"""The integrator against exact solutions, an independent reference, energy and symmetry."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from data import BoucWen, LimitedSlip, Polynomial, parallel
from data.parallel import in_threads
from data.simulation.damage import StiffnessLoss
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from tests.reference import paper_structure, reference_response

DT = 0.01
SUPPORT_STD = {"bilinear": 0.05, "polynomial": 0.1, "bouc_wen": 0.03}  # [m]


def relative_rms(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def forces(structure, excitation, samples=500, dt=DT, seed=0):
    return excitation.draw(structure, samples, dt, 0, np.random.default_rng(seed))[0]


def damaged(structure, damage, *drive, dt=DT, tolerance=1e-7):
    """The motion of a structure that changes; drive: forces, perhaps s and ṡ of supports."""
    if damage is None:
        return simulate(structure, drive[0], dt, *drive[1:], tolerance=tolerance)
    changes, start = damage.changes(structure, len(drive[0]), dt), damage.at_rest(structure)
    return simulate(start, drive[0], dt, *drive[1:], tolerance=tolerance, changes=changes)


def linear_step(structure, q, f0, f1, h):
    """Exact [x, v] after a time h, in which the force goes from f0 to f1 in a straight line."""
    M, C, K = structure.linearised()
    n, inverse = structure.dofs, np.linalg.inv(M)
    held = np.zeros((4 * n, 4 * n))
    held[:n, n : 2 * n] = h * np.eye(n)
    held[n : 2 * n, : 3 * n] = h * np.hstack([-inverse @ K, -inverse @ C, inverse])
    held[2 * n : 3 * n, 3 * n :] = np.eye(n)
    return (expm(held) @ np.concatenate([q, f0, f1 - f0]))[: 2 * n]


def test_linear_motion_equals_the_matrix_exponential(linear_structure):
    force = forces(linear_structure, Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.5))))
    motion = simulate(linear_structure, force, DT, tolerance=1e-12)
    q = [np.zeros(6)]
    for before, now in pairwise(force):
        q.append(linear_step(linear_structure, q[-1], before, now, DT))
    x, v = np.split(np.array(q), 2, axis=1)
    M, C, K = linear_structure.linearised()
    a = (force - v @ C - x @ K) / np.diag(M)
    for ours, exact in zip((motion.x, motion.v, motion.a), (x, v, a), strict=True):
        assert relative_rms(ours, exact) < 1e-9


@pytest.mark.parametrize("shaken", [False, True])
def test_motion_equals_the_event_located_reference(structure, excitation, system, shaken):
    """On supports that stand still, and on supports that move."""
    supports = BandLimitedGaussian(SUPPORT_STD[system], (0.0, 2.0)) if shaken else None
    driven = Excitation(excitation.force, supports)
    drive = driven.draw(structure, 100 if shaken else 150, DT, 0, np.random.default_rng(2))
    motion = simulate(structure, drive[0], DT, *drive[1:])
    reference = reference_response(*paper_structure(system), DT, *drive)
    assert motion.escape_time is None
    allowed = 1e-5 if system == "bilinear" else 1e-6
    for name in "xvayr":
        assert relative_rms(getattr(motion, name)[1:], reference[name][1:]) < allowed, name


@pytest.mark.parametrize(("n", "eta_rate", "nu_rate"), [(2.0, 0.2, 0.4), (1.5, 0.0, 0.3)])
def test_bouc_wen_of_any_power_and_degradation_equals_the_reference(n, eta_rate, nu_rate):
    ends = {"base": ("s1", "x1"), "link": ("x1", "x2")}
    law = {"eta": 1.3, "nu": 0.8, "eta_rate": eta_rate, "nu_rate": nu_rate}
    ours = Structure(
        [0.7, 1.4],
        {
            name: BoucWen(between=b, stiffness=40.0, beta=12.0, gamma=-5.0, exponent=n, **law)
            for name, b in ends.items()
        },
    )
    theirs = [
        {"law": "bouc_wen", "start": a, "end": b, "A": 40.0, "beta": 12.0, "gamma": -5.0, "n": n}
        | law
        for a, b in ends.values()
    ]
    force = forces(ours, Excitation(force=BandLimitedGaussian(4.0, (0.0, 3.0))), 100)
    reference = reference_response(ours.masses, theirs, DT, force)
    assert relative_rms(simulate(ours, force, DT).a, reference["a"]) < 1e-6
    assert relative_rms(simulate(ours, force, DT).r, reference["r"]) < 1e-6


def test_accelerations_obey_the_equation_of_motion_at_every_sample(structure, excitation):
    force = forces(structure, excitation)
    motion = simulate(structure, force, DT)
    B, _ = structure.incidence()
    assert_allclose(motion.a * structure.masses + motion.r @ B, force, atol=1e-12 * force.std())
    assert_allclose(motion.y, motion.x @ B.T, atol=1e-14)


@pytest.mark.parametrize("damage", [None, StiffnessLoss("r2", 2.137, 0.5)], ids=["sound", "hurt"])
def test_error_falls_in_step_with_the_tolerance(structure, excitation, damage):
    """Samples are 0.1 s apart, and a change is between two of them."""
    force = forces(structure, excitation, 50, dt=0.1)
    exact, *motions = (
        damaged(structure, damage, force, dt=0.1, tolerance=t).a
        for t in (1e-13, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
    )
    tolerances = np.array([1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
    errors = [relative_rms(a, exact) for a in motions]
    slope = np.polyfit(np.log10(tolerances), np.log10(errors), 1)[0]
    assert 0.6 < slope < 1.2
    assert errors[-1] < 1e-6


@pytest.mark.parametrize(
    ("damage", "least", "most"), [(None, 4.7, 5.6), (StiffnessLoss("r2", 1.03, 0.5), 4.5, 5.7)]
)
def test_the_step_is_of_fifth_order_on_the_smooth_system(polynomial_structure, damage, least, most):
    """One step per sample, under a force that is linear between samples 0.08 s apart."""
    coarse = 3.0 * np.random.default_rng(0).standard_normal((26, 3))

    def displacement(parts: int, tolerance: float) -> np.ndarray:
        grid = np.arange(25 * parts + 1) / parts
        force = np.stack([np.interp(grid, np.arange(26), f) for f in coarse.T], axis=1)
        step = {"dt": 0.08 / parts, "tolerance": tolerance}
        return damaged(polynomial_structure, damage, force, **step).x[::parts]

    exact = displacement(16, 1e-13)
    parts = np.array([2, 4, 8, 16])
    errors = [relative_rms(displacement(p, 1e-3), exact) for p in parts]
    order = -np.polyfit(np.log2(parts), np.log2(errors), 1)[0]
    assert least < order < most


@pytest.mark.parametrize("damage", [None, StiffnessLoss("r2", 1.50037, 0.5)], ids=["sound", "hurt"])
def test_energy_put_in_is_stored_or_taken_up(structure, excitation, system, damage):
    dt = 0.001
    shaken = Excitation(excitation.force, BandLimitedGaussian(SUPPORT_STD[system] / 3, (0.0, 2.0)))
    force, s, s_dot = shaken.draw(structure, 4000, dt, 0, np.random.default_rng(0))
    motion = damaged(structure, damage, force, s, s_dot, dt=dt)
    B_s = structure.incidence()[1]
    power = (force * motion.v).sum(axis=1) + (motion.r @ B_s * s_dot).sum(axis=1)
    put_in = np.concatenate([[0.0], np.cumsum(0.5 * dt * (power[1:] + power[:-1]))])
    kinetic = 0.5 * (structure.masses * motion.v**2).sum(axis=1)
    balance = kinetic + motion.work.sum(axis=1) - put_in
    assert np.abs(balance).max() < 2e-5 * np.abs(put_in).max()


def test_in_a_frame_that_moves_with_the_supports_inertia_acts_as_a_force(structure, excitation):
    """The whole structure on one shaking table: x = u + s, with −M s̈ acting on u."""
    force = forces(structure, excitation, 400)
    s_ddot = forces(structure, excitation, 400, seed=7)[:, :1]
    s_dot, s = np.zeros((400, 1)), np.zeros((400, 1))
    for k in range(1, 400):  # exact for a table acceleration that is linear between samples
        s_dot[k] = s_dot[k - 1] + 0.5 * DT * (s_ddot[k - 1] + s_ddot[k])
        s[k] = s[k - 1] + DT * s_dot[k - 1] + DT**2 / 6 * (2 * s_ddot[k - 1] + s_ddot[k])
    everywhere = np.ones((1, 3))
    tight = {"tolerance": 1e-10}
    shaken = simulate(structure, force, DT, s * everywhere, s_dot * everywhere, **tight)
    fixed = simulate(structure, force - structure.masses * s_ddot, DT, **tight)
    assert relative_rms(shaken.x - s, fixed.x) < 1e-6
    assert relative_rms(shaken.a - s_ddot, fixed.a) < 1e-6
    assert relative_rms(shaken.r, fixed.r) < 1e-6


@pytest.mark.parametrize("law", ["outer", "inner"])
def test_two_equal_elements_side_by_side_are_one_of_twice_the_stiffness(bilinear_structure, law):
    """Both yield, slip and close their gap at the same instant."""
    like = vars(bilinear_structure.elements["r1" if law == "outer" else "r2"])
    kind = type(bilinear_structure.elements["r1" if law == "outer" else "r2"])
    single = like | {"between": ("s1", "x1")}
    double = {k: 2 * u if "stiffness" in k or "damping" in k else u for k, u in single.items()}
    pair = Structure([1.0], {"a": kind(**single), "b": kind(**single)})
    one = Structure([1.0], {"c": kind(**double)})
    force = forces(one, Excitation(force=BandLimitedGaussian(2.0, (0.0, 3.0))))
    together, alone = simulate(pair, force, DT), simulate(one, force, DT)
    assert np.abs(alone.y).max() > 0.03
    assert_array_equal(together.r[:, 0], together.r[:, 1])
    assert relative_rms(together.a, alone.a) < 1e-6


def test_reordered_elements_give_the_reordered_forces(structure, excitation):
    force = forces(structure, excitation)
    names = ["r4", "r1", "r6", "r3", "r5", "r2"]
    reordered = Structure(structure.masses, {name: structure.elements[name] for name in names})
    motion, again = simulate(structure, force, DT), simulate(reordered, force, DT)
    columns = [list(structure.elements).index(name) for name in names]
    assert relative_rms(again.r, motion.r[:, columns]) < 1e-9
    assert relative_rms(again.work, motion.work[:, columns]) < 1e-9
    assert relative_rms(again.a, motion.a) < 1e-9


def test_many_records_and_repeated_calls_give_the_same_bits(structure, excitation, monkeypatch):
    shaken = Excitation(excitation.force, BandLimitedGaussian(0.01, (0.0, 2.0)))
    draws = [shaken.draw(structure, 200, DT, 0, np.random.default_rng(i)) for i in range(4)]
    monkeypatch.setattr(parallel, "CORES", 2)
    motions = in_threads(lambda one: simulate(structure, one[0], DT, *one[1:]), draws)
    for drive, together in zip(draws, motions, strict=True):
        alone = simulate(structure, drive[0], DT, *drive[1:])
        for name in ("x", "v", "a", "y", "r", "work"):
            assert_array_equal(getattr(together, name), getattr(alone, name))


def softening() -> Structure:
    """A spring that is exhausted at y = 1 m, at a force of 2/3 · 30 N."""
    spring = Polynomial(between=("s1", "x1"), stiffness=30.0, damping=1.0, cubic_stiffness=-10.0)
    return Structure([1.0], {"r": spring})


def test_a_motion_pushed_over_the_top_of_a_softening_spring_escapes():
    force = np.full((600, 1), 25.0)
    motion = simulate(softening(), force, DT)
    assert motion.escape_time is not None
    assert 0.2 < motion.escape_time < 3.0
    before = int(motion.escape_time / DT) - 2
    shorter = simulate(softening(), force[:before], DT)
    assert shorter.escape_time is None
    assert_array_equal(motion.a[:before], shorter.a)
    finer = simulate(softening(), np.full((6000, 1), 25.0), DT / 10)
    assert abs(finer.escape_time - motion.escape_time) < 1e-3


@pytest.mark.parametrize("size", [1e3, 1e8, 1e60, 1e100, 1e200])
def test_no_motion_is_handed_out_as_nan(size):
    motion = simulate(softening(), np.full((100, 1), size), DT)
    assert motion.escape_time is not None
    assert np.isfinite(motion.x).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": np.zeros((50, 2))}, r"force has shape \(50, 2\); expected \(50, 3\)"),
        ({"force": np.zeros(50)}, r"force has shape \(50,\)"),
        ({"force": np.full((50, 3), np.nan)}, "force is not finite at sample 0"),
        ({"force": np.vstack([np.zeros((7, 3)), np.full((1, 3), np.inf)])}, "sample 7"),
        ({"support": np.zeros((49, 3))}, r"support has shape \(49, 3\); expected \(50, 3\)"),
        ({"support_velocity": np.zeros((50, 1))}, "support_velocity has shape"),
        ({"support": np.full((50, 3), np.nan)}, "support is not finite"),
        ({"dt": 0.0}, "dt=0.0 s must be positive"),
        ({"dt": -0.01}, "must be positive"),
        ({"dt": np.nan}, "must be positive"),
        ({"tolerance": 0.0}, "tolerance=0.0"),
        ({"tolerance": 0.1}, "tolerance=0.1"),
    ],
)
def test_input_that_fits_no_structure_is_refused(bilinear_structure, change, message):
    still = {"force": np.zeros((50, 3)), "dt": DT}
    still |= {"support": np.zeros((50, 3)), "support_velocity": np.zeros((50, 3))}
    simulate(bilinear_structure, **still)
    with pytest.raises(ValueError, match=message):
        simulate(bilinear_structure, **(still | change))


def test_a_slider_never_carries_more_than_its_yield_force():
    """z is put exactly on the yield surface; a slider left beyond it would yield when unloading."""
    slider = LimitedSlip(
        between=("ground", "x1"),
        yield_displacement=0.02,
        stiffness=40.0,
        gap_stiffness=40.0,
        gap=100.0,
    )
    spring = Polynomial(between=("ground", "x1"), stiffness=20.0, damping=0.2)
    structure = Structure([1.0], {"slider": slider, "spring": spring})
    force = 2.0 * np.random.default_rng(5).standard_normal((2000, 1)).cumsum(axis=0) / 5.0
    friction = simulate(structure, force, 0.01).r[:, 0]
    limit = 40.0 * 0.02
    assert (np.abs(friction) == limit).mean() > 0.2
    assert np.abs(friction).max() == limit
