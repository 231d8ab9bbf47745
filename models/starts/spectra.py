"""A linear structure from the spectra of its motion: positive masses, springs and dampers.

(−ω² M + iω C + K) X = F,   K = Bᵀ k B,   C = Bᵀ c B        k, c, M > 0: logarithms are searched,
but for springs that may be of either sign.
A typical structure is moved through the frequencies of the motion; the best places are polished by
damped least squares on the error of the output, which noise does not bias as it does the equation.
F frequencies, n DOFs, E elements, m channels of excitation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from data.record import Record, singles

SHARE = 0.998  # of the power of the outputs lies in the band that is compared
MOST_NUMBERS, FEWEST, MOST = 400_000, 200, 2000  # of matrices, of frequencies in each record
TAPER = 0.1  # of a record that is faded, where it is cut
FADED = 5.0  # a free motion fades by exp(−FADED) until its end: less than 1 % of it is cut off
GRID, POLISHED, EVALUATIONS = 60, 5, 40  # places tried, of them polished, evaluations for each
STIFFEST, ASIDE = 3.0, 0.05  # of the frequencies; stiffness beside a chain of 1
RATIO = 0.05  # of critical damping of the first mode, to begin with
PULL_MASS, PULL = 3e-3, 1e-3  # weight of (log of a ratio)² relative to the squared relative error
TINY = np.finfo(float).tiny


@dataclass(frozen=True)
class Layout:
    """What is known of a structure: incidences, where forces act, and its masses, if at all."""

    B: np.ndarray  # (E, n)
    B_s: np.ndarray  # (E, p)
    forced: list[int]  # DOFs with a force
    base: bool = False  # whether the motion is that relative to a shaking base
    masses: np.ndarray | None = None  # (n,) [kg], NaN where one is unknown
    either: np.ndarray | None = None  # (E,): springs that may be of either sign
    seen: list[int] | None = None  # DOFs with a sensor; None: all

    def shapes(self) -> list[np.ndarray]:
        """Relative stiffnesses (E,) to begin with: all alike, and mostly a chain if it is there."""
        alike, chain = np.ones(len(self.B)), self.chain()
        return [alike] if chain.all() or chain.sum() < self.B.shape[1] else [alike, chain + ASIDE]

    def chain(self) -> np.ndarray:
        """Which elements (E,) join a DOF to the one before, or the first to what is fixed."""
        n = self.B.shape[1]
        chain = np.eye(n) - np.eye(n, k=-1)
        return np.array([(np.abs(row) == np.abs(chain)).all(axis=1).any() for row in self.B])

    @property
    def open_scale(self) -> bool:
        """No force and no mass says how heavy it is: the first mass is 1."""
        return self.masses is None and not self.forced

    @property
    def open_masses(self) -> np.ndarray:
        """Which masses (n,) are unknown."""
        return np.ones(self.B.shape[1], bool) if self.masses is None else np.isnan(self.masses)


@dataclass(frozen=True)
class LinearStructure:
    """Masses (n,) [kg], stiffnesses (E,) [N/m] and dampers (E,) [N s/m] of elements."""

    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    def times(self, factor: float) -> LinearStructure:
        return LinearStructure(*(factor * part for part in vars(self).values()))

    def frequencies(self, B: np.ndarray) -> np.ndarray:
        """Squares of the natural frequencies (n,) [1/s²], rising; negative where it is unstable."""
        root = 1.0 / np.sqrt(self.mass)
        matrix = root[:, None] * (B.T @ (self.stiffness[:, None] * B)) * root
        return np.linalg.eigvalsh(0.5 * (matrix + matrix.T))


@dataclass(frozen=True)
class Spectra:
    """Fourier transforms of motions: ω (F,), outputs (F, n), excitation (F, m).

    measured: 0 for displacements, 1 for velocities, 2 for accelerations.
    """

    omega: np.ndarray
    outputs: np.ndarray
    inputs: np.ndarray
    measured: int = 2
    size: float = 0.0  # norm of the outputs
    motion: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  # (F,): number of each
    fading: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (F,) [1/s], where free

    @staticmethod
    def of(records: Iterable[Record], measured: int = 2) -> Spectra:
        """Spectra of records where their outputs have power; their constant parts are left out."""
        parts, fading = [], []
        for one in singles(records):
            a, u = one.a.cpu().numpy(), one.excitation.cpu().numpy()  # of no channel, where free
            parts.append(_of_one(a, u, one.dt, one.initial_state != "rest"))
            fading.append(FADED / (one.dt * len(a)))
        omega, a, u = (np.concatenate(s) for s in zip(*parts, strict=True))
        motion = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        size = float(np.linalg.norm(a))
        return Spectra(omega, a, u, measured, size, motion, np.array(fading)[motion])

    @property
    def dominant(self) -> float:
        """The frequency with the largest output [rad/s]."""
        return float(self.omega[np.argmax(np.linalg.norm(self.outputs, axis=1))])

    @property
    def free(self) -> bool:
        """Whether nothing drives the motions, which go on from a first state of their own."""
        return self.inputs.shape[1] == 0

    def error(self, structure: LinearStructure, layout: Layout) -> float:
        """Relative error of the structure's response; 1 where it does not move."""
        return float(np.linalg.norm(self.outputs - respond(structure, layout, self)[0]) / self.size)


def _of_one(
    a: np.ndarray, u: np.ndarray, dt: float, cut: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    T = len(a)
    if not u.shape[1]:  # faded to nil at the end, which is a transform on another line: exact
        fade = np.exp(-FADED * np.arange(T) / T)
        fade[0] *= 0.5  # by trapezia
        return _lines((a - a.mean(axis=0)) * fade[:, None], u, dt)
    ends = np.hanning(int(TAPER * T))
    fade = np.ones(T)
    fade[T - len(ends) // 2 :] = ends[(len(ends) + 1) // 2 :]
    if cut:
        fade[: len(ends) // 2] = ends[: len(ends) // 2]
    a, u = ((s - s.mean(axis=0) * (i == 0)) * fade[:, None] for i, s in enumerate((a, u)))
    return _lines(a, u, dt)


def _lines(a: np.ndarray, u: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ω and the transforms of signals (T, ·), over the lines in which a has its power."""
    T = len(a)
    omega = 2.0 * np.pi * np.fft.rfftfreq(2 * T, dt)  # padded: what goes round is not this motion
    A, U = np.fft.rfft(a, 2 * T, axis=0), np.fft.rfft(u, 2 * T, axis=0)
    power = np.cumsum((np.abs(A) ** 2).sum(axis=1))
    inside = np.flatnonzero(
        (power >= 0.5 * (1.0 - SHARE) * power[-1]) & (power <= SHARE * power[-1])
    )
    first, last = (inside[0], inside[-1]) if len(inside) else (1, len(omega) - 1)
    most = int(np.clip(MOST_NUMBERS // a.shape[1] ** 2, FEWEST, MOST))
    first = max(first, 2)
    some = np.arange(first, max(last, first + 1) + 1, max(1, (last - first) // most))
    some = some[some < len(omega)]
    return omega[some], A[some], U[some]


def respond(
    structure: LinearStructure,
    layout: Layout,
    spectra: Spectra,
    units: LinearStructure | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (F, S), and their derivatives by masses, springs, dampers in units (F, S, n + 2E).

    S: DOFs with a sensor.
    """
    if spectra.free:
        return _released(structure, layout, spectra, units)
    seen = slice(None) if layout.seen is None else layout.seen
    m, k, c = structure.mass, structure.stiffness, structure.damping
    w, U, B = spectra.omega[:, None], spectra.inputs, layout.B
    iw = 1j * w
    n, forces = B.shape[1], 1 if layout.base else len(layout.forced)
    s, s_dot = np.split(U[:, forces:], 2, axis=1)
    support, support_rate = s @ layout.B_s.T, s_dot @ layout.B_s.T  # (F, E)
    F = np.zeros((len(U), n), dtype=complex)
    if layout.base:
        F += m * U[:, :1]
    F[:, layout.forced] += U[:, : len(layout.forced)]
    K, C = (B.T * k) @ B, (B.T * c) @ B
    dynamic = K + iw[:, :, None] * C
    dynamic[:, np.arange(n), np.arange(n)] -= w**2 * m
    driving, rate = F - (k * support + c * support_rate) @ B, iw**spectra.measured
    if units is None:
        return rate * np.linalg.solve(dynamic, driving[:, :, None])[:, seen, 0], np.empty(0)
    G = np.linalg.inv(dynamic)
    X = (G @ driving[:, :, None])[:, :, 0]
    m, k, c = units.mass, units.stiffness, units.damping
    driven = m * (w**2 * X + (U[:, :1] if layout.base else 0.0))  # (F, n)
    springs, dampers = k * (X @ B.T + support), c * (iw * (X @ B.T) + support_rate)
    through = G @ B.T  # (F, n, E)
    by = [G * driven[:, None, :], -through * springs[:, None, :], -through * dampers[:, None, :]]
    return rate * X[:, seen], rate[:, :, None] * np.concatenate(by, axis=2)[:, seen]


SMALL = 1e-6  # of a number: the step of a difference


def _released(
    structure: LinearStructure,
    layout: Layout,
    spectra: Spectra,
    units: LinearStructure | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """`respond` where nothing drives: of all first states the one that suits each motion best.

    (s² M + s C + K) X = M v₀ + (s M + C) x₀ with s = fading + iω; outputs are sᵐ X less what the
    first state adds to the transform of a derivative. Linear in x₀ and v₀, which are eliminated
    (Golub & Pereyra 1973).
    """
    M, B, s = np.diag(structure.mass), layout.B, (spectra.fading + 1j * spectra.omega)
    s = s[:, None, None]
    K, C = (B.T @ (part[:, None] * B) for part in (structure.stiffness, structure.damping))
    eye, order = np.eye(len(M)), spectra.measured
    X = np.linalg.solve(s**2 * M + s * C + K, np.concatenate([s * M + C, M + 0.0 * s], axis=2))
    added = [s ** (order - 1 - i) * eye if order > i else 0.0 * s * eye for i in (0, 1)]
    effect = s**order * X - np.concatenate(added, axis=2)  # (F, S, 2n)
    effect = effect if layout.seen is None else effect[:, layout.seen]
    found = np.zeros_like(spectra.outputs)
    for number in np.unique(spectra.motion):
        own = spectra.motion == number
        rows, target = effect[own].reshape(-1, 2 * len(M)), spectra.outputs[own].ravel()
        both = [np.concatenate([part.real, part.imag]) for part in (rows, target)]
        size = np.maximum(np.linalg.norm(both[0], axis=0), TINY)
        first = np.linalg.lstsq(both[0] / size, both[1], rcond=None)[0] / size
        found[own] = effect[own] @ first
    if units is None:
        return found, np.empty(0)
    parts = [np.concatenate(list(vars(one).values())) for one in (structure, units)]
    moves = SMALL * parts[1] * np.eye(len(parts[1]))
    ends = (np.split(parts[0] + move, np.cumsum([len(M), len(B)])) for move in moves)
    moved = [_released(LinearStructure(*end), layout, spectra)[0] for end in ends]
    return found, np.stack([(end - found) / SMALL for end in moved], axis=2)


def typical(spectra: Spectra, layout: Layout, square: float, shape: np.ndarray) -> LinearStructure:
    """A structure of equal masses whose first natural frequency has this square [1/s²]."""
    mass = np.ones(layout.B.shape[1]) if layout.masses is None else layout.masses
    mass = np.where(np.isnan(mass), np.nanmean(mass), mass)
    unit = LinearStructure(mass, mass.mean() * shape, 0.0 * shape)
    lowest = unit.frequencies(layout.B)
    stiffness = unit.stiffness * square / max(lowest[0], 1e-9 * lowest[-1])
    structure = replace(
        unit, stiffness=stiffness, damping=2.0 * RATIO / np.sqrt(square) * stiffness
    )
    if layout.masses is not None or layout.open_scale:
        return structure
    run = respond(structure, layout, spectra)[0]  # as heavy as its motion says
    factor = float(np.vdot(run, spectra.outputs).real / max(np.vdot(run, run).real, TINY))
    return structure.times(1.0 / max(factor, TINY)) if factor > 0.0 else structure


def places(spectra: Spectra, layout: Layout) -> list[LinearStructure]:
    """Typical structures at the frequencies where the error is least around, the best first.

    Of each shape, all valleys of the error and the dominant frequency of the motion.
    """
    grid = np.geomspace(0.5 * spectra.omega.min(), STIFFEST * spectra.omega.max(), GRID) ** 2
    found: list[tuple[float, LinearStructure]] = []
    for shape in layout.shapes():
        tried = [typical(spectra, layout, square, shape) for square in grid]
        errors = np.array([spectra.error(structure, layout) for structure in tried])
        walls = np.concatenate([[np.inf], errors, [np.inf]])
        valleys = np.flatnonzero((errors < walls[:-2]) & (errors <= walls[2:]))
        found += [(errors[i], tried[i]) for i in valleys]
        there = typical(spectra, layout, spectra.dominant**2, shape)
        found.append((spectra.error(there, layout), there))
    found.sort(key=lambda one: one[0])
    return [structure for _, structure in found]


def polished(spectra: Spectra, layout: Layout, start: LinearStructure) -> LinearStructure:
    """The structure near `start` whose response has the least error.

    Springs that may be of either sign are positive until all has been polished once.
    """
    near = _polished(spectra, layout, start, np.zeros(len(layout.B), dtype=bool))
    return near if layout.either is None else _polished(spectra, layout, near, layout.either)


def _polished(
    spectra: Spectra, layout: Layout, start: LinearStructure, either: np.ndarray
) -> LinearStructure:
    """Masses, springs and dampers are u exp θ, the springs of `either` sign (E,) are u θ."""
    from scipy.optimize import least_squares  # slow to import

    E, n = layout.B.shape
    learned = np.ones(n + 2 * E, dtype=bool)
    learned[:n] = layout.open_masses
    if layout.open_scale:
        learned[0] = False
    if not learned.any():
        return start
    straight = np.concatenate([np.zeros(n, dtype=bool), either, np.zeros(E, dtype=bool)])
    values = np.concatenate([start.mass, start.stiffness, start.damping])
    units = np.where(straight, np.median(start.stiffness), values)
    begin = np.where(straight, values / units, 0.0)
    pull = np.sqrt(np.concatenate([np.full(n, PULL_MASS), np.full(2 * E, PULL)]))

    def at(theta: np.ndarray) -> tuple[LinearStructure, LinearStructure]:
        """The structure, and what a change of each θ is multiplied by."""
        whole = begin.copy()
        whole[learned] = theta
        grown = units * np.exp(np.clip(np.where(straight, 0.0, whole), -300, 300))
        both = np.where(straight, units * whole, grown), grown
        structure, slope = (LinearStructure(*np.split(one, [n, n + E])) for one in both)
        return structure, slope

    def away(theta: np.ndarray) -> np.ndarray:
        whole = np.zeros_like(begin)  # a change of all masses, springs and dampers costs nothing
        whole[learned] = theta - begin[learned]
        free = whole[:n] - (whole[:n].mean() if learned[:n].all() else 0.0)
        return np.asarray(pull * np.concatenate([free, whole[n:]]))

    def residuals(theta: np.ndarray) -> np.ndarray:
        e = (respond(at(theta)[0], layout, spectra)[0] - spectra.outputs).ravel()
        return np.concatenate([e.real / spectra.size, e.imag / spectra.size, away(theta)])

    def jacobian(theta: np.ndarray) -> np.ndarray:
        structure, slope = at(theta)
        slopes = respond(structure, layout, spectra, slope)[1]
        rows = slopes.reshape(-1, n + 2 * E)[:, learned] / spectra.size
        return np.concatenate([rows.real, rows.imag, moved])

    moved = np.stack([away(begin[learned] + e) for e in np.eye(learned.sum())], axis=1)
    found = least_squares(
        residuals, begin[learned], jacobian, method="trf", max_nfev=EVALUATIONS, xtol=1e-6
    )
    return at(found.x)[0]
