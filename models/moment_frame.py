"""Moment frame: floors on columns and beams of steel, whose joints turn; the base is shaken.

M ẍ + α M v + F = M u,   F from members whose ends yield (models/moment_frame_compiled.py)

Only floors are measured. Yielding wanders between the joints: no law between two floors follows
it, while columns and beams with joints as hidden unknowns do. Their numbers are fitted to forces
that balance the measured motion, then to its free run; no solver is needed.
Choose it for frames of steel: columns and beams yield at their ends, all joints of a floor turn
alike, columns are clamped at the base, beams carry no load between them. From accelerations alone
a fit may end away from the frame: `free_run_error` says so.   n floors, T samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.parallel import in_threads
from data.record import Drive, Record, Response
from models.composition.states import integrated_states
from models.estimator import Estimator
from models.fit.minimise import minimise
from models.fit.progress import announce
from models.layers.integrate import between
from models.moment_frame_compiled import free, imposed


class MomentFrame(Estimator):
    """Motion (…, T, n) of floors against a shaken base; every estimate is a free run from rest.

    masses: of the floors, from the lowest to the roof [kg]. heights: of the storeys, in any unit;
    None: alike. substeps: of a sample. The records' one channel of excitation is the acceleration
    that it gives all masses, minus that of the base; displacements and velocities that they lack
    are integrated.
    Raises ValueError for other channels, and for a free run that does not begin at rest.
    """

    reads = ("f",)
    on_processor = True

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        masses: Sequence[float] | None = None,
        heights: Sequence[float] | None = None,
        substeps: int = 2,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        if inputs != 1:
            raise ValueError(
                f"inputs={inputs}: a moment frame is shaken at its base, by one channel; choose "
                "model=element_network for forces on its floors"
            )
        heights = [1.0] * dofs if heights is None else heights
        for name, values in (("masses", masses), ("heights", heights)):
            if values is None or len(values) != dofs or not all(value > 0.0 for value in values):
                raise ValueError(
                    f"model.{name}={values}: expected {dofs} positive numbers, from the lowest "
                    "floor to the roof; model=element_network needs none"
                )
        if substeps < 1:
            raise ValueError(f"model.substeps={substeps}: expected at least 1")
        assert masses is not None
        self.known = Known(np.array(masses, float), np.array(heights, float) / heights[0])
        self.substeps = substeps
        empty = torch.full((number_of(dofs),), torch.nan, dtype=torch.float64)
        self.numbers = nn.Parameter(empty, requires_grad=False)  # see models/moment_frame.py

    def identify(self, batches: Iterable[Record]) -> dict[str, Any]:
        """Fit all numbers; returns relative errors of the accelerations.

        balance_error: of those that the frame's forces give under the measured motion;
        free_run_error: of the free run.
        """
        motions = [motion for record in batches for motion in self._motions(record.to("cpu"))]
        numbers, balance, free_run = fit_numbers(self.known, motions)
        self.numbers.data.copy_(torch.from_numpy(numbers))
        return {"balance_error": balance, "free_run_error": free_run}

    def forward(self, record: Record) -> Tensor:
        """Accelerations (…, T, n) of the free run of a record or a batch."""
        return self.run_of(record).a

    def free_run(self, drive: Drive) -> Response:
        """The motion from rest; infinite from where it is lost."""
        self.require_identified(self.numbers)
        if bool(drive.x0.any()) or bool(drive.v0.any()):
            raise ValueError(
                "MomentFrame simulates from rest, and this record begins in motion; count its "
                "first samples as warm-up (data.initial_state=rest, data.warmup)"
            )
        frame = members(self.numbers.cpu().numpy(), self.known.mass, self.known.rho)
        none = torch.zeros(*drive.u.shape[:-1], self.dofs, dtype=torch.float64)
        motions = self._of(none, none, none, drive.u.cpu(), drive.hold, drive.dt)
        runs = np.stack([run_frame(frame, self.known, motion) for motion in motions], axis=1)
        x, v, a = torch.from_numpy(runs).reshape(3, *none.shape).to(drive.u.device)
        return Response(x, v, a)

    def _motions(self, record: Record) -> list[Motion]:
        """Those of a batch; displacements and velocities that it lacks are integrated."""
        x, v = record.x, record.v
        if x is None or v is None:
            states = [(x, v) for x, v, _, _ in integrated_states(record, 1)]
            x, v = (torch.stack(s).reshape(record.a.shape) for s in zip(*states, strict=True))
        return self._of(x, v, record.a, record.excitation, record.hold, record.dt)

    def _of(self, x: Tensor, v: Tensor, a: Tensor, u: Tensor, hold: str, dt: float) -> list[Motion]:
        """Motions of x, v, a (…, T, n) under the excitation u (…, T, 1)."""
        T = u.shape[-2]
        ends = between(u.reshape(-1, T, 1), hold, self.substeps)[..., 0].contiguous()
        signals = [s.reshape(-1, T, self.dofs).contiguous() for s in (x, v, a)]
        signals += [u.reshape(-1, T).contiguous(), ends]
        parts = zip(*(s.numpy() for s in signals), strict=True)
        return [Motion(x, v, a, u, ends, dt) for x, v, a, u, ends in parts]


# The fit of a moment frame to forces that balance a measured motion, then to its free run.
#
# M ẍ + α M v + F(x, v) = M u.   At first the motion is imposed on the floors and joints turn as
# they have to, so that no error of one sample is in the next. Displacements that were integrated
# from noise lead that astray; so free runs choose between its end and starts of a grid.
# Derivatives are differences, a run for each number.   T samples, S steps of a sample, n floors,
# P numbers.

PRIOR = 1e-5  # weight of Σ θ² relative to the squared relative error of the accelerations
FIRST = 2  # motions that are balanced at first
SETTINGS = {
    **{"damping": 1e-3, "decrease": 0.2, "increase": 5.0, "largest": 1e4, "scaled": True},
    **{"change": 2e-3, "patience": 2, "gradient": 0.0, "longest": 1.0},
}
ITERATIONS = (15, 25, 25)  # to balance these, to balance all, and of the free run
STIFFER, STRONGER = (0.6, 1.0, 1.6, 2.5), (0.5, 1.0, 2.0)  # times those of the start: the grid
FOLLOWED, FOLLOWING = 2, 15  # beginnings of the free run, iterations of each on some motions
NEAR = 2.0  # times the least error: what is farther off is not followed
DIFFERENCE = 1e-4  # of θ


@dataclass(frozen=True)
class Motion:
    """x, v, a against the base (T, n), and the accelerations that excitation gives masses.

    u: these (T,); ends: at the end of each step (T − 1, S).
    """

    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    ends: np.ndarray
    dt: float


@dataclass(frozen=True)
class Known:
    """What is given of a frame: masses (n,), heights over that of the first storey (n,)."""

    mass: np.ndarray
    rho: np.ndarray


def fit_numbers(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, float, float]:
    """Numbers (P,) of the frame, relative errors where forces balance and in free run."""
    begin = start(known.mass, *_storeys(known, motions))
    theta = _solved(Balance(known, motions[:FIRST], begin, np.zeros_like(begin)), ITERATIONS[0])
    balance = Balance(known, motions, begin, theta)
    theta = _solved(balance, ITERATIONS[1])
    free_run = FreeRun(known, motions, begin, _best(known, motions, begin, theta))
    theta_free = _solved(free_run, ITERATIONS[2])
    return moved(begin, theta_free), balance.error(theta), free_run.error(theta_free)


def _best(
    known: Known, motions: Sequence[Motion], begin: np.ndarray, theta: np.ndarray
) -> np.ndarray:
    """θ from which the free run is fitted: that of the balance, or what a start of a grid leads to.

    Where a motion is known the balance is nearer than the grid by far, and alone is followed. The
    motions that push least are followed first: they tell stiffness before strength matters.
    """
    quiet = sorted(motions, key=lambda m: float(m.u @ m.u))[:FIRST]
    judge = FreeRun(known, quiet, begin, theta)
    grid = [scaled(begin, *np.log(both)) for both in product(STIFFER, STRONGER)]
    judged = sorted(((judge.error(at), at) for at in (theta, *grid)), key=lambda both: both[0])
    near = [at for error, at in judged[:FOLLOWED] if error <= NEAR * judged[0][0]]
    if len(near) == 1:
        return near[0]
    ends = [_solved(FreeRun(known, quiet, begin, at), FOLLOWING) for at in near]
    return min(ends, key=FreeRun(known, motions, begin, theta).error)


def _solved(problem: Balance, iterations: int) -> np.ndarray:
    """θ where Levenberg–Marquardt ends."""
    announce(f"a moment frame, {problem.doing}")
    minimise(problem, SETTINGS, iterations=iterations)
    found: np.ndarray = problem.theta.detach().numpy().copy()
    return found


def run_frame(frame: Members, known: Known, motion: Motion) -> np.ndarray:
    """x, v, a (3, T, n) of a frame under the excitation of a motion, from rest."""
    found = np.zeros((3, len(motion.u), len(known.mass)))
    free(
        frame.laws, frame.sag, known.rho, known.mass, frame.alpha, frame.beta, motion.u[0],
        motion.ends, motion.dt / motion.ends.shape[1], *found,
    )  # fmt: skip
    return found


def _storeys(known: Known, motions: Sequence[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Drifts and shears (N, n) of all motions."""
    pushed = [known.mass * (m.u[:, None] - m.a) for m in motions]
    shear = np.concatenate([np.cumsum(f[:, ::-1], axis=1)[:, ::-1] for f in pushed])
    return np.concatenate([np.diff(m.x, axis=1, prepend=0.0) for m in motions]), shear


class Balance:
    """Relative errors of the accelerations that the frame's forces give under a motion."""

    doing = "fitted to forces that balance its motion"
    steepest = float("inf")
    own: Sequence[Tensor] = ()

    def __init__(
        self, known: Known, motions: Sequence[Motion], begin: np.ndarray, theta: np.ndarray
    ) -> None:
        self.known, self.motions, self.begin = known, motions, begin
        self.theta = nn.Parameter(torch.from_numpy(theta.copy()))
        self.free = [self.theta]
        absolute = np.concatenate([m.a - m.u[:, None] for m in motions])
        self.y = torch.from_numpy(absolute.ravel())
        self.weight = float(np.sqrt(absolute.size)) / float(np.linalg.norm(absolute))

    def errors(self, theta: np.ndarray) -> np.ndarray:
        """Weighted so that their mean square is that relative to the accelerations, (N n,)."""
        frame = members(moved(self.begin, theta), self.known.mass, self.known.rho)
        return (
            self.weight * np.concatenate([self._residual(frame, m) for m in self.motions]).ravel()
        )

    def _residual(self, frame: Members, m: Motion) -> np.ndarray:
        force = np.empty_like(m.x)
        imposed(frame.laws, frame.sag, self.known.rho, frame.beta, m.x, m.v, m.dt, force)
        return m.u[:, None] - frame.alpha * m.v - force / self.known.mass - m.a

    def error(self, theta: np.ndarray) -> float:
        """Infinite where a run is lost."""
        return float(np.sqrt(np.mean(self.errors(theta) ** 2)))

    def loss(self) -> Tensor:
        theta = self.theta.detach().numpy()
        return torch.tensor(np.mean(self.errors(theta) ** 2) + PRIOR * float(theta @ theta))

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (P, P) and Jᵀe (P,), with the pull towards the start."""
        theta = self.theta.detach().numpy()
        ways = theta + DIFFERENCE * np.eye(len(theta))
        errors, *others = in_threads(self.errors, [theta, *ways])
        J = (np.stack(others, axis=1) - errors[:, None]) / DIFFERENCE
        pull = PRIOR * len(errors)
        matrix, vector = J.T @ J + pull * np.eye(len(theta)), J.T @ errors + pull * theta
        return torch.from_numpy(matrix), torch.from_numpy(vector)


class FreeRun(Balance):
    """Relative errors of the accelerations in free run."""

    doing = "fitted to its free run"

    def _residual(self, frame: Members, m: Motion) -> np.ndarray:
        left: np.ndarray = run_frame(frame, self.known, m)[2] - m.a
        return left


# The numbers of a moment frame: what is fitted, and the members that follow from it.
#
# θ holds logarithms, and logits of shares, beside those of the start, so that it is 0 there:
#     α, β, γ;   of all columns, then of all beams: k_hinge/k, b, R₀, c₁;
#     of every floor: k of its columns, their yield moment, k of its beams, their yield moment
# Weight takes g_i = γ Σ m / ρ_i of the stiffness of a storey, γ = 9.81 m/s² over a storey's
# height.
# n floors, P = 11 + 4 n.

SHARED = 11
SHARES = (4, 6, 8, 10)  # b and c₁, between 0 and 1
KIND = (12.0, 0.03, 6.0, 0.8)  # of a member at the start: k_hinge/k, b, R₀, c₁
DAMPERS = (0.02, 0.01, 0.02)  # α/ω, β ω and γ/ω² at the start, ω of the first mode
TURNING = 2.5  # times the stiffness that columns between joints that do not turn would need
YIELDS = 0.4  # of the largest shear of a storey, per member


@dataclass(frozen=True)
class Members:
    """All that a run is given: see run_compiled.py."""

    laws: np.ndarray  # (n, 2, 6)
    sag: np.ndarray  # g (n,)
    alpha: float
    beta: float


def number_of(floors: int) -> int:
    return SHARED + 4 * floors


def start(mass: np.ndarray, drift: np.ndarray, shear: np.ndarray) -> np.ndarray:
    """Numbers (P,) for the drifts and shears (N, n) of storeys.

    Raises ValueError for a storey that never drifts, or that pushes the way it goes.
    """
    square = (drift**2).sum(axis=0)
    if not (square > 0.0).all() or not ((shear * drift).sum(axis=0) > 0.0).all():
        raise ValueError(
            "a storey does not drift, or not against its shear; give displacements, velocities and "
            "accelerations against the base, from the lowest floor to the roof"
        )
    secant, largest = (shear * drift).sum(axis=0) / square, np.abs(shear).max(axis=0)
    B = np.eye(len(mass)) - np.eye(len(mass), k=-1)
    rate = np.sqrt(np.linalg.eigvals(B.T * secant @ B / mass[:, None]).real.min())
    dampers = (DAMPERS[0] * rate, DAMPERS[1] / rate, DAMPERS[2] * rate**2)
    member = (TURNING / 6.0 * secant, YIELDS * largest)
    return np.concatenate([dampers, KIND, KIND, *member, *member])


def moved(start: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Numbers (P,) at θ."""
    found: np.ndarray = start * np.exp(theta)
    for i in SHARES:
        odds = start[i] / (1.0 - start[i]) * np.exp(theta[i])
        found[i] = odds / (1.0 + odds)
    return found


def scaled(start: np.ndarray, stiffer: float, stronger: float) -> np.ndarray:
    """θ (P,) of a frame whose members are all so much stiffer and stronger, in logarithms."""
    theta = np.zeros_like(start)
    theta[SHARED:].reshape(2, 2, -1)[:] = np.array([stiffer, stronger])[:, None]
    return theta


def members(numbers: np.ndarray, mass: np.ndarray, rho: np.ndarray) -> Members:
    alpha, beta, gamma = numbers[:3]
    kinds, (k_column, m_column, k_beam, m_beam) = (
        numbers[3:SHARED].reshape(2, 4),
        numbers[SHARED:].reshape(4, -1),
    )
    laws = np.empty((len(mass), 2, 6))
    for j, (k, moment) in enumerate(((k_column, m_column), (k_beam, m_beam))):
        stiff, *shape = kinds[j]
        laws[:, j, 0], laws[:, j, 1], laws[:, j, 2] = k, moment / (stiff * k), stiff * k
        laws[:, j, 3:] = shape
    above = np.cumsum(mass[::-1])[::-1]
    return Members(laws, gamma * above / rho, float(alpha), float(beta))
