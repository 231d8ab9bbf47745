"""A structure composed of a linear core, elements of learned laws, and outputs.

q̈ = −K q − C q̇ + Γ u − G r,   y = D q + (supports),   r = law(y, ẏ, z),   o = Φ q

`simulate` is the readable reference, and differentiable in all it returns; models run the compiled
twin in simulate_compiled.py wherever autograd does not ask for derivatives of a whole motion.
n coordinates, E elements, m excitations, o outputs, L columns of coefficients of a law.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from data.record import Drive, Response
from models.composition.coefficients import Part
from models.composition.laws import LINEAR, law, units
from models.layers.integrate import between

DISPLACEMENT, VELOCITY, ACCELERATION = range(3)


@dataclass(frozen=True)
class Composition:
    """All coefficients of the equation of motion."""

    core: Part  # K and C (2, n) [1/s²], [1/s], diagonal
    inputs: Part  # Γ (n, m)
    G: Part  # (n, E)
    D: Part  # (E, n)
    laws: Part  # (E, L)
    outputs: Part  # Φ (o, n)
    supports: Tensor  # (2, E, m): what excitations add to y and to ẏ
    counts: tuple[int, int, int]  # hinges, tanhs, units of an element
    parameters: int  # P
    measures: Tensor  # (o,): what each output is: displacement 0, velocity 1, acceleration 2

    def limits(self) -> Tensor:
        """Limits of the units' memory (E, units)."""
        hinges, tanhs, _ = self.counts
        return self.laws.value[:, LINEAR + 2 * hinges + 3 * tanhs + 1 :: 4]

    def output(self, x: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """What sensors measure (…, T, o) of the motion x, v, a (…, T, o) of the outputs."""
        if bool((self.measures == ACCELERATION).all()):
            return a
        which = self.measures.to(a.device).expand(a.shape)[..., None]
        return torch.stack([x, v, a], dim=-1).gather(-1, which)[..., 0]


def simulate(
    composition: Composition, drive: Drive, substeps: int, begin: Tensor | None = None
) -> Response:
    """Free run (…, T, o) in PyTorch, batched and differentiable.

    begin: q, q̇ and the units' memory (…, 2n + E·units) at the first sample, or the drive's.
    """
    K, C = composition.core.value
    inputs, G, D = composition.inputs.value, composition.G.value, composition.D.value
    laws, outputs, h = composition.laws.value, composition.outputs.value, drive.dt / substeps
    back = torch.linalg.pinv(outputs)
    u, fine = drive.u, between(drive.u, drive.hold, substeps)
    q, rate = drive.x0 @ back.T, drive.v0 @ back.T
    if begin is not None:
        q, rate = begin[..., : q.shape[-1]], begin[..., q.shape[-1] : 2 * q.shape[-1]]

    def deformation(q: Tensor, rate: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        return q @ D.T + u @ composition.supports[0].T, rate @ D.T + u @ composition.supports[1].T

    def acceleration(
        q: Tensor, rate: Tensor, u: Tensor, y: Tensor, speed: Tensor, z: Tensor
    ) -> Tensor:
        return u @ inputs.T - K * q - C * rate - law(laws, composition.counts, y, speed, z) @ G.T

    y, speed = deformation(q, rate, u[..., 0, :])
    z = y.new_zeros(*y.shape, composition.counts[2])
    if begin is not None:
        z = begin[..., 2 * q.shape[-1] :].reshape(z.shape)
    a = acceleration(q, rate, u[..., 0, :], y, speed, z)
    history = [(q, rate, a)]
    for k in range(1, drive.samples):
        for part in range(substeps):
            now = fine[..., k - 1, part, :]
            q, ahead = q + h * (rate + 0.5 * h * a), rate + h * a
            before = y
            y, speed = deformation(q, ahead, now)
            z = units(laws, composition.counts, z, y - before)
            new = acceleration(q, ahead, now, y, speed, z)
            rate, a = rate + 0.5 * h * (a + new), new
        a = a + (u[..., k, :] - fine[..., k - 1, -1, :]) @ inputs.T  # a held excitation jumps
        history.append((q, rate, a))
    x, v, a = (torch.stack(s, dim=-2) @ outputs.T for s in zip(*history, strict=True))
    return Response(x, v, composition.output(x, v, a))
