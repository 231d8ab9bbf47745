"""A moment frame under an imposed motion, and in free run, compiled.

All joints of a floor turn alike, by φ_i. A storey drifts by Δ_i = x_i − x_{i−1}; rotations are in
units of length: angles times the height of the first storey, ρ_i of which a storey is high.
Columns of a storey, an elastic one with a hinge p at either end, with θ = ρ φ − Δ:

    M_b = k (2 (θ_b − p_b) + θ_t − p_t) = hinge(p_b),   M_t likewise,   V = −(M_b + M_t) − g Δ
    beams of a floor:   M = 3 k (φ − p) = hinge(p);   at every joint all moments balance

g is what the weight above takes from the stiffness. Dampers go with the elastic stiffness, β K₀,
and with the masses, α m. Steps are implicit (Newton): joints have no mass.
n floors, T samples, S steps of a sample.

Hinges are of steel after Menegotto & Pinto; data/simulation/laws/menegotto_pinto.py has the
formulas, here without isotropic hardening. There a motion is known; here a hinge turns as far as
balances its member, so that a step is tried before it is taken: `new` is what `old` becomes.
Memory of a hinge (MEMORY,): y_r, ρ_r, y₀, R, y₊, y₋, branch, y; branch 0 is the first loading,
1 goes forward, 2 backward. law of a hinge: y_y, k, b, R₀, c₁.

laws (n, 2, 6): columns and beams of each floor, k, then y_y, k, b, R₀, c₁ of their hinges.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__))

MEMORY = 8
LOSS_EXCURSION = 0.15  # c₂
BOTTOM, TOP, BEAM = range(3)  # hinges of a floor
MOST = 50  # iterations
SLOW = 12  # iterations, from which steps are halved
BALANCED = 1e-9  # of the force at which a member yields
BALANCED_JOINT = 1e-7  # of the largest of these
LOST = 1e3  # times the largest rotation at which a hinge yields: a run that went astray


@inlined
def _approach(e, b, R):
    """b e + (1 − b) e / (1 + |e|^R)^(1/R) and its slope, also where |e|^R is beyond all numbers."""
    size, side = abs(e), 1.0 if e > 0.0 else -1.0
    if size <= 1.0:
        grown = 1.0 + size**R
        share = (1.0 - b) * grown ** (-1.0 / R)
        return b * e + share * e, b + share / grown
    power = size**-R
    share = (1.0 - b) * (1.0 + power) ** (-1.0 / R)
    return b * e + share * side, b + share * power / (1.0 + power) / size


@inlined
def _shape(law, at, y):
    """ρ = r/k and its slope at y, on the branch that the memory `at` is on."""
    if at[6] == 0.0:
        value, slope = _approach(y / law[0], law[2], law[3])
        return law[0] * value, slope
    span = at[2] - at[0]
    value, slope = _approach((y - at[0]) / span, law[2], at[3])
    return at[1] + span * value, slope


@inlined
def _turned(law, old, forward, new):
    """Turn round where the memory `old` ends."""
    y, y_y, b = old[7], law[0], law[2]
    rho, _ = _shape(law, old, y)
    highest, lowest = max(y_y, old[4]), min(-y_y, old[5])
    if forward:
        lowest, side = min(lowest, y), 1.0
    else:
        highest, side = max(highest, y), -1.0
    span = (y_y * (1.0 - b) - side * (rho - b * y)) / (1.0 - b)
    corner = y + side * max(span, 1e-9 * y_y)
    xi = abs((highest if forward else lowest) - corner) / y_y
    R = law[3] * (1.0 - law[4] * xi / (LOSS_EXCURSION + xi))
    new[0], new[1], new[2], new[3], new[4], new[5] = y, rho, corner, R, highest, lowest
    new[6] = 1.0 if forward else 2.0


@inlined
def turn(law, old, y, new):
    """Force and stiffness of a hinge that goes from its memory `old` to y; fills `new`."""
    for i in range(MEMORY):
        new[i] = old[i]
    last, branch = old[7], old[6]
    if branch == 0.0:
        back = (last > 0.0 and y < last) or (last < 0.0 and y > last)
    else:
        back = (branch == 1.0 and y < last) or (branch == 2.0 and y > last)
    if back:
        _turned(law, old, y > last, new)
    new[7] = y
    rho, slope = _shape(law, new, y)
    return law[1] * rho, law[1] * slope


@inlined
def _column(law, old, new, bottom, top):
    """Moments of both ends, and their stiffnesses k_bb, k_bt, k_tt, at rotations θ of the ends."""
    k, hinge, small = law[0], law[1:], BALANCED * law[2] * law[1]
    p_b, p_t = new[BOTTOM, 7], new[TOP, 7]
    m_b, m_t, h_b, h_t = 0.0, 0.0, 1.0, 1.0
    for i in range(MOST):
        m_b, h_b = turn(hinge, old[BOTTOM], p_b, new[BOTTOM])
        m_t, h_t = turn(hinge, old[TOP], p_t, new[TOP])
        left_b = k * (2.0 * (bottom - p_b) + top - p_t) - m_b
        left_t = k * (2.0 * (top - p_t) + bottom - p_b) - m_t
        if abs(left_b) + abs(left_t) < small:
            break
        a, c = 2.0 * k + h_b, 2.0 * k + h_t
        share = (1.0 if i < SLOW else 0.5) / (a * c - k * k)
        p_b += share * (c * left_b - k * left_t)
        p_t += share * (a * left_t - k * left_b)
    a, c, off = 2.0 / (3.0 * k) + 1.0 / h_b, 2.0 / (3.0 * k) + 1.0 / h_t, 1.0 / (3.0 * k)
    whole = a * c - off * off
    return m_b, m_t, c / whole, off / whole, a / whole


@inlined
def _beam(law, old, new, phi):
    """Moment and stiffness of the beams of a floor whose joints turn by φ."""
    k, hinge, small = 3.0 * law[0], law[1:], BALANCED * law[2] * law[1]
    p, m, h = new[BEAM, 7], 0.0, 1.0
    for i in range(MOST):
        m, h = turn(hinge, old[BEAM], p, new[BEAM])
        left = k * (phi - p) - m
        if abs(left) < small:
            break
        p += (1.0 if i < SLOW else 0.5) * left / (k + h)
    return m, k * h / (k + h)


@inlined
def _add(K, i, j, value):
    K[i, j] += value
    if i != j:
        K[j, i] += value


@compiled
def _balance(laws, sag, rho, u, old, new, F, K):
    """Forces F (2n,) and stiffnesses K (2n, 2n) of floors and joints at u = [x, φ]."""
    n = sag.size
    for i in range(2 * n):
        F[i] = 0.0
        for j in range(2 * n):
            K[i, j] = 0.0
    for i in range(n):
        drift = u[i] - (u[i - 1] if i > 0 else 0.0)
        below = rho[i] * u[n + i - 1] if i > 0 else 0.0
        m_b, m_t, bb, bt, tt = _column(
            laws[i, 0], old[i], new[i], below - drift, rho[i] * u[n + i] - drift
        )
        shear, across, b, t = (
            -m_b - m_t - sag[i] * drift,
            bb + 2.0 * bt + tt - sag[i],
            bb + bt,
            bt + tt,
        )
        F[i] += shear
        F[n + i] += rho[i] * m_t
        _add(K, i, i, across)
        _add(K, i, n + i, -rho[i] * t)
        _add(K, n + i, n + i, rho[i] ** 2 * tt)
        if i > 0:
            F[i - 1] -= shear
            F[n + i - 1] += rho[i] * m_b
            _add(K, i - 1, i - 1, across)
            _add(K, i, i - 1, -across)
            _add(K, i - 1, n + i, rho[i] * t)
            _add(K, i - 1, n + i - 1, rho[i] * b)
            _add(K, i, n + i - 1, -rho[i] * b)
            _add(K, n + i - 1, n + i - 1, rho[i] ** 2 * bb)
            _add(K, n + i, n + i - 1, rho[i] ** 2 * bt)
        m, k = _beam(laws[i, 1], old[i], new[i], u[n + i])
        F[n + i] += m
        K[n + i, n + i] += k


@compiled
def elastic(laws, sag, rho):
    """The stiffness (2n, 2n) of floors and joints at rest."""
    n = sag.size
    F, K = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    old, new = np.zeros((n, 3, MEMORY)), np.zeros((n, 3, MEMORY))
    _balance(laws, sag, rho, np.zeros(2 * n), old, new, F, K)
    return K


@inlined
def _eliminate(A, b, first):
    """Solve A x = b from row `first` on, A positive definite; x in place of b."""
    n = b.size
    for i in range(first, n):
        for j in range(i + 1, n):
            factor = A[j, i] / A[i, i]
            for k in range(i + 1, n):
                A[j, k] -= factor * A[i, k]
            b[j] -= factor * b[i]
    for i in range(n - 1, first - 1, -1):
        for k in range(i + 1, n):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]


@inlined
def _keep(new, old):
    for i in range(old.shape[0]):
        for j in range(3):
            for k in range(MEMORY):
                old[i, j, k] = new[i, j, k]


@inlined
def _largest(laws):
    """Moment and rotation at which the strongest hinge, and the one that turns farthest, yields."""
    moment, rotation = 0.0, 0.0
    for i in range(laws.shape[0]):
        for j in range(2):
            moment = max(moment, laws[i, j, 1] * laws[i, j, 2])
            rotation = max(rotation, laws[i, j, 1] + moment / laws[i, j, 0])
    return moment, rotation


@compiled
def imposed(laws, sag, rho, beta, x, v, dt, F_out):
    """Fill the floors' forces (T, n) of members and dampers β under a motion x, v (T, n)."""
    T, n = x.shape
    K0, (moment, _) = elastic(laws, sag, rho), _largest(laws)
    old, new = np.zeros((n, 3, MEMORY)), np.zeros((n, 3, MEMORY))
    u, before, rate = np.zeros(2 * n), np.zeros(2 * n), np.zeros(2 * n)
    F, K = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    for k in range(T):
        step = dt if k > 0 else np.inf
        for i in range(n):
            u[i], rate[i] = x[k, i], v[k, i]
            u[n + i] += dt * rate[n + i]
        for iteration in range(MOST):
            for i in range(n, 2 * n):
                rate[i] = (u[i] - before[i]) / step
            _balance(laws, sag, rho, u, old, new, F, K)
            left = 0.0
            for i in range(2 * n):
                for j in range(2 * n):
                    F[i] += beta * K0[i, j] * rate[j]
                    K[i, j] += beta / step * K0[i, j]
                if i >= n:
                    left = max(left, abs(F[i]))
            if left < BALANCED_JOINT * moment:
                break
            _eliminate(K, F, n)
            for i in range(n, 2 * n):
                u[i] -= (1.0 if iteration < SLOW else 0.5) * F[i]
        _keep(new, old)
        for i in range(2 * n):
            before[i] = u[i]
        for i in range(n):
            F_out[k, i] = F[i]


@compiled
def free(laws, sag, rho, mass, alpha, beta, first, between, h, x, v, a):
    """Fill the motion x, v, a (T, n) from rest by Newmark's method, in steps h.

    first, between (T − 1, S): accelerations that the excitation gives all masses, at the first
    sample and at the end of each step. A run that is lost is infinite from there on.
    """
    T, n = x.shape
    K0, (moment, rotation) = elastic(laws, sag, rho), _largest(laws)
    old, new = np.zeros((n, 3, MEMORY)), np.zeros((n, 3, MEMORY))
    u, rate, acc = np.zeros(2 * n), np.zeros(2 * n), np.zeros(n)
    F, K, u_old, rate_old, acc_old = (
        np.zeros(2 * n),
        np.zeros((2 * n, 2 * n)),
        u.copy(),
        u.copy(),
        acc.copy(),
    )
    for i in range(n):
        acc[i] = a[0, i] = first
    for k in range(1, T):
        for part in range(between.shape[1]):
            for i in range(2 * n):
                u_old[i], rate_old[i] = u[i], rate[i]
                u[i] += h * rate[i]
            for i in range(n):
                acc_old[i] = acc[i]
            left = np.inf
            for iteration in range(MOST):
                for i in range(2 * n):
                    rate[i] = 2.0 / h * (u[i] - u_old[i]) - rate_old[i]
                _balance(laws, sag, rho, u, old, new, F, K)
                for i in range(2 * n):
                    for j in range(2 * n):
                        F[i] += beta * K0[i, j] * rate[j]
                        K[i, j] += 2.0 / h * beta * K0[i, j]
                for i in range(n):
                    acc[i] = 2.0 / h * (rate[i] - rate_old[i]) - acc_old[i]
                    F[i] += mass[i] * (acc[i] + alpha * rate[i] - between[k - 1, part])
                    K[i, i] += mass[i] * (4.0 / h**2 + 2.0 / h * alpha)
                left = 0.0
                for i in range(2 * n):
                    left = max(left, abs(F[i]))
                if left < BALANCED_JOINT * moment:
                    break
                _eliminate(K, F, 0)
                for i in range(2 * n):
                    u[i] -= (1.0 if iteration < SLOW else 0.5) * F[i]
            _keep(new, old)
            far = 0.0
            for i in range(n):
                far = max(far, abs(u[i]))
            if not (far < LOST * rotation and left < np.inf):
                for later in range(k, T):
                    for i in range(n):
                        x[later, i] = v[later, i] = a[later, i] = np.inf
                return
        for i in range(n):
            x[k, i], v[k, i], a[k, i] = u[i], rate[i], acc[i]
