"""The compiled run of a composition, on the processor wherever the data are.

B records, T samples, n coordinates, E elements, o outputs, P free parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from data.memory import empty_array, require_memory
from data.parallel import in_threads, interruptible, threads
from data.record import Drive, Response
from models.composition.branch_run_compiled import Laws
from models.composition.coefficients import PART, Composition, Part
from models.composition.simulate_compiled import (
    Course,
    Equation,
    Histories,
    Sensors,
    Term,
    room_of,
    run,
)
from models.layers.integrate import between

Place = TypeVar("Place")
SMALLEST_BLOCK = 24  # derivatives that are worth a run of their own


@dataclass(frozen=True)
class Trace:
    """A compiled run (…, T, ·): the motion, the elements' forces and deformations, ∂output/∂θ."""

    response: Response
    forces: Tensor  # (…, T, E) [N]
    deformations: Tensor  # (…, T, E) [m]
    jacobian: Tensor  # (…, T, o, P), or P = 0
    by_begin: Tensor  # ∂output/∂(q, q̇, z) of the first sample (…, T, o, S), or S = 0


@torch.no_grad()
def traced(
    composition: Composition,
    drive: Drive,
    substeps: int,
    anchors: Tensor | None = None,
    every: int = 0,
    derivatives: bool = False,
    bound: Tensor | None = None,
    begin: Tensor | None = None,
    by_begin: bool = False,
    branches: Laws | tuple[()] = (),
) -> Trace:
    """The compiled run of a batch of drives.

    anchors: measured x and v (…, 2, T, o), from which the run begins again every `every` samples;
    None: it never does. derivatives: fill the Jacobian too. bound: what sensors measure (o,) in a
    run that has diverged; None: it is infinite. begin: q, q̇ and the units' memory
    (…, 2n + E·units) at the first sample, in place of the drive's; by_begin: derivatives by it too.
    branches: laws of the elements in place of units, whose derivatives go along with all others.
    """
    device, lead = drive.u.device, drive.u.shape[:-2]
    drive = on_processor(drive)
    u, measured = drive.u.reshape(lead.numel(), *drive.u.shape[-2:]), anchors_of(drive, anchors)
    o, E = composition.outputs.value.shape[0], composition.laws.value.shape[0]
    begins = drive.u.new_zeros(len(u), 0) if begin is None else begin.cpu().reshape(len(u), -1)
    S = begins.shape[1] if by_begin else 0
    P = composition.parameters if derivatives or (S and branches) else 0
    per_sample = 3 * o + 2 * E + o * (P + S) + substeps * drive.u.shape[-1]
    require_memory(
        8.0 * per_sample * len(u) * drive.samples,
        f"{len(u)} runs of {drive.samples} samples with {E} elements and {P} derivatives",
        "take shorter records, fewer elements or fewer of their units",
    )
    fine = between(u, drive.hold, substeps)
    shapes = [(o,)] * 3 + [(E,)] * 2 + [(o, P + S)]
    out = [empty_array(len(u), drive.samples, *shape) for shape in shapes]
    blocks = _blocks(P, S, -(-threads() // max(1, len(u))) if not branches else 1)
    sensitive = P + S > 0 or bool(branches)
    stated = [stated_by(composition, sensitive, bound, lo, hi) for lo, hi, _ in blocks]

    def one(place: tuple[int, int]) -> None:
        i, block = place
        (lo, hi, own), (equation, sensors) = blocks[block], stated[block]
        *motion, jacobian = (signal[i] for signal in out)
        if block > 0:  # a place that two threads write is not safe, even where both write the same
            motion = [torch.empty_like(signal) for signal in motion]
        of_record = (s[i].contiguous().numpy() for s in (u, fine, measured, begins))
        own_u, own_fine, own_measured, own_begin = of_record
        course = Course(own_u, own_fine, drive.dt, every, own_measured, own_begin)
        filled = Histories(*(signal.numpy() for signal in motion))
        if sensitive:
            filled = filled._replace(jacobian=jacobian.numpy())
        room = room_of(equation, hi - lo + own, branches)
        run(course, equation, branches, sensors, room, filled, hi - lo, own, lo)

    steps = drive.samples * substeps * max(1, o) * (1 + P + S) // len(blocks)
    do_all(one, [(i, block) for i in range(len(u)) for block in range(len(blocks))], steps)
    x, v, a, r, y, jacobian = (s.reshape(*lead, *s.shape[1:]).to(device) for s in out)
    motion = Response(x, v, composition.output(x, v, a))
    by_theta, by_first = jacobian.split([P, S], dim=-1)
    return Trace(motion, r, y, by_theta if derivatives else by_theta[..., :0], by_first)


def do_all(one: Callable[[Place], None], places: Sequence[Place], steps: int) -> None:
    """Compiled work, so many inner steps each, on every place: side by side where that may be."""
    if len(places) > 1 and threads() > 1:
        in_threads(one, places, steps)
        return
    for place in places:
        interruptible(partial(one, place), steps)


def _blocks(P: int, S: int, wanted: int) -> list[tuple[int, int, int]]:
    """Parameters first to last of each run of a record, and how many of a beginning go along.

    A run with some of the derivatives repeats the motion, which is a small part of the work.
    """
    count = max(1, min(wanted, (P + S) // SMALLEST_BLOCK, P))
    ends = [round(P * k / count) for k in range(count + 1)]
    return [(ends[k], ends[k + 1], S if k + 1 == count else 0) for k in range(count)]


def on_processor(drive: Drive) -> Drive:
    return Drive(drive.dt, drive.u.cpu(), drive.x0.cpu(), drive.v0.cpu(), drive.hold)


def anchors_of(drive: Drive, anchors: Tensor | None) -> Tensor:
    """x and v (B, 2, T, o) from which runs begin again; of the first sample alone where none do."""
    lead = drive.u.shape[:-2]
    if anchors is not None:
        return anchors.cpu().reshape(lead.numel(), *anchors.shape[-3:])
    starts = torch.stack([drive.x0, drive.v0], dim=-2).expand(*lead, 2, -1)
    return starts.reshape(lead.numel(), 2, -1)[:, :, None, :]


@lru_cache(maxsize=1)  # a search for a first state runs one composition many times
def stated_by(
    composition: Composition,
    derivatives: bool,
    bound: Tensor | None = None,
    lo: int = 0,
    hi: int | None = None,
) -> tuple[Equation, Sensors]:
    """A composition as arguments of the compiled run; `bound` of as many outputs, or of each part.

    Parameters lo to hi are numbered from 0 on; on others nothing depends.
    """

    def term(name: str) -> Term:
        part: Part = getattr(composition, name)
        if hi is not None:
            inside = (part.index >= lo) & (part.index < hi)
            part = replace(part, index=torch.where(inside, part.index - lo, -1))
        arrays = (getattr(part, k).detach().cpu().numpy() for k in PART)
        value, index, slope = map(np.ascontiguousarray, arrays)
        return Term(value, index, slope) if derivatives else Term(value)

    names = ("core", "inputs", "G", "D", "laws", "outputs")
    core, inputs, G, D, laws, outputs = map(term, names)
    supports = np.ascontiguousarray(composition.supports.cpu().numpy())
    back = np.ascontiguousarray(np.linalg.pinv(outputs.value))
    o = len(outputs.value)
    ends = np.full(o, np.inf) if bound is None else bound.repeat(o // len(bound)).cpu().numpy()
    sensors = Sensors(outputs, back, composition.measures.cpu().numpy(), ends)
    return Equation(core, inputs, G, D, laws, supports, composition.counts), sensors


class DifferentiatedRun(torch.autograd.Function):
    """A compiled run with derivatives as a function of its free parameters in autograd."""

    @staticmethod
    def forward(ctx: Any, run: Callable[[], tuple[Tensor, Tensor]], *free: Tensor) -> Tensor:
        outputs, jacobian = run()
        ctx.save_for_backward(jacobian)
        ctx.shapes = [p.shape for p in free]
        return outputs

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Any:
        (jacobian,) = ctx.saved_tensors
        flat = slope.reshape(-1) @ jacobian.flatten(0, -2)
        parts = flat.split([shape.numel() for shape in ctx.shapes])
        return (None, *(p.view(s) for p, s in zip(parts, ctx.shapes, strict=True)))
