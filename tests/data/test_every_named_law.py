"""What holds for every named law: symmetry, energy, units, steps of any length, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicHermiteSpline

from data import (
    BaberNoori,
    FrictionPendulum,
    Maxwell,
    MenegottoPinto,
    Pinching4,
    PowerDamper,
)
from data.parallel import in_threads
from data.simulation.damage import StiffnessLoss
from data.simulation.element_test import force, growing_cycles, imposed, write
from data.simulation.laws import INLINED, NUMBERS, dispatch
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from tests.data.named_laws import (
    BETWEEN,
    DT,
    EVEN,
    HISTORY,
    LAWS,
    LENGTHS,
    OF_RATE,
    K,
    Y,
    _with_dt,
    every_law,
)
from tests.data.test_elements import UNDAMPED, eased

# --- all of them


def test_threads_that_need_a_law_at_once_find_it_in_one_place(monkeypatch):
    monkeypatch.setattr(dispatch, "_tables", {})
    places = set(in_threads(lambda _: dispatch.entry(NUMBERS["menegotto_pinto"]), range(8)))
    assert len(places) == 1
    assert all(dispatch.entry(NUMBERS[paper]) == NUMBERS[paper] for paper in INLINED)


@pytest.mark.parametrize("element", (EVEN | UNDAMPED).values(), ids=EVEN | UNDAMPED)
def test_a_mirrored_deformation_gives_the_mirrored_force_and_work(element):
    if isinstance(element, MenegottoPinto):
        element = replace(element, a3=element.a1)
    y, rate = eased(*HISTORY)
    forward, mirrored = imposed(element, y, DT, rate), imposed(element, -y, DT, -rate)
    assert_allclose(mirrored.r, -forward.r, atol=1e-9 * np.abs(forward.r).max())
    assert_allclose(mirrored.work, forward.work, atol=1e-9 * np.abs(forward.work).max())
    r = force(element, y, DT, rate)
    assert_allclose(force(element, -y, DT, -rate), -r, atol=1e-7 * np.abs(r).max())


@every_law
def test_no_closed_cycle_gives_energy(element):
    """Cycles of three random turns, each gone through six times, from one element at rest.

    The wall gives a little in some: its lines after a turn are no sum of what loses energy.
    """
    little = (0.01 if isinstance(element, Pinching4) else 1e-6) * K * Y**2
    rng = np.random.default_rng(1)
    for size in (0.5, 1.5, 4.0):
        for _ in range(4):
            cycle = [*(size * Y * rng.standard_normal(3)), 0.0]
            work = imposed(element, *_with_dt(eased(*(6 * cycle), samples=30))).work[:, 0]
            assert (work >= -little).all()
            assert work[-1] - work[-1 - 30 * len(cycle)] >= -little


@every_law
def test_other_units_of_length_and_force_change_nothing(element):
    """Millimetres and kilonewtons: the same force, a thousandth of the number."""
    length, unit = 1e3, 1e-3
    changes = {"between": BETWEEN}
    for name, power in LENGTHS.items():
        if hasattr(element, name):
            changes[name] = getattr(element, name) * length**power
    if isinstance(element, PowerDamper | Maxwell):  # powers of metres
        changes["damping"] = element.damping * length**-element.exponent
    if isinstance(element, PowerDamper):
        changes["stiffness"] = element.stiffness * length**-element.spring_exponent
    for name in ("stiffness", "back_stiffness", "weight", "damping", "force"):
        if name in vars(element):
            changes[name] = changes.get(name, getattr(element, name)) * unit
    for name in ("eta_rate", "nu_rate", "pinching_rate", "pinching_spread"):  # per energy, kN mm
        if hasattr(element, name):
            changes[name] = changes.get(name, getattr(element, name)) / (length * unit)
    y, rate = eased(*HISTORY)
    r = force(element, y, DT, rate)
    other = force(replace(element, **changes), length * y, DT, length * rate)
    assert_allclose(other, unit * r, atol=1e-7 * unit * np.abs(r).max())


OF_ANY_RATE = {name: law for name, law in LAWS.items() if name not in OF_RATE} | UNDAMPED


@pytest.mark.parametrize("element", OF_ANY_RATE.values(), ids=OF_ANY_RATE)
def test_steps_of_any_length_give_the_same_force(element):
    turns = HISTORY[:6]
    if isinstance(element, FrictionPendulum):
        element = replace(element, rate=0.0)
    slow, fast = (force(element, *_with_dt(eased(*turns, samples=n)))[::n] for n in (200, 40))
    assert_allclose(slow, fast, atol=1e-5 * np.abs(slow).max())


@every_law
def test_a_loss_of_fibres_scales_the_force_from_then_on(element):
    if isinstance(element, BaberNoori):  # its wear follows the work
        element = replace(element, eta_rate=0.0, nu_rate=0.0, pinching=0.0)
    y, rate = eased(*HISTORY)
    structure = Structure([1e30], {"r": element})
    changes = StiffnessLoss("r", 6.0, 0.3).changes(structure, y.size, DT)
    s, w = -y[:, None], -rate[:, None]
    sound, weak = (
        simulate(structure, 0.0 * s, DT, s, w, changes=c).r[:, 0] for c in (None, changes)
    )
    assert_allclose(weak[:600], sound[:600], rtol=0.0, atol=0.0)
    assert_allclose(weak[600:], 0.7 * sound[600:], atol=1e-6 * np.abs(sound).max())


@every_law
def test_energy_balances_in_a_structure(element):
    """Work of the force = kinetic energy + work taken up by the elements."""
    scale = 12.0 if isinstance(element, FrictionPendulum) else 2.0
    structure = Structure([2e4], {"r": element})
    t = 0.002 * np.arange(5001)
    f = scale * 1.2e4 * np.sin(2.0 * np.pi * 0.8 * t) * np.sin(0.15 * np.pi * t)
    motion = simulate(structure, f[:, None], 0.002)
    power = f * motion.v[:, 0]
    given = 0.002 * (np.cumsum(power) - 0.5 * power)
    kinetic = 0.5 * 2e4 * motion.v[:, 0] ** 2
    assert np.abs(motion.y).max() > 1.2 * Y
    assert_allclose(given, kinetic + motion.work[:, 0], atol=2e-4 * given.max())


@pytest.mark.parametrize("name", ["uneven joint", "uneven wall"])
def test_yield_forces_of_both_sides_are_those_of_a_pull(name):
    ends = [force(LAWS[name], np.linspace(0.0, end, 99), DT)[-1] for end in (Y, -0.7 * Y)]
    assert_allclose(LAWS[name].strengths(), np.abs(ends), rtol=1e-6)


def test_an_element_test_is_written_as_a_record(tmp_path):
    y = growing_cycles(0.03, 3, DT, 0.5)
    write(tmp_path / "test.csv", LAWS["flag"], y, DT)
    table = np.loadtxt(tmp_path / "test.csv", delimiter=",", skiprows=1)
    assert (tmp_path / "test.csv").read_text().startswith("time,s1,s_dot1,r1\n")
    assert_allclose(table[:, 1], y, atol=1e-10)
    assert_allclose(table[:, 3], force(LAWS["flag"], y, DT), atol=1e-5)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [((np.zeros((4, 2)), DT), "four at least"), ((np.zeros(9), 0.0), "must be positive"),
     ((np.full(9, np.nan), DT), "not finite at sample 0"),
     ((np.zeros(9), DT, np.zeros(8)), r"expected \(9,\)")],
)  # fmt: skip
def test_an_impossible_deformation_is_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        force(LAWS["flag"], *wrong)


MEANINGLESS = {
    "steel": {"yield_displacement": 0.0, "hardening_ratio": 1.0, "sharpness": -1.0, "a2": 0.0,
              "sharpness_loss": 1.0, "a1": -0.1, "damping": -1.0},
    "flag": {"activation_displacement": 0.0, "flag": 1.1, "hardening_ratio": -0.1},
    "slack": {"gap": -0.1, "stiffness": 0.0, "hardening_ratio": 1.0},
    "pendulum": {"weight": 0.0, "radius": -1.0, "friction_slow": 0.2, "rate": -1.0,
                 "spring_share": 1.1, "curvature": -1.0},
    "concrete": {"unloading_exponent": 1.0, "yield_displacement": -1.0, "hardening_ratio": np.nan},
    "timber": {"beta": 20.0, "asymmetry": 60.0, "exponent": 0.5, "pinching": 1.0, "eta_rate": -1.0},
    "wall": {"displacement_2": 0.005, "strength_3": 0.0, "unloading_force": 0.4,
             "reloading_force": -0.05, "weakening_limit": 1.0, "softening_by_energy": -1.0},
    "joint": {"displacement_2": 0.005, "displacement_3": 0.02, "strength_2": 0.0,
              "reloading_place": 1.1, "reloading_force": -0.1, "growth_by_ductility": -1.0,
              "unloading_exponent": 1.0},
    "uneven joint": {"back_displacement_2": 0.005, "back_strength_1": 0.0},
    "metal": {"kinematic_ratio": -0.1, "kinematic_rate": -1.0, "isotropic_ratio": -0.1,
              "isotropic_rate": -1.0},
    "uneven concrete": {"peak_displacement": 0.06, "residual_force": 1.1, "focus": 0.0,
                        "cracking_displacement": -1.0, "tension_softening": 0.0},
    "fluid damper": {"exponent": 0.0, "damping": -1.0, "stiffness": -1.0, "linear_below": 0.0},
    "rubber": {"exponent": 1.1, "stiffness": 0.0, "damping": 0.0},
    "relief valve": {"force": -1.0, "saturation_rate": 0.0},
}  # fmt: skip


@pytest.mark.parametrize(
    ("law", "name", "value"), [(w, n, v) for w, bad in MEANINGLESS.items() for n, v in bad.items()]
)
def test_parameters_without_physical_meaning_are_refused(law, name, value):
    with pytest.raises(ValueError, match=name):
        replace(LAWS[law], **{name: value})


@pytest.mark.parametrize("law", LAWS)
def test_a_negative_stiffness_yield_displacement_or_damper_is_refused(law):
    for name in {"stiffness", "yield_displacement", "damping"} & vars(LAWS[law]).keys():
        with pytest.raises(ValueError, match=f"{name}=-1.0 must be a number"):
            replace(LAWS[law], **{name: -1.0})


# --- forces followed along a path are those of the integrator

FINER = 16
BY_PATH = {name: law for name, law in LAWS.items() if law.by_path}


def sampled(dt: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random deformation (T,) of 30 s from rest, and its rate."""
    rng, t = np.random.default_rng(seed), dt * np.arange(round(30.0 / dt))
    waves = np.sin(np.outer(t, rng.uniform(1.0, 20.0, 8)) + rng.uniform(0.0, 6.0, 8))
    y = np.minimum(t / 3.0, 1.0) ** 2 * (waves @ rng.standard_normal(8))
    y *= 4.3 * Y / np.abs(y).max()
    return y, np.gradient(y, dt)


@pytest.mark.parametrize("law", BY_PATH.values(), ids=BY_PATH)
@pytest.mark.parametrize("dt", [0.01, 0.05])
def test_the_integrator_tends_to_the_force_along_the_path(law, dt):
    """Coarse samples turn twice between two of them, which the integrator may not see."""
    y, rate = sampled(dt, 3)
    t = dt * np.arange(y.size)
    fine = CubicHermiteSpline(t, y, rate)
    times = np.linspace(0.0, t[-1], FINER * (y.size - 1) + 1)
    theirs = imposed(law, fine(times), dt / FINER, fine(times, 1)).r[::FINER, 0]
    ours = force(law, y, dt, rate)
    assert np.linalg.norm(ours - theirs) < 1e-5 * np.linalg.norm(theirs)
