"""The equation of motion of simulate.py and its derivatives, compiled: the production run.

Velocity-Verlet substeps: q and the deformations to the end of a substep, the units from the
increments of deformation, the accelerations there with a velocity that is extrapolated, then the
velocity by the trapezoid: second order, one evaluation a substep. Along with the motion go its
derivatives by P parameters. simulate.py is the readable reference; tests hold both together.

n coordinates, E elements, m excitations, o outputs, T samples, P parameters, S of a beginning.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.numba_cache import compilers
from models.composition.laws_compiled import HERE, LINEAR, add, memoryless, unit_step

compiled, inlined = compilers(Path(__file__), HERE, contract=True)

VECTOR = 8  # numbers that a processor takes at once: rows of derivatives end with one


class Term(NamedTuple):
    """Coefficients of one part: values, the parameter behind each (−1: none), slopes by it."""

    value: np.ndarray
    parameter: np.ndarray
    slope: np.ndarray


class Equation(NamedTuple):
    """q̈ = −K q − C q̇ + Γ u − G r with y = D q + supports u, as `Composition` of simulate.py."""

    core: Term  # K and C (2, n)
    inputs: Term  # Γ (n, m)
    G: Term  # (n, E)
    D: Term  # (E, n)
    laws: Term  # (E, L)
    supports: np.ndarray  # (2, E, m)
    counts: tuple[int, int]  # hinges, units of an element


class Sensors(NamedTuple):
    """What of the motion is returned: o = Φ q, which diverges where it passes `bound`."""

    outputs: Term  # Φ (o, n)
    back: np.ndarray  # Φ⁺ (n, o)
    measures: np.ndarray  # (o,): displacement 0, velocity 1, acceleration 2
    bound: np.ndarray  # (o,)


class Course(NamedTuple):
    """Excitation and start of a run."""

    u: np.ndarray  # (T, m)
    between: np.ndarray  # (T − 1, substeps, m): u at the end of each substep
    dt: float  # [s]
    every: int  # samples after which the run starts again from `measured`; 0: never
    measured: np.ndarray  # x and v (2, ·, o)
    begin: np.ndarray  # q, q̇ and the units' z at the first sample, or empty


class Elements(NamedTuple):
    """Deformations, memories of units and forces of the elements, with derivatives."""

    y: np.ndarray  # (E,)
    dy: np.ndarray  # (E, P)
    z: np.ndarray  # (E, units)
    dz: np.ndarray  # (E, units, P)
    r: np.ndarray  # (E,)
    dr: np.ndarray  # (E, P)
    work: np.ndarray  # (2, P)


class Histories(NamedTuple):
    """What a run fills."""

    x: np.ndarray  # (T, o), and v, a
    v: np.ndarray
    a: np.ndarray
    forces: np.ndarray  # (T, E)
    deformations: np.ndarray
    jacobian: np.ndarray  # (T, o, ·)


@inlined
def _forces(q, rate, dq, drate, moved, u_at, equation, elements):
    """Forces of the elements r (E,) and dr (E, P); where the structure `moved`, the units follow.

    y, z and their derivatives are those before the move and become those after it.
    """
    D, iD, sD = equation.D
    laws, ilaws, slaws = equation.laws
    hinges, units = equation.counts
    supports = equation.supports
    y, dy, z, dz, r, dr, work = elements
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
                add(dnow, iD[e, i], sD[e, i] * q[i])
                add(drate_e, iD[e, i], sD[e, i] * rate[i])
        for j in range(m):
            ye += supports[0, e, j] * u_at[j]
            ratee += supports[1, e, j] * u_at[j]
        for p in range(P):
            dr[e, p] = 0.0
        r[e], by_y, by_rate = memoryless(e, ye, ratee, laws, ilaws, slaws, hinges, dr[e], P > 0)
        first = LINEAR + 2 * hinges
        for unit in range(units):
            j = first + 4 * unit
            weight, side = laws[e, j], 0.0
            if moved:
                z[e, unit], side, by_z, by_delta, by_up, by_down = unit_step(
                    z[e, unit], ye - y[e], laws[e, j + 1], laws[e, j + 2], laws[e, j + 3]
                )
                if side == 0.0:
                    for p in range(P):
                        new = by_z * dz[e, unit, p] + by_delta * (dnow[p] - dy[e, p])
                        dz[e, unit, p] = new
                        dr[e, p] += weight * new
                    if P > 0:
                        add(dz[e, unit], ilaws[e, j + 2], by_up * slaws[e, j + 2])
                        add(dr[e], ilaws[e, j + 2], weight * by_up * slaws[e, j + 2])
                        add(dz[e, unit], ilaws[e, j + 3], by_down * slaws[e, j + 3])
                        add(dr[e], ilaws[e, j + 3], weight * by_down * slaws[e, j + 3])
            else:
                for p in range(P):
                    dr[e, p] += weight * dz[e, unit, p]
            r[e] += weight * (z[e, unit] - ye)
            by_y -= weight
            if side != 0.0:  # on its limit, which alone its memory depends on
                for p in range(P):
                    dz[e, unit, p] = 0.0
                if P > 0:
                    add(dz[e, unit], ilaws[e, j + 1], side * slaws[e, j + 1])
                    add(dr[e], ilaws[e, j + 1], weight * side * slaws[e, j + 1])
            if P > 0:
                add(dr[e], ilaws[e, j], slaws[e, j] * (z[e, unit] - ye))
        y[e] = ye
        for p in range(P):
            dr[e, p] += by_y * dnow[p] + by_rate * drate_e[p]
            dy[e, p] = dnow[p]


@inlined
def _accelerations(q, rate, dq, drate, u_at, equation, r, dr, a, da):
    """q̈ (n,) and its derivatives (n, P)."""
    core, icore, score = equation.core
    inputs, iinputs, sinputs = equation.inputs
    G, iG, sG = equation.G
    n, m = inputs.shape
    E, P = dr.shape
    for i in range(n):
        a[i] = -core[0, i] * q[i] - core[1, i] * rate[i]
        for p in range(P):
            da[i, p] = -core[0, i] * dq[i, p] - core[1, i] * drate[i, p]
        if P > 0:
            add(da[i], icore[0, i], -score[0, i] * q[i])
            add(da[i], icore[1, i], -score[1, i] * rate[i])
        for j in range(m):
            a[i] += inputs[i, j] * u_at[j]
            if P > 0:
                add(da[i], iinputs[i, j], sinputs[i, j] * u_at[j])
        for e in range(E):
            g = G[i, e]
            if g != 0.0:
                a[i] -= g * r[e]
                for p in range(P):
                    da[i, p] -= g * dr[e, p]
            if P > 0:
                add(da[i], iG[i, e], -sG[i, e] * r[e])


@compiled
def run(course, equation, sensors, P, S, histories, lo):
    """A free run from the first of `course.measured`, started again every `course.every` samples.

    Fills the histories and, for P + S > 0, columns `lo` to lo + P + S of the jacobian (T, o, ·) of
    what each output measures; S columns by `course.begin`.
    The units keep their memory where a run starts again. A run of which an output's measure passes
    its bound has diverged; it is NaN from there on.
    """
    u, between, dt, every, measured, begin = course
    outputs, ioutputs, soutputs = sensors.outputs
    back, measures, bound = sensors.back, sensors.measures, sensors.bound
    x, v, a, forces, deformations, jacobian = histories
    T, substeps = len(u), between.shape[1]
    E, n = equation.D.value.shape
    o, h, first, P = outputs.shape[0], dt / substeps, P, P + S
    q, rate, ahead, acc, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    W = -(-P // VECTOR) * VECTOR
    dq, drate, dahead = np.zeros((n, W)), np.zeros((n, W)), np.zeros((n, W))
    dacc, dnew = np.zeros((n, W)), np.zeros((n, W))
    y, dy, r, dr = np.zeros(E), np.zeros((E, W)), np.zeros(E), np.zeros((E, W))
    units = equation.counts[1]
    z, dz, work = np.zeros((E, units)), np.zeros((E, units, W)), np.zeros((2, W))
    elements = Elements(y, dy, z, dz, r, dr, work)
    for k in range(T):
        begins = k == 0 or (every > 0 and (k - 1) % every == 0)
        if begins:
            _begin_anew(measured, max(k - 1, 0), sensors.outputs, back, q, rate, dq, drate)
            if k == 0 and begin.size > 0:
                _begin_at(begin, first, S, q, rate, z, dq, drate, dz)
            before = u[max(k - 1, 0)]
            _forces(q, rate, dq, drate, False, before, equation, elements)
            _accelerations(q, rate, dq, drate, before, equation, r, dr, acc, dacc)
        for substep in range(substeps if k > 0 else 0):
            _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead)
            at = between[k - 1, substep]
            _forces(q, ahead, dq, dahead, True, at, equation, elements)
            _accelerations(q, ahead, dq, dahead, at, equation, r, dr, new, dnew)
            _speed_up(h, rate, acc, new, drate, dacc, dnew)
        if k > 0:
            _jump(u[k], between[k - 1, substeps - 1], equation.inputs, acc, dacc)
        lost = False
        for c in range(o):
            x[k, c] = v[k, c] = a[k, c] = 0.0
            row = jacobian[k, c, lo : lo + P]
            for p in range(P):
                row[p] = 0.0
            for i in range(n):
                weight = outputs[c, i]
                x[k, c] += weight * q[i]
                v[k, c] += weight * rate[i]
                a[k, c] += weight * acc[i]
                if weight != 0.0:
                    for p in range(P):
                        if measures[c] == 2:
                            row[p] += weight * dacc[i, p]
                        elif measures[c] == 1:
                            row[p] += weight * drate[i, p]
                        else:
                            row[p] += weight * dq[i, p]
                if P > 0:
                    seen = (q[i], rate[i], acc[i])[measures[c]]
                    add(row, ioutputs[c, i], soutputs[c, i] * seen)
            measure = (x[k, c], v[k, c], a[k, c])[measures[c]]
            lost = lost or not (abs(measure) < bound[c] and abs(x[k, c]) < np.inf)
        for e in range(E):
            forces[k, e], deformations[k, e] = r[e], y[e]
        if lost:
            for later in range(k, len(x)):
                for c in range(x.shape[1]):
                    x[later, c] = v[later, c] = a[later, c] = np.nan
                    for p in range(P):
                        jacobian[later, c, lo + p] = np.nan
                for e in range(E):
                    forces[later, e] = deformations[later, e] = np.nan
            return


@inlined
def _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead):
    """q to the end of a substep h, and the velocity there as the accelerations so far have it."""
    for i in range(q.size):
        q[i] += h * (rate[i] + 0.5 * h * acc[i])
        ahead[i] = rate[i] + h * acc[i]
        for p in range(dq.shape[1]):
            dq[i, p] += h * (drate[i, p] + 0.5 * h * dacc[i, p])
            dahead[i, p] = drate[i, p] + h * dacc[i, p]


@inlined
def _speed_up(h, rate, acc, new, drate, dacc, dnew):
    """q̇ to the end of a substep by the trapezoid; the accelerations there become the present."""
    for i in range(rate.size):
        rate[i] += 0.5 * h * (acc[i] + new[i])
        acc[i] = new[i]
        for p in range(drate.shape[1]):
            drate[i, p] += 0.5 * h * (dacc[i, p] + dnew[i, p])
            dacc[i, p] = dnew[i, p]


@inlined
def _jump(u_at, u_before, gain, acc, dacc):
    """An excitation that is held between samples jumps at them; gain: Γ."""
    inputs, iinputs, sinputs = gain
    for j in range(u_at.size):
        jump = u_at[j] - u_before[j]
        if jump != 0.0:
            for i in range(acc.size):
                acc[i] += inputs[i, j] * jump
                if dacc.shape[1] > 0:
                    add(dacc[i], iinputs[i, j], sinputs[i, j] * jump)


@inlined
def _begin_anew(measured, k, outputs, back, q, rate, dq, drate):
    """q = Φ⁺ x, dq = −Φ⁺ dΦ q; q̇ likewise."""
    _, ioutputs, soutputs = outputs
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
                    add(dq[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * q[j])
                    add(drate[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * rate[j])


@inlined
def _begin_at(begin, first, S, q, rate, z, dq, drate, dz):
    """q, q̇ and z of `begin`; where S > 0, their derivatives by themselves stand from `first` on."""
    n, (E, units) = q.size, z.shape
    dq[:], drate[:], dz[:] = 0.0, 0.0, 0.0
    for i in range(n):
        q[i], rate[i] = begin[i], begin[n + i]
        if S > 0:
            dq[i, first + i] = drate[i, first + n + i] = 1.0
    for e in range(E):
        for unit in range(units):
            at = 2 * n + e * units + unit
            z[e, unit] = begin[at]
            if S > 0:
                dz[e, unit, first + at] = 1.0
