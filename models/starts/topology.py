"""Which nodes are joined, where a record's masses are unknown: a chain, or all pairs?

A building is a chain. A bridge whose deck ends at an abutment is none: a mass of it moves under
an element that the chain lacks. Each mass is asked on its own, by least squares of its acceleration
on springs and dampers to its neighbours, and to all other nodes.
T samples, n masses, k columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.record import Record
from models.layers.reconstructed import reconstructed

MOST_PAIRED = 4  # DOFs all of whose pairs one motion tells apart
GAPS = (0.3, 0.6)  # of the largest deformation: where a spring may change its stiffness
UNTOLD = 0.3  # of a mass's acceleration, as an RMS: more than this the chain does not explain
BETTER = 0.6  # times that, at most, is what all pairs leave
RIDGE = 1e-4  # of the columns' norm


def topology_of(records: Sequence[Record]) -> str:
    """ "all" where masses of base-excited records (T, n) move as no chain explains, else "chain".

    Accelerations relative to the base; x and v are integrated from them.
    """
    motions = [(r, *reconstructed(r.a, r.f, r.dt)) for r in records]
    for i in range(records[0].a.shape[-1]):
        chain, pairs = (_untold(motions, i, near) for near in (True, False))
        if chain > UNTOLD and pairs < BETTER * chain:
            return "all"
    return "chain"


def _untold(motions: Sequence[tuple[Record, Tensor, Tensor]], i: int, near: bool) -> float:
    """Share of the absolute acceleration of mass i that no springs and dampers explain."""
    rows, targets = [], []
    for record, x, v in motions:
        ground = x.new_zeros(len(x), 1)
        y, rate = (torch.cat([ground, s], dim=1) - s[:, i : i + 1] for s in (x, v))
        n = x.shape[1]
        others = [j for j in range(n + 1) if j != i + 1 and (not near or abs(j - i - 1) == 1)]
        rows.append(torch.cat([_columns(y[:, j], rate[:, j]) for j in others], dim=1))
        targets.append(record.a[:, i] - record.f[:, 0])
    A, target = torch.cat(rows), torch.cat(targets)
    A = A / A.norm(dim=0).clamp_min(1e-300)
    ridge = RIDGE * torch.eye(A.shape[1]).to(A)
    padded = torch.cat([target, target.new_zeros(len(ridge))])[:, None]
    known = torch.linalg.lstsq(torch.cat([A, ridge]), padded, driver="gelsd").solution[:, 0]
    return float((target - A @ known).norm() / target.norm().clamp_min(1e-300))


def _columns(y: Tensor, rate: Tensor) -> Tensor:
    """What an element may do at a deformation y (T,) (T, k)."""
    far = y.abs().max()
    hinges = [torch.sign(y) * (y.abs() - gap * far).clamp_min(0.0) for gap in GAPS]
    return torch.stack([y, rate, y * y.abs(), y**3, *hinges], dim=1)
