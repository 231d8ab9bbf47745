"""The linear start of a modal network: poles from spectra, all else by least squares in time.

T samples, J modes, m inputs, o outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.modal.excitation import Excited
from models.modal.layout import Layout
from models.modal.problem import Motion, State
from models.modal.run import blocks, outputs, steady_state

RIDGE = 1e-12, 1e-5  # of the squares of columns; of several inputs, such as s and its rate
RELOCATIONS = (6, 20)  # of poles; the better
MOST_MOTIONS = 6  # whose spectra give the poles, those with most samples


def by_spectra(motions: Sequence[Motion], modes: int) -> tuple[Layout, State] | None:
    """Layout without elements, parameters and first states; None where the lines show fewer.

    The motions' outputs are those of a linear system of so many modes, or what another model
    leaves of outputs.
    """
    lines = [
        Lines.of(motion.of(motion.excited.u), motion.y * motion.weight)
        for motion in sorted(motions, key=lambda motion: -len(motion.y))[:MOST_MOTIONS]
    ]
    lines = [one for one in lines if len(one.z) > 1]  # without an input there are none
    rows, m = 2 * sum(len(one.z) for one in lines), motions[0].excited.u.shape[1]
    if rows < (2 * modes + 1) * (m + 1 + len(lines)):
        return None
    found = []
    with np.errstate(all="ignore"):
        for iterations in RELOCATIONS:
            poles = relocated(lines, first_poles(lines, modes), iterations)
            k, c = oscillators(poles, motions[0].excited.dt)
            layout, state = _by_least_squares(motions, k, c)
            found.append((held_back_error(layout, state, motions), layout, state))
    return min(found, key=lambda one: one[0])[1:]


def held_back_error(layout: Layout, state: State, motions: Sequence[Motion]) -> float:
    """RMS of the weighted error after `stop`, of all of it where nothing is held back."""
    squares, count = 0.0, 0
    for motion, begin in zip(motions, state.begins, strict=True):
        with np.errstate(all="ignore"):
            out, _ = outputs(layout, state.values, motion.excited, begin)
        first = motion.stop if motion.stop < len(motion.y) else 0
        e = (motion.weight * (motion.of(out) - motion.y))[first:]
        squares, count = squares + float((e * e).sum()), count + e.size
    return float(np.sqrt(squares / count)) if np.isfinite(squares) else float("inf")


def settle(layout: Layout, state: State, motions: Sequence[Motion]) -> State:
    """The state with the periods among the motions begun in their steady state."""
    state = state.copy()
    for number, motion in enumerate(motions):
        if motion.periodic:
            with np.errstate(all="ignore"):
                begin = steady_state(layout, state.values, motion.excited, motion.first)
            state.begins[number] = begin if np.isfinite(begin).all() else 0.0
    return state


def _modal(k: np.ndarray, c: np.ndarray, excited: Excited, begin: float) -> np.ndarray:
    """q and q̇ (T, 2J) of modes under the one input of `excited`, from q = `begin`."""
    J = len(k)
    layout = Layout(J, 0, 1, 1, 0, 0)
    parts = {name: np.zeros(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": np.log(k), "log_c": np.log(c), "gamma": np.ones((J, 1))}
    first = np.r_[np.full(J, begin), np.zeros(J)]
    return outputs(layout, layout.join(parts), excited, first)[1]


def _columns(motion: Motion, k: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(stop, m·2J + m + 1 + 2J): modes forced by each input, inputs, 1, free decays."""
    whole, m = motion.excited, motion.excited.u.shape[1]
    each = [(whole.u[:, [i]], np.ascontiguousarray(whole.fine[..., [i]])) for i in range(m)]
    forced = [_modal(k, c, Excited(u, fine, whole.dt), 0.0) for u, fine in each]
    still = Excited(0.0 * whole.u[:, :1], 0.0 * whole.fine[..., :1], whole.dt)
    one = np.ones((len(whole.u), 1))
    decays = _modal(k, c, still, 1.0) if motion.unknown else np.zeros((len(one), 2 * len(k)))
    whole_run = np.concatenate([*forced, whole.u, one, decays], axis=1)
    return motion.of(whole_run)[: motion.stop]


def _by_least_squares(
    motions: Sequence[Motion], k: np.ndarray, c: np.ndarray
) -> tuple[Layout, State]:
    """All linear parameters except k and c, from the outputs up to `stop`."""
    J, m, o = len(k), motions[0].excited.u.shape[1], motions[0].y.shape[1]
    shared, own = 2 * J * m + m + 1, 2 * J
    width = shared + own * len(motions)
    gram, right = np.zeros((o, width, width)), np.zeros((o, width))
    squares, samples = np.zeros(shared), 0
    for number, motion in enumerate(motions):
        A = _columns(motion, k, c)
        place = np.r_[:shared, shared + own * number : shared + own * (number + 1)]
        square, side = A.T @ A, A.T @ motion.y[: motion.stop]
        for output in range(o):
            gram[output][np.ix_(place, place)] += motion.weight[output] ** 2 * square
            right[output, place] += motion.weight[output] ** 2 * side[:, output]
        squares, samples = squares + square.diagonal()[:shared], samples + motion.stop
    ridge, pairs = RIDGE[m > 1], list(zip(gram, right, strict=True))  # of each output
    solved = np.stack([_solve(matrix, side, ridge) for matrix, side in pairs])
    size = np.sqrt(squares / samples)
    rms = size[: 2 * J * m].reshape(m, 2, J).clip(1e-12)
    R = solved[:, : 2 * J * m].reshape(o, m, 2, J)
    layout = Layout(J, 0, m, o)
    parts = {name: np.zeros(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": np.log(k), "log_c": np.log(c)}
    for j in range(J):  # the direction of the inputs that moves a mode most
        scale = rms[:, :, j].max(axis=0)  # of q and q̇
        V = np.linalg.svd((R[..., j] * scale).transpose(0, 2, 1).reshape(2 * o, m))[2]
        parts["gamma"][j] = V[0] / np.sqrt(((V[0] * rms[:, 0, j]) ** 2).sum())
    together = _together(parts["gamma"], width)
    joint = [(together.T @ matrix @ together, side @ together) for matrix, side in pairs]
    solved = np.stack([_solve(matrix, side, ridge) for matrix, side in joint])
    parts["Cq"], parts["Cv"], parts["Du"] = np.split(solved[:, : 2 * J + m], [J, 2 * J], axis=1)
    parts["o0"] = solved[:, 2 * J + m]
    values = layout.join(parts)
    begins = np.stack([first_state(layout, values, motion) for motion in motions])
    return layout, State(values, begins)


def _together(gamma: np.ndarray, width: int) -> np.ndarray:
    """From 2J columns of modes, forced by all inputs as Γ says, to those of each input alone."""
    J, m = gamma.shape
    by_mode = np.zeros((width, 2 * J + width - 2 * J * m))
    for n in range(m):
        for part in range(2):
            place = np.arange(J) + part * J
            by_mode[2 * J * n + place, place] = gamma[:, n]
    rest = np.arange(2 * J * m, width)
    by_mode[rest, rest - 2 * J * (m - 1)] = 1.0
    return by_mode


def _solve(gram: np.ndarray, right: np.ndarray, ridge: float) -> np.ndarray:
    """Least squares from normal equations, every column in units of its size."""
    size = np.sqrt(gram.diagonal())
    seen = size > 1e-12 * size.max()
    scale = np.where(seen, size, 1.0)
    scaled = gram / scale / scale[:, None] + ridge * np.eye(len(gram))
    scaled[~seen, :] = scaled[:, ~seen] = 0.0
    scaled[~seen, ~seen] = 1.0
    x: np.ndarray = np.linalg.lstsq(scaled, np.where(seen, right / scale, 0.0), rcond=1e-13)[0]
    return np.where(seen, x / scale, 0.0)


def first_state(
    layout: Layout, values: np.ndarray, motion: Motion, deviation: np.ndarray | None = None
) -> np.ndarray:
    """The first state (S,) with which the run follows the samples before `stop` best.

    deviation (S,): of first states, in units of which Σ s² is kept small beside the squares of
    w (o − y); None: nothing is known of them. At rest where the motion says so.
    """
    state = np.zeros(layout.states)
    if motion.periodic:
        return steady_state(layout, values, motion.excited, motion.first)
    if not motion.unknown:
        return state
    pull = np.zeros(layout.states) if deviation is None else 1.0 / np.maximum(deviation, 1e-12)
    best, damping = np.inf, 1e-9
    kept = state
    for _ in range(8):  # the run is all but linear in its first state
        matrix, vector, pulled, at = np.diag(pull**2), pull**2 * state, pull * state, 0
        loss = float(pulled @ pulled)
        runs = blocks(layout, values, motion.excited, state, None, True, motion.stop)
        for out, _, jacobian in runs:
            e = motion.weight * (out - motion.y[at : at + len(out)])
            rows = (motion.weight[:, None] * jacobian).reshape(e.size, -1)
            matrix += rows.T @ rows
            vector += rows.T @ e.ravel()
            loss, at = loss + float((e * e).sum()), at + len(out)
        if not np.isfinite(loss) or loss > best * (1.0 + 1e-9):
            break
        gain, best, kept = 1.0 - loss / best if np.isfinite(best) else 1.0, loss, state
        if gain < 1e-6:
            break
        size = np.sqrt(matrix.diagonal().clip(1e-30))
        scaled = matrix / size / size[:, None] + damping * np.eye(len(size))
        state = state - np.linalg.lstsq(scaled, vector / size, rcond=None)[0] / size
    return kept


# Poles of a linear system from spectra of its inputs and outputs: vector fitting.
#
# σ(z) Y(z) = N(z) U(z) + τ(z),  all with the poles of σ, whose zeros are the next poles
# Gustavsen & Semlyen (1999), relaxed (Gustavsen 2006), output by output (Deschrijver 2008).
# τ is what a record's first and last state leave in its discrete Fourier transform: exact for any
# record, so no window is needed (Pintelon, Schoukens & Vandersteen 1997). Periods have none, but
# what is not linear in them disturbs the poles less where τ may take it up.
# F frequencies, n poles, m inputs, o outputs.

MOST_LINES = 1500  # of a record
POWER = 3e-5  # of the largest power of the inputs: lines with less are left out
SHARPEST = 0.25  # half the width of a resonance, in distances of lines
NEAR = 0.02  # share of critical damping of the first poles


@dataclass(frozen=True)
class Lines:
    """Discrete Fourier transforms of one motion: z (F,), U (F, m), Y (F, o)."""

    z: np.ndarray
    U: np.ndarray
    Y: np.ndarray

    @staticmethod
    def of(u: np.ndarray, y: np.ndarray) -> Lines:
        """Lines of signals (T, ·) at which the inputs have power; the constant parts left out."""
        T = len(u)
        U, Y = (np.fft.rfft(s - s.mean(axis=0), axis=0) / np.sqrt(T) for s in (u, y))
        power = (np.abs(U) ** 2).sum(axis=1)
        lines = np.flatnonzero(power[1:] > POWER * power.max()) + 1
        lines = lines[:: max(1, -(-len(lines) // MOST_LINES))]
        return Lines(np.exp(2j * np.pi * lines / T), U[lines], Y[lines])


def relocated(lines: list[Lines], poles: np.ndarray, iterations: int) -> np.ndarray:
    """Poles (n,) in the z plane near those given, stable, in pairs or real."""
    # a sharper resonance could be as high as it likes between two lines
    most = np.exp(-SHARPEST * min(float(np.diff(np.angle(one.z)).min()) for one in lines))
    for _ in range(iterations):
        poles = _step(lines, poles)
        poles = np.where(np.abs(poles) > most, poles / np.abs(poles) * most, poles)
    return poles


def first_poles(lines: list[Lines], modes: int) -> np.ndarray:
    """Lightly damped pairs where the outputs have most power, spread over it evenly."""
    angle = np.concatenate([np.angle(one.z) for one in lines])
    powers = [[(np.abs(s) ** 2).sum(axis=1) for s in (one.Y, one.U)] for one in lines]
    gain = np.concatenate([of_y / of_u.clip(1e-300) for of_y, of_u in powers])
    order = np.argsort(angle)
    share = np.cumsum(np.sqrt(gain[order]))
    at = np.interp((np.arange(modes) + 0.5) / modes * share[-1], share, angle[order])
    spread = np.linspace(angle.min(), angle.max(), modes + 2)[1:-1]
    at = np.where(np.arange(modes) % 2 == 0, at, spread)
    s = np.sort(at) * (-NEAR + 1j)
    return np.exp(np.concatenate([s, s.conj()]))


def _basis(z: np.ndarray, poles: np.ndarray) -> np.ndarray:
    """Real combinations (F, n) of 1/(z − p): of pairs the sum and i times the difference."""
    columns, done = [], np.zeros(len(poles), dtype=bool)
    for i, p in enumerate(poles):
        if done[i]:
            continue
        if abs(p.imag) < 1e-12:
            columns.append(1.0 / (z - p.real))
            continue
        done[[i, _partner(poles, i, done)]] = True
        one, two = 1.0 / (z - p), 1.0 / (z - p.conj())
        columns += [one + two, 1j * (one - two)]
    return np.stack(columns, axis=1)


def _partner(poles: np.ndarray, i: int, done: np.ndarray) -> int:
    """Which pole is the conjugate of the i-th, of those not yet done."""
    others = done | (np.arange(len(poles)) == i)
    return int(np.argmin(np.abs(poles - poles[i].conj()) + 1e9 * others))


def _step(lines: list[Lines], poles: np.ndarray) -> np.ndarray:
    n, o = len(poles), lines[0].Y.shape[1]
    bases = [_basis(one.z, poles) for one in lines]
    rows, right = [], []
    for c in range(o):
        size = np.sqrt(sum(float((np.abs(one.Y[:, c]) ** 2).sum()) for one in lines))
        parts = []
        for number, (one, phi) in enumerate(zip(lines, bases, strict=True)):
            whole = np.column_stack([phi, np.ones(len(phi))])
            driven = [whole * u[:, None] for u in one.U.T]
            left = [whole if number == other else 0.0 * whole for other in range(len(lines))]
            relaxed = -whole * one.Y[:, c : c + 1]
            parts.append(np.concatenate([*driven, *left, relaxed], axis=1) / max(size, 1e-300))
        A = np.concatenate(parts)
        A = np.concatenate([A.real, A.imag])
        R: np.ndarray = np.linalg.qr(A)[1]
        rows.append(R[-(n + 1) :, -(n + 1) :])
        right.append(np.zeros(n + 1))
    # Σ Re σ = number of lines keeps σ from vanishing
    level = sum(np.concatenate([phi, np.ones((len(phi), 1))], axis=1).real.sum(0) for phi in bases)
    count = sum(len(phi) for phi in bases)
    weight = 1.0 / count
    A = np.concatenate([*rows, weight * level[None]])
    b = np.concatenate([*right, [weight * count]])
    scale = np.linalg.norm(A, axis=0).clip(1e-300)
    x = np.linalg.lstsq(A / scale, b, rcond=1e-13)[0] / scale
    residues, d = x[:n], x[n]
    if abs(d) < 1e-8:
        d = np.copysign(1e-8, d)
    return _zeros(poles, residues / d)


def _zeros(poles: np.ndarray, residues: np.ndarray) -> np.ndarray:
    """Zeros of 1 + Σ residues · basis, mirrored into the unit circle."""
    n = len(poles)
    A, b, done, at = np.zeros((n, n)), np.zeros(n), np.zeros(n, dtype=bool), 0
    for i, p in enumerate(poles):
        if done[i]:
            continue
        if abs(p.imag) < 1e-12:
            A[at, at], b[at] = p.real, 1.0
            at += 1
            continue
        done[[i, _partner(poles, i, done)]] = True
        A[at, at] = A[at + 1, at + 1] = p.real
        A[at, at + 1], A[at + 1, at] = p.imag, -p.imag
        b[at] = 2.0
        at += 2
    zeros = np.linalg.eigvals(A - b[:, None] * residues)
    outside = np.abs(zeros) > 1.0
    zeros[outside] = 1.0 / zeros[outside].conj()
    return zeros


def oscillators(poles: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """k (J,) and c (J,) of the pairs of poles, real ones paired; rising frequencies."""
    s = np.log(np.where(np.abs(poles) > 1e-6, poles, 1e-6).astype(complex)) / dt
    complex_ones = s[s.imag > 1e-9 / dt]
    # a real pole at or below zero belongs to nothing that is continuous: its frequency is kept
    real = np.sort(-np.minimum(s[np.abs(s.imag) <= 1e-9 / dt].real, -1e-6 / dt))
    negative = np.abs(complex_ones.imag) > 0.999 * np.pi / dt
    extra = np.abs(complex_ones[negative])
    complex_ones = complex_ones[~negative]
    singles = np.sort(np.concatenate([real, extra]))
    singles = singles[: len(singles) // 2 * 2]
    one, two = singles[0::2], singles[1::2]
    k = np.concatenate([np.abs(complex_ones) ** 2, one * two])
    c = np.concatenate([-2.0 * complex_ones.real, one + two])
    c = np.maximum(c, 1e-4 * np.sqrt(k))
    order = np.argsort(k)
    return k[order], c[order]
