"""Which nodes are joined, where a record's masses are unknown: a chain, or all pairs?

A building is a chain. A bridge whose deck ends at an abutment is none: a mass of it moves under
an element that the chain lacks. Each mass is asked on its own, by least squares of its acceleration
on springs, dampers and sliders to its neighbours, and to all other nodes: without sliders a chain
that yields looks like none.
T samples, n masses, k columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.record import Record
from models.layers.reconstructed import reconstructed
from models.sliders.stop_operator import stretches

MOST_PAIRED = 4  # DOFs all of whose pairs one motion tells apart
GAPS = (0.3, 0.6)  # of the largest deformation: where a spring may change its stiffness
UNTOLD = 0.3  # of a mass's acceleration, as an RMS: more than this the chain does not explain
WIDTHS = (0.05, 0.1, 0.2, 0.4)  # half widths of sliders, of the largest deformation
BETTER = 0.4  # times that, at most, is what all pairs leave
RIDGE = 1e-4  # of the columns' norm


def topology_of(records: Sequence[Record]) -> str:
    """ "all" where masses of records (T, n) move as no chain explains, else "chain".

    A base moves, accelerations are relative to it, and x and v are integrated from them; or one
    support moves, and x and v are measured: where they are not, it is a chain.
    """
    if any(r.s is not None and (r.x is None or r.v is None) for r in records):
        return "chain"
    motions = [_of_base(r) if r.s is None else _of_support(r) for r in records]
    for i in range(records[0].a.shape[-1]):
        chain, pairs = (_untold(motions, i, near) for near in (True, False))
        if chain > UNTOLD and pairs < BETTER * chain:
            return "all"
    return "chain"


Nodes = tuple[Tensor, Tensor, Tensor]  # displacements, velocities (T, 1 + n), accelerations (T, n)


def _of_base(record: Record) -> Nodes:
    """The base stands still; accelerations are absolute."""
    x, v = reconstructed(record.a, record.f, record.dt)
    ground = x.new_zeros(len(x), 1)
    return torch.cat([ground, x], dim=1), torch.cat([ground, v], dim=1), record.a - record.f[:, :1]


def _of_support(record: Record) -> Nodes:
    u = record.signals()
    return torch.cat([u["s"], u["x"]], dim=1), torch.cat([u["s_dot"], u["v"]], dim=1), record.a


def _untold(motions: Sequence[Nodes], i: int, near: bool) -> float:
    """Share of the absolute acceleration of mass i that no elements explain."""
    rows, targets = [], []
    for places, speeds, absolute in motions:
        y, rate = (u - u[:, i + 1 : i + 2] for u in (places, speeds))
        n = absolute.shape[1]
        others = [j for j in range(n + 1) if j != i + 1 and (not near or abs(j - i - 1) == 1)]
        rows.append(torch.cat([_columns(y[:, j], rate[:, j]) for j in others], dim=1))
        targets.append(absolute[:, i])
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
    widths = far * torch.tensor(WIDTHS, dtype=y.dtype)
    smooth = torch.stack([y, rate, y * y.abs(), y**3, *hinges], dim=1)
    return torch.cat([smooth, stretches(y, widths, torch.zeros_like(widths))], dim=1)
