"""Whether a fitted model holds beyond its training: in bounds, like other fits, how far it goes.

No error on the motion of training says so. Of several fits whose training errors differ by a few
percent, what they do farther out may differ a hundredfold: a gap that training never closed, a
yield point that it never passed. One of them may fail there; that most of them fail in the same way
is less likely.
B records, T samples, n DOFs, E elements, m excitations.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from data.record import Drive, Record
from models.composition.composite import Composite
from models.estimator import Estimator
from models.fit.objective import state_of
from models.fit.trainable import Trainable

MORE, BOUND = 1.5, 10.0  # times the excitation, and times the motion, that a model has to stand
LESS, LEFT = 0.1, 0.5  # times the excitation: less than this share of the motion has to be left
ALIKE = 1.5  # times the least loss
DRAWS, TAPERED = 16, 0.05  # excitations like one of training; of their length, at either end

# where a fit ended: its loss, its state, and its run (…, T, n) of every batch under more excitation
End = tuple[float, list[Tensor], list[Tensor]]


@torch.no_grad()
def stays_in_bounds(estimator: Trainable, record: Record) -> bool:
    """Whether free runs stay in bounds where the excitation is larger or smaller than a record's.

    Under MORE times the excitation a law that was bent to fit one motion may run away; under LESS
    of it one that makes energy at small motions goes on moving by itself. A force under an imposed
    motion is only tried under MORE: one of friction keeps its size under LESS.
    """
    more = estimator.free_run(scaled(record, MORE)).a.abs().max()
    if not float(more / record.a.abs().max()) < BOUND * MORE:  # NaN too
        return False
    if record.quantity == "force":
        return True
    whole, less = (estimator.free_run(scaled(record, share)).a for share in (1.0, LESS))
    left = float(less.square().mean() / whole.square().mean().clamp_min(1e-300)) ** 0.5
    return left < LEFT


def scaled(record: Record, share: float) -> Drive:
    """A larger or smaller motion under the same other inputs, such as a temperature."""
    scaled = record if record.e is None else replace(record, e=record.e / share)
    drive = scaled.drive()
    return replace(drive, u=share * drive.u, x0=share * drive.x0, v0=share * drive.v0)


@torch.no_grad()
def end_of(estimator: Trainable, loss: float, batches: Iterable[Record]) -> End:
    """The present state as an end."""
    runs = [estimator.free_run(scaled(record.measured(), MORE)).a for record in batches]
    return loss, state_of(estimator), runs


def middle(ends: Sequence[End]) -> list[Tensor]:
    """State of the end whose farther runs are nearest to the others', of those that fit alike.

    Of fewer than three the one with the least loss, and likewise where none of them agree.
    """
    least, best, _ = min(ends, key=lambda end: end[0])
    alike = [(state, farther) for loss, state, farther in ends if loss <= ALIKE * least]
    if len(alike) < 3:
        return best
    apart = [sum(_apart(one, other) for _, other in alike) for _, one in alike]
    return alike[apart.index(min(apart))][0] if math.isfinite(min(apart)) else best


def _apart(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Distance of two ends' runs; infinite where one of them is lost and the other is not."""
    square = 0.0
    for run, same in zip(one, other, strict=True):
        there = torch.isfinite(run)
        if not torch.equal(there, torch.isfinite(same)):
            return math.inf
        square += float((run[there] - same[there]).square().sum())
    return math.sqrt(square)


@torch.no_grad()
def free_run_error(model: Estimator, records: Sequence[Record]) -> float | None:
    """Relative error, infinite where a run diverges; None where a record begins unknown."""
    error = size = 0.0
    for record in records:
        try:
            drive = record.drive()
        except ValueError:  # begins in motion, in a state that was not measured
            return None
        run = model.free_run(drive).a
        error += float(record.counted(run - record.a).square().sum())
        size += float(record.counted(record.a).square().sum())
    return math.sqrt(error / size) if math.isfinite(error) and size > 0.0 else math.inf


@torch.no_grad()
def farthest(model: Composite, records: Sequence[Record]) -> float:
    """How large motions grow under excitations like those of records, and MORE times as large.

    Times what is in proportion, of accelerations and of the elements' deformations; infinite where
    one is lost. Excitations are alike that have the same spectrum and other phases (Theiler et al.
    1992, Testing for nonlinearity in time series).
    """
    generator, most = torch.Generator().manual_seed(0), 0.0
    for record in records:
        try:
            own = _sizes(model, record.drive())
        except ValueError:  # begins in motion, in a state that was not measured
            continue
        for _ in range(DRAWS):
            drive = _like(record, generator)
            for times in (1.0, MORE):
                sizes = _sizes(model, replace(drive, u=times * drive.u))
                most = max(most, _largest_ratio(sizes, own) / times)
    return most


@torch.no_grad()
def excess(model: Estimator, records: Iterable[Record]) -> float:
    """The largest RMS of free runs under excitations like those of records, over their own.

    It is one for a linear structure, whatever the phases are (Parseval), and infinite where a run
    is lost. DRAWS runs for each batch, whatever records it has.
    """
    generator, most = torch.Generator().manual_seed(0), 0.0
    for record in records:
        batch = record if record.a.ndim == 3 else record.map(lambda u: u[None])
        rows = torch.arange(DRAWS, device=batch.a.device) % len(batch.a)
        drawn = batch.map(partial(torch.index_select, dim=0, index=rows))
        run, own = model.free_run(_like(drawn, generator)).a, drawn.a
        rms = [signal.square().sum(dim=-1).mean(dim=-1).sqrt() for signal in (run, own)]
        most = max(most, _largest_ratio(*rms))
    return most


def _largest_ratio(sizes: Tensor, own: Tensor) -> float:
    """Of sizes over others; 0 where both are at rest, infinite where one is lost."""
    both = (sizes == 0.0) & (own == 0.0)
    ratio = float(torch.where(both, 0.0, sizes / own).max())
    return ratio if math.isfinite(ratio) else math.inf


def _sizes(model: Composite, drive: Drive) -> Tensor:
    """Largest acceleration, and deformation of each element, of a run (1 + E,)."""
    trace = model.trace(drive)
    each = trace.deformations.abs().flatten(0, -2).amax(dim=0)
    return torch.cat([trace.response.a.abs().max()[None], each])


def _like(record: Record, generator: torch.Generator) -> Drive:
    """A drive from rest whose excitation has the spectrum of a record's, and other phases."""
    u, T = record.excitation, record.samples
    ramp = torch.linspace(0.0, 1.0, max(2, round(TAPERED * T))).to(u)
    window = torch.cat([ramp, ramp.new_ones(T - 2 * len(ramp)), ramp.flip(0)])
    spectrum = torch.fft.rfft(window[:, None] * u, dim=-2)
    turns = torch.rand(*spectrum.shape[:-1], 1, generator=generator, dtype=u.dtype).to(u)
    other = torch.fft.irfft(spectrum * torch.exp(2j * math.pi * turns), n=T, dim=-2)
    rest = torch.zeros_like(record.a[..., 0, :])
    return Drive(record.dt, other, rest, rest, record.hold)
