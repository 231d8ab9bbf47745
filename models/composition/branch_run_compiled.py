"""Elements of a composition that follow the branch law, compiled, with their derivatives.

simulate_compiled.py moves them. An element that turns round within a step does so where the cubic
through both ends of the step has no slope. The derivatives by all P parameters go along; θ of the
laws, an element's after the other's, are the first of them.
E elements, n coordinates. The readable reference: tests/reference_networks.py.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.numba_cache import compilers
from models.composition import branch_law_compiled
from models.composition.branch_law_compiled import (
    HIGHEST,
    LOWEST,
    SIDE,
    STATES,
    Y_TURN,
    element_force,
    extreme_at,
    follow,
    go_on,
    hermite,
    law_size,
    turn,
)

compiled, inlined = compilers(
    Path(__file__), Path(str(branch_law_compiled.__file__)), contract=True, allocate=False
)


class Laws(NamedTuple):
    """The branch laws of all elements: θ one after the other, sizes, and Y, V, F, log k₀ (4, E)."""

    theta: np.ndarray  # (E·L,)
    sizes: tuple[int, int, int, int]
    scale: np.ndarray


class Room(NamedTuple):
    """What a law is evaluated in."""

    work: np.ndarray  # (5, P)
    x: np.ndarray  # (width,), and x_turn, by_x
    x_turn: np.ndarray
    by_x: np.ndarray
    by_m: np.ndarray  # (memories,)


class Memory(NamedTuple):
    """Deformations, memories, forces and speeds of the elements, with derivatives."""

    y: np.ndarray  # (E,), over Y
    z: np.ndarray  # (E, STATES)
    r: np.ndarray  # (E,)
    dy: np.ndarray  # (E, P)
    dz: np.ndarray  # (E, STATES, P)
    dr: np.ndarray  # (E, P)
    speed: np.ndarray  # (E,), over V
    dspeed: np.ndarray  # (E, P)
    room: Room


def memory_of(laws, columns):
    """Of elements that have not moved, with derivatives by so many columns."""
    E, (width, memories, _, _) = laws.scale.shape[1], laws.sizes
    zeros, rows = np.zeros((3, E)), np.zeros((3, E, columns))
    room = Room(np.zeros((5, columns)), *np.zeros((3, width)), np.zeros(memories))
    y, r, speed = zeros
    dy, dr, dspeed = rows
    z, dz = np.zeros((E, STATES)), np.zeros((E, STATES, columns))
    return Memory(y, z, r, dy, dz, dr, speed, dspeed, room)


@inlined
def _deformation(e, q, rate, dq, drate, u_at, equation, scale, dy, dspeed, sensitive):
    """y/Y and ẏ/V of an element; fills their derivatives (P,)."""
    D, supports, Y, V = equation.D.value, equation.supports, scale[0, e], scale[1, e]
    y, speed = 0.0, 0.0
    if sensitive:
        for p in range(dy.size):
            dy[p] = dspeed[p] = 0.0
    for i in range(q.size):
        d = D[e, i]
        if d != 0.0:
            y += d * q[i]
            speed += d * rate[i]
            if sensitive:
                for p in range(dy.size):
                    dy[p] += d / Y * dq[i, p]
                    dspeed[p] += d / V * drate[i, p]
    for j in range(u_at.size):
        y += supports[0, e, j] * u_at[j]
        speed += supports[1, e, j] * u_at[j]
    return y / Y, speed / V


@inlined
def _turn_within(e, laws, side, h, y1, v1, memory, sensitive):
    """Follow the branch to where the motion turns round before y₁, and begin the next.

    h: the step, in V/Y. Returns the place; fills its derivatives, the third row of the room.
    """
    (theta, sizes, scale), room = laws, memory.room
    first, log_k0, y0, v0 = e * law_size(sizes), scale[3, e], memory.y[e], memory.speed[e]
    dy0, dv0, dy1, dv1 = memory.dy[e], memory.dspeed[e], room.work[0], room.work[1]
    S, D, at, dh, none = memory.z[e], memory.dz[e], room.work[2], room.work[3], room.work[4]
    x, x_turn, by_x, by_m = room.x, room.x_turn, room.by_x, room.by_m
    t = extreme_at(y0, y1, h * v0, h * v1) if v0 * v1 < 0.0 and v0 * side < 0.0 else 0.0
    by_y0, by_v0, by_y1, by_v1 = hermite(t)
    by_v0, by_v1 = h * by_v0, h * by_v1
    y = by_y0 * y0 + by_v0 * v0 + by_y1 * y1 + by_v1 * v1
    if sensitive:
        for p in range(at.size):
            at[p] = by_y0 * dy0[p] + by_v0 * dv0[p] + by_y1 * dy1[p] + by_v1 * dv1[p]
    force = 0.0
    if S[SIDE] != 0.0:
        force, _ = follow(
            theta, first, sizes, y, 0.0, at, none, S, D, dh, x, x_turn, by_x, sensitive
        )
    elif sensitive:
        for p in range(dh.size):
            dh[p] = 0.0
    go_on(y, y0, force, at, dy0, dh, S, D, sensitive)
    turn(theta, first, sizes, log_k0, side, y, at, S, D, by_m, sensitive)
    return y


@compiled
def forces_of_branches(q, rate, dq, drate, moved, h, u_at, equation, laws, memory):
    """Forces of the elements r (E,) and dr (E, P); where the structure `moved`, by a step h.

    The memory is that before the move and becomes that after it.
    """
    theta, sizes, scale = laws
    y, S, r, dy, dS, dr, speed, dspeed, room = memory
    work, x, x_turn, by_x, _ = room
    E, size, P = y.size, law_size(sizes), dq.shape[1]
    sensitive = P > 0
    dnow, dfast, at, dh = work[0], work[1], work[2], work[3]
    for e in range(E):
        Y, V, F = scale[0, e], scale[1, e], scale[2, e]
        first = e * size
        now, fast = _deformation(
            e, q, rate, dq, drate, u_at, equation, scale, dnow, dfast, sensitive
        )
        before, turned = y[e], False
        if moved:
            side = 0.0
            if S[e, SIDE] == 0.0 and now != before:
                side = 1.0 if now > before else -1.0
            elif S[e, SIDE] * fast < 0.0:
                side = -S[e, SIDE]
            if side != 0.0:
                turned = True
                before = _turn_within(e, laws, side, h * V / Y, now, fast, memory, sensitive)
        force, still = 0.0, 1.0
        if S[e, SIDE] != 0.0:
            force, still = follow(
                theta, first, sizes, now, fast, dnow, dfast, S[e], dS[e], dh, x, x_turn, by_x,
                sensitive,
            )  # fmt: skip
        elif sensitive:
            for p in range(P):
                dh[p] = 0.0
        go_on(now, before, force, dnow, at if turned else dy[e], dh, S[e], dS[e], sensitive)
        r[e] = F * element_force(
            theta, first + size - 1, now, fast, force, still, dnow, dfast, dh, dr[e], sensitive
        )
        y[e], speed[e] = now, fast
        if sensitive:
            for p in range(P):
                dr[e, p] *= F
                dy[e, p], dspeed[e, p] = dnow[p], dfast[p]


@inlined
def begin_branches(q, rate, dq, drate, u_at, equation, laws, memory):
    """Elements that remember nothing but where they are."""
    y, past, dy, dpast, dspeed = memory.y, memory.z, memory.dy, memory.dz, memory.dspeed
    for e in range(y.size):
        at, _ = _deformation(
            e, q, rate, dq, drate, u_at, equation, laws.scale, dy[e], dspeed[e], dy.shape[1] > 0
        )
        past[e, Y_TURN] = at
        y[e], past[e, HIGHEST], past[e, LOWEST] = at, max(at, 0.0), min(at, 0.0)
        for p in range(dy.shape[1]):
            dpast[e, Y_TURN, p] = dy[e, p]
            dpast[e, HIGHEST if at > 0.0 else LOWEST, p] = dy[e, p]
