"""Equivalent linear system as a bar to clear: identified from any record, stable, in free run.

ẍ = −M⁻¹C ẋ − M⁻¹K x + Γ u,   of an element test   r = k s + c ṡ

Unlike `EquivalentLinear` it needs no measured x and v, and its free run cannot diverge.
B records, T samples, n DOFs, m excitations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import ClassVar

import torch
from torch import Tensor, nn

from data.record import Drive, Record, Response, singles
from models.estimator import Estimator, Parameter, weight_matrix
from models.fit.metrics import free_run_score
from models.fit.minimise import minimise
from models.fit.problem import MOST_DERIVATIVES, in_steady_state
from models.layers.integrate import between
from models.layers.least_squares import LeastSquares
from models.layers.reconstructed import corner_frequency, filtered_states
from models.linear import EquivalentLinear

CORNERS = (0.3, 1.0, 3.0, 10.0)  # times the usual corner of the filters; the best of them is kept
QUANTITIES = ("acceleration", "velocity", "displacement", "force")  # of motions: integrals of ẍ
SUBSTEPS = 4  # of a sample interval, where the excitation is band-limited
RIDGE = 1e-12  # against silent channels
LEAST_DAMPING = 1e-3  # share of critical that a mode has, or an unstable one is given


class LinearMotion(Estimator):
    """Every estimate is a free run. The motion sets the excitation's effect: no mass is needed.

    Of some ways of filtering the signals, that one is kept whose free run of the records that it is
    identified from is best; poles that would grow are made to decay. From there the weights are
    fitted by the free run itself.
    """

    reads: ClassVar[tuple[str, ...]] = ("f",)

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__(dofs, inputs, dt)
        self.register_buffer("measures", torch.tensor(0))  # number in QUANTITIES
        self.system = EquivalentLinear(dofs, inputs, dt)
        self.weights = weight_matrix(inputs, dofs)  # of an element test

    measures: Tensor

    @property
    def quantity(self) -> str:
        """What it estimates."""
        return QUANTITIES[int(self.measures)]

    @property
    def is_static(self) -> bool:
        """Whether it estimates the force of an element test, which is no motion."""
        return self.quantity == "force"

    @property
    def identified_parameters(self) -> int:
        return (self.weights if self.is_static else self.system.weights).numel()

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        records = [record.measured() for record in batches]
        self.measures.fill_(QUANTITIES.index(records[0].quantity))
        if self.is_static:
            self.system.weights.data.zero_()
            return self._static(records)
        self.weights.data.zero_()
        best: tuple[float, Tensor | None] = (float("inf"), None)
        for corner in (*([None] if all(map(self._states_known, records)) else []), *CORNERS):
            self.system.weights.data = self._dynamic(records, corner)
            error = free_run_score(self, records).get("relative_rms_percent")
            if error is not None and error < best[0]:
                best = error, self.system.weights.data
        if best[1] is None:
            raise ValueError("no linear system follows the motion; look for outliers in the record")
        self.system.weights.data = fitted_by_free_run(best[1], records, run_of_weights, self._seen)
        return {}

    def _static(self, records: list[Record]) -> dict[str, float]:
        fit = LeastSquares(RIDGE)
        for record in records:
            fit.add(record.counted(record.excitation), record.counted(record.a))
        self.weights.data = fit.solve().weights
        return {}

    def _dynamic(self, records: list[Record], corner: float | None) -> Tensor:
        """Weights (2n + m, n) of [ẋ, x, u] that make a stable system."""
        fit = LeastSquares(RIDGE)
        for record in singles(records):
            x, v, a, u = (s[record.warmup :] for s in self._signals(record, corner))
            fit.add(torch.cat([v, x, u], dim=-1), a)
        return stable(fit.solve().weights, self.dofs)

    def _signals(self, record: Record, corner: float | None) -> tuple[Tensor, ...]:
        """x, v, a, u (T, ·) of a record, filtered alike.

        corner: times the usual one of the filters; None: as measured.
        """
        if corner is None:
            assert record.x is not None
            assert record.v is not None
            return record.x, record.v, record.a, record.excitation
        cut, order = corner * corner_frequency(record.a, record.dt), 2 - int(self.measures)
        return filtered_states(record.a, record.excitation, cut, record.dt, order)

    def _states_known(self, record: Record) -> bool:
        known = record.x is not None and record.v is not None
        return self.quantity == "acceleration" and known

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor] | None:
        return self.system.small_motion()

    def _physical_parameters(self) -> Iterable[Parameter]:
        return self.system.physical_parameters()

    def forward(self, record: Record) -> Tensor:
        return self.free_run(record.drive()).a

    def free_run(self, drive: Drive) -> Response:
        if self.is_static:
            self.require_identified(self.weights)
            r = drive.u @ self.weights
            return Response(torch.zeros_like(r), torch.zeros_like(r), r)
        self.require_identified(self.system.weights)
        run = motion_of(self.system, drive)
        return Response(run.x, run.v, self._seen(run))

    def _seen(self, run: Response) -> Tensor:
        return (run.a, run.v, run.x)[int(self.measures)]


def motion_of(system: EquivalentLinear, drive: Drive) -> Response:
    """The system's free run; a band-limited excitation is linear between finer samples."""
    if drive.hold != "band_limited":
        return system.free_run(drive)
    finer = EquivalentLinear(system.dofs, system.inputs, system.dt / SUBSTEPS)
    finer.weights = system.weights
    u = torch.cat([drive.u[..., :1, :], between(drive.u, drive.hold, SUBSTEPS).flatten(-3, -2)], -2)
    run = finer.free_run(replace(drive, dt=finer.dt, u=u, hold="linear"))
    x, v = run.x[..., ::SUBSTEPS, :], run.v[..., ::SUBSTEPS, :]
    return Response(x, v, system.acceleration(x, v, drive.u))


def run_of_weights(weights: Tensor, drive: Drive) -> Response:
    """The free run of a system with weights (2n + m, n)."""
    n = weights.shape[1]
    system = EquivalentLinear(n, len(weights) - 2 * n, drive.dt)
    system.weights.data = weights
    return motion_of(system, drive)


def stable(weights: Tensor, dofs: int) -> Tensor:
    """Weights (2n + m, n) of [ẋ, x, u] with poles that grow, and only those, made to decay.

    A pole with a positive real part is given its mirror image, or a little damping.
    """
    n = dofs
    poles, vectors = poles_of(weights, n)
    least = LEAST_DAMPING * poles.abs()
    if bool((poles.real <= 0.0).all()):
        return weights
    decaying = torch.where(
        poles.real > 0.0, torch.complex(-torch.maximum(poles.real, least), poles.imag), poles
    )
    shapes = vectors[:n]
    both = torch.cat([shapes, shapes * decaying])
    rows = torch.linalg.solve(both.T, (shapes * decaying**2).T).T.real  # [−M⁻¹K, −M⁻¹C]
    return torch.cat([rows[:, n:].T, rows[:, :n].T, weights[2 * n :]])


# A linear system fitted by its free run, from weights that another fit found.
#
# ẍ = Wᵀ φ,  φ = [ẋ, x, u];   ∂ẍ/∂W_ij is the motion of the same system under φ_i at DOF j alone
#                                   Ljung (1999), System Identification, Sect. 7.2 (output error)
# B records, T samples, n DOFs, p = 2n + m weights of a DOF.

SETTINGS = {
    **{"iterations": 30, "change": 1e-3, "patience": 3},
    **{"damping": 1e-3, "gradient": 0.0, "scaled": True},
}

Run = Callable[[Tensor, Drive], Response]  # weights (2n + m, n), and what drives the system
Seen = Callable[[Response], Tensor]  # of a motion, what was measured (…, T, n)


def fitted_by_free_run(weights: Tensor, records: Sequence[Record], run: Run, seen: Seen) -> Tensor:
    """Weights (p, n) with a smaller error of the free run of all records; those given, if none.

    They are given back as they are where derivatives would not fit into memory, too.
    """
    most = max(record.a.numel() for record in records)
    if weights.numel() * most > MOST_DERIVATIVES:
        return weights
    whole = [in_steady_state(r) if r.initial_state == "periodic" else r for r in records]
    problem = OutputError(weights, whole, run, seen)
    if not math.isfinite(float(problem.loss())):
        return weights
    minimise(problem, SETTINGS)
    return problem.weights()


class OutputError:
    """Squared relative error of the free run by the weights, in units of what each multiplies."""

    steepest = float("inf")
    own: Sequence[Tensor] = ()

    @torch.no_grad()
    def __init__(self, weights: Tensor, records: Sequence[Record], run: Run, seen: Seen) -> None:
        self.records, self.run, self.seen = records, run, seen
        self.y = torch.cat([r.counted(r.a).reshape(-1) for r in records])
        self.weight = self.y.numel() ** 0.5 / float(self.y.norm())
        squares = [self._driving(r, run(weights, r.drive())).square().mean(0) for r in records]
        size = torch.stack(squares).mean(dim=0).sqrt()
        self.size = torch.where(size > 0.0, size, 1.0)[:, None]  # (p, 1)
        self.theta = nn.Parameter(weights * self.size, requires_grad=False)
        self.free = [self.theta]

    def weights(self) -> Tensor:
        return self.theta.data / self.size

    def loss(self) -> Tensor:
        """Mean square of e; infinite where the system has a pole that grows."""
        if not decays(self.weights(), self.theta.shape[1]):
            return self.y.new_tensor(math.inf)
        errors = [self._errors(r, self.run(self.weights(), r.drive())) for r in self.records]
        return torch.cat(errors).square().mean()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        """JᵀJ (pn, pn) and Jᵀe (pn,)."""
        count = self.theta.numel()
        matrix, vector = self.y.new_zeros(count, count), self.y.new_zeros(count)
        for record in self.records:
            motion = self.run(self.weights(), record.drive())
            J, e = self._derivatives(record, motion), self._errors(record, motion)
            matrix, vector = matrix + J @ J.T, vector + J @ e
        return matrix, vector

    def _errors(self, record: Record, motion: Response) -> Tensor:
        return self.weight * record.counted(self.seen(motion) - record.a).reshape(-1)

    def _driving(self, record: Record, motion: Response) -> Tensor:
        """φ (B T, p) of a motion."""
        return torch.cat([motion.v, motion.x, record.excitation], dim=-1).flatten(0, -2)

    def _derivatives(self, record: Record, motion: Response) -> Tensor:
        """J (pn, N): motions under φ_i, which is linear between samples, at each DOF alone."""
        p, n = self.theta.shape
        phi = self._driving(record, motion) / self.size[:, 0]
        phi = phi.T.reshape(p, *record.a.shape[:-1])  # (p, …, T)
        forces = phi[:, None, ..., None] * torch.eye(n).to(phi).reshape(
            1, n, *[1] * (phi.ndim - 1), n
        )
        system = torch.cat([self.weights()[: 2 * n], torch.eye(n).to(phi)])
        rest = forces.new_zeros(*forces.shape[:-2], n)
        answer = self.seen(self.run(system, Drive(record.dt, forces, rest, rest)))
        return self.weight * record.counted(answer).reshape(p * n, -1)


def decays(weights: Tensor, dofs: int) -> bool:
    """Whether no pole of a system with weights (2n + m, n) grows."""
    return bool((poles_of(weights, dofs)[0].real <= 0.0).all())


def poles_of(weights: Tensor, dofs: int) -> tuple[Tensor, Tensor]:
    """Poles (2n,) [rad/s] of ẍ = Wᵀ[ẋ, x, u], and their shapes (2n, 2n) of [x, ẋ]."""
    A = weights.new_zeros(2 * dofs, 2 * dofs)
    A[:dofs, dofs:] = torch.eye(dofs, dtype=A.dtype)
    A[dofs:, :dofs], A[dofs:, dofs:] = weights[dofs : 2 * dofs].T, weights[:dofs].T
    poles, shapes = torch.linalg.eig(A)
    return poles, shapes
