"""Poles of a linear system from spectra of its inputs and outputs: vector fitting.

σ(z) Y(z) = N(z) U(z) + τ(z),  all with the poles of σ, whose zeros are the next poles
Gustavsen & Semlyen (1999), relaxed (Gustavsen 2006), solved output by output (Deschrijver 2008).
τ is what a record's first and last state leave in its discrete Fourier transform: exact for any
record, so no window is needed (Pintelon, Schoukens & Vandersteen 1997). Periods have none, but what
is not linear in them disturbs the poles less where τ may take it up.
F frequencies, n poles, m inputs, o outputs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
        lines = lines[:: -(-len(lines) // MOST_LINES)]
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
    gain = np.concatenate(
        [
            (np.abs(one.Y) ** 2).sum(axis=1) / (np.abs(one.U) ** 2).sum(axis=1).clip(1e-300)
            for one in lines
        ]
    )
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
