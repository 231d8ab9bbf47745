"""Restoring-force laws: deformation y [m], velocity ẏ [m/s] and state z → force r [N] and ż.

Every law is written branch by branch (elastic, yielded, gap closed, ...), and is smooth within a
branch; the integrator finds the instants at which a branch ends. A law is a file with three small
compiled functions and a dataclass of its parameters:

    force(p, m, e, branch, y, ẏ, z, work) → (r, ż)   work = ∫ r ẏ dt, the energy e took up [J]
    margin(p, m, e, branch, y, ẏ, z)                 ≥ 0 while the branch holds, < 0 past its end
    next_branch(p, m, e, branch, y, ẏ, z) → (branch, z)   what holds past that end

of which each takes what it needs. p (E, P) are the parameters of all elements, e the number of
this one; m (E, MEMORY) is what a law remembers of its past: `next_branch` alone writes into it, so
that it stands still along a branch. m is in metres, so that a loss of fibres leaves it as it is.
Branch 0 is the branch at rest, where m is zero.
"""

from __future__ import annotations

from data.simulation.elements import (
    baber_noori,
    bilinear,
    bouc_wen,
    friction_pendulum,
    hysteretic,
    limited_slip,
    menegotto_pinto,
    pinching4,
    polynomial,
    self_centering,
    slack_brace,
    takeda,
)
from data.simulation.elements.baber_noori import BABER_NOORI
from data.simulation.elements.bilinear import BILINEAR
from data.simulation.elements.bouc_wen import BOUC_WEN
from data.simulation.elements.compiling import compiled, inlined
from data.simulation.elements.element import MEMORY
from data.simulation.elements.friction_pendulum import FRICTION_PENDULUM
from data.simulation.elements.hysteretic import HYSTERETIC
from data.simulation.elements.limited_slip import LIMITED_SLIP
from data.simulation.elements.menegotto_pinto import MENEGOTTO_PINTO
from data.simulation.elements.pinching4 import PINCHING4
from data.simulation.elements.polynomial import POLYNOMIAL
from data.simulation.elements.self_centering import SELF_CENTERING
from data.simulation.elements.slack_brace import SLACK_BRACE

INLINED = (BILINEAR, LIMITED_SLIP, POLYNOMIAL, BOUC_WEN)


@inlined
def force(law, p, m, e, branch, y, ydot, z, work):
    if law == BILINEAR:
        return bilinear.force(p, e, branch, y, ydot, z)
    if law == LIMITED_SLIP:
        return limited_slip.force(p, e, branch, y, ydot, z)
    if law == POLYNOMIAL:
        return polynomial.force(p, e, y, ydot)
    if law == BOUC_WEN:
        return bouc_wen.force(p, e, branch, ydot, z, work)
    if m is None:
        return 0.0, 0.0
    return _force(law, _parameters(p, e), _memory(m, e), branch, y, ydot, z, work)


@inlined
def margin(law, p, m, e, branch, y, ydot, z):
    if law == POLYNOMIAL:
        return 1.0
    if law == BOUC_WEN:
        return bouc_wen.margin(p, e, branch, ydot, z)
    if law == BILINEAR:
        return bilinear.margin(p, e, branch, ydot, z)
    if law == LIMITED_SLIP:
        return limited_slip.margin(p, e, branch, y, ydot, z)
    if m is None:
        return 1.0
    return _margin(law, _parameters(p, e), _memory(m, e), branch, y, ydot, z)


@inlined
def next_branch(law, p, m, e, branch, y, ydot, z):
    if law == BILINEAR:
        return bilinear.next_branch(p, e, branch, ydot, z)
    if law == LIMITED_SLIP:
        return limited_slip.next_branch(p, e, branch, y, ydot, z)
    if law == POLYNOMIAL:
        return 0, z
    if law == BOUC_WEN:
        return bouc_wen.next_branch(ydot, z)
    if m is None:
        return branch, z
    branch, z, past = _next(law, _parameters(p, e), _memory(m, e), branch, y, ydot, z)
    for i in range(MEMORY):
        m[e, i] = past[i]
    return branch, z


# The other laws are called. That costs the integrator's loop some five times its time, because
# numba then counts who holds each array; so the loop is compiled a second time, without them, for
# structures of the four laws above: m is None there.


@inlined
def _parameters(p, e):
    return (p[e, 0], p[e, 1], p[e, 2], p[e, 3], p[e, 4], p[e, 5], p[e, 6],
            p[e, 7], p[e, 8], p[e, 9], p[e, 10], p[e, 11], p[e, 12], p[e, 13],
            p[e, 14], p[e, 15], p[e, 16], p[e, 17], p[e, 18], p[e, 19], p[e, 20],
            p[e, 21], p[e, 22], p[e, 23], p[e, 24], p[e, 25], p[e, 26], p[e, 27],
            p[e, 28], p[e, 29], p[e, 30], p[e, 31], p[e, 32], p[e, 33], p[e, 34],
            p[e, 35], p[e, 36], p[e, 37], p[e, 38])  # fmt: skip


@inlined
def _memory(m, e):
    return (m[e, 0], m[e, 1], m[e, 2], m[e, 3], m[e, 4], m[e, 5],
            m[e, 6], m[e, 7], m[e, 8], m[e, 9], m[e, 10], m[e, 11])  # fmt: skip


@compiled
def _force(law, p, m, branch, y, ydot, z, work):
    if law == MENEGOTTO_PINTO:
        return menegotto_pinto.force(p, m, branch, y, ydot)
    if law == SELF_CENTERING:
        return self_centering.force(p, branch, y, ydot, z)
    if law == SLACK_BRACE:
        return slack_brace.force(p, m, branch, y, ydot)
    if law == FRICTION_PENDULUM:
        return friction_pendulum.force(p, branch, y, ydot, z)
    if law == BABER_NOORI:
        return baber_noori.force(p, branch, y, ydot, z, work)
    if law == PINCHING4:
        return pinching4.force(p, m, branch, y, ydot)
    if law == HYSTERETIC:
        return hysteretic.force(p, m, branch, y, ydot)
    return takeda.force(p, m, branch, y, ydot)


@compiled
def _margin(law, p, m, branch, y, ydot, z):
    if law == MENEGOTTO_PINTO:
        return menegotto_pinto.margin(branch, y, ydot)
    if law == SELF_CENTERING:
        return self_centering.margin(p, branch, y, ydot, z)
    if law == SLACK_BRACE:
        return slack_brace.margin(p, m, branch, y, ydot)
    if law == FRICTION_PENDULUM:
        return friction_pendulum.margin(p, branch, ydot, z)
    if law == BABER_NOORI:
        return baber_noori.margin(branch, ydot, z)
    if law == PINCHING4:
        return pinching4.margin(p, m, branch, y, ydot)
    if law == HYSTERETIC:
        return hysteretic.margin(p, m, branch, y, ydot)
    return takeda.margin(p, m, branch, y, ydot)


@compiled
def _next(law, p, m, branch, y, ydot, z):
    """What holds past the end of a branch: branch, state, memory."""
    if law == SELF_CENTERING:
        branch, z = self_centering.next_branch(p, branch, y, ydot, z)
    elif law == FRICTION_PENDULUM:
        branch, z = friction_pendulum.next_branch(p, branch, ydot, z)
    elif law == BABER_NOORI:
        branch = baber_noori.next_branch(ydot, z)
    elif law == PINCHING4:
        branch, m = pinching4.next_branch(p, m, branch, y, z)
    elif law == HYSTERETIC:
        branch, m = hysteretic.next_branch(p, m, branch, y, z)
    else:
        few = m[0], m[1], m[2], m[3], m[4], m[5]
        if law == MENEGOTTO_PINTO:
            branch, few = menegotto_pinto.next_branch(p, few, branch, y)
        elif law == SLACK_BRACE:
            branch, few = slack_brace.next_branch(p, few, branch, y)
        else:
            branch, few = takeda.next_branch(p, few, branch, y)
        m = few[0], few[1], few[2], few[3], few[4], few[5], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return branch, z, m
