"""How far the free run of a model, as it stands, is from the motions that it is to begin with.

And how far it goes under excitations like theirs.   T samples, E elements, m excitations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from data.record import Drive, Record
from models.composition.composite import Composite
from models.estimator import Estimator
from models.fit.stands import MORE

DRAWS, TAPERED = 16, 0.05  # excitations like one of training; of their length, at either end


@torch.no_grad()
def free_run_error(model: Estimator, records: Sequence[Record]) -> float | None:
    """Relative error, infinite where a run diverges; None where a record begins unknown."""
    error = size = 0.0
    for record in records:
        try:
            drive = record.drive()
        except ValueError:  # begins in motion, in a state that was not measured
            return None
        counted = slice(record.warmup, None)
        run = model.free_run(drive).a
        error += float((run - record.a)[..., counted, :].square().sum())
        size += float(record.a[..., counted, :].square().sum())
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
                ratio = float((sizes / own).max()) / times
                most = max(most, ratio if math.isfinite(ratio) else math.inf)
    return most


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
