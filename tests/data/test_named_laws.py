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

from data import (
    BaberNoori,
    Bilinear,
    BoucWen,
    Hysteretic,
    MenegottoPinto,
    Polynomial,
    PowerDamper,
    SelfCentering,
    SlackBrace,
    Stop,
)
from data.simulation.element_test import force, imposed
from data.simulation.laws.element import Element
from data.simulation.laws.pinching4 import LOSSES
from tests.data.named_laws import BETWEEN, DT, HISTORY, LAWS, K, Y, _with_dt
from tests.data.test_elements import eased

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


# --- nailed wall


def at_turns(*turns: float, law: Element = LAWS["nailed wall"]) -> np.ndarray:
    """Forces of a law over its stiffness [m] at turning points, from rest."""
    y, rate = eased(*turns)
    samples = (len(y) - 1) // len(turns)
    return force(law, y, DT, rate)[samples::samples] / K


def test_a_nailed_wall_follows_its_lines():
    """Forces at turning points by the lines of Folz & Filiatrault, with 5 % of hardening."""

    def envelope(u: float) -> float:
        near = min(u, 0.04)
        return (Y + 0.05 * near) * (1.0 - np.exp(-near / Y)) - 0.1 * (u - near)

    def reload(u: float, w: float, top: float) -> float:
        return top + (Y / w) ** 0.7 * (u - w)

    below = at_turns(0.001, -0.001, 0.0005)  # the slip line: elastic
    assert_allclose(below, [envelope(0.001), -envelope(0.001), envelope(0.0005)], rtol=1e-6)
    r = at_turns(0.03, 0.027, 0.029, 0.032, 0.0, -0.03, 0.02, 0.018, 0.0185, 0.038, 0.0, 0.03, 0.05)
    w, beyond = 1.1 * 0.032, 1.1 * 0.038
    by_lines = [
        envelope(0.03),
        envelope(0.03) - 1.2 * 0.003,  # it unloads
        envelope(0.03) - 1.2 * 0.001,  # and goes back to where it left the envelope
        envelope(0.032),
        -0.15 * Y,  # nails slip
        -envelope(0.03),  # on a side where it never was
        reload(0.02, w, envelope(w)),
        reload(0.02, w, envelope(w)) - 1.2 * 0.002,
        reload(0.02, w, envelope(w)) - 1.2 * 0.0015,
        envelope(0.038),
        -0.15 * Y,
        reload(0.03, beyond, envelope(0.04)),  # beyond the strength: to the strength
        envelope(0.05),  # which falls
    ]
    assert_allclose(r, by_lines, rtol=1e-6)


def test_a_nailed_wall_slips_on_a_line_that_rises():
    """Back from 0.03 to 0.01 and forward again: the lines of both directions are parallel."""
    r = at_turns(0.03, 0.01, 0.012)
    assert_allclose(r[1], -0.15 * Y + 0.04 * 0.01, rtol=1e-6)
    assert_allclose(r[2] - r[1], 1.2 * 0.002, rtol=1e-6)  # not up to the other line yet


# --- hinge


def test_a_hinge_reloads_towards_its_peaks():
    """The local peak first, where that is steeper; a cap beyond 0.04, 5 % of hardening before."""
    top, back = Y + 0.05 * 0.022, Y + 0.05 * 0.02  # at 0.032 forward, at 0.03 backward
    turns = 0.032, 0.03, 0.031, -0.005, -0.03, 0.01, -0.01, 0.009, 0.02, 0.05, 0.2
    r = at_turns(*turns, law=replace(LAWS["hinge"], deterioration=0.0, residual_force=0.2))
    local = top * (0.01 + 0.03 - back) / (0.032 + 0.03 - back)  # at 0.01
    other = back * (0.01 + 0.01 - local) / (0.03 + 0.01 - local)  # at −0.01
    by_lines = [
        top,
        top - 0.002,
        top - 0.001,
        -Y * (0.005 + 0.032 - top) / (Y + 0.032 - top),  # to the yield point, where it never was
        -back,
        local,  # on the way to the global peak
        -other,
        local * (0.009 + 0.01 - other) / (0.01 + 0.01 - other),  # to the local peak
        local + (top - local) / 0.022 * 0.01,  # from there to the global one
        Y + 0.05 * 0.03 - 0.1 * 0.01,
        0.2 * Y,  # the residual force
    ]
    assert_allclose(r, by_lines, rtol=1e-6)


def test_a_hinge_pinches():
    """To u_p, f_p first; back on the way there it goes up to where it turned, and on to u_p."""
    law = replace(LAWS["uneven hinge"], deterioration=0.0, back_strength=1.0)
    top = Y + 0.05 * 0.02
    r = at_turns(0.03, -0.02, 0.002, 0.0015, 0.004, 0.02, law=law)
    there = at_turns(0.03, -0.02, law=law)[-1]
    u0 = -0.02 - there
    u_p = 0.4 * (0.03 - top)
    f_p = 0.3 * top * (u_p - u0) / (0.03 - u0)
    slope = f_p / (u_p - u0)
    by_lines = [
        slope * (0.002 - u0),
        slope * (0.002 - u0) - 0.0005,
        slope * (0.004 - u0),
        f_p + (top - f_p) / (0.03 - u_p) * (0.02 - u_p),
    ]
    assert_allclose(r[2:], by_lines, rtol=1e-6)


def test_a_hinge_without_a_cap_hardens_by_its_strength_on_either_side():
    law = replace(LAWS["hinge"], softening_ratio=0.0, deterioration=0.0, back_strength=1.5)
    backward = -1.5 * (Y + 0.05 * (0.05 - 1.5 * Y))
    assert_allclose(at_turns(0.03, -0.05, law=law), [Y + 0.05 * 0.02, backward], rtol=1e-6)


def test_a_hinge_wears_out_with_its_energy():
    """The first excursion backward has lost β of its strength, and unloading β of its slope."""
    top, full = Y + 0.05 * 0.02, Y**2 / 0.01  # capacity over k
    plastic = 0.5 * Y**2 + 0.5 * (Y + top) * 0.02 - 0.5 * top**2
    kept = 1.0 - plastic / (full - plastic)
    r = at_turns(0.03, 0.025, -0.035, law=LAWS["hinge"])
    assert_allclose(r[1], top - 0.005 * kept, rtol=1e-6)
    energy = plastic + 0.5 * top**2 * (1.0 - 1.0 / kept)  # at zero force
    left = 1.0 - energy / (full - energy)
    assert_allclose(r[2], -left * (Y + 0.05 * (0.035 - left * Y)), rtol=1e-6)


def test_a_hinge_that_has_spent_its_energy_is_broken():
    """It turns with more than its capacity, and does not push on at any deformation."""
    law = replace(LAWS["hinge"], softening_ratio=0.0, residual_force=0.2)
    r = at_turns(0.6, 0.5, -0.6, 0.1, law=law)
    assert_allclose(r[1:], 0.0, atol=1e-12)


# --- metal


def test_metal_hardens_up_to_its_limits():
    """A long slip ends at the largest yield limit, the middle moved as far as it goes."""
    law = LAWS["metal"]
    grown, moved = 0.5 * Y + 0.02 / 20.0, 0.1 / 50.0
    assert_allclose(at_turns(1.0, -0.5, law=law), [grown + moved, -grown - moved], rtol=1e-6)


def test_metal_without_limits_is_that_of_return_mapping():
    """With straight lines, return mapping is exact; the middle moves beyond the yield limit."""
    C, h = 1.0, 0.02
    law = replace(LAWS["metal"], kinematic_ratio=C, kinematic_rate=0.0, isotropic_rate=0.0)
    y, rate = eased(*HISTORY)
    slip = total = 0.0
    expected = []
    for now in y:
        beyond = now - slip - C * slip
        d = max(abs(beyond) - (0.5 * Y + h * total), 0.0) / (1.0 + C + h)
        slip, total = slip + d * np.sign(beyond), total + d
        expected.append(K * (now - slip))
    r = force(law, y, DT, rate)
    assert_allclose(r, expected, atol=1e-9 * np.abs(r).max())


# --- concrete that cracks


def test_concrete_crushes_and_cracks_on_its_lines():
    law = replace(LAWS["uneven concrete"], forward=True)
    top, crushed = 0.01, 0.01 - 0.007 / 4.0  # at 0.02 and 0.03
    E = (crushed + 0.02) / (0.03 + 0.02)
    u0 = 0.03 - crushed / E
    turns = 0.01, 0.02, 0.03, 0.0295, u0 + 0.006, u0 + 0.0062, u0 - 0.0005, u0 - 0.003, u0 - 0.001
    more = u0 - 0.002, u0 - 0.02, u0 - 0.001, u0 + 0.002, u0 + 0.0015, 0.025, 0.0248, 0.04, 0.08
    by_lines = [
        0.01 * (1.0 - 0.25),
        top,
        crushed,
        crushed - 0.0005,
        0.5 * E * 0.006,
        0.5 * E * 0.006 + 0.0002,
        -0.0005,  # not cracked yet
        -(0.001 - 0.1 * 0.002),
        -(0.001 - 0.1 * 0.002) / 3.0,  # towards the closed crack
        -(0.001 - 0.1 * 0.002) * 2.0 / 3.0,
        0.0,
        0.0,
        E * 0.002,
        E * 0.002 - 0.0005,
        E * (0.025 - u0),  # not the envelope yet
        E * (0.025 - u0) - 0.0002,
        top - 0.007 / 2.0,
        0.3 * top,
    ]
    assert_allclose(at_turns(*turns, *more, law=law), by_lines, atol=1e-6 * top)
    mirrored = at_turns(*(-u for u in (*turns, *more)), law=replace(law, forward=False))
    assert_allclose(mirrored, np.negative(by_lines), atol=1e-6 * top)


def test_concrete_is_strong_where_it_crushes():
    law = LAWS["uneven concrete"]
    assert law.strengths() == (K * 0.001, K * Y)
    assert replace(law, forward=True).strengths() == (K * Y, K * 0.001)


def test_concrete_without_tension_opens_freely():
    law = replace(LAWS["uneven concrete"], cracking_displacement=0.0)
    r = at_turns(0.02, -0.01, 0.0, 0.03, -0.005, law=law)
    assert_allclose(r[[0, 2, 3]], 0.0, atol=1e-12)
    assert r[1] == pytest.approx(-0.0075)
    E = (0.0075 + 0.02) / (0.01 + 0.02)
    assert r[4] == pytest.approx(-E * (0.005 - (0.01 - 0.0075 / E)))


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


# --- slack brace


def slack(e: SlackBrace, y: np.ndarray) -> np.ndarray:
    """Two braces that only pull, or two stops, one sample after the other."""
    plastic, out, b = [0.0, 0.0], [], e.hardening_ratio
    for now in y:
        total = 0.0
        for i, (sign, (k, gap)) in enumerate(((1.0, (e.stiffness, e.gap)), (-1.0, e.back))):
            stretch = sign * now - gap
            limit = e.yield_displacement + b * (stretch - e.yield_displacement)
            if stretch - plastic[i] > limit:
                plastic[i] = stretch - limit
            total += k * sign * max(stretch - plastic[i], 0.0)
        out.append(total)
    return np.array(out)


@pytest.mark.parametrize("name", ["slack", "uneven stops"])
def test_slack_brace_and_stops_equal_the_step_by_step_law(name):
    y, rate = eased(*HISTORY)
    assert_allclose(force(LAWS[name], y, DT, rate), slack(LAWS[name], y), atol=1e-7 * K * Y)


def test_a_stop_on_one_side_leaves_the_other_free():
    y, rate = eased(*HISTORY)
    one = replace(LAWS["slack"], gap=0.003)
    front = Stop(**vars(one))
    back = Stop(
        between=one.between, yield_displacement=Y, hardening_ratio=0.02, back_stiffness=K,
        back_gap=0.003,
    )  # fmt: skip
    both, *sides = (force(law, y, DT, rate) for law in (one, front, back))
    assert_allclose(sides[0], np.where(y > 0.0, both, 0.0), atol=1e-7 * K * Y)
    assert_allclose(sides[1], np.where(y < 0.0, both, 0.0), atol=1e-7 * K * Y)
    assert back.strengths() == (0.0, K * Y)


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


def test_a_spring_in_series_with_a_slider_keeps_its_stiffness_at_any_speed():
    """By return mapping; a share of a half sticks over the geometric mean of both shears."""
    e = replace(LAWS["spring bearing"], yield_displacement=3e-3, curvature=0.0)
    y, rate = eased(*HISTORY, samples=400)
    mu = e.friction_fast - (e.friction_fast - e.friction_slow) * np.exp(-e.rate * np.abs(rate))
    spring = e.friction_slow * e.weight / e.yield_displacement
    q = np.zeros_like(y)
    for k in range(1, y.size):
        limit = mu[k] * e.weight
        q[k] = np.clip(q[k - 1] + spring * (y[k] - y[k - 1]), -limit, limit)
    r = force(e, y, DT, rate) - e.weight * y / e.radius
    far = np.linalg.norm(r - q) / np.linalg.norm(q)
    grows = force(replace(e, spring_share=0.0), y, DT, rate) - e.weight * y / e.radius
    assert far < 0.01 < 0.03 < np.linalg.norm(grows - q) / np.linalg.norm(q)
    y = 0.2 * DT * np.arange(40.0)  # at a constant speed from rest
    for share in (0.0, 0.5, 1.0):
        half = replace(e, spring_share=share)
        r = force(half, y, DT / 100.0, np.full_like(y, 20.0)) - e.weight * y / e.radius
        steep = (r[1] - r[0]) / (y[1] - y[0])
        ratio = e.friction_fast / e.friction_slow
        assert_allclose(steep, spring * ratio ** (1.0 - share), rtol=1e-3)


def test_a_bearing_on_a_circle_is_a_weight_on_a_slope_with_friction():
    """Sliding at constant speed up and down: W tan(θ ± arctan μ)."""
    e = replace(LAWS["spring bearing"], rate=0.0)
    assert e.friction_slow < e.friction_fast
    mu, R = e.friction_slow, e.radius
    y = np.concatenate([np.linspace(0.0, 0.9, 400), np.linspace(0.9, -0.9, 800)])
    r = force(e, y, DT, np.gradient(y, DT))
    for k, side in ((100, 1.0), (390, 1.0), (500, -1.0), (800, -1.0), (1190, -1.0)):
        slope = np.arcsin(y[k] / R)
        assert_allclose(r[k], e.weight * np.tan(slope + side * np.arctan(mu)), rtol=1e-9)


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


# --- four points that pinch


def test_four_points_are_the_envelope_and_go_on_level_where_it_falls():
    e = LAWS["wall"]
    r = force(e, *_with_dt(eased(Y, 0.02, 0.03, 0.04, 0.07, 0.09))) / (K * Y)
    assert_allclose(r[100::100], [1.0, 1.6, 1.7, 1.8, 1.1, 1.1], atol=1e-6)


def test_without_losses_a_path_is_three_lines():
    lossless = {name: 0.0 for name in LOSSES if "_by_" in name}
    e = replace(LAWS["wall"], **lossless)
    y, _ = eased(0.04, -0.04, samples=1000)
    unloaded = 0.04 - (1.8 - 0.18) * Y  # u < 0: a tenth of the strength above zero
    places, forces = [-0.04, -0.4 * 0.04, unloaded, 0.04], [-1.8, -0.3 * 1.8, 0.18, 1.8]
    by_hand = K * Y * np.interp(y[1000:], places, forces)
    earlier = force(e, *_with_dt(eased(0.04, -0.04, 0.04, -0.04, samples=1000)))
    assert_allclose(earlier[3000:], by_hand, atol=1e-6 * K * Y)


# --- three lines that pinch and are damaged


def joint(e: Hysteretic, y: np.ndarray) -> np.ndarray:
    """Without energy damage, one sample after the other: lines in the direction of the motion."""
    Y = e.yield_displacement
    places = np.array([0.0, Y, e.displacement_2, e.displacement_3, 1.0])
    heights = Y * np.array([0.0, 1.0, e.strength_2, e.strength_3, e.strength_3])
    peaks, zeros, out, last = {1: 0.0, -1: 0.0}, {1: 0.0, -1: 0.0}, [0.0], 0
    for before, now in itertools.pairwise(y):
        way = 1 if now > before else -1
        mu = {side: max(peak / Y, 1.0) for side, peak in peaks.items()}
        x, r, step = way * now, way * out[-1], abs(now - before)
        if last == -way and r <= 0.0:
            zeros[way] = way * before - r * mu[-way] ** e.unloading_exponent
            peaks[way] *= 1.0 + e.growth_by_ductility * (mu[-way] - 1.0)
        if last:
            peaks[way] = max(peaks[way], Y)
        last = way
        if x >= peaks[way]:
            peaks[way] = x
            out.append(way * np.interp(x, places, heights))
            continue
        slope = max(peaks[way] / Y, 1.0) ** -e.unloading_exponent
        if x < zeros[way]:
            out.append(way * min(r + mu[-way] ** -e.unloading_exponent * step, 0.0))
            continue
        top = np.interp(peaks[way], places, heights)
        elastic = peaks[way] - (1.0 - e.reloading_force) * top / slope
        bend = zeros[way] + e.reloading_place * (elastic - zeros[way])
        line = np.interp(x, [zeros[way], bend, peaks[way]], [0.0, e.reloading_force * top, top])
        out.append(way * min(r + slope * step, line))
    return e.stiffness * np.array(out)


@pytest.mark.parametrize("samples", [200, 2000])
def test_joint_equals_the_step_by_step_law(samples):
    """But for samples next to a corner, where a step of the reference is too flat."""
    e = replace(LAWS["joint"], growth_by_energy=0.0)
    y, rate = eased(*HISTORY, samples=samples)
    assert_allclose(force(e, y, DT, rate), joint(e, y), atol=1e-3 * K * Y)


def test_three_lines_are_the_envelope_and_go_on_level_where_it_falls():
    e = LAWS["joint"]
    r = force(e, *_with_dt(eased(0.5 * Y, Y, 0.025, 0.0425, 0.06, 0.09))) / (K * Y)
    assert_allclose(r[100::100], [0.5, 1.0, 1.4, 1.25, 1.1, 1.1], atol=1e-6)
    rising = replace(e, strength_3=2.1)
    r = force(rising, *_with_dt(eased(0.06, 0.095))) / (K * Y)
    assert_allclose(r[100::100], [2.1, 2.8], atol=1e-6)


def test_damage_of_one_side_moves_the_target_of_the_other_away():
    """By ductility and by what was lost, in shares of the area under both envelopes."""
    e = replace(LAWS["joint"], growth_by_ductility=0.1, growth_by_energy=0.3)
    e = replace(e, unloading_exponent=0.0, reloading_place=1.0, reloading_force=1.0)
    back, front = 0.02, 0.03
    r = force(e, *_with_dt(eased(-back, front, -0.07, samples=1000)))
    y = eased(-back, front, -0.07, samples=1000)[0]
    pushed, pulled = Y * (1.0 + 0.4 * 2.0 / 3.0), Y * (1.4 - 0.3 / 7.0)  # ρ at the turns
    first = 0.5 * Y * Y + 0.5 * (Y + pushed) * 0.01  # work over k
    zero, target = -back + pushed, None
    lost = first - 0.5 * pushed**2
    area = 0.5 * Y * Y + 0.5 * 2.4 * Y * 0.015 + 0.5 * 2.5 * Y * 0.035
    # the front never yielded before, so its target is Y; the way to it is straight, then on
    reload = 0.5 * (Y - zero) * Y + 0.5 * 2.4 * Y * 0.015 + 0.5 * (1.4 * Y + pulled) * 0.005
    total = lost + reload - 0.5 * pulled**2
    target = back * (1.0 + 0.1 * (front / Y - 1.0) + 0.3 * total / (2.0 * area))
    last, after = y[2000:], r[2000:] / K
    unloaded = front - pulled
    between = (last < unloaded) & (last > -target)
    height = np.interp(target, [Y, 0.025, 0.06], [Y, 1.4 * Y, 1.1 * Y])
    by_hand = -height * (unloaded - last) / (unloaded + target)
    assert_allclose(after[between], by_hand[between], atol=1e-6 * Y)


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
    assert_allclose(e.strengths(), [K / 120.0, K / 80.0])


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


# --- laws of the rate


def test_a_power_damper_with_exponents_of_one_is_a_spring_and_a_damper():
    y, rate = eased(*HISTORY)
    power = PowerDamper(between=BETWEEN, damping=3e4, stiffness=K)
    linear = Polynomial(between=BETWEEN, damping=3e4, stiffness=K)
    assert_allclose(force(power, y, DT, rate), force(linear, y, DT, rate), atol=1e-12 * K * Y)


def test_a_power_damper_is_the_power_of_the_rate_where_that_is_not_small():
    y, rate = eased(*HISTORY)
    e, fast = LAWS["fluid damper"], np.abs(rate) > 100.0 * LAWS["fluid damper"].linear_below
    theirs = e.damping * np.sign(rate) * np.abs(rate) ** e.exponent
    theirs += e.stiffness * np.sign(y) * np.abs(y) ** e.spring_exponent
    assert_allclose(force(e, y, DT, rate)[fast], theirs[fast], atol=1e-4 * np.abs(theirs).max())


def test_a_dashpot_that_saturates_is_linear_at_low_rates_and_constant_at_high_ones():
    e, t = LAWS["relief valve"], DT * np.arange(100)
    for speed, right in ((1e-4, 1e4 * 1e-4 / 0.05), (1.0, 1e4)):
        r = force(e, speed * t, DT, np.full(100, speed))
        assert_allclose(r, right, rtol=2e-6)


def test_a_maxwell_damper_relaxes_as_its_closed_form():
    """Under a ramp, from rest: r = C v (1 − exp(−k t / C))."""
    e, t, v = LAWS["rubber"], DT * np.arange(200), 0.3
    r = force(e, v * t, DT, np.full(200, v))
    right = e.damping * v * (1.0 - np.exp(-t * e.stiffness / e.damping))
    assert_allclose(r, right, atol=1e-6 * right.max())


@pytest.mark.parametrize("name", ["rubber", "damper on a brace"])
def test_a_maxwell_damper_is_its_dashpot_when_slow_and_its_spring_when_fast(name):
    """Of a sine at far ends of the rate; the error falls as a power of the rate."""
    e, phase = LAWS[name], np.arange(800) * 2.0 * np.pi / 200.0
    y, slope = 1e-3 * np.sin(phase), 1e-3 * np.cos(phase)
    dashpot = PowerDamper(between=BETWEEN, damping=e.damping, exponent=e.exponent,
                          linear_below=1e-12)  # fmt: skip
    slow, fast = [], []
    for w in (1e-4, 1e-3):
        dt = (phase[1] - phase[0]) / w
        r, right = (force(law, y, dt, w * slope)[400:] for law in (e, dashpot))
        slow.append(np.linalg.norm(r - right) / np.linalg.norm(right))
    for w in (1e5, 1e4):
        r = force(e, y, (phase[1] - phase[0]) / w, w * slope)
        fast.append(np.linalg.norm(r - K * y) / np.linalg.norm(K * y))
    assert slow[0] < 0.5 * slow[1] < 0.1
    assert fast[0] < 0.5 * fast[1] < 0.1


def test_a_maxwell_damper_of_a_power_equals_its_equation_by_scipy():
    e, w = LAWS["damper on a brace"], 7.0
    t = DT * np.arange(300)

    def elongation(s: float, z: np.ndarray) -> np.ndarray:
        r = e.stiffness * z
        return 0.02 * w * np.cos(w * s) - np.sign(r) * np.abs(r / e.damping) ** (1.0 / e.exponent)

    right = solve_ivp(elongation, (0.0, t[-1]), [0.0], t_eval=t, rtol=1e-10, atol=1e-14).y[0]
    r = force(e, 0.02 * np.sin(w * t), DT, 0.02 * w * np.cos(w * t))
    assert_allclose(r, e.stiffness * right, atol=1e-4 * np.abs(r).max())
