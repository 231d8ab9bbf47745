"""A composition of elements that follow the branch law, compiled, with its derivatives.

The steps are those of simulate_compiled.py. An element that turns round within a step does so where
the cubic through both ends of the step has no slope. The derivatives by all P parameters go along;
θ of the laws, an element's after the other's, are the first of them.
E elements, n coordinates. The readable reference: branch_run.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers
from models.composition import branch_law_compiled, laws_compiled, simulate_compiled
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
from models.composition.simulate_compiled import (
    _accelerations,
    _begin_anew,
    _jump,
    _move,
    _speed_up,
)

_SOURCES = (branch_law_compiled, laws_compiled, simulate_compiled)
compiled, inlined = compilers(
    Path(__file__), *(Path(str(module.__file__)) for module in _SOURCES), contract=True
)


@inlined
def _deformation(e, q, rate, dq, drate, u_at, D, supports, Y, V, dy, dspeed, sensitive):
    """y/Y and ẏ/V of an element; fills their derivatives (P,)."""
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
def _turn_within(theta, first, sizes, log_k0, side, h, y0, v0, y1, v1, dy0, dv0, dy1, dv1,
                 S, D, at, dh, none, x, x_turn, by_x, by_m, sensitive):  # fmt: skip
    """Follow the branch to where the motion turns round between y₀ and y₁, and begin the next.

    h: the step, in V/Y. Returns the place; fills its derivatives `at` (P,).
    """
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
def _forces(q, rate, dq, drate, moved, h, u_at, D, supports, theta, sizes, scale,
            y, speed, dy, dspeed, S, dS, r, dr, work, x, x_turn, by_x, by_m):  # fmt: skip
    """Forces of the elements r (E,) and dr (E, P); where the structure `moved`, by a step h.

    y, speed (E,), their derivatives (E, P) and the memories S (E, STATES), dS (E, STATES, P) are
    those before the move and become those after it.
    """
    E, size, P = D.shape[0], law_size(sizes), dq.shape[1]
    sensitive = P > 0
    dnow, dfast, at, dh, none = work[0], work[1], work[2], work[3], work[4]
    for e in range(E):
        Y, V, F, log_k0 = scale[0, e], scale[1, e], scale[2, e], scale[3, e]
        first = e * size
        now, fast = _deformation(
            e, q, rate, dq, drate, u_at, D, supports, Y, V, dnow, dfast, sensitive
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
                before = _turn_within(
                    theta, first, sizes, log_k0, side, h * V / Y, before, speed[e], now, fast,
                    dy[e], dspeed[e], dnow, dfast, S[e], dS[e], at, dh, none,
                    x, x_turn, by_x, by_m, sensitive,
                )  # fmt: skip
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


@compiled
def run(u, between, dt, every, measured, begin, core, icore, score, inputs, iinputs, sinputs,
        G, iG, sG, D, supports, theta, sizes, scale, measures, bound,
        P, S, x, v, a, forces, deformations, jacobian):  # fmt: skip
    """A free run as that of simulate_compiled.py, of outputs that are the coordinates themselves.

    theta (E·L,): of the branch laws; scale (4, E): Y, V, F and log k₀ of each. begin: q and q̇ at
    the first sample (2n,), or empty. Of the P + S columns of the jacobian, S are by `begin`.
    """
    T, substeps = len(u), between.shape[1]
    E, n = D.shape
    h, first, P = dt / substeps, P, P + S
    width, memories, _, _ = sizes
    q, rate, ahead, acc, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    dq, drate, dahead = np.zeros((n, P)), np.zeros((n, P)), np.zeros((n, P))
    dacc, dnew = np.zeros((n, P)), np.zeros((n, P))
    y, speed, dy, dspeed = np.zeros(E), np.zeros(E), np.zeros((E, P)), np.zeros((E, P))
    r, dr, work = np.zeros(E), np.zeros((E, P)), np.zeros((5, P))
    past, dpast = np.zeros((E, STATES)), np.zeros((E, STATES, P))
    w, w_turn, by_w, by_m = np.zeros(width), np.zeros(width), np.zeros(width), np.zeros(memories)
    back, none = np.eye(n), np.full((n, n), -1)
    for k in range(T):
        begins = k == 0 or (every > 0 and (k - 1) % every == 0)
        if begins:
            _begin_anew(measured, max(k - 1, 0), back, none, back, q, rate, dq, drate)
            if k == 0 and begin.size > 0:
                for i in range(n):
                    q[i], rate[i] = begin[i], begin[n + i]
                    if S > 0:
                        dq[i, first + i] = drate[i, first + n + i] = 1.0
            if k == 0:
                for e in range(E):
                    at, _ = _deformation(
                        e, q, rate, dq, drate, u[0], D, supports, scale[0, e], scale[1, e],
                        dy[e], dspeed[e], P > 0,
                    )  # fmt: skip
                    past[e, Y_TURN] = at
                    y[e], past[e, HIGHEST], past[e, LOWEST] = at, max(at, 0.0), min(at, 0.0)
                    for p in range(P):
                        dpast[e, Y_TURN, p] = dy[e, p]
                        dpast[e, HIGHEST if at > 0.0 else LOWEST, p] = dy[e, p]
            _forces(q, rate, dq, drate, False, h, u[max(k - 1, 0)], D, supports, theta,
                    sizes, scale, y, speed, dy, dspeed, past, dpast, r, dr, work, w, w_turn, by_w,
                    by_m)  # fmt: skip
            _accelerations(q, rate, dq, drate, u[max(k - 1, 0)], core, icore, score, inputs,
                           iinputs, sinputs, G, iG, sG, r, dr, acc, dacc)  # fmt: skip
        for substep in range(substeps if k > 0 else 0):
            _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead)
            now = between[k - 1, substep]
            _forces(q, ahead, dq, dahead, True, h, now, D, supports, theta, sizes, scale, y, speed,
                    dy, dspeed, past, dpast, r, dr, work, w, w_turn, by_w, by_m)  # fmt: skip
            _accelerations(q, ahead, dq, dahead, now, core, icore, score, inputs, iinputs, sinputs,
                           G, iG, sG, r, dr, new, dnew)  # fmt: skip
            _speed_up(h, rate, acc, new, drate, dacc, dnew)
        if k > 0:
            _jump(u[k], between[k - 1, substeps - 1], inputs, iinputs, sinputs, acc, dacc)
        lost = False
        for i in range(n):
            x[k, i], v[k, i], a[k, i] = q[i], rate[i], acc[i]
            for p in range(P):
                if measures[i] == 2:
                    jacobian[k, i, p] = dacc[i, p]
                elif measures[i] == 1:
                    jacobian[k, i, p] = drate[i, p]
                else:
                    jacobian[k, i, p] = dq[i, p]
            seen = (q[i], rate[i], acc[i])[measures[i]]
            lost = lost or not (abs(seen) < bound[i] and abs(q[i]) < np.inf)
        for e in range(E):
            forces[k, e], deformations[k, e] = r[e], scale[0, e] * y[e]
        if lost:
            for later in range(k, T):
                for i in range(n):
                    x[later, i] = v[later, i] = a[later, i] = np.nan
                    for p in range(P):
                        jacobian[later, i, p] = np.nan
                for e in range(E):
                    forces[later, e] = deformations[later, e] = np.nan
            return
