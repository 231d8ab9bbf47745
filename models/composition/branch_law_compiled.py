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
FARTHEST = 1.2  # of the largest deformation: beyond, E and the spring go on in a line
KEPT = 2.0  # of the largest deformation and force: what goes beyond is remembered as that much
LEAST_SLOPE = 0.05  # of the line
SECANT = 0.1  # of the largest deformation, whose slopes the line has
ENDS = (  # places along ŷ and their weights in the mean slope of both ends
    (FARTHEST, 0.5 / SECANT),
    (FARTHEST - SECANT, -0.5 / SECANT),
    (SECANT - FARTHEST, 0.5 / SECANT),
    (-FARTHEST, -0.5 / SECANT),
)
LEAST_DAMPER = 1e-3  # of force over rate: a damper takes up energy, if next to none
TAIL = 5  # parameters after E, k and R: log y₀, spring, damper, log(1 + ρ), log v₀
BACK = 0.1  # of the largest deformation: the way in which the envelope pulls such a one back

# numbers of what an element remembers: direction of its branch, turning point and force there,
# excursions, path, energy, the force of the last step, the branch's stiffness and sharpness, and
# the inputs of E, k and R: the largest excursion in the direction of the branch and against it,
# the path, for a larger law the turning point, the force there and the energy, and last, where
# the sides differ, the direction
SIDE, Y_TURN, H_TURN, HIGHEST, LOWEST, PATH, ENERGY, FORCE, STIFF, SHARP, MEMORY = range(11)
LESS, MORE = 3, 6  # memories of a law that knows no direction
STATES = MEMORY + MORE + 1


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
def envelope(theta, first, ramps, x, inputs):
    """E(x): beyond FARTHEST along ŷ lines on both sides that rise alike, so that loops stay wide.

    Their slope is the mean of the secants at both ends, and in both directions.
    """
    now = x[0]
    if abs(now) <= FARTHEST:
        return ramp_sum(theta, first, ramps, x, inputs)
    slope = _slope_beyond(theta, first, ramps, x, inputs)
    end = math.copysign(FARTHEST, now)
    x[0] = end
    value = ramp_sum(theta, first, ramps, x, inputs)
    x[0] = now
    return value + max(slope, LEAST_SLOPE) * (now - end)


@inlined
def _slope_beyond(theta, first, ramps, x, inputs):
    now, rise = x[0], 0.0
    for _ in range(ways(inputs)):
        for at, weight in ENDS:
            x[0] = at
            rise += weight * ramp_sum(theta, first, ramps, x, inputs) / ways(inputs)
        turn_over(x, inputs)
    x[0] = now
    return rise


@inlined
def ways(inputs):
    """Number of directions that the inputs tell apart."""
    return 2 if inputs == LESS + 3 or inputs == MORE + 3 else 1


@inlined
def turn_over(x, inputs):
    """The inputs of the other direction, where they tell them apart."""
    if ways(inputs) == 2:
        x[inputs - 2] = -x[inputs - 2]


@inlined
def add_envelope_slopes(theta, first, ramps, x, inputs, weight, gradient, by_x):
    """Add `weight` times the slopes of `envelope` by θ and by x."""
    now = x[0]
    if abs(now) <= FARTHEST:
        add_slopes(theta, first, ramps, x, inputs, weight, gradient, by_x)
        return
    before, end = by_x[0], math.copysign(FARTHEST, now)
    slope = _slope_beyond(theta, first, ramps, x, inputs)
    x[0] = end
    add_slopes(theta, first, ramps, x, inputs, weight, gradient, by_x)
    if slope > LEAST_SLOPE:
        for _ in range(ways(inputs)):
            for at, share in ENDS:
                x[0] = at
                share *= weight * (now - end) / ways(inputs)
                add_slopes(theta, first, ramps, x, inputs, share, gradient, by_x)
            turn_over(x, inputs)
    x[0] = now
    by_x[0] = before + weight * max(slope, LEAST_SLOPE)


@inlined
def law_size(sizes):
    """Number of parameters of a law."""
    inputs, memories, ramps_E, ramps_k = sizes
    of_E = 1 + inputs + ramps_E * (inputs + 2)
    return of_E + 2 * (1 + memories + ramps_k * (memories + 2)) + TAIL


@inlined
def beyond(excursion, least):
    """The excursion beyond y₀, smooth, up to KEPT, and its slopes by both."""
    h = min(excursion, KEPT) - least
    root = math.sqrt(h * h + EDGE * EDGE)
    slope = 0.5 * (1.0 + h / root)
    return 0.5 * (h + root), slope if excursion < KEPT else 0.0, -slope


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
def extreme_at(y0, y1, d0, d1):
    """Where in [0, 1] Hermite's cubic between y0, y1 with slopes d0, d1 of opposite sign turns."""
    c2, c3 = 3.0 * (y1 - y0) - 2.0 * d0 - d1, -2.0 * (y1 - y0) + d0 + d1
    root = math.sqrt(max(c2 * c2 - 3.0 * c3 * d0, 0.0))
    q = -(c2 + math.copysign(root, c2))
    t = d0 / q if q != 0.0 else 0.5
    if not 0.0 <= t <= 1.0:
        t = q / (3.0 * c3) if c3 != 0.0 else 0.5
    return min(max(t, 0.0), 1.0)


@inlined
def hermite(t):
    """Weights of y0, d0, y1 and d1 in Hermite's cubic at t."""
    from_1 = t * t * (3.0 - 2.0 * t)
    return 1.0 - from_1, t * (1.0 - t) ** 2, from_1, t * t * (t - 1.0)


@inlined
def _extreme(y0, y1, d0, d1):
    by_y0, by_d0, by_y1, by_d1 = hermite(extreme_at(y0, y1, d0, d1))
    return by_y0 * y0 + by_d0 * d0 + by_y1 * y1 + by_d1 * d1


@compiled
def follow(theta, first, sizes, y, speed, dy, dspeed, S, D, d, x, x_turn, by_x, sensitive):
    """Force h on the present branch at y and exp(−|ẏ|/v₀); fills d (P,) where `sensitive`.

    theta: of all elements, one after the other; `first` is the number of this element's first, in
    θ as in the P columns of derivatives. dy, dspeed (P,): of y and ẏ; S (STATES,) and D (STATES, P)
    as `turn` leaves them.
    """
    inputs, memories, ramps_E, _ = sizes
    last = first + law_size(sizes) - 1
    v0, side = math.exp(theta[last]), S[SIDE]
    fast = math.exp(-abs(speed) / v0)
    x[0], x_turn[0] = side * y, side * S[Y_TURN]
    for i in range(memories):
        x[1 + i] = x_turn[1 + i] = S[MEMORY + i]
    x[inputs - 1] = x_turn[inputs - 1] = 1.0 - fast
    E_now = envelope(theta, first, ramps_E, x, inputs)
    E_turn = envelope(theta, first, ramps_E, x_turn, inputs)
    p = max(side * (y - S[Y_TURN]), 0.0)
    force, by_E, by_E_turn, by_h_turn, by_k, by_R, by_p = on_branch(
        p, E_now, E_turn, side * S[H_TURN], S[STIFF], S[SHARP]
    )
    if sensitive:
        if p == 0.0:
            by_p = 0.0
        for q in range(d.size):
            d[q] = 0.0
        for i in range(inputs):
            by_x[i] = 0.0
        add_envelope_slopes(theta, first, ramps_E, x, inputs, by_E, d, by_x)
        by_y, by_x[0] = by_x[0] + by_p, 0.0
        add_envelope_slopes(theta, first, ramps_E, x_turn, inputs, by_E_turn, d, by_x)
        by_g, by_turn = side * by_x[inputs - 1], by_x[0] - by_p
        d[last] -= side * by_g * fast * abs(speed) / v0
        by_speed = by_g * fast * (1.0 if speed > 0.0 else -1.0) / v0
        by_k, by_R = side * by_k, side * by_R
        for q in range(d.size):
            d[q] = side * d[q] + by_y * dy[q] + by_speed * dspeed[q] + by_turn * D[Y_TURN, q]
            d[q] += by_h_turn * D[H_TURN, q] + by_k * D[STIFF, q] + by_R * D[SHARP, q]
        for i in range(memories):
            weight = side * by_x[1 + i]
            for q in range(d.size):
                d[q] += weight * D[MEMORY + i, q]
    return side * force, fast


@inlined
def go_on(y, y_before, h, dy, dy_before, dh, S, D, sensitive):
    """Take up energy from y_before, where the force was S[FORCE], to y, where it is h."""
    step, mean = y - y_before, 0.5 * (S[FORCE] + h)
    S[ENERGY] += mean * step
    if sensitive:
        for q in range(dy.size):
            D[ENERGY, q] += 0.5 * (D[FORCE, q] + dh[q]) * step + mean * (dy[q] - dy_before[q])
            D[FORCE, q] = dh[q]
    S[FORCE] = h
    if y > S[HIGHEST]:
        S[HIGHEST] = y
        if sensitive:
            for q in range(dy.size):
                D[HIGHEST, q] = dy[q]
    if y < S[LOWEST]:
        S[LOWEST] = y
        if sensitive:
            for q in range(dy.size):
                D[LOWEST, q] = dy[q]


@compiled
def turn(theta, first, sizes, log_k0, side, y, dy, S, D, by_m, sensitive):
    """Begin a branch in the direction `side` at y, where the force is S[FORCE]."""
    inputs, memories, ramps_E, ramps_k = sizes
    first_k = first + 1 + inputs + ramps_E * (inputs + 2)
    first_R = first_k + 1 + memories + ramps_k * (memories + 2)
    of_least = first + law_size(sizes) - TAIL
    least, way = math.exp(theta[of_least]), 1.0 if y > S[Y_TURN] else -1.0
    S[PATH] += abs(y - S[Y_TURN])
    ahead, behind = (HIGHEST, LOWEST) if side > 0.0 else (LOWEST, HIGHEST)
    S[MEMORY], by_ahead, ahead_by_least = beyond(side * S[ahead], least)
    S[MEMORY + 1], by_behind, behind_by_least = beyond(-side * S[behind], least)
    S[MEMORY + 2] = SHARE * math.log1p(S[PATH])
    if sensitive:
        for q in range(dy.size):
            D[PATH, q] += way * (dy[q] - D[Y_TURN, q])
            D[Y_TURN, q], D[H_TURN, q] = dy[q], D[FORCE, q]
            D[MEMORY, q] = by_ahead * side * D[ahead, q]
            D[MEMORY + 1, q] = -by_behind * side * D[behind, q]
            D[MEMORY + 2, q] = SHARE / (1.0 + S[PATH]) * D[PATH, q]
        D[MEMORY, of_least] += ahead_by_least * least
        D[MEMORY + 1, of_least] += behind_by_least * least
    S[SIDE], S[Y_TURN], S[H_TURN] = side, y, S[FORCE]
    if memories == LESS + 1 or memories == MORE + 1:
        S[MEMORY + memories - 1] = side
    if memories >= MORE:
        inside, weak = abs(y) < KEPT, abs(S[H_TURN]) < KEPT
        S[MEMORY + 3] = side * (y if inside else math.copysign(KEPT, y))
        S[MEMORY + 4] = side * (S[H_TURN] if weak else math.copysign(KEPT, S[H_TURN]))
        S[MEMORY + 5] = SHARE * math.copysign(math.log1p(abs(S[ENERGY])), S[ENERGY])
        if sensitive:
            for q in range(dy.size):
                D[MEMORY + 3, q] = side * dy[q] if inside else 0.0
                D[MEMORY + 4, q] = side * D[H_TURN, q] if weak else 0.0
                D[MEMORY + 5, q] = SHARE / (1.0 + abs(S[ENERGY])) * D[ENERGY, q]
    memory = S[MEMORY : MEMORY + memories]
    raw_k = ramp_sum(theta, first_k, ramps_k, memory, memories) / SPREAD_K
    raw_R = ramp_sum(theta, first_R, ramps_k, memory, memories) / SPREAD_R
    S[STIFF] = math.exp(log_k0 + SPREAD_K * math.tanh(raw_k))
    S[SHARP] = SHARPNESS * math.exp(SPREAD_R * math.tanh(raw_R))
    for row in range(STIFF, SHARP + 1 if sensitive else STIFF):
        begin, raw = (first_k, raw_k) if row == STIFF else (first_R, raw_R)
        slope = S[row] * (1.0 - math.tanh(raw) ** 2)
        total = D[row]
        for q in range(total.size):
            total[q] = 0.0
        for i in range(memories):
            by_m[i] = 0.0
        add_slopes(theta, begin, ramps_k, memory, memories, slope, total, by_m)
        for i in range(memories):
            for q in range(total.size):
                total[q] += by_m[i] * D[MEMORY + i, q]


@inlined
def element_force(theta, last, y, speed, h, fast, dy, dspeed, dh, dr, sensitive):
    """Spring, damper and the force h that grows with the rate; fills dr (P,)."""
    growth, bent = math.exp(theta[last - 1]), math.sqrt(theta[last - 2] ** 2 + LEAST_DAMPER**2)
    spring, damper = theta[last - 3], 0.5 * (theta[last - 2] + bent)
    factor = 1.0 + (growth - 1.0) * (1.0 - fast)
    inside = spring > 0.0 or abs(y) < FARTHEST  # a spring below zero pushes no further
    stretched = y if inside else math.copysign(FARTHEST, y)
    if sensitive:
        by_y = spring if inside else 0.0
        v0 = math.exp(theta[last])
        by_fast = -(growth - 1.0) * h * fast / v0
        by_speed = damper - by_fast * (1.0 if speed > 0.0 else -1.0)
        for q in range(dr.size):
            dr[q] = factor * dh[q] + by_y * dy[q] + by_speed * dspeed[q]
        dr[last - 3] += stretched
        dr[last - 2] += 0.5 * (1.0 + theta[last - 2] / bent) * speed
        dr[last - 1] += growth * (1.0 - fast) * h
        dr[last] += by_fast * abs(speed)
    return spring * stretched + damper * speed + factor * h


@compiled
def imposed(theta, sizes, y, rate, turns, place, log_k0, r, jacobian):
    """Forces of a motion in steps, and their derivatives where jacobian (T, P) is not empty.

    y, rate, turns, place (N,): of `with_turning_points`; r (T,) is filled at the places. sizes:
    inputs of E and of k, ramps of E and of k and R.
    """
    inputs, memories, _, _ = sizes
    P, sensitive = theta.size, jacobian.size > 0
    x, x_turn, by_x, by_m = np.zeros(inputs), np.zeros(inputs), np.zeros(inputs), np.zeros(memories)
    S, D = np.zeros(STATES), np.zeros((STATES, P))
    none, dh, dr = np.zeros(P), np.zeros(P), np.zeros(P)
    S[Y_TURN], S[HIGHEST], S[LOWEST] = y[0], max(y[0], 0.0), min(y[0], 0.0)
    for n in range(y.size):
        h, fast = 0.0, 1.0
        if S[SIDE] != 0.0:
            h, fast = follow(
                theta, 0, sizes, y[n], rate[n], none, none, S, D, dh, x, x_turn, by_x, sensitive
            )
        go_on(y[n], y[max(n - 1, 0)], h, none, none, dh, S, D, sensitive)
        if place[n] >= 0:
            r[place[n]] = element_force(
                theta, P - 1, y[n], rate[n], h, fast, none, none, dh, dr, sensitive
            )
            for q in range(P if sensitive else 0):
                jacobian[place[n], q] = dr[q]
        if turns[n] != 0:
            turn(theta, 0, sizes, log_k0, float(turns[n]), y[n], none, S, D, by_m, sensitive)
