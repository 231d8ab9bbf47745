"""Equivalent linear system: the mass, damping and stiffness that fit the motion best.

ẍ = −M⁻¹C ẋ − M⁻¹K x + M⁻¹ f                          Brewick & Masri (2016), Eqs. 7–8
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import ClassVar

import torch
from torch import Tensor, nn

from data.annotations import NotNegative
from data.parallel import interruptible
from data.record import Drive, Record, Response
from data.sample import Sample
from models.estimator import Parameter, weight_matrix
from models.layers.integrate import History, differentiated, flat, one_by_one, runge_kutta
from models.layers.integrate_compiled import recurrence
from models.layers.least_squares import LeastSquares, require_solvable
from models.linear_in_weights import LinearInWeights


class EquivalentLinear(LinearInWeights):
    """Accelerations as a linear function of velocities, displacements and excitation.

    `ridge` ≥ 0, without unit, penalises weights of scaled columns.
    """

    reads: ClassVar[tuple[str, ...]] = ("x", "v", "f")

    def __init__(self, dofs: int, inputs: int, dt: float, ridge: NotNegative = 0.0) -> None:
        super().__init__(dofs, inputs, dt)
        self.ridge = ridge
        require_solvable(
            2 * dofs + inputs, f"{dofs} DOFs and {inputs} inputs", "take fewer channels"
        )
        self.weights = weight_matrix(2 * dofs + inputs, dofs)  # rows: ẋ, x, f

    def state(self, record: Record) -> Tensor:
        """[ẋ, x, f] (…, T, 2n + m)."""
        self.check(record)
        return state_of(record)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        fit = LeastSquares(self.ridge)
        for record in batches:
            fit.add(record.counted(self.state(record)), record.counted(record.a))
        solution = fit.solve()
        self.weights.data = solution.weights
        return solution.facts()

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.weights)
        return self.state(record) @ self.weights

    def small_motion(self) -> tuple[Tensor, Tensor, Tensor] | None:
        if type(self) is not EquivalentLinear:
            return None
        self.require_identified(self.weights)
        damping, stiffness, _ = self.matrices()
        return stiffness, damping, torch.eye(self.dofs).to(stiffness)

    def _physical_parameters(self) -> Iterable[Parameter]:
        """Entries of M⁻¹K, M⁻¹C and of what the excitation does: a fit to motion knows no more."""
        self.require_identified(self.weights)
        damping, stiffness, inputs = self.matrices()
        about = "" if type(self) is EquivalentLinear else "of the linear system beneath the rest"
        named = (("stiffness_by_mass", stiffness, "1/s²"), ("damping_by_mass", damping, "1/s"))
        for name, matrix, unit in named:
            for i, row in enumerate(matrix.tolist(), start=1):
                for j, value in enumerate(row, start=1):
                    yield Parameter(f"x{i}.{name}.x{j}", value, unit, about)
        for i, row in enumerate(inputs.tolist(), start=1):
            for j, value in enumerate(row, start=1):
                name = f"x{i}.acceleration_by_input.u{j}"
                yield Parameter(name, value, "m/s² per unit", about)

    def heads(self) -> list[nn.Parameter]:
        return [self.weights]

    def features_of(self, record: Record) -> Iterator[tuple[slice, list[Tensor]]]:
        yield slice(0, record.samples), [self.state(record)]

    def features_at(self, sample: Sample, memory: Tensor) -> list[Tensor]:
        return [state_of(sample)]

    def acceleration(self, x: Tensor, v: Tensor, u: Tensor) -> Tensor:
        """ẍ (…, n) of a state and an excitation (…, m)."""
        return torch.cat([v, x, u], dim=-1) @ self.weights

    def free_run(self, drive: Drive) -> Response:
        """The motion, exact for an excitation that is linear or constant between samples."""
        self.require_identified(self.weights)
        if drive.hold == "band_limited":
            return runge_kutta(self.acceleration, drive)
        step, first, last = self._exact_step(drive.hold)
        before, after = drive.u[..., :-1, :], drive.u[..., 1:, :]
        driven = before @ first + after @ last
        start = torch.cat([drive.x0, drive.v0], dim=-1)
        asked = differentiated(drive.u, start, self.weights)
        states = self._states(start, step, driven) if asked else _compiled(start, step, driven)
        x, v = states.chunk(2, dim=-1)
        return Response(x, v, self.acceleration(x, v, drive.u))

    def _states(self, state: Tensor, step: Tensor, driven: Tensor) -> Tensor:
        """[x ẋ] (…, T, 2n) in PyTorch: the readable reference, for derivatives."""
        states = History()
        states.add(state)
        for added in one_by_one(driven):
            state = state @ step + added
            states.add(state)
        return states.signals()[0]

    def _exact_step(self, hold: str) -> tuple[Tensor, Tensor, Tensor]:
        """S (2n, 2n), F and L (m, 2n) of [x v][k+1] = [x v][k] S + u[k] F + u[k+1] L.

        By one matrix exponential, u and its slope being further states (Van Loan 1978).
        """
        n, m, dt = self.dofs, self.inputs, self.dt
        damping, stiffness, inputs = self.matrices()
        largest = dt**2 * inputs.abs().amax(dim=-2)  # (…, m): of a unit of u, in a time step
        largest = torch.where(largest > 0.0, largest, 1.0)
        size = 2 * (n + m)  # of [x, dt v, u, Δu], the last two in units of their effect
        A = self.weights.new_zeros(*self.weights.shape[:-2], size, size)
        A[..., :n, n : 2 * n] = torch.eye(n, dtype=A.dtype, device=A.device)
        effect = dt**2 * inputs / largest[..., None, :]
        A[..., n : 2 * n, : 2 * n + m] = torch.cat(
            [-(dt**2) * stiffness, -dt * damping, effect], -1
        )
        A[..., 2 * n : 2 * n + m, 2 * n + m :] = torch.eye(m, dtype=A.dtype, device=A.device)
        units = torch.ones_like(A[..., 0])
        units[..., n : 2 * n] = dt
        units[..., 2 * n :] = torch.cat([largest, largest], dim=-1)
        moved = torch.linalg.matrix_exp(A) * units[..., None, :] / units[..., :, None]
        transition = moved[..., : 2 * n, :].mT
        step, held, risen = transition.split([2 * n, m, m], dim=-2)
        if hold == "zero_order":
            return step, held, torch.zeros_like(held)
        return step, held - risen, risen

    def matrices(self) -> tuple[Tensor, Tensor, Tensor]:
        """M⁻¹C (n, n) [1/s], M⁻¹K (n, n) [1/s²] and the input matrix (n, m), M⁻¹ for forces."""
        damping, stiffness, inputs = self.weights.mT.split(
            [self.dofs, self.dofs, self.inputs], dim=-1
        )
        return -damping, -stiffness, inputs


def _compiled(start: Tensor, step: Tensor, driven: Tensor) -> Tensor:
    """[x ẋ] (…, T, 2n) by the compiled recurrence, on the processor."""
    first = start.expand(*driven.shape[:-2], -1).unsqueeze(-2)
    states = torch.cat([first, driven], dim=-2).detach().cpu()
    work = partial(recurrence, flat(step)[0], flat(states))
    interruptible(work, states.numel() * len(step))
    return states.to(driven.device)


def state_of(signals: Record | Sample) -> Tensor:
    """[ẋ, x, f] (…, 2n + m)."""
    x, v = signals.x, signals.v
    assert x is not None
    assert v is not None
    return torch.cat([v, x, signals.excitation], dim=-1)
