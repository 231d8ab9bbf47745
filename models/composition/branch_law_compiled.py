"""The branch law, compiled, with its derivatives: the production twin of branch_law.py.

Forces, deformations and rates are in units of the data's largest, so that all here is of order one.
P parameters θ of an element: those of the envelope E, of log k, of log R; then log y₀, the spring,
the damper, log(1 + ρ) and log v₀.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from data.numba_cache import compilers

compiled, inlined = compilers(Path(__file__), contract=True)

CORNER = 0.1  # h over which a ramp ½(h + √(h² + CORNER²)) bends
SPREAD_K, SPREAD_R, SHARPNESS = 6.0, 2.1, 3.0  # |log k/k₀| and |log R/SHARPNESS| at most, R's start
FLOOR = 0.02  # of k: the least slope of a branch against its envelope
SHARE = 0.25  # of log(1 + path) and log(1 + energy), as inputs of about one
EDGE = 0.02  # of the largest deformation: over which excursions beyond y₀ begin to count
BEND = 1e-3  # of the largest force: over which a turning point beyond the envelope bends
BACK = 0.1  # of the largest deformation: the way in which the envelope pulls such a one back


@inlined
def ramp_sum(theta, first, ramps, x, inputs):
    """c + Σ cᵢ xᵢ + Σ wⱼ ramp(aⱼ·x + bⱼ): parameters c, cᵢ, (bⱼ, aⱼ, wⱼ) from `first` on."""
    value = theta[first]
    for i in range(inputs):
        value += theta[first + 1 + i] * x[i]
    at = first + 1 + inputs
    for _ in range(ramps):
        h = theta[at]
        for i in range(inputs):
            h += theta[at + 1 + i] * x[i]
        value += theta[at + 1 + inputs] * 0.5 * (h + math.sqrt(h * h + CORNER * CORNER))
        at += inputs + 2
    return value


@inlined
def add_slopes(theta, first, ramps, x, inputs, weight, gradient, by_x):
    """Add `weight` times the slopes of `ramp_sum` by θ and by x."""
    gradient[first] += weight
    for i in range(inputs):
        gradient[first + 1 + i] += weight * x[i]
        by_x[i] += weight * theta[first + 1 + i]
    at = first + 1 + inputs
    for _ in range(ramps):
        h = theta[at]
        for i in range(inputs):
            h += theta[at + 1 + i] * x[i]
        root = math.sqrt(h * h + CORNER * CORNER)
        gradient[at + 1 + inputs] += weight * 0.5 * (h + root)
        slope = weight * theta[at + 1 + inputs] * 0.5 * (1.0 + h / root)
        gradient[at] += slope
        for i in range(inputs):
            gradient[at + 1 + i] += slope * x[i]
            by_x[i] += slope * theta[at + 1 + i]
        at += inputs + 2


@inlined
def beyond(excursion, least):
    """The excursion beyond y₀, smooth, and its slope by log y₀."""
    h = excursion - least
    root = math.sqrt(h * h + EDGE * EDGE)
    return 0.5 * (h + root), -0.5 * (1.0 + h / root) * least


@inlined
def blended(a, T, R):
    """(a⁻ᴿ + T⁻ᴿ)^(−1/R) of positive a and T, and its slopes by a, T and R."""
    if a < 1e-12 * T:
        return a, 1.0, 0.0, 0.0
    log_a, log_T = math.log(a), math.log(T)
    least = min(log_a, log_T)
    log_B = least - math.log1p(math.exp(-R * abs(log_a - log_T))) / R
    of_a, of_T = log_a - log_B, log_T - log_B  # not negative
    share_a, share_T = math.exp(-R * of_a), math.exp(-R * of_T)
    B = math.exp(log_B)
    by_R = B * (share_a * of_a + share_T * of_T) / R
    return B, share_a * math.exp(-of_a), share_T * math.exp(-of_T), by_R


@inlined
def on_branch(p, E_now, E_turn, r_turn, k, R):
    """Force on a branch a way p after its turning point, in the direction of the motion.

    Returns r and its slopes by E_now, E_turn, r_turn, k, R and p.
    """
    T, rise = E_turn - r_turn, E_now - E_turn
    bent = math.sqrt(T * T + BEND * BEND)
    T_plus, by_T_plus = 0.5 * (T + bent), 0.5 * (1.0 + T / bent)
    decay = math.exp(-p / BACK)
    A = k * p - rise
    root = math.sqrt(A * A + (FLOOR * k * p) ** 2) + 1e-300
    a, a_by_A = 0.5 * (A + root), 0.5 * (1.0 + A / root)
    B, B_a, B_T, B_R = blended(a, T_plus, R)
    r = r_turn + rise + B + (T - T_plus) * (1.0 - decay)
    by_T = B_T * by_T_plus + (1.0 - by_T_plus) * (1.0 - decay)
    floor = 0.5 * FLOOR * FLOOR * k * p / root
    by_k = B_a * (a_by_A * p + floor * p)
    by_p = B_a * (a_by_A * k + floor * k) + (T - T_plus) * decay / BACK
    return r, 1.0 - B_a * a_by_A, -1.0 + B_a * a_by_A + by_T, 1.0 - by_T, by_k, B_R, by_p


@compiled
def with_turning_points(y, rate, dt, band):
    """A motion (T,) with its turning points put in: y, ẏ, direction and place of 2 T steps at most.

    A turning point lies where the cubic through both ends of a step has no slope; it counts where
    the motion comes back by more than `band`. direction: that of the branch that begins at a step,
    0 where none does. place: number of the sample, −1 where a turning point was put in.
    """
    T = y.size
    at, fast = np.zeros(2 * T), np.zeros(2 * T)
    direction, place = np.zeros(2 * T, np.int64), np.zeros(2 * T, np.int64)
    N, furthest, side = 0, 0, 0
    for k in range(T):
        for inside in range(2):
            if inside == 0:
                if k == 0 or rate[k - 1] * rate[k] >= 0.0:
                    continue
                now, speed, number = (
                    _extreme(y[k - 1], y[k], dt * rate[k - 1], dt * rate[k]),
                    0.0,
                    -1,
                )
            else:
                now, speed, number = y[k], rate[k], k
            at[N], fast[N], place[N] = now, speed, number
            if side == 0:
                if abs(now - y[0]) > band:
                    side = 1 if now > y[0] else -1
                    direction[0] = side
                    furthest = N
            elif side * (now - at[furthest]) >= 0.0:
                furthest = N
            elif side * (at[furthest] - now) > band:
                side = -side
                direction[furthest] = side
                furthest = N
            N += 1
    return at[:N], fast[:N], direction[:N], place[:N]


@inlined
def _extreme(y0, y1, d0, d1):
    """The extreme of Hermite's cubic between values y0, y1 with slopes d0, d1 of opposite sign."""
    c2, c3 = 3.0 * (y1 - y0) - 2.0 * d0 - d1, -2.0 * (y1 - y0) + d0 + d1
    root = math.sqrt(max(c2 * c2 - 3.0 * c3 * d0, 0.0))
    q = -(c2 + math.copysign(root, c2))
    t = d0 / q if q != 0.0 else 0.5
    if not 0.0 <= t <= 1.0:
        t = q / (3.0 * c3) if c3 != 0.0 else 0.5
    t = min(max(t, 0.0), 1.0)
    return y0 + t * (d0 + t * (c2 + t * c3))


@compiled
def imposed(theta, sizes, y, rate, turns, place, log_k0, r, jacobian):
    """Forces of a motion in steps, and their derivatives where jacobian (T, P) is not empty.

    y, rate, turns, place (N,): of `with_turning_points`; r (T,) is filled at the places. sizes:
    inputs of E and of k, ramps of E and of k and R. `memory` holds, at the beginning of a
    branch: the largest excursion in its direction and against it, the path, and for a larger law
    the turning point, the force there and the energy.
    """
    inputs, memories, ramps_E, ramps_k = sizes
    P, sensitive, larger = theta.size, jacobian.size > 0, memories > 3
    first_k = 1 + inputs + ramps_E * (inputs + 2)
    first_R = first_k + 1 + memories + ramps_k * (memories + 2)
    last = P - 1
    v0, growth, least = math.exp(theta[last]), math.exp(theta[last - 1]), math.exp(theta[last - 4])
    x, x_turn, memory = np.zeros(inputs), np.zeros(inputs), np.zeros(memories)
    by_x, by_m = np.zeros(inputs), np.zeros(memories)
    d_k, d_R = np.zeros(P), np.zeros(P)
    d_turn, d_energy, d_energy_turn = np.zeros(P), np.zeros(P), np.zeros(P)
    d_before, d_now = np.zeros(P), np.zeros(P)
    highest, lowest, path, energy = max(y[0], 0.0), min(y[0], 0.0), 0.0, 0.0
    y_turn, h_turn, h, h_before = y[0], 0.0, 0.0, 0.0
    direction, k, R = 0.0, 1.0, 1.0
    forward_by_least, against_by_least = 0.0, 0.0
    for n in range(y.size):
        fast = math.exp(-abs(rate[n]) / v0)
        if direction != 0.0:
            x[0], x[inputs - 1], x_turn[inputs - 1] = direction * y[n], 1.0 - fast, 1.0 - fast
            E_now = ramp_sum(theta, 0, ramps_E, x, inputs)
            E_turn = ramp_sum(theta, 0, ramps_E, x_turn, inputs)
            p = max(direction * (y[n] - y_turn), 0.0)
            force, by_E, by_E_turn, by_h_turn, by_k, by_R, _ = on_branch(
                p, E_now, E_turn, direction * h_turn, k, R
            )
            h = direction * force
            if sensitive:
                d_now[:] = 0.0
                by_x[:] = 0.0
                add_slopes(theta, 0, ramps_E, x, inputs, by_E, d_now, by_x)
                add_slopes(theta, 0, ramps_E, x_turn, inputs, by_E_turn, d_now, by_x)
                d_now[last - 4] += by_x[1] * forward_by_least + by_x[2] * against_by_least
                d_now[last] -= by_x[inputs - 1] * fast * abs(rate[n]) / v0
                by_turn = by_h_turn + (by_x[5] if larger else 0.0)
                by_energy = by_x[6] if larger else 0.0
                for q in range(P):
                    d_now[q] += by_k * d_k[q] + by_R * d_R[q] + by_energy * d_energy_turn[q]
                    d_now[q] = direction * d_now[q] + by_turn * d_turn[q]
        step = y[n] - y[n - 1] if n > 0 else 0.0
        energy += 0.5 * (h_before + h) * step
        if sensitive:
            for q in range(P):
                d_energy[q] += 0.5 * (d_before[q] + d_now[q]) * step
                d_before[q] = d_now[q]
        h_before = h
        highest, lowest = max(highest, y[n]), min(lowest, y[n])
        if place[n] >= 0:
            factor = 1.0 + (growth - 1.0) * (1.0 - fast)
            r[place[n]] = theta[last - 3] * y[n] + theta[last - 2] * rate[n] + factor * h
            if sensitive:
                row = jacobian[place[n]]
                for q in range(P):
                    row[q] = factor * d_now[q]
                row[last - 3] += y[n]
                row[last - 2] += rate[n]
                row[last - 1] += growth * (1.0 - fast) * h
                row[last] -= (growth - 1.0) * fast * abs(rate[n]) / v0 * h
        if turns[n] != 0:
            direction = float(turns[n])
            path += abs(y[n] - y_turn)
            y_turn, h_turn = y[n], h
            if sensitive:
                d_turn[:] = d_now
                d_energy_turn[:] = SHARE * d_energy / (1.0 + abs(energy))
            memory[0], forward_by_least = beyond(highest if direction > 0.0 else -lowest, least)
            memory[1], against_by_least = beyond(-lowest if direction > 0.0 else highest, least)
            memory[2] = SHARE * math.log1p(path)
            if larger:
                memory[3], memory[4] = direction * y_turn, direction * h_turn
                memory[5] = SHARE * math.copysign(math.log1p(abs(energy)), energy)
            raw_k = ramp_sum(theta, first_k, ramps_k, memory, memories) / SPREAD_K
            raw_R = ramp_sum(theta, first_R, ramps_k, memory, memories) / SPREAD_R
            k = math.exp(log_k0 + SPREAD_K * math.tanh(raw_k))
            R = SHARPNESS * math.exp(SPREAD_R * math.tanh(raw_R))
            x_turn[0] = direction * y_turn
            for i in range(memories):
                x[1 + i] = x_turn[1 + i] = memory[i]
            for which in range(2 if sensitive else 0):
                total = d_k if which == 0 else d_R
                total[:] = 0.0
                by_m[:] = 0.0
                if which == 0:
                    slope = k * (1.0 - math.tanh(raw_k) ** 2)
                    add_slopes(theta, first_k, ramps_k, memory, memories, slope, total, by_m)
                else:
                    slope = R * (1.0 - math.tanh(raw_R) ** 2)
                    add_slopes(theta, first_R, ramps_k, memory, memories, slope, total, by_m)
                total[last - 4] += by_m[0] * forward_by_least + by_m[1] * against_by_least
                if larger:
                    total += by_m[4] * direction * d_turn + by_m[5] * d_energy_turn
