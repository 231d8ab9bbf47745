"""Named laws under imposed deformations: closed forms, limits, and step-by-step references.

Deformations turn round at samples only, so that references of a few lines are exact there.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from data.simulation.damage import StiffnessLoss
from data.simulation.element_test import force, growing_cycles, imposed, write
from data.simulation.elements import (
    BaberNoori,
    Bilinear,
    BoucWen,
    FrictionPendulum,
    MenegottoPinto,
    SelfCentering,
    SlackBrace,
    Takeda,
)
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from tests.data.test_elements import eased

DT, K, Y = 0.01, 2.0e6, 0.01  # s, N/m, m
BETWEEN = ("s1", "x1")
LAWS = {
    "steel": MenegottoPinto(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.03, a1=0.05, a3=0.02
    ),
    "flag": SelfCentering(
        between=BETWEEN, activation_displacement=Y, stiffness=K, hardening_ratio=0.05, flag=0.7
    ),
    "slack": SlackBrace(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.02, gap=0.003
    ),
    "pendulum": FrictionPendulum(
        between=BETWEEN, weight=1e6, radius=2.0, friction_fast=0.1, friction_slow=0.04, rate=20.0,
        yield_displacement=5e-4,
    ),
    "concrete": Takeda(between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.03),
    "timber": BaberNoori(
        between=BETWEEN, stiffness=K, post_yield_ratio=0.05, beta=70.0, gamma=30.0, eta_rate=1e-5,
        nu_rate=5e-6, pinching=0.8, pinching_rate=1e-4, pinching_place=0.1, pinching_width=0.01,
        pinching_spread=1e-8, pinching_lambda=0.2,
    ),
}  # fmt: skip
LENGTHS = {  # power of the metre in each parameter, where there is one besides the stiffness
    "yield_displacement": 1, "activation_displacement": 1, "gap": 1, "radius": 1, "rate": -1,
    "beta": -1, "gamma": -1, "pinching_width": 1, "pinching_spread": 1, "stiffness": -1,
}  # fmt: skip
every_law = pytest.mark.parametrize("element", LAWS.values(), ids=LAWS)


HISTORY = (0.004, -0.006, 0.018, 0.012, 0.03, -0.012, 0.008, -0.035, 0.05, -0.03, 0.0, -0.06, 0.02)


# --- steel


def steel(e: MenegottoPinto, y: np.ndarray) -> np.ndarray:
    """Menegotto–Pinto with Filippou's shift in force and strain, one sample after the other."""
    E, ey, b = e.stiffness, e.yield_displacement, e.hardening_ratio
    fy = E * ey
    way = np.sign(y[1] - y[0])
    highest, lowest, start, corner = ey, -ey, (0.0, 0.0), (way * ey, way * fy)
    R, out = e.sharpness, [0.0]
    for k in range(1, len(y)):
        if way * (y[k] - y[k - 1]) < 0.0:
            start, way = (y[k - 1], out[-1]), -way
            highest, lowest = max(highest, y[k - 1]), min(lowest, y[k - 1])
            a, scale = (e.a3, e.a4) if way > 0 else (e.a1, e.a2)
            shift = 1.0 + a * ((highest - lowest) / (2.0 * scale * ey)) ** 0.8
            meets = (way * fy * shift * (1.0 - b) - start[1] + E * start[0]) / (E * (1.0 - b))
            corner = meets, start[1] + E * (meets - start[0])
            xi = abs((highest if way > 0 else lowest) - meets) / ey
            R = e.sharpness * (1.0 - e.sharpness_loss * xi / (e.loss_excursion + xi))
        ratio = (y[k] - start[0]) / (corner[0] - start[0])
        part = b * ratio + (1.0 - b) * ratio / (1.0 + abs(ratio) ** R) ** (1.0 / R)
        out.append(start[1] + part * (corner[1] - start[1]))
    return np.array(out)


def test_steel_equals_the_step_by_step_law():
    y, rate = eased(*HISTORY)
    assert_allclose(force(LAWS["steel"], y, DT, rate), steel(LAWS["steel"], y), atol=1e-9 * K * Y)


def test_sharp_steel_is_bilinear():
    y, rate = eased(*HISTORY)
    sharp = MenegottoPinto(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.1, sharpness=2000.0,
        sharpness_loss=0.0,
    )  # fmt: skip
    corners = Bilinear(
        between=BETWEEN, yield_displacement=Y, stiffness=K, post_yield_stiffness=0.1 * K
    )
    assert_allclose(force(sharp, y, DT, rate), force(corners, y, DT, rate), atol=1e-3 * K * Y)


def test_steel_of_constant_sharpness_unloads_along_its_first_curve_twice_as_large():
    element = MenegottoPinto(
        between=BETWEEN, yield_displacement=Y, stiffness=K, hardening_ratio=0.02, sharpness_loss=0.0
    )
    y, rate = eased(0.08, -0.08)
    r, half = force(element, y, DT, rate), 0.5 * (0.08 - y[100:])
    first = K * Y * (0.02 * half / Y + 0.98 * half / Y / (1.0 + (half / Y) ** 20.0) ** (1.0 / 20.0))
    assert_allclose(r[100] - r[100:], 2.0 * first, atol=1e-6 * K * Y)


# --- flag


def flag(e: SelfCentering, y: np.ndarray) -> np.ndarray:
    """The slip is pushed along by its two limits, one sample after the other."""
    u, out, steep = 0.0, [], 1.0 - e.hardening_ratio
    for now in y:
        size = abs(now)
        low = steep * max(size - e.activation_displacement, 0.0)
        high = steep * max(size - (1.0 - e.flag) * e.activation_displacement, 0.0)
        u = np.sign(now) * np.clip(abs(u) if u * now > 0.0 else 0.0, low, high)
        out.append(e.stiffness * (now - u))
    return np.array(out)


def test_flag_equals_the_step_by_step_law():
    y, rate = eased(*HISTORY)
    assert_allclose(force(LAWS["flag"], y, DT, rate), flag(LAWS["flag"], y), atol=1e-7 * K * Y)


@pytest.mark.parametrize("beta", [0.3, 1.0])
def test_flag_encloses_two_parallelograms_and_returns_to_zero(beta):
    element = replace(LAWS["flag"], flag=beta)
    motion = imposed(element, *_with_dt(eased(0.04, -0.04, 0.0)))
    area = 2.0 * K * beta * Y * 0.95 * (0.04 - Y)
    assert_allclose(motion.work[-1, 0], area, rtol=1e-6)
    assert_allclose(motion.r[-1, 0], 0.0, atol=1e-7 * K * Y)


def _with_dt(history):
    y, rate = history
    return y, DT, rate


# --- slack brace


def slack(e: SlackBrace, y: np.ndarray) -> np.ndarray:
    """Two braces that only pull, one sample after the other."""
    plastic, out, b = [0.0, 0.0], [], e.hardening_ratio
    for now in y:
        total = 0.0
        for i, sign in enumerate((1.0, -1.0)):
            stretch = sign * now - e.gap
            limit = e.yield_displacement + b * (stretch - e.yield_displacement)
            if stretch - plastic[i] > limit:
                plastic[i] = stretch - limit
            total += sign * max(stretch - plastic[i], 0.0)
        out.append(e.stiffness * total)
    return np.array(out)


def test_slack_brace_equals_the_step_by_step_law():
    y, rate = eased(*HISTORY)
    assert_allclose(force(LAWS["slack"], y, DT, rate), slack(LAWS["slack"], y), atol=1e-7 * K * Y)


def test_slack_brace_dissipates_its_yield_force_times_its_elongation():
    element = replace(LAWS["slack"], hardening_ratio=0.0)
    work = imposed(element, *_with_dt(eased(0.05, -0.03, 0.05, 0.0))).work[:, 0]
    elongation = (0.05 - 0.003 - Y) + (0.03 - 0.003 - Y)
    assert_allclose(work[-1], K * Y * elongation, rtol=1e-6)


# --- friction pendulum


def test_pendulum_equals_a_slider_times_the_friction_of_its_speed():
    e = LAWS["pendulum"]
    y, rate = eased(*HISTORY)
    z = np.zeros_like(y)
    for k in range(1, y.size):
        limit = e.yield_displacement
        z[k] = np.clip(z[k - 1] + y[k] - y[k - 1], -limit, limit)
    mu = e.friction_fast - (e.friction_fast - e.friction_slow) * np.exp(-e.rate * np.abs(rate))
    by_hand = e.weight * (y / e.radius + mu * z / e.yield_displacement)
    assert_allclose(force(e, y, DT, rate), by_hand, atol=1e-6 * e.weight)


def test_pendulum_dissipates_four_times_friction_times_amplitude_a_cycle():
    """At constant speed v: triangles up and down."""
    e, v = LAWS["pendulum"], 0.2
    t = np.arange(401) * DT
    y = 0.1 * (np.abs((2.0 * t + 1.0) % 4.0 - 2.0) - 1.0) * -1.0
    rate = np.gradient(y, DT)
    motion = imposed(e, y, DT, rate)
    friction = 0.1 - 0.06 * np.exp(-e.rate * v)
    cycle = motion.work[250, 0] - motion.work[50, 0]
    assert_allclose(cycle, 4.0 * friction * e.weight * 0.1, rtol=0.02)


# --- concrete


def test_clough_unloads_elastically_and_aims_at_the_largest_excursions():
    e = replace(LAWS["concrete"], unloading_exponent=0.0, hardening_ratio=0.0)
    F = K * Y
    r = force(e, *_with_dt(eased(0.03, 0.02, -0.01, -0.04, -0.03, 0.03, 0.035)))
    zero = -0.03
    assert_allclose(r[100::100], [F, 0.0, -F, -F, 0.0, F, F], atol=1e-6 * F)
    y, _ = eased(0.03, 0.02, -0.01, -0.04, -0.03, 0.03, 0.035)
    reload = slice(501, 600)
    assert_allclose(r[reload], F * (y[reload] - zero) / (0.03 - zero), atol=1e-6 * F)


def test_takeda_unloads_with_the_root_of_ductility_and_remembers_inner_loops():
    e = replace(LAWS["concrete"], unloading_exponent=0.5, hardening_ratio=0.0)
    F, slope = K * Y, K * 0.5  # y_max = 4 y_y
    r = force(e, *_with_dt(eased(0.04, 0.03, 0.04, 0.02, -0.01, 0.02, 0.04, 0.05)))
    assert_allclose(r[200], F - slope * 0.01, atol=1e-6 * F)
    assert_allclose(r[300], F, atol=1e-6 * F)  # back where it left
    assert_allclose(r[[400, 500]], [0.0, -F], atol=1e-6 * F)
    zero = -0.01 + F / K  # the other side has only just yielded: its slope is k
    assert_allclose(r[600], F * (0.02 - zero) / (0.04 - zero), atol=1e-6 * F)
    assert_allclose(r[[700, 800]], F, atol=1e-6 * F)


def test_steady_clough_loop_is_a_parallelogram():
    e = replace(LAWS["concrete"], unloading_exponent=0.0, hardening_ratio=0.0)
    work = imposed(e, *_with_dt(eased(0.04, -0.04, 0.04, -0.04, 0.04))).work[:, 0]
    corners = np.array([[0.04, 1.0], [0.04 - Y, 0.0], [-0.04, -1.0], [-0.04 + Y, 0.0]])
    x, f = corners.T
    area = 0.5 * abs(x @ np.roll(f, -1) - f @ np.roll(x, -1)) * K * Y
    assert_allclose(work[500] - work[300], area, rtol=1e-6)


# --- generalised Bouc–Wen


def test_plain_baber_noori_is_bouc_wen():
    y, rate = eased(*HISTORY)
    n = 2.0
    plain = BaberNoori(between=BETWEEN, stiffness=K, beta=6e3, gamma=4e3, exponent=n)
    same = BoucWen(
        between=BETWEEN, stiffness=K, beta=6e3 * K ** (1 - n), gamma=-4e3 * K ** (1 - n), exponent=n
    )
    assert_allclose(force(plain, y, DT, rate), force(same, y, DT, rate), atol=1e-6 * K * Y)


def test_baber_noori_of_large_exponent_is_elastoplastic():
    y, rate = eased(*HISTORY)
    n = 100.0
    sharp = BaberNoori(
        between=BETWEEN, stiffness=K, post_yield_ratio=0.1, beta=0.5 * Y**-n, gamma=0.5 * Y**-n,
        exponent=n,
    )  # fmt: skip
    corners = Bilinear(
        between=BETWEEN, yield_displacement=Y, stiffness=K, post_yield_stiffness=0.1 * K
    )
    assert_allclose(force(sharp, y, DT, rate), force(corners, y, DT, rate), atol=0.01 * K * Y)


def test_asymmetry_sets_the_largest_force_of_either_side():
    e = BaberNoori(between=BETWEEN, stiffness=K, beta=60.0, gamma=40.0, asymmetry=10.0)
    r = force(e, *_with_dt(eased(0.2, -0.2, samples=400)))
    assert_allclose(r[[400, 800]], [K / 120.0, -K / 80.0], rtol=1e-5)


def test_degrading_pinching_law_equals_its_differential_equation():
    e = LAWS["timber"]
    y, rate = eased(0.02, -0.03, 0.04, -0.01)
    r, z, worked = [0.0], 0.0, 0.0

    def slope(x, state, way):
        z, energy = state
        nu, eta = 1.0 + e.nu_rate * energy, 1.0 + e.eta_rate * energy
        loss = e.pinching * (1.0 - np.exp(-e.pinching_rate * energy))
        width = (e.pinching_width + e.pinching_spread * energy) * (e.pinching_lambda + loss)
        ultimate = 1.0 / (nu * (e.beta + e.gamma))
        h = 1.0 - loss * np.exp(-(((z * way - e.pinching_place * ultimate) / width) ** 2))
        bend = e.beta * np.sign(way * z) + e.gamma
        dz = h * (1.0 - nu * abs(z) * bend) / eta
        return [dz, (1.0 - e.post_yield_ratio) * e.stiffness * z]

    for first, last in itertools.pairwise(y):
        state = solve_ivp(
            slope, (first, last), (z, worked), args=(np.sign(last - first),), rtol=1e-9, atol=1e-12
        ).y
        z, worked = state[:, -1]
        r.append(K * (e.post_yield_ratio * last + (1.0 - e.post_yield_ratio) * z))
    assert_allclose(force(e, y, DT, rate), r, atol=1e-5 * K * Y)


# --- all of them


@every_law
def test_a_mirrored_deformation_gives_the_mirrored_force(element):
    if isinstance(element, MenegottoPinto):
        element = replace(element, a3=element.a1)
    y, rate = eased(*HISTORY)
    r = force(element, y, DT, rate)
    assert_allclose(force(element, -y, DT, -rate), -r, atol=1e-7 * np.abs(r).max())


@every_law
def test_no_closed_cycle_gives_energy(element):
    """Cycles of three random turns, each gone through six times, from one element at rest."""
    rng = np.random.default_rng(1)
    for size in (0.5, 1.5, 4.0):
        for _ in range(4):
            cycle = [*(size * Y * rng.standard_normal(3)), 0.0]
            work = imposed(element, *_with_dt(eased(*(6 * cycle), samples=30))).work[:, 0]
            assert (work >= -1e-6 * K * Y**2).all()
            assert work[-1] - work[-1 - 30 * len(cycle)] >= -1e-6 * K * Y**2


@every_law
def test_other_units_of_length_and_force_change_nothing(element):
    """Millimetres and kilonewtons: the same force, a thousandth of the number."""
    length, unit = 1e3, 1e-3
    changes = {"between": BETWEEN}
    for name, power in LENGTHS.items():
        if hasattr(element, name):
            changes[name] = getattr(element, name) * length**power
    for name in ("stiffness", "weight"):
        if hasattr(element, name):
            changes[name] = changes.get(name, getattr(element, name)) * unit
    for name in ("eta_rate", "nu_rate", "pinching_rate", "pinching_spread"):  # per energy, kN mm
        if hasattr(element, name):
            changes[name] = changes.get(name, getattr(element, name)) / (length * unit)
    y, rate = eased(*HISTORY)
    r = force(element, y, DT, rate)
    other = force(replace(element, **changes), length * y, DT, length * rate)
    assert_allclose(other, unit * r, atol=1e-7 * unit * np.abs(r).max())


@every_law
def test_steps_of_any_length_give_the_same_force(element):
    turns = HISTORY[:6]
    if isinstance(element, FrictionPendulum):
        element = replace(element, rate=0.0)
    slow, fast = (force(element, *_with_dt(eased(*turns, samples=n)))[::n] for n in (200, 40))
    assert_allclose(slow, fast, atol=1e-5 * np.abs(slow).max())


@every_law
def test_a_loss_of_fibres_scales_the_force_from_then_on(element):
    if isinstance(element, BaberNoori):
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
    "pendulum": {"weight": 0.0, "radius": -1.0, "friction_slow": 0.2, "rate": -1.0},
    "concrete": {"unloading_exponent": 1.0, "yield_displacement": -1.0, "hardening_ratio": np.nan},
    "timber": {"beta": 20.0, "asymmetry": 60.0, "exponent": 0.5, "pinching": 1.0, "eta_rate": -1.0},
}  # fmt: skip


@pytest.mark.parametrize(
    ("law", "name", "value"), [(w, n, v) for w, bad in MEANINGLESS.items() for n, v in bad.items()]
)
def test_parameters_without_physical_meaning_are_refused(law, name, value):
    with pytest.raises(ValueError, match=name):
        replace(LAWS[law], **{name: value})
