"""Elements that change during a record: exact solutions, the reference, fibres, energy, truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from data import Bilinear, BoucWen, LimitedSlip, Polynomial
from data.simulation.damage import HystereticDegradation, StiffnessLoss
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.motion import simulate
from data.simulation.records import Simulation
from data.simulation.scenario import FullState, Noisy
from data.simulation.structure import Structure
from runner.config.compose import composed
from tests.data.test_motion import DT, damaged, forces, linear_step, relative_rms
from tests.experiments import data_from
from tests.reference import paper_structure, reference_response

NAMES = ("x", "v", "a", "y", "r", "work")


@pytest.mark.parametrize("time", [1.0, 1.2345, 1.2399999, 0.004])
def test_a_linear_structure_follows_one_matrix_exponential_and_then_the_other(
    linear_structure, time
):
    force = forces(linear_structure, Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.5))), 300)
    weak = dict(linear_structure.elements)
    weak["r2"] = replace(weak["r2"], stiffness=0.6 * weak["r2"].stiffness)
    after = Structure(linear_structure.masses, weak)
    q = [np.zeros(6)]
    for k in range(1, 300):
        sound = np.clip(time - (k - 1) * DT, 0.0, DT)  # time before the change
        middle = force[k - 1] + sound / DT * (force[k] - force[k - 1])
        state = linear_step(linear_structure, q[-1], force[k - 1], middle, sound)
        q.append(linear_step(after, state, middle, force[k], DT - sound))
    motion = damaged(linear_structure, StiffnessLoss("r2", time, 0.4), force, tolerance=1e-12)
    exact = np.array(q)
    assert relative_rms(motion.x, exact[:, :3]) < 1e-9
    assert relative_rms(motion.v, exact[:, 3:]) < 1e-9
    sound = simulate(linear_structure, force, DT, tolerance=1e-12)
    assert relative_rms(sound.x, exact[:, :3]) > 1e-2


def test_a_damaged_motion_equals_the_event_located_reference(structure, excitation, system):
    """Of outer elements in the one structure, of inner ones in the others."""
    element = "r1" if system == "bilinear" else "r2"
    force, kept, k = forces(structure, excitation, 120), 0.7, 50
    masses, laws = paper_structure(system)
    after, factors = [dict(law) for law in laws], np.ones(6)
    weak = after[list(structure.elements).index(element)]
    for name in ("k1", "k2", "p1", "p3", "A"):
        if name in weak:
            weak[name] *= kept
    if system == "bouc_wen":
        factors[list(structure.elements).index(element)] = kept
    reference = reference_response(masses, laws, DT, force, change=(k, after, factors))
    motion = damaged(structure, StiffnessLoss(element, k * DT, 1.0 - kept), force)
    allowed = 1e-5 if system == "bilinear" else 1e-6
    for name in "xvayr":
        assert relative_rms(getattr(motion, name), reference[name]) < allowed, name
    assert relative_rms(simulate(structure, force, DT).a, reference["a"]) > 1e-2


def test_before_the_damage_all_bits_are_those_of_the_sound_structure(structure, excitation):
    force = forces(structure, excitation)
    sound = simulate(structure, force, DT)
    for time, first in ((2.0, 200), (2.0001, 201)):
        motion = damaged(structure, StiffnessLoss("r2", time, 0.2), force)
        for name in NAMES:
            ours, theirs = getattr(motion, name), getattr(sound, name)
            assert_array_equal(ours[:first], theirs[:first])
            assert not np.array_equal(ours[first:], theirs[first:])
        assert motion.r[first, 1] != sound.r[first, 1]


def half_of(element):
    """An element of which two side by side are the given one, by hand."""
    more = {"between": element.between}
    if isinstance(element, BoucWen):  # n = 2: r/2 obeys A/2, 2β, 2γ
        more |= {"stiffness": element.stiffness / 2, "beta": 2 * element.beta}
        more |= {"gamma": 2 * element.gamma}
    else:
        halved = {k: v / 2 for k, v in vars(element).items() if "stiffness" in k or "damping" in k}
        more |= halved
    return replace(element, **more)


FIBRED = {
    "bilinear": Bilinear(
        between=("s1", "x1"), yield_displacement=0.02, stiffness=40.0, post_yield_stiffness=10.0,
    ),
    "limited_slip": LimitedSlip(
        between=("s1", "x1"), yield_displacement=0.01, stiffness=40.0, gap_stiffness=30.0, gap=0.03,
    ),
    "polynomial": Polynomial(between=("s1", "x1"), stiffness=40.0, cubic_stiffness=100.0),
    "bouc_wen": BoucWen(
        between=("s1", "x1"), stiffness=40.0, beta=12.0, gamma=-8.0, exponent=2.0, nu=1.2,
    ),
}  # fmt: skip


@pytest.mark.parametrize("law", FIBRED)
def test_to_lose_half_the_stiffness_is_to_lose_one_of_two_halves(law):
    """The slider, the gap and the force of the half that holds go on with their memory."""
    spring = Polynomial(between=("s1", "x1"), stiffness=20.0, damping=0.3)
    one = Structure([1.0], {"whole": FIBRED[law], "spring": spring})
    half = half_of(FIBRED[law])
    two = Structure([1.0], {"this": half, "that": half, "spring": spring})
    force = forces(one, Excitation(force=BandLimitedGaussian(2.0, (0.0, 3.0))))
    whole = damaged(one, StiffnessLoss("whole", 1.503, 0.5), force, tolerance=1e-11)
    halves = damaged(two, StiffnessLoss("that", 1.503, 1.0), force, tolerance=1e-11)
    assert np.abs(whole.y).max() > 0.04
    assert relative_rms(whole.a, halves.a) < 1e-7
    assert relative_rms(whole.r[:, 0], halves.r[:, 0] + halves.r[:, 1]) < 1e-7
    assert (halves.r[151:, 1] == 0.0).all()
    assert np.abs(halves.r[100:151, 1]).max() > 0.1


def test_the_energy_that_broken_fibres_had_stored_is_lost():
    spring = Polynomial(between=("s1", "x1"), stiffness=40.0, cubic_stiffness=900.0)
    structure = Structure([1.0], {"r": spring})
    force = np.zeros((400, 1))
    force[:20] = 3.0
    motion = damaged(structure, StiffnessLoss("r", 2.09, 0.25), force, tolerance=1e-10)
    stored = 20.0 * motion.y**2 + 225.0 * motion.y**4
    kinetic = 0.5 * motion.v**2
    before, after = (kinetic + stored)[21:209], (kinetic + 0.75 * stored)[209:]
    assert_allclose(before, before[0, 0], rtol=1e-8)
    assert_allclose(after, before[0, 0] - 0.25 * stored[209, 0], rtol=1e-8)
    assert stored[209, 0] > 0.3 * before[0, 0]


def test_a_gradual_loss_is_a_straight_line_to_second_order():
    """One mass on a linear spring whose stiffness falls from 1 s to 4 s."""
    structure = Structure([1.0], {"r": Polynomial(between=("s1", "x1"), stiffness=40.0, damping=1)})
    damage = StiffnessLoss("r", 1.0, 0.5, duration=3.0)

    def push(t):
        return np.sin(5.0 * t)

    def slope(t, q):
        k = 40.0 * (1.0 - 0.5 * np.clip((t - 1.0) / 3.0, 0.0, 1.0))
        return [q[1], push(t) - k * q[0] - q[1]]

    errors = []
    for dt in (0.02, 0.01, 0.005):
        t = dt * np.arange(round(5.0 / dt) + 1)
        x = damaged(structure, damage, push(t)[:, None], dt=dt, tolerance=1e-10).x[:, 0]
        held = simulate(structure, push(t)[:, None], dt, tolerance=1e-10).x[:, 0]
        exact = solve_ivp(slope, (0, 5), [0, 0], "DOP853", t, rtol=1e-11, atol=1e-13, max_step=0.05)
        errors.append(relative_rms(x, exact.y[0]))
    assert relative_rms(held, exact.y[0]) > 0.1
    assert errors[-1] < 2e-4
    assert 1.8 < np.log2(errors[0] / errors[2]) / 2 < 2.2


def test_a_worn_element_softens_with_the_energy_that_it_took_up():
    """Without β and γ, ṙ = A ẏ/η: the slope of the force over the deformation tells η."""
    between = ("s1", "x1")
    sound = BoucWen(between=between, stiffness=40.0, beta=0.0, gamma=0.0, eta=1.5)
    spring = Polynomial(between=between, stiffness=10.0, damping=0.5)
    structure, damage = Structure([1.0], {"r": sound, "s": spring}), HystereticDegradation("r", 0.8)
    force = forces(structure, Excitation(force=BandLimitedGaussian(20.0, (0.0, 2.0))), 4000, 0.001)
    motion = damaged(structure, damage, force, dt=0.001)
    kept = damage.kept(structure, motion.work, 0.001)
    rise, way = np.diff(motion.r[:, 0]), np.diff(motion.y[:, 0])
    fast = np.abs(way) > 0.2 * np.abs(way).max()
    mean = 0.5 * (kept[1:, 0] + kept[:-1, 0])
    assert_allclose((rise / way)[fast], (40.0 / 1.5 * mean)[fast], rtol=2e-4)
    assert kept.min() < 0.8
    assert (kept[:, 1] == 1.0).all()


def test_damage_leaves_an_element_the_wear_of_its_own():
    worn = BoucWen(between=("s1", "x1"), stiffness=40.0, beta=1.0, gamma=1.0, eta_rate=0.5)
    damage = HystereticDegradation("r", eta_rate=0.1, nu_rate=0.2)
    element = damage.at_rest(Structure([1.0], {"r": worn})).elements["r"]
    assert_allclose([element.eta_rate, element.nu_rate], [0.6, 0.2])
    kept = damage.kept(Structure([1.0], {"r": worn}), np.ones((2, 1)), DT)
    assert_allclose(kept, 1.0 / 1.6)


@pytest.fixture
def simulation(bilinear_structure):
    force = Excitation(force=BandLimitedGaussian(1.7, (0.0, 4.5)))
    damage = StiffnessLoss("r2", 1.995, 0.2)
    return Simulation(bilinear_structure, force, FullState(), DT, 4.0, damage=damage)


def test_only_test_motions_are_damaged(simulation):
    sound = replace(simulation, damage=None)
    (ours,), (theirs,) = (s.records("train", 1, seed=0)[0] for s in (simulation, sound))
    assert torch.equal(ours.truth.r, theirs.truth.r)
    assert ours.truth.kept is None
    (ours, _), (theirs, _) = (s.records("test", 2, seed=0)[0] for s in (simulation, sound))
    assert torch.equal(ours.f, theirs.f)
    assert torch.equal(ours.a[:200], theirs.a[:200])
    assert (ours.a[200:] != theirs.a[200:]).any(dim=1).all()
    assert simulation.error("train", 0) == sound.error("train", 0) != simulation.error("test", 0)


def test_the_truth_knows_what_was_lost_and_when(simulation):
    record = replace(simulation, scenario=Noisy()).records("test", 1, seed=0)[0][0]
    kept = torch.ones(400, 6, dtype=torch.float64)
    kept[200:, 1] = 0.8
    assert torch.equal(record.truth.kept, kept)
    assert torch.equal(record.window(190, 20).truth.kept, kept[190:210])
    assert record.measured().truth is None


def test_measured_structures_are_not_damaged():
    with pytest.raises(ValueError, match="choose damage=none"):
        data_from(composed("data=measured", "data.path=x.csv", "damage=sudden"))


REFUSED = [
    (StiffnessLoss, ("r9", 2.0, 0.2), r"damage\.element=r9 is no element.*r1, r2, r3"),
    (StiffnessLoss, ("r2", 0.0, 0.2), r"damage\.time=0 s lies outside the record, 0 to 3\.99 s"),
    (StiffnessLoss, ("r2", np.nan, 0.2), r"damage\.time=nan s lies outside"),
    (StiffnessLoss, ("r2", 2.0, 0.2, 2.5), r"damage\.time=2 s to 4\.5 s lies outside"),
    (StiffnessLoss, ("r2", 2.0, 1.1), r"fraction=1\.1 must be a number above 0 and at most 1"),
    (StiffnessLoss, ("r2", 2.0, 0.2, -1.0), r"duration=-1\.0 must"),
    (HystereticDegradation, ("r9", 0.5), r"damage\.element=r9 is no element"),
    (HystereticDegradation, ("r2", 0.5), "r2 is LimitedSlip, and only BoucWen has η"),
    (HystereticDegradation, ("r2", np.nan), r"damage\.eta_rate=nan"),
    (HystereticDegradation, ("r2", 0.0, 0.0), "at least one above 0"),
]


@pytest.mark.parametrize(("make", "arguments", "message"), REFUSED)
def test_damage_that_cannot_be_is_refused(simulation, make, arguments, message):
    with pytest.raises(ValueError, match=message):
        replace(simulation, damage=make(*arguments))
