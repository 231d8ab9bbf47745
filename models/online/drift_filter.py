"""Drifts of all storeys, sample by sample: as likely laws run beside the fit, and data weigh them.

    x ≈ x₀ + Σ c_i (x_i − x₀) + δ,   δ' = A δ + B δm + G w,   s = [δ, w, δm, c]

x₀ is the free run of the fit, and x_i are those of laws about it, a deviation off by directions of
their covariance (`directions`): whole structures, each with a memory of its own, simulated corner
by corner. c ~ N(0, I) is what is not known of the laws. (Were they draws, c would be N(0, I/N);
where data determine a good part of the N weights, these suit them by chance.) w is noise in the
measured motion of a base, δ what it does to x, ẋ and z of the fit, and δm to what its laws
remember, which changes at corners alone. All are small, so that s is linear, and Kalman's (1960)
filter gives it.

Corrections are in s alone. A filter that moves the states of a law, as the unscented one does,
makes it turn where it did not: of a law that remembers where it turned, the next force is wrong.
Displacements and drifts that are measured have zeros of their own, which stand before δm in s: of
them nothing is known before the first sample.
N likely laws, n DOFs, S accelerometers, k others, E storeys, L = 2n + elements.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data.parallel import in_threads
from data.simulation.integrator import Progress, at_rest
from data.simulation.laws.dispatch import entries
from data.simulation.laws.element import MEMORY
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from models.online.drift_filter_compiled import (
    advance,
    learn,
    linearise,
    move,
    pass_corners,
    spread,
)
from models.uncertainty.laplace import NORMAL

TOLERANCE = 1e-4  # of the simulation; its error is still a tenth of that, far below any noise
WINDOW, RARE = 1.0, 1.0 / 3600.0  # [s] of innovations; share of such windows, one in an hour


class DriftFilter:
    """What is known of the drifts, and the watch over it.

    structures: the fit, then the laws that are as likely; of the same elements. storeys: numbers of
    the elements (E,) whose drifts are wanted; sensors: those of the DOFs with an accelerometer;
    others (k, n): what other sensors have of the displacements of all DOFs. noise (S + k,) of these
    [m/s²], [m], and ground, of a base's motion [m/s²], which moves all DOFs.
    variance: of c, one over the number of these laws where they are draws. lost: innovations of
    another structure are so many times as large as rare ones; the fit runs
    alone from there on.
    """

    keeps = False  # how s goes from a sample to the next, which a smoother asks for

    def __init__(
        self,
        structures: Sequence[Structure],
        storeys: Sequence[int],
        sensors: Sequence[int],
        noise: np.ndarray,
        ground: float,
        dt: float,
        lost: float,
        others: np.ndarray | None = None,
        variance: float | None = None,
    ) -> None:
        from scipy.stats import chi2  # slow to import

        fit, N = structures[0], len(structures)
        self.others = np.zeros((0, fit.dofs)) if others is None else others
        k = len(self.others)
        n, m, E = fit.dofs, fit.supports, len(fit.elements)
        self.fit, self.dt, self.sensors, self.lost = fit, dt, np.array(sensors, dtype=int), lost
        self.storeys = list(storeys)
        self.zeroed = np.zeros(k, dtype=bool)  # of the others: whose zero was found
        self.model = (fit.masses, fit.ends, entries(fit.law))
        self.masses = np.array([one.masses for one in structures])
        own = (at_rest(n, m, one.parameters, dt, TOLERANCE) for one in structures)
        self.states = Progress(*(np.array(parts) for parts in zip(*own, strict=True)))
        self.before: tuple[np.ndarray, ...] | None = None  # forces, supports, their velocities
        self.a = np.zeros((N, n))
        self.largest, L = np.zeros((3, E)), 2 * n + E
        self.A, self.G = np.zeros((L, L)), np.repeat([0.0, 1.0, 0.0], [n, n, E])
        self.B, self.place = np.zeros((L, k)), np.full((E, MEMORY), -1)
        self.s = np.zeros(L + k + N)  # δ, w, zeros, δm and c
        spread = 1.0 / (N - 1) if variance is None else variance
        self.C = np.diag(np.concatenate([np.zeros(L + 1 + k), np.full(N - 1, spread)]))
        self.errors = np.zeros((len(self.s), 0))  # what may be those of s (D, M)
        self.variances, self.ground = noise**2, ground**2
        self.heavier = self._heavier(self.masses)
        self.powers, self.guessed = np.zeros(2), 0  # of the ground, samples; guessed ones on end
        self.ends = fit.ends[self.storeys]
        B, _ = fit.incidence()
        self.of_drifts = np.zeros((len(self.ends), self.s.size))
        self.of_drifts[:, :n] = B[self.storeys]
        self.misses = deque[float](maxlen=max(1, round(WINDOW / dt)))  # of samples: eᵀ S⁻¹ e
        self.counts = deque[int](maxlen=self.misses.maxlen)  # of samples: innovations
        most = len(noise) * (self.misses.maxlen or 1)
        self.rare = np.append(math.inf, chi2.isf(RARE, np.arange(1, most + 1)))  # by their number
        self.ratio, self.is_rare, self.diverged = 1.0, False, False
        self.own = np.zeros(len(self.ends))  # drifts of the fit alone
        self.peaks = np.zeros((3, len(self.ends)))  # drift, half, and that of the fit alone
        self.drifts = np.zeros((2, len(self.ends)))  # and halves of their 95 % intervals [m]

    def predict(
        self, force: np.ndarray, s: np.ndarray, s_dot: np.ndarray, guessed: bool = False
    ) -> np.ndarray:
        """Accelerations (S,) at the next sample under forces (n,) [N] and motions of supports.

        guessed: these were not measured, and are as wrong as the ground's motion is large.
        """
        now, L = (force, s, s_dot), len(self.A)
        self.guessed = self.guessed + 1 if guessed else 0
        if not guessed:
            self.powers += (force[0] / self.fit.masses[0]) ** 2, 1.0
        apart = 2.0 * self.powers[0] / max(self.powers[1], 1.0)  # of two values of its motion
        ground = max(self.ground, apart) if guessed else self.ground
        rows = [now] if self.before is None else [self.before, now]
        driving, *moved = (np.array(part) for part in zip(*rows, strict=True))
        forces = driving * self.heavier[:, None]
        began = self.before is not None
        q, branch, memory = self.states.q, self.states.branch, self.states.memory
        branch_before, memory_before, p = branch[0].copy(), memory[0].copy(), self.states.p[0]
        _, *alike = self.model
        advance(self.masses, *alike, forces, *moved, self.dt, TOLERANCE, self.a, self.states)
        self._remember((memory[0] != 0.0) & (self.place < 0))
        self.before, A, B = now, self.A.copy(), self.B.copy()
        linearise(
            self.model, p, branch[0], memory[0], q[0], self.fit.supports,
            self.largest, self.place, self.A, self.B,
        )  # fmt: skip
        M = self.errors.shape[1]
        fresh = math.sqrt(ground) * self._deviates(M)
        if began:
            unit = np.eye(len(self.s), len(self.s) * self.keeps)
            X, noise = np.column_stack([self.s, self.errors, unit]), np.zeros(1 + M + unit.shape[1])
            noise[1 : M + 1] = fresh
            move(A, self.A, B, self.B, self.G, self.dt, ground, noise, X, self.C)
            pass_corners(
                self.model, p, branch_before, memory_before, branch[0],
                q[0], self.fit.supports, self.largest, self.place, X, self.C,
            )  # fmt: skip
            self.s, self.errors, self.moved = X[:, 0].copy(), X[:, 1 : M + 1], X[:, M + 1 :]
        else:
            self.C[L, L], self.errors[L] = ground, fresh
        others = self.a[1:] - self.a[0]
        n, seen = self.fit.dofs, self.sensors
        own = self.A[n : 2 * n][seen]
        lost = ~np.isfinite(others).all(axis=1)  # a law that escaped says nothing any more
        others[lost] = 0.0
        moved = q[1:, :n] - q[0, :n]
        moved[lost] = 0.0
        k, K = len(self.others), self.B.shape[1]
        of_others = np.hstack([
            self.others, np.zeros((k, L - n + 1)), np.eye(k, K), self.others @ moved.T
        ])  # fmt: skip
        of_floors = [own, np.zeros((len(seen), 1)), self.B[n : 2 * n][seen], others[:, seen].T]
        self.H = np.vstack([np.hstack(of_floors), of_others])
        positions = q[:, self.ends[:, 1]] - q[:, self.ends[:, 0]]
        self.own = positions[0].copy()
        self.of_drifts[:, L + 1 + self.B.shape[1] :] = np.where(
            lost[:, None], 0.0, positions[1:] - self.own
        ).T
        S, x = len(seen), q[0, :n]
        self.free = np.concatenate([self.a[0, seen], self.others @ x])
        self.sizes = np.repeat([np.abs(self.a[0]).max(), np.abs(x).max()], [S, k])
        return self.free[:S] + (0.0 if self.diverged else self.H[:S] @ self.s)

    def _heavier(self, masses: np.ndarray) -> np.ndarray:
        """Forces on masses (…, n) over those on the fit's, which are in proportion at a base."""
        return masses / self.fit.masses if self.ground > 0.0 else np.ones_like(masses)

    def _deviates(self, *shape: int) -> np.ndarray:
        """Normal deviates for the errors, of which a filter follows none."""
        return np.zeros(shape)

    def _remember(self, new: np.ndarray) -> None:
        """Make room for numbers (E, MEMORY) that a law of the fit begins to remember."""
        if not new.any():
            return
        (L, K), more = self.B.shape, np.count_nonzero(new)
        self.place[new] = K + np.arange(more)
        at = np.full(more, L + 1 + K)
        self.B = np.hstack([self.B, np.zeros((L, more))])
        self.s = np.insert(self.s, at, 0.0)
        self.C, self.errors = (np.insert(u, at, 0.0, axis=0) for u in (self.C, self.errors))
        self.C, self.of_drifts = (np.insert(u, at, 0.0, axis=1) for u in (self.C, self.of_drifts))

    def correct(self, a: np.ndarray | None, others: np.ndarray | None = None) -> None:
        """Take over the accelerations (S,) of the sample that was predicted; None: of no use.

        others (k,) [m]: of the same sample, NaN where there is none.
        """
        if not (a is None or self.diverged):
            lacking = np.full(len(self.others), math.nan)
            self._learn(np.concatenate([a, lacking if others is None else others]))
        if self.guessed >= (self.misses.maxlen or 1):
            self.diverged = True  # nothing tells how the ground moved since
        self.drifts = self._drifts()
        values = np.vstack([self.drifts, self.own])
        larger = np.abs(values) > np.abs(self.peaks)
        larger[1] = larger[0]
        self.peaks = np.where(larger, values, self.peaks)
        if self.diverged:
            self.peaks[0], self.peaks[1] = self.peaks[2], math.nan

    def _learn(self, measured: np.ndarray) -> None:
        variances, left = self.variances + (TOLERANCE * self.sizes) ** 2, measured - self.free
        known, S = np.isfinite(left), len(self.sensors)
        new = np.flatnonzero(known[S:] & ~self.zeroed).tolist()
        known[[S + j for j in new]] = False
        missed = self._update(self.H[known], variances[known], left[known])
        for j in new:
            self._find_zero(j, left[S + j], variances[S + j])
        self.misses.append(missed)
        self.counts.append(int(np.count_nonzero(known)))
        misses, freedom = sum(self.misses), sum(self.counts)
        rare = float(self.rare[freedom])
        self.ratio = misses / max(freedom, 1)
        self.is_rare = misses > rare
        self.diverged = not (freedom == 0 or misses <= self.lost**2 * rare)

    def _update(self, H: np.ndarray, variances: np.ndarray, left: np.ndarray) -> float:
        return float(learn(H, variances, left, self.s, self.C))

    def _find_zero(self, j: int, left: float, variance: float) -> None:
        """Let the first sample of another sensor tell its zero, of which nothing was known."""
        at, h = len(self.A) + 1 + j, self.H[len(self.sensors) + j].copy()
        h[at] = 0.0
        g = self.C @ h
        self.s[at], self.zeroed[j] = left - h @ self.s, True
        self.C[at] = self.C[:, at] = -g
        self.C[at, at] = h @ g + variance

    @property
    def c(self) -> np.ndarray:
        """Of the likely laws (N,)."""
        return self.s[-len(self.masses) + 1 :]

    def _drifts(self) -> np.ndarray:
        """Drifts and halves (2, E); of the fit alone there are no halves."""
        if self.diverged:
            return np.stack([self.own, np.full(len(self.own), math.nan)])
        variance = np.empty_like(self.own)
        spread(self.of_drifts, self.C, variance)
        half = NORMAL * np.sqrt(max(1.0, self.ratio) * variance.clip(0.0))
        return np.stack([self.own + self.of_drifts @ self.s, half])


# Drifts of all storeys by all samples of a record: the filter forwards, its adjoint backwards.
#
#     ŝ = s − C λ,   Ĉ = C − C Λ C,   e = s⁺ − ŝ⁺ = e_f + C λ⁺
#
# λ, Λ gather what later samples say (modified Bryson–Frazier smoother; Bierman 1973). No covariance
# is inverted, many of which are singular: at rest, of memories, of zeros. e: what may be the error
# of ŝ, from that of the filter, e_f, by drawn noise s⁺ (Durbin & Koopman 2002).
#
# s is linear, and a structure is not: little noise of the ground may decide whether a storey turns,
# and the drifts after that are others. So the structure runs on grounds that are drawn with e, and
# what these runs have beside the linear drifts widens the intervals.    D numbers in s, M draws

Adjoint = tuple[np.ndarray, np.ndarray]  # λ, λ⁺ (D, 1 + M) and Λ (D, D)
DRAWS = 32  # of motions, or of weights: their spread is then known to an eighth of itself


class DriftSmoother(DriftFilter):
    """A filter that remembers its steps, so that the drifts of a whole record can be smoothed."""

    keeps = True

    def __init__(self, *settings: Any) -> None:
        super().__init__(*settings)
        self.back: list[Callable[[np.ndarray, np.ndarray], Adjoint]] = []
        self.missed = self.freedom = 0.0
        self.rows: list[np.ndarray] = []  # drifts and variances, the last sample first
        self.grounds: list[np.ndarray] = []  # w as it may have been (M,) [m/s²]
        self.answers: list[np.ndarray] = []  # linear drifts (E, M) under it
        self.driven: list[tuple[np.ndarray, ...]] = []  # forces, supports, their velocities
        self.rng = np.random.default_rng(0)
        own = np.sqrt(self.C.diagonal())[:, None]
        self.errors = own * self._deviates(len(own), DRAWS)

    def _deviates(self, *shape: int) -> np.ndarray:
        return self.rng.standard_normal(shape)

    def predict(self, *drive: Any) -> np.ndarray:
        self.moved = np.eye(len(self.s))
        predicted = super().predict(*drive)
        self.driven.append(drive[:3])
        self._go_on(self.moved)
        return predicted

    def _go_on(self, F: np.ndarray) -> None:
        """Remember a step to F s (D, D), most of whose rows are those of the unit matrix."""
        rows = np.flatnonzero((np.eye(len(F)) != F).any(axis=1))
        own = F[rows]

        def before(u: np.ndarray, U: np.ndarray) -> Adjoint:
            kept, half = u.copy(), U.copy()
            kept[rows] = half[rows] = 0.0
            half += own.T @ U[rows]
            whole = half.copy()
            whole[:, rows] = 0.0
            return kept + own.T @ u[rows], whole + half[:, rows] @ own

        self.back.append(before)

    def _remember(self, new: np.ndarray) -> None:
        before = len(self.s)
        super()._remember(new)
        if len(self.s) > before:
            end = len(self.A) + 1 + self.B.shape[1]
            kept = np.delete(np.arange(len(self.s)), slice(end - len(self.s) + before, end))
            self.back.append(lambda u, U: (u[kept], U[np.ix_(kept, kept)]))

    def _update(self, H: np.ndarray, variances: np.ndarray, left: np.ndarray) -> float:
        CH, M = self.C @ H.T, self.errors.shape[1]
        V = np.linalg.pinv(H @ CH + np.diag(variances))
        K, noise = CH @ V, np.sqrt(variances)[:, None] * self._deviates(len(left), M)
        innovation = np.column_stack([left - H @ self.s, H @ self.errors + noise])
        self.errors = self.errors - K @ innovation[:, 1:]

        def before(u: np.ndarray, U: np.ndarray) -> Adjoint:
            A = np.eye(len(u)) - K @ H
            return A.T @ u - H.T @ V @ innovation, A.T @ U @ A + H.T @ V @ H

        self.back.append(before)
        missed = super()._update(H, variances, left)
        self.missed, self.freedom = self.missed + missed, self.freedom + len(left)
        return missed

    def _find_zero(self, j: int, left: float, variance: float) -> None:
        super()._find_zero(j, left, variance)
        at, T = len(self.A) + 1 + j, np.eye(len(self.s))
        T[at] = -self.H[len(self.sensors) + j]
        T[at, at] = 0.0
        self.errors = T @ self.errors
        self.errors[at] -= math.sqrt(variance) * self._deviates(self.errors.shape[1])
        self._go_on(T)

    def correct(self, a: np.ndarray | None, others: np.ndarray | None = None) -> None:
        super().correct(a, others)
        PC, at, laws = self.of_drifts @ self.C, len(self.A), len(self.s) - len(self.c)
        drifts, variance = self.own + self.of_drifts @ self.s, (PC * self.of_drifts).sum(axis=1)
        rows = np.vstack([np.eye(1, len(self.s), at), self.of_drifts])  # of w, and of drifts
        rows[:, laws:] = 0.0
        w, C, errors = self.s[at], rows @ self.C, rows @ self.errors

        def read(u: np.ndarray, U: np.ndarray) -> Adjoint:
            own, drawn = drifts - PC @ u[:, 0], errors + C @ u[:, 1:]
            self.rows.append(np.stack([own, variance - ((PC @ U) * PC).sum(axis=1)]))
            self.grounds.append(w - C[0] @ u[:, 0] + drawn[0])
            self.answers.append(own[:, None] + drawn[1:])
            return u, U

        self.back.append(read)

    def smoothed(self) -> np.ndarray:
        """Drifts and halves of their 95 % intervals (2, T, E) [m], both of the linear s."""
        self.rows, self.grounds, self.answers, D = [], [], [], len(self.s)
        state = np.zeros((D, 1 + self.errors.shape[1])), np.zeros((D, D))
        for step in reversed(self.back):
            state = step(*state)
        drifts, variances = np.array(self.rows[::-1]).transpose(1, 0, 2)
        return np.stack([drifts, NORMAL * np.sqrt(self.wide * variances.clip(0.0))])

    @property
    def wide(self) -> float:
        """By how much variances grow where innovations are larger than expected."""
        return max(1.0, self.missed / max(self.freedom, 1.0))

    def nonlinearity(self, structure: Structure) -> np.ndarray:
        """Mean square (T, E) [m²] of what its runs have beside the linear s of a smoothed record.

        structure: of the laws that all samples ask for. It runs on grounds as they may have been.
        """
        force, s, s_dot = (np.array(part) for part in zip(*self.driven, strict=True))
        base, heavier = (s, s_dot) if s.shape[1] else (None, None), self._heavier(structure.masses)

        def run(w: np.ndarray) -> np.ndarray:
            driving = force * heavier + w[:, None] * structure.masses
            motion = simulate(structure, driving, self.dt, base[0], base[1], TOLERANCE)
            lost = motion.escape_time is not None
            return motion.y[:, self.storeys] + (math.inf if lost else 0.0)

        runs = in_threads(run, list(np.array(self.grounds[::-1]).T))
        linear = np.array(self.answers[::-1]).transpose(2, 0, 1)
        return np.asarray(np.square(runs - linear).mean(axis=0))
