"""The equation of motion of models/composition/simulate.py and its derivatives, compiled.

Velocity-Verlet substeps: q and the deformations to the end of a substep, the units from the
increments of deformation, the accelerations there with a velocity that is extrapolated, then the
velocity by the trapezoid: second order, one evaluation a substep. Along with the motion go its
derivatives by P parameters; every coefficient depends on one parameter at most, whose number and
slope stand beside it (−1: on none), so that a coefficient adds one number to one derivative.
The PyTorch version in composition.py is the reference; tests hold both together.

n coordinates, E elements, m excitations, o outputs, T samples, S substeps, P parameters.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__), contract=True)

LINEAR = 6  # columns before those of hinges, tanhs and units
STIFFNESS, DAMPING, CUBIC, QUADRATIC, ABSOLUTE_DAMPING, SQUARE_DAMPING = range(LINEAR)
LOST = 1e6  # [m]; a motion beyond has diverged


@inlined
def _add(row, index, value):
    if index >= 0:
        row[index] += value


@inlined
def _unit(z, delta, limit, slope_up, slope_down):
    """z after an increment of deformation, its slopes by z and delta, and by the b in use.

    dz = (1 + b u) dy with u = sgn(dy) z is solved exactly up to fourth order; then |z| ≤ limit.
    side: ±1 on the limit, 0 within.
    """
    sign = 1.0 if delta > 0.0 else -1.0
    rising = sign * z > 0.0
    c = sign * (slope_up if rising else slope_down)
    q, h = c * delta, 1.0 + c * z
    phi = 1.0 + q * (0.5 + q * (1.0 / 6.0 + q / 24.0))
    slope = 0.5 + q * (1.0 / 3.0 + q / 8.0)
    new = z + delta * h * phi
    if new > limit:
        return limit, 1, rising, 0.0, 0.0, 0.0
    if new < -limit:
        return -limit, -1, rising, 0.0, 0.0, 0.0
    by_b = sign * delta * (z * phi + delta * h * slope)
    return new, 0, rising, 1.0 + q * phi, h * (phi + q * slope), by_b


@inlined
def _memoryless(e, y, rate, laws, ilaws, slaws, hinges, tanhs, dr, sensitive):
    """Force of an element's spring and damper, its slopes by y and ẏ; own parameters into dr."""
    p = laws[e]
    size, side = abs(y), (1.0 if y > 0.0 else -1.0)
    r = p[0] * y + p[1] * rate + p[2] * y**3 + p[3] * y * y + (p[4] * size + p[5] * y * y) * rate
    by_y = p[0] + 3.0 * p[2] * y * y + 2.0 * p[3] * y + (p[4] * side + 2.0 * p[5] * y) * rate
    by_rate = p[1] + p[4] * size + p[5] * y * y
    if sensitive:
        _add(dr, ilaws[e, 0], slaws[e, 0] * y)
        _add(dr, ilaws[e, 1], slaws[e, 1] * rate)
        _add(dr, ilaws[e, 2], slaws[e, 2] * y**3)
        _add(dr, ilaws[e, 3], slaws[e, 3] * y * y)
        _add(dr, ilaws[e, 4], slaws[e, 4] * size * rate)
        _add(dr, ilaws[e, 5], slaws[e, 5] * y * y * rate)
    for j in range(LINEAR, LINEAR + 2 * hinges, 2):
        if size > p[j + 1]:
            r += p[j] * side * (size - p[j + 1])
            by_y += p[j]
            if sensitive:
                _add(dr, ilaws[e, j], slaws[e, j] * side * (size - p[j + 1]))
                _add(dr, ilaws[e, j + 1], -slaws[e, j + 1] * side * p[j])
    for j in range(LINEAR + 2 * hinges, LINEAR + 2 * hinges + 3 * tanhs, 3):
        g, s, b = p[j], p[j + 1], p[j + 2]
        above, below, middle = np.tanh(s * (y + b)), np.tanh(s * (y - b)), np.tanh(s * b)
        step = (above + below) / (2.0 * s)
        up, down, flat = 1.0 - above * above, 1.0 - below * below, 1.0 - middle * middle
        r += g * (step - flat * y)
        by_y += g * (0.5 * (up + down) - flat)
        if sensitive:
            _add(dr, ilaws[e, j], slaws[e, j] * (step - flat * y))
            turn = (0.5 * (up * (y + b) + down * (y - b)) - step) / s
            turn += 2.0 * middle * flat * b * y
            _add(dr, ilaws[e, j + 1], slaws[e, j + 1] * g * turn)
            shift = 0.5 * (up - down) + 2.0 * middle * flat * s * y
            _add(dr, ilaws[e, j + 2], slaws[e, j + 2] * g * shift)
    return r, by_y, by_rate


@inlined
def _forces(q, rate, dq, drate, moved, u_at, D, iD, sD, supports, laws, ilaws, slaws, counts,
            y, dy, z, dz, r, dr, work):  # fmt: skip
    """Element forces r (E,) and dr (E, P); where the structure `moved`, the units follow.

    y, z and their derivatives are those before the move and become those after it.
    """
    hinges, tanhs, units = counts
    E, n = D.shape
    P, m = dq.shape[1], u_at.size
    dnow, drate_e = work[0], work[1]  # (P,) each
    for e in range(E):
        ye, ratee = 0.0, 0.0
        for p in range(P):
            dnow[p] = 0.0
            drate_e[p] = 0.0
        for i in range(n):
            d = D[e, i]
            if d != 0.0:
                ye += d * q[i]
                ratee += d * rate[i]
                for p in range(P):
                    dnow[p] += d * dq[i, p]
                    drate_e[p] += d * drate[i, p]
            if P > 0:
                _add(dnow, iD[e, i], sD[e, i] * q[i])
                _add(drate_e, iD[e, i], sD[e, i] * rate[i])
        for j in range(m):
            ye += supports[0, e, j] * u_at[j]
            ratee += supports[1, e, j] * u_at[j]
        for p in range(P):
            dr[e, p] = 0.0
        r[e], by_y, by_rate = _memoryless(
            e, ye, ratee, laws, ilaws, slaws, hinges, tanhs, dr[e], P > 0
        )
        first = LINEAR + 2 * hinges + 3 * tanhs
        for unit in range(units):
            j = first + 4 * unit
            weight = laws[e, j]
            if moved:
                z[e, unit], side, rising, by_z, by_delta, by_b = _unit(
                    z[e, unit], ye - y[e], laws[e, j + 1], laws[e, j + 2], laws[e, j + 3]
                )
                for p in range(P):
                    dz[e, unit, p] = by_z * dz[e, unit, p] + by_delta * (dnow[p] - dy[e, p])
                if P > 0:
                    used = j + 2 if rising else j + 3
                    _add(dz[e, unit], ilaws[e, j + 1], side * slaws[e, j + 1])
                    _add(dz[e, unit], ilaws[e, used], by_b * slaws[e, used])
            r[e] += weight * (z[e, unit] - ye)
            by_y -= weight
            for p in range(P):
                dr[e, p] += weight * dz[e, unit, p]
            if P > 0:
                _add(dr[e], ilaws[e, j], slaws[e, j] * (z[e, unit] - ye))
        y[e] = ye
        for p in range(P):
            dr[e, p] += by_y * dnow[p] + by_rate * drate_e[p]
            dy[e, p] = dnow[p]


@inlined
def _accelerations(q, rate, dq, drate, u_at, core, icore, score, inputs, iinputs, sinputs,
                   G, iG, sG, r, dr, a, da):  # fmt: skip
    """q̈ (n,) and its derivatives (n, P)."""
    n, m = inputs.shape
    E, P = dr.shape
    for i in range(n):
        a[i] = -core[0, i] * q[i] - core[1, i] * rate[i]
        for p in range(P):
            da[i, p] = -core[0, i] * dq[i, p] - core[1, i] * drate[i, p]
        if P > 0:
            _add(da[i], icore[0, i], -score[0, i] * q[i])
            _add(da[i], icore[1, i], -score[1, i] * rate[i])
        for j in range(m):
            a[i] += inputs[i, j] * u_at[j]
            if P > 0:
                _add(da[i], iinputs[i, j], sinputs[i, j] * u_at[j])
        for e in range(E):
            g = G[i, e]
            if g != 0.0:
                a[i] -= g * r[e]
                for p in range(P):
                    da[i, p] -= g * dr[e, p]
            if P > 0:
                _add(da[i], iG[i, e], -sG[i, e] * r[e])


@compiled
def run(u, between, dt, every, measured, back, core, icore, score, inputs, iinputs,
        sinputs, G, iG, sG, D, iD, sD, supports, laws, ilaws, slaws, counts, outputs, ioutputs,
        soutputs, measures, P, x, v, a, forces, deformations, jacobian):  # fmt: skip
    """A free run from the first of `measured` (2, T, o), begun anew every `every` samples (0: not).

    u (T, m); between (T − 1, S, m), u at the end of each substep. Fills x, v, a (T, o), forces and
    deformations (T, E) and, for P > 0, jacobian (T, o, P) of what each output `measures` (o,): the
    displacement (0), velocity (1) or acceleration (2). The units' memory goes on where a
    run begins anew. A run that is lost is NaN from there on.
    """
    (T, m), S = u.shape, between.shape[1]
    E, n = D.shape
    o, h = outputs.shape[0], dt / S
    q, rate, ahead, acc, new = np.zeros((5, n))
    dq, drate, dahead = np.zeros((n, P)), np.zeros((n, P)), np.zeros((n, P))
    dacc, dnew = np.zeros((n, P)), np.zeros((n, P))
    y, dy, r, dr = np.zeros(E), np.zeros((E, P)), np.zeros(E), np.zeros((E, P))
    z, dz, work = np.zeros((E, counts[2])), np.zeros((E, counts[2], P)), np.zeros((2, P))
    for k in range(T):
        begins = k == 0 or (every > 0 and (k - 1) % every == 0)
        if begins:
            _begin_anew(measured, max(k - 1, 0), back, ioutputs, soutputs, q, rate, dq, drate)
            _forces(q, rate, dq, drate, False, u[max(k - 1, 0)], D, iD, sD, supports, laws, ilaws,
                    slaws, counts, y, dy, z, dz, r, dr, work)  # fmt: skip
            _accelerations(q, rate, dq, drate, u[max(k - 1, 0)], core, icore, score, inputs,
                           iinputs, sinputs, G, iG, sG, r, dr, acc, dacc)  # fmt: skip
        for substep in range(S if k > 0 else 0):
            for i in range(n):
                q[i] += h * (rate[i] + 0.5 * h * acc[i])
                ahead[i] = rate[i] + h * acc[i]
                for p in range(P):
                    dq[i, p] += h * (drate[i, p] + 0.5 * h * dacc[i, p])
                    dahead[i, p] = drate[i, p] + h * dacc[i, p]
            at = between[k - 1, substep]
            _forces(q, ahead, dq, dahead, True, at, D, iD, sD, supports, laws, ilaws, slaws,
                    counts, y, dy, z, dz, r, dr, work)  # fmt: skip
            _accelerations(q, ahead, dq, dahead, at, core, icore, score, inputs, iinputs, sinputs,
                           G, iG, sG, r, dr, new, dnew)  # fmt: skip
            for i in range(n):
                rate[i] += 0.5 * h * (acc[i] + new[i])
                acc[i] = new[i]
                for p in range(P):
                    drate[i, p] += 0.5 * h * (dacc[i, p] + dnew[i, p])
                    dacc[i, p] = dnew[i, p]
        for j in range(m):  # an excitation held between samples jumps at them
            jump = u[k, j] - between[k - 1, S - 1, j] if k > 0 else 0.0
            if jump != 0.0:
                for i in range(n):
                    acc[i] += inputs[i, j] * jump
                    if P > 0:
                        _add(dacc[i], iinputs[i, j], sinputs[i, j] * jump)
        lost = False
        for c in range(o):
            x[k, c] = v[k, c] = a[k, c] = 0.0
            for p in range(P):
                jacobian[k, c, p] = 0.0
            for i in range(n):
                weight = outputs[c, i]
                x[k, c] += weight * q[i]
                v[k, c] += weight * rate[i]
                a[k, c] += weight * acc[i]
                if weight != 0.0:
                    for p in range(P):
                        if measures[c] == 2:
                            jacobian[k, c, p] += weight * dacc[i, p]
                        elif measures[c] == 1:
                            jacobian[k, c, p] += weight * drate[i, p]
                        else:
                            jacobian[k, c, p] += weight * dq[i, p]
                if P > 0:
                    seen = (q[i], rate[i], acc[i])[measures[c]]
                    _add(jacobian[k, c], ioutputs[c, i], soutputs[c, i] * seen)
            lost = lost or not abs(x[k, c]) < LOST
        for e in range(E):
            forces[k, e], deformations[k, e] = r[e], y[e]
        if lost:
            for lost_signal in (x, v, a, forces, deformations):
                lost_signal[k:] = np.nan
            jacobian[k:] = np.nan
            return


@inlined
def _begin_anew(measured, k, back, ioutputs, soutputs, q, rate, dq, drate):
    """q = Φ⁺ x, dq = −Φ⁺ dΦ q; q̇ likewise."""
    n, o = back.shape
    for i in range(n):
        q[i] = rate[i] = 0.0
        dq[i] = 0.0
        drate[i] = 0.0
        for c in range(o):
            q[i] += back[i, c] * measured[0, k, c]
            rate[i] += back[i, c] * measured[1, k, c]
    if dq.shape[1] > 0:
        for i in range(n):
            for c in range(o):
                for j in range(n):
                    _add(dq[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * q[j])
                    _add(drate[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * rate[j])
