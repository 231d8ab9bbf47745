"""The free run of a modal network and its derivatives, compiled.

q̈ = −k q − c q̇ + Γ (u + u₀) − G r,   y = D q,   o = C_q q + C_v q̇ + D_u u + D_r r + o₀

Modes step by their exact exponential, the excitation within a substep as a parabola, the elements'
forces linearly: r is extrapolated as it was, evaluated at the end that this predicts, and the end
corrected: second order, one evaluation a substep. `core` (J, 3, 14) has for every mode eᴬʰ (2, 2),
P₀, P₁ of a linear force and Q₀, Q½, Q₁ of a parabola, and their slopes by log k and log c.

J modes, E elements, m inputs, o outputs, T samples; P columns of derivatives by parameters and by
the first state.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.numba_cache import compilers
from models.modal.units_compiled import HERE, HINGE, TERMS, UNIT, hinge, terms, unit_step

compiled, inlined = compilers(Path(__file__), HERE, contract=True)


class Parts(NamedTuple):
    """Numbers of a network; or the column of derivatives that each has, −1 where it has none."""

    core: np.ndarray  # (J, 3, 14); the columns of log k and log c: (2, J)
    gamma: np.ndarray  # (J, m)
    u0: np.ndarray  # (m,)
    G: np.ndarray  # (J, E)
    D: np.ndarray  # (E, J)
    laws: np.ndarray  # (E, ·)
    Cq: np.ndarray  # (o, J), and Cv
    Cv: np.ndarray
    Du: np.ndarray  # (o, m)
    Dr: np.ndarray  # (o, E)
    o0: np.ndarray  # (o,)


class Modes(NamedTuple):
    """q and q̇, with derivatives."""

    q: np.ndarray  # (J,), and v
    v: np.ndarray
    dq: np.ndarray  # (J, P), and dv
    dv: np.ndarray


class Elements(NamedTuple):
    """Deformations y, now and before, memories of units and forces, with derivatives."""

    y: np.ndarray  # (E,), and rate
    rate: np.ndarray
    dy: np.ndarray  # (E, P), and drate
    drate: np.ndarray
    before: np.ndarray  # (E,)
    dbefore: np.ndarray  # (E, P)
    z: np.ndarray  # (E, units)
    dz: np.ndarray  # (E, units, P)
    r: np.ndarray  # (E,)
    dr: np.ndarray  # (E, P)
    new: np.ndarray  # (E,): forces at the end of a substep
    dnew: np.ndarray  # (E, P)


class Filled(NamedTuple):
    """What a run fills; states and jacobian may have no rows."""

    out: np.ndarray  # (·, o)
    states: np.ndarray  # (·, 2J + 2E): q, q̇, y, ẏ
    jacobian: np.ndarray  # (·, o, columns), of which the first P have dynamics


@inlined
def add(row, column, value):
    if column >= 0:
        row[column] += value


@inlined
def _deform(parts, at, modes, elements):
    """y = D q and ẏ = D q̇ of every element, with derivatives."""
    D, at_D = parts.D, at.D
    q, v, dq, dv = modes
    y, rate, dy, drate = elements.y, elements.rate, elements.dy, elements.drate
    E, J = D.shape
    P = dq.shape[1]
    for i in range(E):
        y[i] = 0.0
        rate[i] = 0.0
        for p in range(P):
            dy[i, p] = 0.0
            drate[i, p] = 0.0
        for j in range(J):
            d = D[i, j]
            y[i] += d * q[j]
            rate[i] += d * v[j]
            for p in range(P):
                dy[i, p] += d * dq[j, p]
                drate[i, p] += d * dv[j, p]
            if P > 0:
                add(dy[i], at_D[i, j], q[j])
                add(drate[i], at_D[i, j], v[j])


@inlined
def _laws(parts, at, counts, elements, moved, r, dr, phi):
    """r of every element, with derivatives; units move from the deformations `before`."""
    laws, at_laws = parts.laws, at.laws
    hinges, units = counts
    y, rate, dy, drate = elements.y, elements.rate, elements.dy, elements.drate
    before, dbefore, z, dz = elements.before, elements.dbefore, elements.z, elements.dz
    E = laws.shape[0]
    P = dy.shape[1]
    for i in range(E):
        terms(y[i], rate[i], phi[0], phi[1], phi[2])
        by_y, by_rate, r[i] = 0.0, 0.0, 0.0
        for p in range(P):
            dr[i, p] = 0.0
        for k in range(TERMS):
            w = laws[i, k]
            r[i] += w * phi[0, k]
            by_y += w * phi[1, k]
            by_rate += w * phi[2, k]
            if P > 0:
                add(dr[i], at_laws[i, k], phi[0, k])
        column = TERMS
        for _ in range(hinges):
            value, slope, by_width = hinge(y[i], laws[i, column + 1], laws[i, column + 2])
            w = laws[i, column]
            r[i] += w * value
            by_y += w * slope
            if P > 0:
                add(dr[i], at_laws[i, column], value)
                add(dr[i], at_laws[i, column + 1], -w * slope)
                add(dr[i], at_laws[i, column + 2], w * by_width)
            column += HINGE
        for unit in range(units):
            w = laws[i, column]
            if moved:
                z[i, unit], by_z, by_delta, by_beta, by_kappa = unit_step(
                    z[i, unit], y[i] - before[i], laws[i, column + 1], laws[i, column + 2]
                )
                for p in range(P):
                    dz[i, unit, p] = by_z * dz[i, unit, p] + by_delta * (dy[i, p] - dbefore[i, p])
                if P > 0:
                    add(dz[i, unit], at_laws[i, column + 1], by_beta)
                    add(dz[i, unit], at_laws[i, column + 2], by_kappa)
            r[i] += w * (z[i, unit] - y[i])
            by_y -= w
            for p in range(P):
                dr[i, p] += w * dz[i, unit, p]
            if P > 0:
                add(dr[i], at_laws[i, column], z[i, unit] - y[i])
            column += UNIT
        for p in range(P):
            dr[i, p] += by_y * dy[i, p] + by_rate * drate[i, p]
        before[i] = y[i]
        for p in range(P):
            dbefore[i, p] = dy[i, p]


@inlined
def _predict(parts, at, now, elements, modes):
    """Modes at the end of a substep under forces of elements that stay; now (3, m) the input."""
    core, gamma, offset, G = parts.core, parts.gamma, parts.u0, parts.G
    q, v, dq, r = modes.q, modes.v, modes.dq, elements.r
    J, m = gamma.shape
    for j in range(J):
        c = core[j, 0]
        f0, fm, f1, g = 0.0, 0.0, 0.0, 0.0
        for n in range(m):
            f0 += gamma[j, n] * (now[0, n] + offset[n])
            fm += gamma[j, n] * (now[1, n] + offset[n])
            f1 += gamma[j, n] * (now[2, n] + offset[n])
        for i in range(r.size):
            g -= G[j, i] * r[i]
        qj, vj = q[j], v[j]
        for side in range(2):
            one, two = c[2 * side], c[2 * side + 1]
            held = c[4 + side] + c[6 + side]
            state = one * qj + two * vj + held * g
            state += c[8 + side] * f0 + c[10 + side] * fm + c[12 + side] * f1
            if side == 0:
                q[j] = state
            else:
                v[j] = state
        if dq.shape[1] > 0:
            _slopes_of_mode(j, parts, at, now, elements, modes, (qj, vj, g, f0, fm, f1))


@inlined
def _slopes_of_mode(j, parts, at, now, elements, modes, before):
    """Derivatives of a mode at the end of a substep; before: its state and what moved it."""
    core, gamma, offset, G = parts.core, parts.gamma, parts.u0, parts.G
    at_core, at_gamma, at_offset, at_G = at.core, at.gamma, at.u0, at.G
    r, dr = elements.r, elements.dr
    dq, dv = modes.dq, modes.dv
    qj, vj, g, f0, fm, f1 = before
    c, P = core[j, 0], dq.shape[1]
    held0, held1 = c[4] + c[6], c[5] + c[7]
    for p in range(P):
        a, b = dq[j, p], dv[j, p]
        dq[j, p] = c[0] * a + c[1] * b
        dv[j, p] = c[2] * a + c[3] * b
    for i in range(r.size):
        w0, w1 = -held0 * G[j, i], -held1 * G[j, i]
        for p in range(P):
            dq[j, p] += w0 * dr[i, p]
            dv[j, p] += w1 * dr[i, p]
        add(dq[j], at_G[j, i], -held0 * r[i])
        add(dv[j], at_G[j, i], -held1 * r[i])
    for n in range(gamma.shape[1]):
        for side in range(2):
            row = dq[j] if side == 0 else dv[j]
            moved = (
                c[8 + side] * (now[0, n] + offset[n])
                + c[10 + side] * (now[1, n] + offset[n])
                + c[12 + side] * (now[2, n] + offset[n])
            )
            add(row, at_gamma[j, n], moved)
            add(row, at_offset[n], gamma[j, n] * (c[8 + side] + c[10 + side] + c[12 + side]))
    for which in range(2):
        s = core[j, 1 + which]
        for side in range(2):
            row = dq[j] if side == 0 else dv[j]
            moved = s[2 * side] * qj + s[2 * side + 1] * vj + (s[4 + side] + s[6 + side]) * g
            moved += s[8 + side] * f0 + s[10 + side] * fm + s[12 + side] * f1
            add(row, at_core[which, j], moved)


@inlined
def _correct(parts, at, elements, modes):
    """Modes at the end of a substep, where the forces of elements have become `new`."""
    core, G = parts.core, parts.G
    r, new, q, v = elements.r, elements.new, modes.q, modes.v
    for j in range(q.size):
        change = 0.0
        for i in range(r.size):
            change -= G[j, i] * (new[i] - r[i])
        q[j] += core[j, 0, 6] * change
        v[j] += core[j, 0, 7] * change
        if modes.dq.shape[1] > 0:
            _slopes_of_correction(j, parts, at, elements, modes, change)


@inlined
def _slopes_of_correction(j, parts, at, elements, modes, change):
    """Derivatives of a mode whose forces of elements have become `new`."""
    core, at_core, G, at_G = parts.core, at.core, parts.G, at.G
    r, dr, new, dnew = elements.r, elements.dr, elements.new, elements.dnew
    dq, dv = modes.dq, modes.dv
    for i in range(r.size):
        w0, w1 = -core[j, 0, 6] * G[j, i], -core[j, 0, 7] * G[j, i]
        for p in range(dq.shape[1]):
            by = dnew[i, p] - dr[i, p]
            dq[j, p] += w0 * by
            dv[j, p] += w1 * by
        add(dq[j], at_G[j, i], -core[j, 0, 6] * (new[i] - r[i]))
        add(dv[j], at_G[j, i], -core[j, 0, 7] * (new[i] - r[i]))
    for which in range(2):
        add(dq[j], at_core[which, j], core[j, 1 + which, 6] * change)
        add(dv[j], at_core[which, j], core[j, 1 + which, 7] * change)


@inlined
def output_of(c, u, parts, modes, r):
    """Output c under an input (m,)."""
    q, v, value = modes.q, modes.v, parts.o0[c]
    for j in range(q.size):
        value += parts.Cq[c, j] * q[j] + parts.Cv[c, j] * v[j]
    for n in range(u.size):
        value += parts.Du[c, n] * u[n]
    for i in range(r.size):
        value += parts.Dr[c, i] * r[i]
    return value


@compiled
def run(u, fine, first, last, parts, at, counts, modes, elements, bound, filled):
    """Samples `first` … `last − 1`, from the state of the sample before, or at sample 0.

    The state is q, q̇, z and, once a run has begun, y `before` and r of the elements.

    u (T, m) at samples; fine (T − 1, 2S + 1, m) from a sample to the next.
    Returns whether the outputs stayed below `bound`; they are NaN from where they do not.
    """
    q, v, dq, dv = modes
    y, rate, r, dr = elements.y, elements.rate, elements.r, elements.dr
    new, dnew = elements.new, elements.dnew
    Cq, Cv, Dr = parts.Cq, parts.Cv, parts.Dr
    at_Cq, at_Cv, at_Du, at_Dr, at_o0 = at.Cq, at.Cv, at.Du, at.Dr, at.o0
    out, states, jacobian = filled
    J, m = parts.gamma.shape
    E, o = r.size, parts.o0.size
    P, S = dq.shape[1], (fine.shape[1] - 1) // 2
    phi, now = np.zeros((3, TERMS)), np.zeros((3, m))
    if first == 0:
        _deform(parts, at, modes, elements)
        _laws(parts, at, counts, elements, False, r, dr, phi)
    for k in range(first, last):
        for s in range(S if k > 0 else 0):
            for n in range(m):
                for part in range(3):
                    now[part, n] = fine[k - 1, 2 * s + part, n]
            _predict(parts, at, now, elements, modes)
            if E > 0:
                _deform(parts, at, modes, elements)
                _laws(parts, at, counts, elements, True, new, dnew, phi)
                _correct(parts, at, elements, modes)
                for i in range(E):
                    r[i] = new[i]
                    for p in range(P):
                        dr[i, p] = dnew[i, p]
        row = k - first
        for c in range(o):
            value = output_of(c, u[k], parts, modes, r)
            out[row, c] = value
            if not abs(value) < bound:
                for later in range(row, len(out)):
                    for i in range(o):
                        out[later, i] = np.nan
                return False
        if states.shape[0] > 0:
            for j in range(J):
                states[row, j], states[row, J + j] = q[j], v[j]
            for i in range(E):
                states[row, 2 * J + i], states[row, 2 * J + E + i] = y[i], rate[i]
        if jacobian.shape[0] == 0:
            continue
        for c in range(o):
            jac = jacobian[row, c]
            for p in range(jac.size):
                jac[p] = 0.0
            for j in range(J):
                wq, wv = Cq[c, j], Cv[c, j]
                for p in range(P):
                    jac[p] += wq * dq[j, p] + wv * dv[j, p]
                add(jac, at_Cq[c, j], q[j])
                add(jac, at_Cv[c, j], v[j])
            for i in range(E):
                for p in range(P):
                    jac[p] += Dr[c, i] * dr[i, p]
                add(jac, at_Dr[c, i], r[i])
            for n in range(m):
                add(jac, at_Du[c, n], u[k, n])
            add(jac, at_o0[c], 1.0)
    return True


@compiled
def features(y, rate, hinges, width, betas):
    """What terms of a law would be along a motion (T, K): φ, hinges, and z − y of units."""
    T, H = y.size, hinges.size
    found = np.zeros((T, TERMS + H + betas.size))
    slopes, z = np.zeros((2, TERMS)), np.zeros(betas.size)
    for t in range(T):
        terms(y[t], rate[t], found[t, :TERMS], slopes[0], slopes[1])
        for h in range(H):
            found[t, TERMS + h] = hinge(y[t], hinges[h], width)[0]
        for unit in range(betas.size):
            if t > 0:
                z[unit] = unit_step(z[unit], y[t] - y[t - 1], betas[unit], 0.0)[0]
            found[t, TERMS + H + unit] = z[unit] - y[t]
    return found


@compiled
def driven(core, f, first, every):
    """q and q̇ (rows, J, K, 2) of modes under forces f (T, K), linear between samples.

    Rows are every so-many-th sample from the `first` on; the run begins at sample 0.
    """
    J, (T, K) = core.shape[0], f.shape
    found = np.zeros(((T - first + every - 1) // every, J, K, 2))
    for j in range(J):
        c = core[j]
        for k in range(K):
            q = v = 0.0
            for t in range(T):
                if t > 0:
                    moved = c[0] * q + c[1] * v + c[4] * f[t - 1, k] + c[6] * f[t, k]
                    v = c[2] * q + c[3] * v + c[5] * f[t - 1, k] + c[7] * f[t, k]
                    q = moved
                if t >= first and (t - first) % every == 0:
                    row = (t - first) // every
                    found[row, j, k, 0] = q
                    found[row, j, k, 1] = v
    return found
