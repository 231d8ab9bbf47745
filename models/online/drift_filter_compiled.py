"""Structures one sample on, each with its own laws and memory, and the tangent of one of them.

N structures, n DOFs, m supports, E elements with dampers; q as in data/simulation/integrator.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from data.numba_cache import compilers
from data.simulation.integrator import FINISHED, Progress, Samples, System, integrate
from data.simulation.laws.compiling import CALLERS, ROOM
from data.simulation.laws.dispatch import force, next_branch
from data.simulation.laws.element import MEMORY

compiled, inlined = compilers(Path(__file__), *sorted(ROOM.glob("*.py")), *CALLERS)
STEPS = 100_000  # between two samples: a structure that takes more is escaping
HOPS = 4  # from branch to branch, at most
APART = 1e-4  # of the largest deformation, rate and z so far: the differences of a tangent


@compiled
def advance(masses, ends, law, f, s, w, dt, tolerance, a, states):
    """Move all structures to the sample of the last row of f; sets a (N, n), infinite on escape.

    masses (N, n); f (N, T, n) [N], s and w (T, m): the first sample (T = 1), from rest, or the
    sample before and this one (T = 2). states: the progress of all, (N, ·) each.
    """
    T, n, E = f.shape[1], f.shape[2], law.size
    none, number, same = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, states.p.shape[2]))
    x, v, accelerations = np.zeros((T, n)), np.zeros((T, n)), np.zeros((T, n))
    y, r, work = np.zeros((T, E)), np.zeros((T, E)), np.zeros((T, E))
    for i in range(f.shape[0]):
        at, counts = states.at[i], states.counts[i]
        if at[0] == 0.0:  # it escaped before
            continue
        at[1] = 0.0 if T > 1 else dt
        counts[0], counts[1], counts[2], counts[3] = T - 1, 0, 0, 0
        system = System(masses[i], ends, law, number, none, number, same, none)
        samples = Samples(f[i], s, w, x, v, accelerations, y, r, work)
        progress = Progress(
            states.p[i], states.q[i], states.k[i], states.forces[i], states.branch[i],
            states.memory[i], states.scale[i], states.trial[i], at, counts,
        )  # fmt: skip
        end = integrate(system, samples, progress, dt, tolerance, STEPS)
        if end != FINISHED:
            at[0] = 0.0
        for j in range(n):
            a[i, j] = accelerations[T - 1, j] if end == FINISHED else np.inf


@compiled
def linearise(structure, p, branch, m, q, supports, largest, place, A, B):
    """Set A (L, L) and B (L, K): rates of small changes of x, v and z by these and by memories.

    L = 2n + E. largest (3, E): of the deformation, its rate and z so far, taken further. place
    (E, MEMORY): which of the K columns is that of a number, −1 for one that has not been used yet.
    structure: masses, ends of elements, their laws.
    """
    masses, ends, law = structure
    n, E = masses.size, law.size
    N = n + supports + 1
    A[:], B[:] = 0.0, 0.0
    A[:n, n : 2 * n] = np.eye(n)
    for e in range(E):
        start, end, work = ends[e, 0], ends[e, 1], q[2 * N + E + e]
        at = (q[end] - q[start], q[N + end] - q[N + start], q[2 * N + e])
        for j in range(3):
            largest[j, e] = max(largest[j, e], abs(at[j]))
        for j in range(3):
            h = APART * largest[j, e]
            if j == 2 and h == 0.0:
                continue
            h = max(h, 1e-100)  # at rest any size will do
            y, rate, z = h if j == 0 else 0.0, h if j == 1 else 0.0, h if j == 2 else 0.0
            after, z_after = force(
                law[e], p, m, e, branch[e], at[0] + y, at[1] + rate, at[2] + z, work
            )
            before, z_before = force(
                law[e], p, m, e, branch[e], at[0] - y, at[1] - rate, at[2] - z, work
            )
            of_r, of_z = (after - before) / (2.0 * h), (z_after - z_before) / (2.0 * h)
            for side in range(2):  # of the change; z belongs to the element itself
                node = ends[e, side] if j < 2 else 2 * n + e
                if (j == 2 and side == 0) or (j < 2 and node >= n):
                    continue
                column = node + n if j == 1 else node
                sign = -1.0 if j < 2 and side == 0 else 1.0
                A[2 * n + e, column] += sign * of_z
                if end < n:
                    A[n + end, column] -= sign * of_r / masses[end]
                if start < n:
                    A[n + start, column] += sign * of_r / masses[start]
        for j in range(MEMORY):
            kept = m[e, j]
            h = APART * abs(kept)
            if h == 0.0 or place[e, j] < 0:
                continue
            m[e, j] = kept + h
            after, _ = force(law[e], p, m, e, branch[e], at[0], at[1], at[2], work)
            m[e, j] = kept - h
            before, _ = force(law[e], p, m, e, branch[e], at[0], at[1], at[2], work)
            m[e, j] = kept
            of_r = (after - before) / (2.0 * h)
            if end < n:
                B[n + end, place[e, j]] = -of_r / masses[end]
            if start < n:
                B[n + start, place[e, j]] = of_r / masses[start]


@compiled
def pass_corners(structure, p, before, m_before, branch, q, supports, largest, place, X, C):
    """Change δm, in columns X (D, ·) such as s, and in C, of elements that came to another branch.

    before, m_before: branches and memories at the sample before. By differences of the law's own
    next branch, which is asked at this sample. structure, place: as for `linearise`.
    """
    _, ends, law = structure
    n, E, D = q.size // 2 - law.size - supports - 1, law.size, len(X)
    N, first = n + supports + 1, 2 * n + E + 1  # of δm, in s
    own, trial = np.zeros(MEMORY), m_before.copy()
    G, of = np.zeros((MEMORY, MEMORY + 2)), np.zeros(MEMORY + 2, np.int64)
    for e in range(E):
        if before[e] == branch[e]:
            continue
        start, end = ends[e, 0], ends[e, 1]
        y, rate, z = q[end] - q[start], q[N + end] - q[N + start], q[2 * N + e]
        path = 0  # branches that it passes
        for c in range(-1, MEMORY + 1):  # as it is, with another y, with another memory
            h = 0.0
            if c == 0:
                h = APART * largest[0, e]
            elif c > 0 and place[e, c - 1] >= 0:
                h = APART * abs(m_before[e, c - 1])
            for i in range(MEMORY):
                G[i, max(c, 0)] = 0.0
            for side in range(2):  # that passes the same
                h, at, hops = -h if side else h, before[e], 0
                for i in range(MEMORY):
                    trial[e, i] = m_before[e, i] + (h if i == c - 1 else 0.0)
                while at != branch[e] and hops < HOPS and (c < 0 or h != 0.0):
                    moved = y + (h if c == 0 else 0.0)
                    at, _ = next_branch(law[e], p, trial, e, at, moved, rate, z)
                    hops += 1
                path = hops if c < 0 else path
                if hops == path and at == branch[e]:
                    for i in range(MEMORY):
                        if c < 0:
                            own[i] = trial[e, i]
                        else:
                            G[i, c] = (trial[e, i] - own[i]) / h
                    break
        for i in range(MEMORY):  # y is the difference of two places
            of[i + 1] = first + place[e, i] if place[e, i] >= 0 else -1
            G[i, MEMORY + 1] = -G[i, 0]
        of[0], of[MEMORY + 1] = end if end < n else -1, start if start < n else -1
        for j in range(D + X.shape[1]):
            for i in range(MEMORY):
                own[i] = 0.0
                for c in range(MEMORY + 2):
                    if of[c] >= 0:
                        own[i] += G[i, c] * (C[of[c], j] if j < D else X[of[c], j - D])
            for i in range(MEMORY):
                if of[i + 1] >= 0 and j < D:
                    C[of[i + 1], j] = own[i]
                elif of[i + 1] >= 0:
                    X[of[i + 1], j - D] = own[i]
        for j in range(D):
            for i in range(MEMORY):
                own[i] = 0.0
                for c in range(MEMORY + 2):
                    if of[c] >= 0:
                        own[i] += G[i, c] * C[j, of[c]]
            for i in range(MEMORY):
                if of[i + 1] >= 0:
                    C[j, of[i + 1]] = own[i]


@compiled
def move(before, A, B_before, B, G, dt, ground, fresh, X, C):
    """Take columns X (D, ·) such as s, and the covariance C of s, on: δ under w, and w anew.

    w is linear between samples.

    By the exponential of the mean of both tangents, as Padé (2, 2) has it. ground: variance of w;
    fresh (·,): its value at the new sample in each column.
    """
    L = A.shape[0]
    k = L + 1
    M, eye = np.zeros((k + 1, k + 1)), np.eye(k + 1)  # of δ, w and its change until now
    M[:L, L], M[:L, :L], M[L, k] = dt * G, 0.5 * dt * (before + A), 1.0
    even, odd = eye + np.dot(M, M) / 12.0, 0.5 * M
    R = B.shape[1]
    right = np.zeros((k + 1, k + 1 + R))
    right[:, : k + 1], right[:L, k + 1 :] = even + odd, 0.5 * dt * (B_before + B)
    whole = np.linalg.solve(even - odd, right)
    F, last = np.zeros((k, k + R)), np.zeros(k)
    last[L] = 1.0
    for i in range(L):
        if A[i].any():  # z that nothing moves is at its bound, as in a slider
            last[i] = whole[i, k]
            F[i, :k], F[i, k:] = whole[i, :k], whole[i, k + 1 :]
            F[i, L] -= last[i]
    moved = np.dot(F, X[: k + R])
    rows = np.dot(F, C[: k + R])
    own = np.dot(rows[:, : k + R].copy(), F.T.copy())
    X[:k] = moved + np.outer(last, fresh)
    C[:k], C[:, :k] = rows, rows.T
    C[:k, :k] = 0.5 * (own + own.T) + np.outer(ground * last, last)


@compiled
def learn(H, variances, left, s, C):
    """Correct s and C by what is left (S,) of measurements; the sum of squared innovations over S.

    One after the other, as their noise is independent.
    """
    D, missed, g = s.size, 0.0, np.zeros(s.size)
    for i in range(H.shape[0]):
        innovation, S = left[i], variances[i]
        for j in range(D):
            g[j] = 0.0
            for k in range(D):
                g[j] += C[j, k] * H[i, k]
            innovation -= H[i, j] * s[j]
            S += H[i, j] * g[j]
        if S > 0.0:  # at rest, without noise, nothing is to be learnt
            missed += innovation**2 / S
            for j in range(D):
                s[j] += g[j] * innovation / S
                for k in range(j + 1):
                    C[j, k] -= g[j] * g[k] / S
                    C[k, j] = C[j, k]
    return missed


@compiled
def spread(rows, C, variances):
    """Set variances (E,) of what rows (E, D) have of s."""
    for e in range(rows.shape[0]):
        variances[e] = 0.0
        for i in range(C.shape[0]):
            part = 0.0
            for j in range(C.shape[0]):
                part += C[i, j] * rows[e, j]
            variances[e] += rows[e, i] * part
