"""The integrator: Dormand–Prince 5(4) that stops at every corner of the restoring forces, compiled.

The step is chosen from the error estimate. The laws have corners (yield, slip, gap, velocity
reversal) which lower any fixed-step method to second order, so each step keeps every element on one
smooth branch: where a step runs past the end of a branch, it is cut there, found on the cubic
Hermite interpolant, and the element changes branch.

Between samples the forces are linear, support displacements the cubic through s and ṡ. Where an
element is damaged, a step ends at that very instant, and the motion goes on from the same state.
State q = [position (N), velocity (N), z (E), work (E)] of all N nodes: n DOFs, supports, ground.
Supports are put where the record has them. Slopes k (7, len q); T samples.

Dormand & Prince (1980); Hairer, Nørsett & Wanner (1993), Sects. II.4–II.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from data.simulation.laws.compiling import compiled, inlined
from data.simulation.laws.dispatch import LAST_INLINED, margin, next_branch
from data.simulation.laws.dispatch import force as element_force
from data.simulation.laws.element import LARGEST_DISPLACEMENT, MEMORY

SMALLEST_STEP = 1e-9  # of a sample interval; a motion that needs less is escaping
CORNER_RESOLUTION = 1e-7  # of a step
NONE = 2.0  # fraction of a step, where it has no corner: one may lie at its end, 1
place = np.uintp  # an index without a sign: numba looks whether any other one is negative
TIMES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
WEIGHTS = np.array(  # of the slopes before each stage
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)


class System(NamedTuple):
    """A structure, and how its elements change.

    Change c of element[c] comes offset[c] after sample when[c] − 1: its row of p becomes
    changed_p[c], its z is multiplied by changed_z[c].
    """

    masses: np.ndarray  # (n,)
    ends: np.ndarray  # (E, 2)
    law: np.ndarray  # (E,)
    when: np.ndarray
    offset: np.ndarray
    element: np.ndarray
    changed_p: np.ndarray
    changed_z: np.ndarray


class Samples(NamedTuple):
    """Forces f (T, n) [N], supports s and ṡ = w (T, m) [m, m/s], and the motion that they cause.

    x, v, a (T, n); y, r, work (T, E).
    """

    f: np.ndarray
    s: np.ndarray
    w: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    y: np.ndarray
    r: np.ndarray
    work: np.ndarray


class Progress(NamedTuple):
    """A record that is integrated call by call: all that one call hands on to the next.

    The bits are those of a single call. The state q has the displacements and velocities of all
    nodes, then z and work of all elements.
    """

    p: np.ndarray  # parameters of the laws (E, ·), as they are by now
    q: np.ndarray
    k: np.ndarray
    forces: np.ndarray
    branch: np.ndarray
    memory: np.ndarray
    scale: np.ndarray
    trial: np.ndarray  # q at the end of the step that is tried
    at: np.ndarray  # step, time since the sample before
    counts: np.ndarray  # samples done, changes done, stalled, steps tried

    @property
    def steps(self) -> int:
        return int(self.counts[3])


def at_rest(n: int, m: int, p: np.ndarray, dt: float, tolerance: float) -> Progress:
    """The progress before the first sample: n DOFs, m supports, parameters p of the elements."""
    N, E = n + m + 1, len(p)
    size = 2 * (N + E)
    scale = np.full(2 * N + E, 1e-9 * tolerance)
    scale[n:N], scale[N + n : 2 * N] = np.inf, np.inf  # these are known exactly
    return Progress(
        p, q=np.zeros(size), k=np.zeros((7, size)), forces=np.zeros(E),
        branch=np.zeros(E, np.int64), memory=np.zeros((E, MEMORY)), scale=scale,
        trial=np.zeros(size), at=np.array([dt, dt]), counts=np.zeros(4, np.int64),
    )  # fmt: skip


@inlined
def _support(j, s, w, sample, dt, tau):
    """Position, velocity and acceleration of a support: the cubic through s and ṡ."""
    before = max(sample - 1, 0)
    rise, first, last = s[sample, j] - s[before, j], dt * w[before, j], dt * w[sample, j]
    square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    position = s[before, j] + tau * (first + tau * (square + tau * cube))
    velocity = (first + tau * (2.0 * square + 3.0 * tau * cube)) / dt
    return position, velocity, (2.0 * square + 6.0 * tau * cube) / (dt * dt)


@inlined
def _slope(q, row, tau, sample, dt, system, samples, progress):
    """q̇ at fraction tau of an interval into a row of k, and the element forces.

    Puts the supports into q.
    """
    masses, ends, law = system.masses, system.ends, system.law
    f, s, w = samples.f, samples.s, samples.w
    p, k, m, branch = progress.p, progress.k, progress.memory, progress.branch
    n, E, before = f.shape[1], law.size, max(sample - 1, 0)
    N = n + s.shape[1] + 1
    for i in range(n):
        k[row, i] = q[place(N + i)]
        k[row, place(N + i)] = f[before, i] + tau * (f[sample, i] - f[before, i])
    for j in range(s.shape[1]):
        q[n + j], q[N + n + j], _ = _support(j, s, w, sample, dt, tau)
    for e in range(E):
        start, end = place(ends[e, 0]), place(ends[e, 1])
        to_start, to_end = place(N + ends[e, 0]), place(N + ends[e, 1])
        z, work = place(2 * N + e), place(2 * N + E + e)
        ydot = q[to_end] - q[to_start]
        force, zdot = element_force(
            law[e], p, m, e, branch[e], q[end] - q[start], ydot, q[z], q[work]
        )
        progress.forces[e], k[row, z], k[row, work] = force, zdot, force * ydot
        k[row, to_end] -= force
        k[row, to_start] += force
    for i in range(n):
        k[row, place(N + i)] /= masses[i]
    for j in range(s.shape[1]):  # whatever pulls at them
        _, k[row, n + j], k[row, N + n + j] = _support(j, s, w, sample, dt, tau)
    k[row, 2 * N - 1] = 0.0  # and ground


@inlined
def _step(h, tau, sample, dt, system, samples, progress):
    """One Dormand–Prince step from q, whose slope is k[0]; leaves the trial and its slope k[6]."""
    q0, q1, k = progress.q, progress.trial, progress.k
    for stage in range(1, 7):
        for i in range(q0.size):
            q1[i] = WEIGHTS[stage, 0] * k[0, i]
        for j in range(1, stage):
            for i in range(q0.size):
                q1[i] += WEIGHTS[stage, j] * k[j, i]
        for i in range(q0.size):
            q1[i] = q0[i] + h * q1[i]
        at = tau + TIMES[stage] * (h / dt)
        _slope(q1, stage, at, sample, dt, system, samples, progress)


@inlined
def _error(k, h, scale):
    """Largest estimated error of x, v and z, in units of what is allowed for each."""
    worst = 0.0
    for i in range(scale.size):
        estimate = (  # fifth-order less fourth-order solution
            71 / 57600 * k[0, i]
            - 71 / 16695 * k[2, i]
            + 71 / 1920 * k[3, i]
            - 17253 / 339200 * k[4, i]
            + 22 / 525 * k[5, i]
            - 1 / 40 * k[6, i]
        )
        error = abs(h * estimate) / scale[i]
        if not error <= worst:  # max() would drop a NaN
            worst = error if error < np.inf else np.inf
    return worst


@inlined
def _allow(q, n, N, tolerance, scale):
    """Allowed errors: tolerance × size so far, one size for all x, one for all v, one per z."""
    for i in range(n):
        scale[0] = max(scale[0], tolerance * abs(q[i]))
        scale[N] = max(scale[N], tolerance * abs(q[N + i]))
    for i in range(1, n):
        scale[i], scale[N + i] = scale[0], scale[N]
    for i in range(2 * N, scale.size):
        scale[i] = max(scale[i], tolerance * abs(q[i]))


# Corners: where in a step an element first leaves the branch of its law, and what holds then.


@inlined
def _margin(e, N, system, progress):
    """How far element e is from the end of its branch; negative beyond it."""
    q, start, end = progress.q, system.ends[e, 0], system.ends[e, 1]
    y, ydot = q[end] - q[start], q[N + end] - q[N + start]
    p, m, branch = progress.p, progress.memory, progress.branch
    return margin(system.law[e], p, m, e, branch[e], y, ydot, q[2 * N + e])


@inlined
def _at(u, i, h, progress):
    """Entry i of the state at fraction u of a step, on the cubic Hermite interpolant."""
    q0, q1, k = progress.q, progress.trial, progress.k
    rise, bend = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u)
    return q0[i] + rise * (q1[i] - q0[i]) + bend * ((1.0 - u) * k[0, i] - u * k[6, i])


@inlined
def _margin_at(u, e, h, N, system, progress):
    """The margin of element e at fraction u of a step."""
    start, end = system.ends[e, 0], system.ends[e, 1]
    y = _at(u, end, h, progress) - _at(u, start, h, progress)
    ydot = _at(u, N + end, h, progress) - _at(u, N + start, h, progress)
    p, m, branch = progress.p, progress.memory, progress.branch
    return margin(system.law[e], p, m, e, branch[e], y, ydot, _at(u, 2 * N + e, h, progress))


@inlined
def _crossing(e, high, at_end, h, N, system, progress):
    """Fraction of a step, below `high`, at which element e leaves its branch: Illinois method."""
    start = _margin(e, N, system, progress)
    if not start > 0.0:
        return 0.0
    past = CORNER_RESOLUTION * (start - at_end)  # aim a little past the corner
    low, at_low, at_high, kept = 0.0, start + past, at_end + past, 0
    for _ in range(60):
        if at_high > -past:
            break
        u = high - (high - low) * at_high / (at_high - at_low)
        middle = _margin_at(u, e, h, N, system, progress) + past
        if abs(middle) < past:
            return u
        if middle < 0.0:
            high, at_high = u, middle
            at_low, kept = 0.5 * at_low if kept == -1 else at_low, -1
        else:
            low, at_low = u, middle
            at_high, kept = 0.5 * at_high if kept == 1 else at_high, 1
    return high


@inlined
def first_corner(h, N, system, progress):
    """Fraction of a step at which the first element leaves its branch; NONE where none does."""
    law, ends, branch = system.law, system.ends, progress.branch
    q0, q1, k = progress.q, progress.trial, progress.k
    cut = NONE
    for e in range(law.size):
        start, end = ends[e, 0], ends[e, 1]
        to_start, to_end = place(N + start), place(N + end)
        before, after = q0[to_end] - q0[to_start], q1[to_end] - q1[to_start]
        until, y, z = 1.0, q1[place(end)] - q1[place(start)], q1[place(2 * N + e)]
        beyond = margin(law[e], progress.p, progress.memory, e, branch[e], y, after, z)
        if beyond >= 0.0 and before * after < 0.0:
            # an element that turned round may have been beyond its branch in between
            until = before / (before - after)
            beyond = _margin_at(until, e, h, N, system, progress)
        if law[e] > LAST_INLINED and beyond >= 0.0 and before * after > 0.0:
            # an element with a memory may have turned round twice, where its speed is least
            first = before * (k[0, N + end] - k[0, N + start])
            last = before * (k[6, N + end] - k[6, N + start])
            if first < 0.0 < last:
                until = first / (first - last)
                beyond = _margin_at(until, e, h, N, system, progress)
        if beyond < 0.0:
            cut = min(cut, _crossing(e, until, beyond, h, N, system, progress))
    return cut


@inlined
def change_branches(N, system, progress):
    """Move every element that is past the end of its branch to the next; True if one was."""
    q, branch, ends = progress.q, progress.branch, system.ends
    changed = False
    for e in range(system.law.size):
        if _margin(e, N, system, progress) < 0.0:
            start, end, z = ends[e, 0], ends[e, 1], 2 * N + e
            y, ydot = q[end] - q[start], q[N + end] - q[N + start]
            branch[e], q[z] = next_branch(
                system.law[e], progress.p, progress.memory, e, branch[e], y, ydot, q[z]
            )
            changed = True
    return changed


UNFINISHED, FINISHED = -2.0, -1.0  # what `integrate` returns where the motion did not escape


@compiled
def integrate(system, samples, progress, dt, tolerance, most):
    """Go on with a record, from rest at first, by `most` steps; the time of escape, or how it ends.

    Overwrites the motion among `samples`, and `progress`.
    """
    f, x, v, a, y = samples.f, samples.x, samples.v, samples.a, samples.y
    p, q, k, trial = progress.p, progress.q, progress.k, progress.trial
    at, counts, ends, element = progress.at, progress.counts, system.ends, system.element
    n, N, E = f.shape[1], f.shape[1] + samples.s.shape[1] + 1, system.law.size
    size = 2 * (N + E)
    h, t, first = at[0], at[1], counts[0]
    change, stalled, steps, last = counts[1], counts[2], counts[3], counts[3] + most
    for again in range(2 if first == 0 and steps == 0 else 0):
        _slope(q, 0, 1.0, 0, dt, system, samples, progress)
        if again or not change_branches(N, system, progress):
            break  # a support may start displaced
    for sample in range(first, f.shape[0]):
        start = max(sample - 1, 0) * dt
        while t < dt:
            if steps >= last:
                at[0], at[1] = h, t
                counts[0], counts[1], counts[2], counts[3] = sample, change, stalled, steps
                return UNFINISHED
            steps += 1
            due = change < system.when.size and system.when[change] == sample
            until = system.offset[change] if due else dt
            left, tau = until - t, t / dt
            step = left if h > 0.999 * left else min(h, 0.5 * left)
            cut, error = 1.0, 0.0
            for again in range(2):  # the whole step, then to its first corner
                _step(step, tau, sample, dt, system, samples, progress)
                if again:
                    break
                error = _error(k, step, progress.scale)
                if error > 1.0:
                    break
                h = step * min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
                cut = first_corner(step, N, system, progress)
                if cut >= 1.0:
                    break
                # corners that follow at once get ever longer steps: none can stall the motion
                stalled = stalled + 1 if cut * step <= SMALLEST_STEP * dt else 0
                step = min(max(cut * step, SMALLEST_STEP * dt * 2.0**stalled), left)
            if error > 1.0:
                h = step * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.2)
                if h < SMALLEST_STEP * dt:
                    return start + t
                continue
            t = until if step == left else t + step
            for i in range(size):
                q[i], k[0, i] = trial[i], k[6, i]
            # without a corner in the step no element is past the end of its branch
            changed = cut < NONE and change_branches(N, system, progress)
            if due and t == until:
                for i in range(p.shape[1]):
                    p[element[change], i] = system.changed_p[change, i]
                q[2 * N + element[change]] *= system.changed_z[change]
                change, changed = change + 1, True
            if changed:
                _slope(q, 0, t / dt, sample, dt, system, samples, progress)
            _allow(q, n, N, tolerance, progress.scale)
            if not progress.scale[0] < tolerance * LARGEST_DISPLACEMENT:
                return start + t
        for i in range(n):
            x[sample, i], v[sample, i], a[sample, i] = q[i], q[N + i], k[0, N + i]
        for e in range(E):
            samples.r[sample, e], samples.work[sample, e] = progress.forces[e], q[2 * N + E + e]
            y[sample, e] = q[ends[e, 1]] - q[ends[e, 0]]
        t, stalled = 0.0, 0
    at[0], at[1] = h, 0.0
    counts[0], counts[3] = f.shape[0], steps
    return FINISHED
