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
    parameter: np.ndarray | None = None
    slope: np.ndarray | None = None


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
    """Deformations, memories of units and forces of the elements, with derivatives or None."""

    y: np.ndarray  # (E,)
    dy: np.ndarray  # (E, P)
    z: np.ndarray  # (E, units)
    dz: np.ndarray  # (E, units, P)
    r: np.ndarray  # (E,)
    dr: np.ndarray  # (E, P)
    work: np.ndarray  # (2, P)


class Histories(NamedTuple):
    """What a run fills, or None."""

    x: np.ndarray  # (T, o), and v, a
    v: np.ndarray
    a: np.ndarray
    forces: np.ndarray  # (T, E)
    deformations: np.ndarray
    jacobian: np.ndarray  # (T, o, ·)


# A function that is given None for derivatives is compiled without them, for a processor or a GPU,
# and translated to C without them: numba and the translator leave out what `is not None` rules out.


@inlined
def _forces(q, rate, dq, drate, moved, u_at, equation, elements):
    """Forces of the elements r (E,) and dr (E, P); where the structure `moved`, the units follow.

    y, z and their derivatives are those before the move and become those after it.
    """
    D, laws, supports = equation.D.value, equation.laws.value, equation.supports
    hinges, units = equation.counts
    y, z, r = elements.y, elements.z, elements.r
    E, n = D.shape
    for e in range(E):
        ye, ratee = 0.0, 0.0
        for i in range(n):
            d = D[e, i]
            if d != 0.0:
                ye += d * q[i]
                ratee += d * rate[i]
        for j in range(u_at.size):
            ye += supports[0, e, j] * u_at[j]
            ratee += supports[1, e, j] * u_at[j]
        force, by_y, by_rate = memoryless(e, ye, ratee, equation.laws, hinges, elements.dr)
        if dq is not None:
            _slopes_of_deformation(e, q, rate, dq, drate, equation.D, elements.work)
        moves = ye - y[e]
        for unit in range(units):
            j, side = LINEAR + 2 * hinges + 4 * unit, 0.0
            weight, new = laws[e, j], z[e, unit]
            by_z, by_delta, by_up, by_down = 1.0, 0.0, 0.0, 0.0
            if moved:
                new, side, by_z, by_delta, by_up, by_down = unit_step(
                    new, moves, laws[e, j + 1], laws[e, j + 2], laws[e, j + 3]
                )
                z[e, unit] = new
            force += weight * (new - ye)
            by_y -= weight
            if dq is not None:
                slopes = side, by_z, by_delta, by_up, by_down
                _slopes_of_unit(e, unit, j, moved, new - ye, slopes, equation.laws, elements)
        r[e], y[e] = force, ye
        if dq is not None:
            dnow, drate_e = elements.work[0], elements.work[1]
            for p in range(dnow.size):
                elements.dr[e, p] += by_y * dnow[p] + by_rate * drate_e[p]
                elements.dy[e, p] = dnow[p]


@inlined
def _slopes_of_deformation(e, q, rate, dq, drate, structure, work):
    """Fills the derivatives of y and ẏ of an element (2, P); structure: D."""
    D, iD, sD = structure
    dnow, drate_e = work[0], work[1]
    for p in range(dnow.size):
        dnow[p] = 0.0
        drate_e[p] = 0.0
    for i in range(q.size):
        d = D[e, i]
        if d != 0.0:
            for p in range(dnow.size):
                dnow[p] += d * dq[i, p]
                drate_e[p] += d * drate[i, p]
        if dnow.size > 0:
            add(dnow, iD[e, i], sD[e, i] * q[i])
            add(drate_e, iD[e, i], sD[e, i] * rate[i])


@inlined
def _slopes_of_unit(e, unit, j, moved, way, slopes, laws, elements):
    """Derivatives of a unit's memory and of its part in the force; way: z − y."""
    values, index, slope = laws
    side, by_z, by_delta, by_up, by_down = slopes
    _, dy, _, dz, _, dr, work = elements
    weight, dnow, P = values[e, j], work[0], dy.shape[1]
    if not moved:
        for p in range(P):
            dr[e, p] += weight * dz[e, unit, p]
    elif side == 0.0:
        for p in range(P):
            new = by_z * dz[e, unit, p] + by_delta * (dnow[p] - dy[e, p])
            dz[e, unit, p] = new
            dr[e, p] += weight * new
        add(dz[e, unit], index[e, j + 2], by_up * slope[e, j + 2])
        add(dr[e], index[e, j + 2], weight * by_up * slope[e, j + 2])
        add(dz[e, unit], index[e, j + 3], by_down * slope[e, j + 3])
        add(dr[e], index[e, j + 3], weight * by_down * slope[e, j + 3])
    else:  # on its limit, which alone its memory depends on
        for p in range(P):
            dz[e, unit, p] = 0.0
        add(dz[e, unit], index[e, j + 1], side * slope[e, j + 1])
        add(dr[e], index[e, j + 1], weight * side * slope[e, j + 1])
    add(dr[e], index[e, j], slope[e, j] * way)


@inlined
def _accelerations(q, rate, dq, drate, u_at, equation, r, dr, a, da):
    """q̈ (n,) and its derivatives (n, P)."""
    core, inputs, G = equation.core.value, equation.inputs.value, equation.G.value
    n, E = G.shape
    for i in range(n):
        acc = -core[0, i] * q[i] - core[1, i] * rate[i]
        for j in range(u_at.size):
            acc += inputs[i, j] * u_at[j]
        for e in range(E):
            g = G[i, e]
            if g != 0.0:
                acc -= g * r[e]
        a[i] = acc
        if da is not None:
            _slopes_of_acceleration(i, q, rate, dq, drate, u_at, equation, r, dr, da[i])


@inlined
def _slopes_of_acceleration(i, q, rate, dq, drate, u_at, equation, r, dr, da):
    """Derivatives of an acceleration (P,)."""
    core, icore, score = equation.core
    _, iinputs, sinputs = equation.inputs
    G, iG, sG = equation.G
    for p in range(da.size):
        da[p] = -core[0, i] * dq[i, p] - core[1, i] * drate[i, p]
    if da.size > 0:
        add(da, icore[0, i], -score[0, i] * q[i])
        add(da, icore[1, i], -score[1, i] * rate[i])
        for j in range(u_at.size):
            add(da, iinputs[i, j], sinputs[i, j] * u_at[j])
    for e in range(r.size):
        g = G[i, e]
        if g != 0.0:
            for p in range(da.size):
                da[p] -= g * dr[e, p]
        if da.size > 0:
            add(da, iG[i, e], -sG[i, e] * r[e])


@compiled
def run(course, equation, sensors, histories):
    """A free run without derivatives, as `follow` has it."""
    E, n = equation.D.value.shape
    q, rate, ahead, acc, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    y, z, r = np.zeros(E), np.zeros((E, equation.counts[1])), np.zeros(E)
    motion, elements = (q, rate, ahead, acc, new), Elements(y, None, z, None, r, None, None)
    follow(course, equation, sensors, histories, motion, (None,) * 5, elements, 0, 0, 0)


@compiled
def run_with_derivatives(course, equation, sensors, P, S, histories, lo):
    """A free run that fills columns `lo` to lo + P + S of the jacobian (T, o, ·), too.

    They are derivatives of what each output measures; S columns by `course.begin`.
    """
    E, n = equation.D.value.shape
    q, rate, ahead, acc, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    W = -(-(P + S) // VECTOR) * VECTOR
    dq, drate, dahead = np.zeros((n, W)), np.zeros((n, W)), np.zeros((n, W))
    dacc, dnew = np.zeros((n, W)), np.zeros((n, W))
    y, dy, r, dr = np.zeros(E), np.zeros((E, W)), np.zeros(E), np.zeros((E, W))
    units = equation.counts[1]
    z, dz, work = np.zeros((E, units)), np.zeros((E, units, W)), np.zeros((2, W))
    motion, elements = (q, rate, ahead, acc, new), Elements(y, dy, z, dz, r, dr, work)
    slopes = dq, drate, dahead, dacc, dnew
    follow(course, equation, sensors, histories, motion, slopes, elements, P, S, lo)


@inlined
def follow(course, equation, sensors, histories, motion, slopes, elements, P, S, lo):
    """A free run from the first of `course.measured`, started again every `course.every` samples.

    motion, elements: room for what moves, zero; slopes: for its derivatives, or None. The units
    keep their memory where a run starts again. A run of which an output's measure passes its bound
    has diverged; it is NaN from there on.
    """
    u, between, dt, every, measured, begin = course
    q, rate, ahead, acc, new = motion
    dq, drate, dahead, dacc, dnew = slopes
    T, substeps = len(u), between.shape[1]
    h = dt / substeps
    for k in range(T):
        if k == 0 or (every > 0 and (k - 1) % every == 0):
            _begin_anew(measured, max(k - 1, 0), sensors.outputs, sensors.back, q, rate, dq, drate)
            if k == 0 and begin.size > 0:
                _begin_at(begin, P, S, q, rate, elements.z, dq, drate, elements.dz)
            before = u[max(k - 1, 0)]
            _forces(q, rate, dq, drate, False, before, equation, elements)
            _accelerations(
                q, rate, dq, drate, before, equation, elements.r, elements.dr, acc, dacc
            )
        for substep in range(substeps if k > 0 else 0):
            _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead)
            at = between[k - 1, substep]
            _forces(q, ahead, dq, dahead, True, at, equation, elements)
            _accelerations(q, ahead, dq, dahead, at, equation, elements.r, elements.dr, new, dnew)
            _speed_up(h, rate, acc, new, drate, dacc, dnew)
        if k > 0:
            _jump(u[k], between[k - 1, substeps - 1], equation.inputs, acc, dacc)
        x, v, a, forces, deformations, jacobian = histories
        lost = _observe(
            k, q, rate, acc, sensors, elements.r, elements.y, x, v, a, forces, deformations
        )
        _slopes_of_outputs(k, q, rate, acc, dq, drate, dacc, sensors, jacobian, lo, P + S)
        if lost:
            for later in range(k, T):
                _lose(later, histories, jacobian, lo, P + S)
            return


@inlined
def _observe(k, q, rate, acc, sensors, r, y, x, v, a, forces, deformations):
    """What the outputs and the elements do at a sample. Returns whether the run has diverged."""
    outputs, measures, bound = sensors.outputs.value, sensors.measures, sensors.bound
    lost = False
    for c in range(measures.size):
        xc, vc, ac = 0.0, 0.0, 0.0
        for i in range(q.size):
            weight = outputs[c, i]
            xc += weight * q[i]
            vc += weight * rate[i]
            ac += weight * acc[i]
        x[k, c], v[k, c], a[k, c] = xc, vc, ac
        measure = ac if measures[c] == 2 else (vc if measures[c] == 1 else xc)
        lost = lost or not (abs(measure) < bound[c] and abs(xc) < np.inf)
    for e in range(r.size):
        forces[k, e], deformations[k, e] = r[e], y[e]
    return lost


@inlined
def _slopes_of_outputs(k, q, rate, acc, dq, drate, dacc, sensors, jacobian, first, P):
    """Fills columns `first` to first + P of a sample of the jacobian (T, o, ·)."""
    if jacobian is not None:
        outputs, ioutputs, soutputs = sensors.outputs
        for c in range(sensors.measures.size):
            row, kind = jacobian[k, c, first : first + P], sensors.measures[c]
            for p in range(P):
                row[p] = 0.0
            for i in range(q.size):
                weight = outputs[c, i]
                if weight != 0.0:
                    for p in range(P):
                        if kind == 2:
                            row[p] += weight * dacc[i, p]
                        elif kind == 1:
                            row[p] += weight * drate[i, p]
                        else:
                            row[p] += weight * dq[i, p]
                add(row, ioutputs[c, i], soutputs[c, i] * (q[i], rate[i], acc[i])[kind])


@inlined
def _lose(k, histories, jacobian, first, P):
    """A sample after the run has diverged."""
    for signal in (histories.x, histories.v, histories.a):
        for c in range(signal.shape[1]):
            signal[k, c] = np.nan
    for signal in (histories.forces, histories.deformations):
        for e in range(signal.shape[1]):
            signal[k, e] = np.nan
    if jacobian is not None:
        for c in range(jacobian.shape[1]):
            for p in range(P):
                jacobian[k, c, first + p] = np.nan


@inlined
def _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead):
    """q to the end of a substep h, and the velocity there as the accelerations so far have it."""
    for i in range(q.size):
        q[i] += h * (rate[i] + 0.5 * h * acc[i])
        ahead[i] = rate[i] + h * acc[i]
        if dq is not None:
            for p in range(dq.shape[1]):
                dq[i, p] += h * (drate[i, p] + 0.5 * h * dacc[i, p])
                dahead[i, p] = drate[i, p] + h * dacc[i, p]


@inlined
def _speed_up(h, rate, acc, new, drate, dacc, dnew):
    """q̇ to the end of a substep by the trapezoid; the accelerations there become the present."""
    for i in range(rate.size):
        rate[i] += 0.5 * h * (acc[i] + new[i])
        acc[i] = new[i]
        if drate is not None:
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
                if dacc is not None:
                    if dacc.shape[1] > 0:
                        add(dacc[i], iinputs[i, j], sinputs[i, j] * jump)


@inlined
def _begin_anew(measured, k, outputs, back, q, rate, dq, drate):
    """q = Φ⁺ x, dq = −Φ⁺ dΦ q; q̇ likewise."""
    _, ioutputs, soutputs = outputs
    n, o = back.shape
    for i in range(n):
        q[i] = rate[i] = 0.0
        for c in range(o):
            q[i] += back[i, c] * measured[0, k, c]
            rate[i] += back[i, c] * measured[1, k, c]
    if dq is not None:
        dq[:], drate[:] = 0.0, 0.0
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
    for i in range(n):
        q[i], rate[i] = begin[i], begin[n + i]
    for e in range(E):
        for unit in range(units):
            z[e, unit] = begin[2 * n + e * units + unit]
    if dq is not None:
        dq[:], drate[:], dz[:] = 0.0, 0.0, 0.0
        if S > 0:
            for i in range(n):
                dq[i, first + i] = drate[i, first + n + i] = 1.0
            for e in range(E):
                for unit in range(units):
                    dz[e, unit, first + 2 * n + e * units + unit] = 1.0
