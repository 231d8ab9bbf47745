"""The integrator: Dormand–Prince 5(4) that stops at every corner of the restoring forces, compiled.

The step is chosen from the error estimate. The laws have corners (yield, slip, gap, velocity
reversal) which lower any fixed-step method to second order, so each step keeps every element on one
smooth branch: where a step runs past the end of a branch, it is cut there, found on the cubic
Hermite interpolant, and the element changes branch.

Between samples the forces are linear, support displacements the cubic through s and ṡ. Where an
element is damaged, a step ends at that very instant, and the motion goes on from the same state.
State q = [x (n), v (n), z (E), work (E)]; slopes k (7, len q); T samples, n DOFs, E elements.

Dormand & Prince (1980); Hairer, Nørsett & Wanner (1993), Sects. II.4–II.6.
"""

from __future__ import annotations

import numpy as np

from data.compiled import compiled, inlined
from data.elements import force as element_force
from data.elements import margin, next_branch

STAGES = np.array(  # row i: weights of the slopes before stage i; the last row is the step itself
    [
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
NODES = np.array([1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
ERROR = np.array(  # fifth-order less fourth-order weights
    [71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40]
)
SMALLEST_STEP = 1e-9  # of a sample interval; a motion that needs less is escaping
CORNER_RESOLUTION = 1e-7  # of a step
LARGEST_DISPLACEMENT = 1e6  # [m]; a motion beyond has escaped


@inlined
def _locate(q, n, s, w, sample, dt, tau, place):
    """Positions place[0] and velocities place[1] of all nodes at fraction tau of an interval."""
    for i in range(n):
        place[0, i], place[1, i] = q[i], q[n + i]
    before = max(sample - 1, 0)
    for j in range(s.shape[1]):  # cubic Hermite
        rise, first, last = s[sample, j] - s[before, j], dt * w[before, j], dt * w[sample, j]
        square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
        place[0, n + j] = s[before, j] + tau * (first + tau * (square + tau * cube))
        place[1, n + j] = (first + tau * (2.0 * square + 3.0 * tau * cube)) / dt


@inlined
def _slope(q, branch, masses, ends, law, p, f, s, w, sample, dt, tau, place, dq, r):
    """q̇, from the equation of motion, and the element forces r."""
    n, elements, before = masses.size, law.size, max(sample - 1, 0)
    _locate(q, n, s, w, sample, dt, tau, place)
    for i in range(n):
        dq[i] = q[n + i]
        dq[n + i] = f[before, i] + tau * (f[sample, i] - f[before, i])
    for e in range(elements):
        start, end, z, work = ends[e, 0], ends[e, 1], 2 * n + e, 2 * n + elements + e
        y, ydot = place[0, end] - place[0, start], place[1, end] - place[1, start]
        r[e], dq[z] = element_force(law[e], p, e, branch[e], y, ydot, q[z], q[work])
        dq[work] = r[e] * ydot
        if end < n:
            dq[n + end] -= r[e]
        if start < n:
            dq[n + start] += r[e]
    for i in range(n):
        dq[n + i] /= masses[i]


@inlined
def _step(q0, h, branch, masses, ends, law, p, f, s, w, sample, dt, tau0, place, k, q1, r):
    """One Dormand–Prince step from q0, whose slope is k[0]; leaves q1, its slope k[6] and its r."""
    for stage in range(6):
        q1[:] = q0
        for j in range(stage + 1):
            weight = h * STAGES[stage, j]
            for i in range(q0.size):
                q1[i] += weight * k[j, i]
        tau = tau0 + NODES[stage] * h / dt
        _slope(q1, branch, masses, ends, law, p, f, s, w, sample, dt, tau, place, k[stage + 1], r)


@inlined
def _error(k, h, scale):
    """Largest estimated error of x, v and z, in units of what is allowed for each."""
    worst = 0.0
    for i in range(scale.size):
        estimate = ERROR[0] * k[0, i]
        for j in range(2, 7):
            estimate += ERROR[j] * k[j, i]
        error = abs(h * estimate) / scale[i]
        if not error < np.inf:  # max() would drop a NaN
            return np.inf
        worst = max(worst, error)
    return worst


@inlined
def _margin(e, q, branch, n, ends, law, p, place):
    """How far element e is from the end of its branch; negative beyond it."""
    start, end = ends[e, 0], ends[e, 1]
    y, ydot = place[0, end] - place[0, start], place[1, end] - place[1, start]
    return margin(law[e], p, e, branch[e], y, ydot, q[2 * n + e])


@compiled
def _between(u, q0, q1, k, h, n, s, w, sample, dt, tau0, place, q):
    """State and node positions at fraction u of a step, on the cubic Hermite interpolant."""
    rise, bend = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u)
    for i in range(q.size):
        q[i] = q0[i] + rise * (q1[i] - q0[i]) + bend * ((1.0 - u) * k[0, i] - u * k[6, i])
    _locate(q, n, s, w, sample, dt, tau0 + u * h / dt, place)


@compiled
def _crossing(e, start, high, at_end, q0, q1, k, h, branch, n, ends, law, p, s, w, sample, dt, tau0,
              place, q):  # fmt: skip
    """Fraction of a step, below `high`, at which element e leaves its branch: Illinois method."""
    if not start > 0.0:
        return 0.0
    past = CORNER_RESOLUTION * (start - at_end)  # aim a little past the corner
    low, at_low, at_high = 0.0, start + past, at_end + past
    for _ in range(60):
        if at_high > -past:
            break
        u = high - (high - low) * at_high / (at_high - at_low)
        _between(u, q0, q1, k, h, n, s, w, sample, dt, tau0, place, q)
        middle = _margin(e, q, branch, n, ends, law, p, place) + past
        if abs(middle) < past:
            return u
        if middle < 0.0:
            high, at_high, at_low = u, middle, 0.5 * at_low
        else:
            low, at_low, at_high = u, middle, 0.5 * at_high
    return high


@inlined
def _first_corner(q0, place0, q1, place1, k, h, branch, n, ends, law, p, s, w, sample, dt, tau0,
                  place, q):  # fmt: skip
    """Fraction of a step at which the first element leaves its branch; 1 where none does."""
    cut = 1.0
    for e in range(law.size):
        until, beyond = 1.0, _margin(e, q1, branch, n, ends, law, p, place1)
        if beyond >= 0.0:  # an element that turned round may have been beyond its branch in between
            before = place0[1, ends[e, 1]] - place0[1, ends[e, 0]]
            after = place1[1, ends[e, 1]] - place1[1, ends[e, 0]]
            if before * after < 0.0:
                until = before / (before - after)
                _between(until, q0, q1, k, h, n, s, w, sample, dt, tau0, place, q)
                beyond = _margin(e, q, branch, n, ends, law, p, place)
        if beyond < 0.0:
            start = _margin(e, q0, branch, n, ends, law, p, place0)
            cut = min(cut, _crossing(e, start, until, beyond, q0, q1, k, h, branch, n, ends, law, p,
                                     s, w, sample, dt, tau0, place, q))  # fmt: skip
    return cut


@inlined
def _allow(q, n, tolerance, scale):
    """Allowed errors: tolerance × size so far, one size for all x, one for all v, one per z."""
    for i in range(n):
        scale[0] = max(scale[0], tolerance * abs(q[i]))
        scale[n] = max(scale[n], tolerance * abs(q[n + i]))
    for i in range(1, n):
        scale[i], scale[n + i] = scale[0], scale[n]
    for i in range(2 * n, scale.size):
        scale[i] = max(scale[i], tolerance * abs(q[i]))


@inlined
def _change_branches(q, branch, n, ends, law, p, place):
    """Move every element that is past the end of its branch to the next; True if one was."""
    changed = False
    for e in range(law.size):
        if _margin(e, q, branch, n, ends, law, p, place) < 0.0:
            start, end, z = ends[e, 0], ends[e, 1], 2 * n + e
            y, ydot = place[0, end] - place[0, start], place[1, end] - place[1, start]
            branch[e], q[z] = next_branch(law[e], p, e, branch[e], y, ydot, q[z])
            changed = True
    return changed


@compiled
def integrate(masses, ends, law, p, f, s, w, dt, tolerance, when, offset, element, changed_p,
              changed_z, x, v, a, y, r, work):  # fmt: skip
    """Fill the record sample by sample from rest; returns the time of escape, or −1.

    Change c of element[c] comes offset[c] after sample when[c] − 1: its row of p becomes
    changed_p[c], its z is multiplied by changed_z[c]. p is overwritten.
    """
    n, elements = masses.size, law.size
    size = 2 * (n + elements)
    q, trial, between, k = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros((7, size))
    nodes = n + s.shape[1] + 1  # the last is ground, which stays where it is
    place, place_trial, place_between = np.zeros((3, 2, nodes))
    forces, branch = np.zeros(elements), np.zeros(elements, np.int64)
    scale = np.full(2 * n + elements, 1e-9 * tolerance)
    h, change = dt, 0
    for sample in range(f.shape[0]):
        start, t, stalled = max(sample - 1, 0) * dt, 0.0, 0
        if sample == 0:
            t = dt
            _locate(q, n, s, w, 0, dt, 1.0, place)
            _change_branches(q, branch, n, ends, law, p, place)  # a support may start displaced
            _slope(q, branch, masses, ends, law, p, f, s, w, 0, dt, 1.0, place, k[0], forces)
        while t < dt:
            due = change < when.size and when[change] == sample
            until = offset[change] if due else dt
            left, tau = until - t, t / dt
            step = left if h > 0.999 * left else min(h, 0.5 * left)
            _step(q, step, branch, masses, ends, law, p, f, s, w, sample, dt, tau,
                  place_trial, k, trial, forces)  # fmt: skip
            error = _error(k, step, scale)
            if error > 1.0:
                h = step * (max(0.2, 0.9 * error**-0.2) if error < 1e300 else 0.2)
                if h < SMALLEST_STEP * dt:
                    return start + t
                continue
            h = step * min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
            cut = _first_corner(q, place, trial, place_trial, k, step, branch, n, ends, law, p,
                                s, w, sample, dt, tau, place_between, between)  # fmt: skip
            if cut < 1.0:
                # corners that follow at once get ever longer steps: none can stall the motion
                stalled = stalled + 1 if cut * step <= SMALLEST_STEP * dt else 0
                step = min(max(cut * step, SMALLEST_STEP * dt * 2.0**stalled), left)
                _step(q, step, branch, masses, ends, law, p, f, s, w, sample, dt, tau,
                      place_trial, k, trial, forces)  # fmt: skip
            t = until if step == left else t + step
            q[:], place[:], k[0] = trial, place_trial, k[6]
            changed = _change_branches(q, branch, n, ends, law, p, place)
            if due and t == until:
                p[element[change]] = changed_p[change]
                q[2 * n + element[change]] *= changed_z[change]
                change, changed = change + 1, True
            if changed:
                _slope(q, branch, masses, ends, law, p, f, s, w, sample, dt, t / dt,
                       place, k[0], forces)  # fmt: skip
            _allow(q, n, tolerance, scale)
            if not scale[0] < tolerance * LARGEST_DISPLACEMENT:
                return start + t
        x[sample], v[sample], a[sample] = q[:n], q[n : 2 * n], k[0, n : 2 * n]
        r[sample], work[sample] = forces, q[2 * n + elements :]
        for e in range(elements):
            y[sample, e] = place[0, ends[e, 1]] - place[0, ends[e, 0]]
    return -1.0
