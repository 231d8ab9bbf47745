"""Runs of a composition whose elements follow the branch law: compiled, and in PyTorch.

E elements, T samples, n coordinates, which are the outputs too; θ (E, L).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from data.memory import empty_array, require_memory
from data.record import Drive, Response
from models.composition.branch_law import LEAST_DAMPER, TAIL, Branch, branch_forces, ramp
from models.composition.branch_law_compiled import extreme_at, hermite
from models.composition.branch_run_compiled import Laws, run
from models.composition.simulate import Composition
from models.composition.simulate_compiled import Histories
from models.composition.trace import Trace, anchors_of, course_of, do_all, on_processor, stated_by
from models.estimator import Parameter
from models.layers.integrate import between

STEPS = 100  # of a push


@dataclass(frozen=True)
class Branches:
    """The branch laws of all elements: θ (E, L), their sizes, and Y, V, F, log k₀ (4, E)."""

    theta: Tensor
    sizes: tuple[int, int, int, int]
    scale: Tensor


@torch.no_grad()
def traced_branches(
    composition: Composition,
    branches: Branches,
    drive: Drive,
    substeps: int,
    anchors: Tensor | None = None,
    every: int = 0,
    derivatives: bool = False,
    bound: Tensor | None = None,
    begin: Tensor | None = None,
    by_begin: bool = False,
) -> Trace:
    """The compiled run of a batch of drives, as `traced` of trace.py; `begin`: q, q̇ (…, 2n)."""
    device, lead = drive.u.device, drive.u.shape[:-2]
    drive = on_processor(drive)
    u, measured = drive.u.reshape(lead.numel(), *drive.u.shape[-2:]), anchors_of(drive, anchors)
    begins = drive.u.new_zeros(len(u), 0) if begin is None else begin.cpu().reshape(len(u), -1)
    S = begins.shape[1] if by_begin else 0
    P = composition.parameters if derivatives or S else 0  # of the laws' θ, with those by `begin`
    E, n = composition.D.value.shape
    per_sample = 3 * n + 2 * E + n * (P + S) + substeps * u.shape[-1]
    require_memory(
        8.0 * per_sample * len(u) * drive.samples,
        f"{len(u)} runs of {drive.samples} samples with {E} elements and {P} derivatives",
        "take shorter records, fewer elements or smaller laws",
    )
    fine = between(u, drive.hold, substeps)
    shapes = [(n,)] * 3 + [(E,)] * 2 + [(n, P + S)]
    out = [empty_array(len(u), drive.samples, *shape) for shape in shapes]
    equation, sensors = stated_by(composition, P > 0, bound)
    theta = np.ascontiguousarray(branches.theta.detach().cpu().numpy()).reshape(-1)
    laws = Laws(theta, branches.sizes, np.ascontiguousarray(branches.scale.cpu().numpy()))

    def one(i: int) -> None:
        course = course_of(u[i], fine[i], drive.dt, every, measured[i], begins[i])
        filled = Histories(*(signal[i].numpy() for signal in out))
        run(course, equation, laws, sensors, P, S, filled)

    do_all(one, range(len(u)), drive.samples * substeps * max(1, n) * (1 + P + S))
    x, v, a, forces, deformations, slopes = (s.reshape(*lead, *s.shape[1:]).to(device) for s in out)
    by_theta, by_first = slopes.split([P, S], dim=-1)
    motion = Response(x, v, composition.output(x, v, a))
    by_theta = by_theta if derivatives else by_theta[..., :0]
    return Trace(motion, forces, deformations, by_theta, by_first)


def simulate_branches(
    composition: Composition, branches: Branches, drive: Drive, substeps: int
) -> Response:
    """Free run (…, T, n) in PyTorch: the readable reference, differentiable in all it returns."""
    lead = drive.u.shape[:-2]
    if lead:
        parts = [
            Drive(drive.dt, u, x0, v0, drive.hold)
            for u, x0, v0 in zip(
                drive.u.flatten(0, -3),
                drive.x0.expand(*lead, -1).flatten(0, -2),
                drive.v0.expand(*lead, -1).flatten(0, -2),
                strict=True,
            )
        ]
        runs = [simulate_branches(composition, branches, part, substeps) for part in parts]
        signals = (torch.stack([getattr(r, k) for r in runs]) for k in "xva")
        return Response(*(s.reshape(*lead, *s.shape[1:]) for s in signals))
    inputs, G, D = (getattr(composition, k).value for k in ("inputs", "G", "D"))
    K, C = composition.core.value
    h = drive.dt / substeps
    u, fine = drive.u, between(drive.u, drive.hold, substeps)
    Y, V, F, _ = branches.scale

    def deformation(q: Tensor, rate: Tensor, u: Tensor) -> tuple[Tensor, Tensor]:
        s = composition.supports
        return (D @ q + s[0] @ u) / Y, (D @ rate + s[1] @ u) / V

    q, rate = drive.x0, drive.v0
    y, speed = deformation(q, rate, u[0])
    laws = [
        Branch(theta, branches.sizes, float(branches.scale[3, e]), y[e])
        for e, theta in enumerate(branches.theta)
    ]
    r = torch.stack([law.go_on(*now) for law, *now in zip(laws, y, speed, strict=True)])
    a = inputs @ u[0] - K * q - C * rate - G @ (F * r)
    history = [(q, rate, a)]
    for k in range(1, drive.samples):
        for part in range(substeps):
            now = fine[k - 1, part]
            q, ahead = q + h * (rate + 0.5 * h * a), rate + h * a
            before, slow = y, speed
            y, speed = deformation(q, ahead, now)
            forces = []
            for e, law in enumerate(laws):
                turn_within(law, before[e], slow[e], y[e], speed[e], h * float(V[e] / Y[e]))
                forces.append(law.go_on(y[e], speed[e]))
            new = inputs @ now - K * q - C * ahead - G @ (F * torch.stack(forces))
            rate, a = rate + 0.5 * h * (a + new), new
        a = a + inputs @ (u[k] - fine[k - 1, -1])  # a held excitation jumps
        history.append((q, rate, a))
    x, v, a = (torch.stack(s) for s in zip(*history, strict=True))
    return Response(x, v, composition.output(x, v, a))


def turn_within(law: Branch, y0: Tensor, v0: Tensor, y1: Tensor, v1: Tensor, h: float) -> None:
    """Let an element turn round where the motion does between y₀ and y₁, a step h later."""
    at_0, at_1, slow, fast = (float(t.detach()) for t in (y0, y1, v0, v1))
    side = -law.side if law.side * fast < 0.0 else 0
    if law.side == 0:
        side = int(np.sign(at_1 - at_0))
    if side == 0:
        return
    turns = slow * fast < 0.0 and side * slow < 0.0
    at = extreme_at(at_0, at_1, h * slow, h * fast) if turns else 0.0
    by_y0, by_d0, by_y1, by_d1 = hermite(at)
    law.go_on(by_y0 * y0 + by_d0 * h * v0 + by_y1 * y1 + by_d1 * h * v1, torch.zeros_like(v0))
    law.turn(side)


def branch_law(branches: Branches, e: int, part: str, about: str) -> Iterator[Parameter]:
    """Of element e: its force under a slow push from rest to the largest deformation of training.

    A branch law is curves and has no parameter of its own that is physical, its dampers aside
    (models/composition/branch_law.py). Stiffness: the secant at a twentieth of the way; after
    yielding that over the last fifth; it yields where these two lines meet. Means of both ways.
    """
    theta = branches.theta[e].detach()
    Y, V, F, log_k0 = (float(value) for value in branches.scale[:, e])
    tail = theta[-TAIL:]
    y = torch.linspace(0.0, 1.0, STEPS + 1, dtype=torch.float64)
    turns = torch.zeros(STEPS + 1, dtype=torch.int64)
    r = torch.zeros_like(y)
    for side in (1, -1):
        turns[0] = side
        pushed = branch_forces(theta, branches.sizes, side * y, torch.zeros_like(y), turns, log_k0)
        r += 0.5 * side * pushed
    first, last = round(0.05 * STEPS), round(0.8 * STEPS)
    k, slope = float(r[first] / y[first]), float((r[-1] - r[last]) / (y[-1] - y[last]))
    yield Parameter(f"{part}.stiffness", k * F / Y, "N/m", about, derived=True)
    damper = float(ramp(tail[2], LEAST_DAMPER))
    yield Parameter(f"{part}.damping", damper * F / V, "N s/m", about)
    yield Parameter(f"{part}.growth_with_rate", float(tail[3].exp()) - 1.0, "", about)
    yield Parameter(f"{part}.rate_of_growth", float(tail[4].exp()) * V, "m/s", about)
    yield Parameter(f"{part}.largest_deformation", Y, "m", about)
    yield Parameter(f"{part}.force_there", F * float(r[-1]), "N", about, derived=True)
    yield Parameter(f"{part}.post_yield_stiffness", slope * F / Y, "N/m", about, derived=True)
    if k > 0.0:
        yield Parameter(f"{part}.post_yield_ratio", slope / k, "", about, derived=True)
    corner = (float(r[-1]) - slope) / (k - slope) if k > slope else 0.0
    if 0.0 < corner < 1.0:  # else it does not yield on this way
        yield Parameter(f"{part}.yield_displacement", corner * Y, "m", about, derived=True)
        yield Parameter(f"{part}.yield_force", k * corner * F, "N", about, derived=True)
