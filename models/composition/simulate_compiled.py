"""The equation of motion of a composition and its derivatives, compiled: the production run.

Velocity-Verlet substeps: q and the deformations to the end of a substep, the units from the
increments of deformation, the accelerations there with a velocity that is extrapolated, then the
velocity by the trapezoid: second order, one evaluation a substep. Along with the motion go its
derivatives by P parameters. tests/reference_networks.py is the readable reference.
Without derivatives, which are None then, these functions are the run of a GPU, too (gpu.py), and
the C that is exported.

n coordinates, E elements, m excitations, o outputs, T samples, P parameters, S of a beginning.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from data.memory import empty_array
from data.numba_cache import compilers
from models.composition import branch_law_compiled, branch_run_compiled
from models.composition.branch_run_compiled import begin_branches, forces_of_branches, memory_of
from models.composition.laws_compiled import HERE, LINEAR, add, memoryless, unit_step

_SOURCES = (Path(str(m.__file__)) for m in (branch_law_compiled, branch_run_compiled))
compiled, inlined = compilers(Path(__file__), HERE, *_SOURCES, contract=True, allocate=False)

Derivatives = np.ndarray | None  # a run that is given None is compiled without them
VECTOR = 8  # numbers that a processor takes at once: rows of derivatives end with one


class Term(NamedTuple):
    """Coefficients of one part: values, the parameter behind each (−1: none), slopes by it."""

    value: np.ndarray
    parameter: Derivatives = None
    slope: Derivatives = None


class Equation(NamedTuple):
    """q̈ = −K q − C q̇ + Γ u − G r with y = D q + supports u, as `Composition` has it."""

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
    z: np.ndarray  # (E, units)
    r: np.ndarray  # (E,)
    dy: Derivatives = None  # (E, P)
    dz: Derivatives = None  # (E, units, P)
    dr: Derivatives = None  # (E, P)
    dnow: Derivatives = None  # (P,): of y and of ẏ of one element
    drate: Derivatives = None


class Histories(NamedTuple):
    """What a run fills; None is left out."""

    x: np.ndarray | None = None  # (T, o), and v, a
    v: np.ndarray | None = None
    a: np.ndarray | None = None
    forces: np.ndarray | None = None  # (T, E)
    deformations: np.ndarray | None = None
    jacobian: Derivatives = None  # (T, o, ·)
    measured: np.ndarray | None = None  # (T, o): what each output measures


@inlined
def _forces(q, rate, dq, drate, moved, h, u_at, equation, branches, elements):
    """Forces of the elements, of units where there are no branch laws."""
    if len(branches) == 0:
        _forces_of_units(q, rate, dq, drate, moved, u_at, equation, elements)
    else:
        forces_of_branches(q, rate, dq, drate, moved, h, u_at, equation, branches, elements)


@inlined
def _forces_of_units(q, rate, dq, drate, moved, u_at, equation, elements):
    """Forces of the elements r (E,) and dr (E, P); where the structure `moved`, the units follow.

    y, z and their derivatives are those before the move and become those after it.
    """
    D, iD, sD = equation.D
    laws, ilaws, slaws = equation.laws
    hinges, units = equation.counts
    supports = equation.supports
    y, z, r, dy, dz, dr, dnow, drate_e = elements
    for e in range(D.shape[0]):
        ye, ratee = 0.0, 0.0
        if dq is not None:
            for p in range(dq.shape[1]):
                dnow[p] = 0.0
                drate_e[p] = 0.0
                dr[e, p] = 0.0
        for i in range(q.size):
            d = D[e, i]
            if d != 0.0:
                ye += d * q[i]
                ratee += d * rate[i]
                if dq is not None:
                    for p in range(dq.shape[1]):
                        dnow[p] += d * dq[i, p]
                        drate_e[p] += d * drate[i, p]
            if dq is not None:
                add(dnow, iD[e, i], sD[e, i] * q[i])
                add(drate_e, iD[e, i], sD[e, i] * rate[i])
        for j in range(u_at.size):
            ye += supports[0, e, j] * u_at[j]
            ratee += supports[1, e, j] * u_at[j]
        force, by_y, by_rate = memoryless(e, ye, ratee, equation.laws, hinges, dr)
        before, first = y[e], LINEAR + 2 * hinges
        for unit in range(units):
            j = first + 4 * unit
            weight, side, now = laws[e, j], 0.0, z[e, unit]
            if moved:
                now, side, by_z, by_delta, by_up, by_down = unit_step(
                    now, ye - before, laws[e, j + 1], laws[e, j + 2], laws[e, j + 3]
                )
                z[e, unit] = now
                if dq is not None:
                    if side == 0.0:
                        for p in range(dq.shape[1]):
                            new = by_z * dz[e, unit, p] + by_delta * (dnow[p] - dy[e, p])
                            dz[e, unit, p] = new
                            dr[e, p] += weight * new
                        add(dz[e, unit], ilaws[e, j + 2], by_up * slaws[e, j + 2])
                        add(dr[e], ilaws[e, j + 2], weight * by_up * slaws[e, j + 2])
                        add(dz[e, unit], ilaws[e, j + 3], by_down * slaws[e, j + 3])
                        add(dr[e], ilaws[e, j + 3], weight * by_down * slaws[e, j + 3])
                    else:  # on its limit, which alone its memory depends on
                        for p in range(dq.shape[1]):
                            dz[e, unit, p] = 0.0
                        add(dz[e, unit], ilaws[e, j + 1], side * slaws[e, j + 1])
                        add(dr[e], ilaws[e, j + 1], weight * side * slaws[e, j + 1])
            elif dq is not None:
                for p in range(dq.shape[1]):
                    dr[e, p] += weight * dz[e, unit, p]
            force += weight * (now - ye)
            by_y -= weight
            if dq is not None:
                add(dr[e], ilaws[e, j], slaws[e, j] * (now - ye))
        r[e], y[e] = force, ye
        if dq is not None:
            for p in range(dq.shape[1]):
                dr[e, p] += by_y * dnow[p] + by_rate * drate_e[p]
                dy[e, p] = dnow[p]


@inlined
def _accelerations(q, rate, dq, drate, u_at, equation, r, dr, a, da):
    """q̈ (n,) and its derivatives (n, P)."""
    core, icore, score = equation.core
    inputs, iinputs, sinputs = equation.inputs
    G, iG, sG = equation.G
    for i in range(q.size):
        acc = -core[0, i] * q[i] - core[1, i] * rate[i]
        if da is not None:
            for p in range(da.shape[1]):
                da[i, p] = -core[0, i] * dq[i, p] - core[1, i] * drate[i, p]
            add(da[i], icore[0, i], -score[0, i] * q[i])
            add(da[i], icore[1, i], -score[1, i] * rate[i])
        for j in range(u_at.size):
            acc += inputs[i, j] * u_at[j]
            if da is not None:
                add(da[i], iinputs[i, j], sinputs[i, j] * u_at[j])
        for e in range(r.size):
            g = G[i, e]
            if g != 0.0:
                acc -= g * r[e]
                if da is not None:
                    for p in range(da.shape[1]):
                        da[i, p] -= g * dr[e, p]
            if da is not None:
                add(da[i], iG[i, e], -sG[i, e] * r[e])
        a[i] = acc


def room_of(equation, columns, branches=()):
    """Motion, derivatives of the motion by so many columns, elements: where a run keeps them."""
    E, n = equation.D.value.shape
    if branches:
        slopes = tuple(np.zeros((5, n, columns)))
        return tuple(np.zeros((5, n))), slopes, memory_of(branches, columns)
    units = equation.counts[1]
    y, z, r = np.zeros(E), np.zeros((E, units)), np.zeros(E)
    if columns == 0:
        return tuple(np.zeros((5, n))), (None,) * 5, Elements(y, z, r)
    W = -(-columns // VECTOR) * VECTOR
    rows = empty_array(5 * n + (2 + units) * E + 2, W).zero_().numpy()
    motion, dy, dr, dz, one = np.split(rows, np.cumsum([5 * n, E, E, units * E]))
    elements = Elements(y, z, r, dy, dz.reshape(E, units, W), dr, one[0], one[1])
    return tuple(np.zeros((5, n))), tuple(motion.reshape(5, n, W)), elements


@compiled
def run(course, equation, branches, sensors, room, histories, P, S, lo):
    """A free run from the first of `course.measured`, started again every `course.every` samples.

    branches: laws of the elements, or () where they have units. room: of `room_of`. Fills the
    histories and, where there is a jacobian (T, o, ·), its columns `lo` to lo + P + S with
    derivatives of what each output measures; S columns by `course.begin`.
    The elements keep their memory where a run starts again. A run of which an output's measure
    passes its bound has diverged; it is NaN from there on.
    """
    motion, slopes, elements = room
    u, between, dt, every, measured, begin = course
    q, rate, ahead, acc, new = motion
    dq, drate, dahead, dacc, dnew = slopes
    x, v, a, forces, deformations, jacobian, seen = histories
    outputs, measures, bound = sensors.outputs.value, sensors.measures, sensors.bound
    y, z, r, dr = elements.y, elements.z, elements.r, elements.dr
    T, substeps = len(u), between.shape[1]
    h = dt / substeps
    for k in range(T):
        if k == 0 or (every > 0 and (k - 1) % every == 0):
            _begin_anew(measured, max(k - 1, 0), sensors.outputs, sensors.back, q, rate, dq, drate)
            if k == 0 and begin.size > 0:
                _begin_at(begin, P, S, q, rate, z, dq, drate, elements.dz)
            before = u[max(k - 1, 0)]
            if k == 0:
                _begin_elements(q, rate, dq, drate, before, equation, branches, elements)
            _forces(q, rate, dq, drate, False, h, before, equation, branches, elements)
            _accelerations(q, rate, dq, drate, before, equation, r, dr, acc, dacc)
        for substep in range(substeps if k > 0 else 0):
            _move(h, q, rate, acc, ahead, dq, drate, dacc, dahead)
            at = between[k - 1, substep]
            _forces(q, ahead, dq, dahead, True, h, at, equation, branches, elements)
            _accelerations(q, ahead, dq, dahead, at, equation, r, dr, new, dnew)
            _speed_up(h, rate, acc, new, drate, dacc, dnew)
        if k > 0:
            _jump(u[k], between[k - 1, substeps - 1], equation.inputs, acc, dacc)
        lost = False
        for c in range(measures.size):
            xc, vc, ac = 0.0, 0.0, 0.0
            for i in range(q.size):
                weight = outputs[c, i]
                xc += weight * q[i]
                vc += weight * rate[i]
                ac += weight * acc[i]
            measure = ac if measures[c] == 2 else (vc if measures[c] == 1 else xc)
            _keep(k, c, xc, vc, ac, measure, x, v, a, seen)
            lost = lost or not (abs(measure) < bound[c] and abs(xc) < np.inf)
            _slopes_of_output(k, c, motion, slopes, sensors, jacobian, lo, P + S)
        _keep_elements(k, r, y, branches, forces, deformations)
        if lost:
            for e in range(r.size):
                r[e] = y[e] = np.nan
            for later in range(k, T):
                for c in range(measures.size):
                    _keep(later, c, np.nan, np.nan, np.nan, np.nan, x, v, a, seen)
                _keep_elements(later, r, y, branches, forces, deformations)
                _lose_slopes(later, jacobian, lo, P + S)
            return


@inlined
def _keep(k, c, x_c, v_c, a_c, measure, x, v, a, seen):
    """An output at a sample."""
    if x is not None:
        x[k, c], v[k, c], a[k, c] = x_c, v_c, a_c
    if seen is not None:
        seen[k, c] = measure


@inlined
def _keep_elements(k, r, y, branches, forces, deformations):
    """The elements at a sample."""
    if forces is not None:
        for e in range(r.size):
            forces[k, e], deformations[k, e] = r[e], y[e]
            if len(branches) > 0:
                deformations[k, e] = branches.scale[0, e] * y[e]


@inlined
def _slopes_of_output(k, c, motion, slopes, sensors, jacobian, first, P):
    """Fills columns `first` to first + P of an output at a sample of the jacobian (T, o, ·)."""
    if jacobian is not None:
        q, rate, _, acc, _ = motion
        dq, drate, _, dacc, _ = slopes
        outputs, ioutputs, soutputs = sensors.outputs
        row, measure = jacobian[k, c, first : first + P], sensors.measures[c]
        for p in range(P):
            row[p] = 0.0
        for i in range(q.size):
            weight = outputs[c, i]
            if weight != 0.0:
                for p in range(P):
                    if measure == 2:
                        row[p] += weight * dacc[i, p]
                    elif measure == 1:
                        row[p] += weight * drate[i, p]
                    else:
                        row[p] += weight * dq[i, p]
            add(row, ioutputs[c, i], soutputs[c, i] * (q[i], rate[i], acc[i])[measure])


@inlined
def _lose_slopes(k, jacobian, first, P):
    """A sample after the run has diverged."""
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
        for i in range(n):
            for c in range(o):
                for j in range(n):
                    add(dq[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * q[j])
                    add(drate[i], ioutputs[c, j], -back[i, c] * soutputs[c, j] * rate[j])


@inlined
def _begin_elements(q, rate, dq, drate, u_at, equation, branches, elements):
    """What elements remember at first, beyond z."""
    if len(branches) > 0:
        begin_branches(q, rate, dq, drate, u_at, equation, branches, elements)


@inlined
def _begin_at(begin, first, S, q, rate, z, dq, drate, dz):
    """q, q̇ and z of `begin`; where S > 0, their derivatives by themselves stand from `first` on."""
    n, units = q.size, z.shape[1]
    for i in range(n):
        q[i], rate[i] = begin[i], begin[n + i]
    for k in range(begin.size - 2 * n):
        z[k // units, k % units] = begin[2 * n + k]
    if dq is not None:
        dq[:], drate[:], dz[:] = 0.0, 0.0, 0.0
        if S > 0:
            for i in range(n):
                dq[i, first + i] = drate[i, first + n + i] = 1.0
            for k in range(begin.size - 2 * n):
                dz[k // units, k % units, first + 2 * n + k] = 1.0
