"""Which nodes the elements of a network join: as given, or as the motion of a record shows.

y = B x + B_s s: of two nodes (i, j) y = x_j − x_i, a spring between them; of three (i, j, k)
y = x_i − 2 x_j + x_k, what bends at j; of more the difference of so much higher an order, by which
bending changes along the chain.
Columns whose joints turn carry shear and bending: in a chain both are springs of positive
stiffness, where pairs of nodes alone need negative ones (x_i to x_k). Any symmetric stiffness is
such springs in one way, if all nodes that follow on one another are joined, n(n + 1)/2 elements.

A building is a chain. A bridge whose deck ends at an abutment is none: a mass of it moves under
an element that the chain lacks. Each mass is asked on its own, by least squares of its acceleration
on springs, dampers and sliders to its neighbours, and to all other nodes: without sliders a chain
that yields looks like none. Noise misleads that test: where motion was held back, a network of the
other topology is fitted too, and its free run on held-back motion decides.
n DOFs or masses, E elements, p moving supports, T samples, k columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import pad

from data.memory import require_memory
from data.record import Record
from data.topology import node_numbers
from models.layers.reconstructed import reconstructed
from models.layers.stop_operator import stretches

if TYPE_CHECKING:
    from data.datamodule import Data

MOST_JOINED = 4  # nodes of an element of a frame: one of 6 storeys has its modes to some percent
IN_WORDS = {"chain": "chain", "all": "all pairs", "frame": "chain that bends"}
MOST_PAIRED = 4  # DOFs all of whose pairs one motion tells apart
GAPS = (0.3, 0.6)  # of the largest deformation: where a spring may change its stiffness
UNEXPLAINED = 0.3  # of a mass's acceleration, as an RMS: more than this the chain does not explain
WIDTHS = (0.05, 0.1, 0.2, 0.4)  # half widths of sliders, of the largest deformation
BETTER = 0.4  # times that, at most, is what all pairs leave
RIDGE = 1e-4  # of the columns' norm
OTHER = {"chain": "all", "all": "chain"}
ENOUGH = 0.03  # relative error on held-back motion: a chain that leaves less has no rival
WORTH = 0.9  # times the error of the chain: what all pairs have to be below


def nodes_of(elements: Sequence[Sequence[str]] | str, dofs: int, supports: int) -> list[list[str]]:
    """The nodes that each element joins. Raises ValueError for names that are no topology."""
    if not isinstance(elements, str):
        return [list(nodes) for nodes in elements]
    if elements not in IN_WORDS:
        raise ValueError(
            f"model.elements={elements}: expected nodes, or one of {', '.join(IN_WORDS)}"
        )
    if elements == "all":
        return all_pairs(dofs, supports)
    if supports > 1:
        raise ValueError(
            f"model.elements={elements} is for one support, there are {supports}; name the "
            "pairs that are joined"
        )
    nodes = ["s1" if supports else "ground", *(f"x{i + 1}" for i in range(dofs))]
    chain = [list(pair) for pair in pairwise(nodes)]
    if elements == "chain":
        return chain
    bends = [nodes[i : i + k] for k in range(3, MOST_JOINED + 1) for i in range(dofs + 2 - k)]
    return chain + bends


def all_pairs(dofs: int, supports: int) -> list[list[str]]:
    """All pairs of nodes: every DOF with ground or each moving support, then every two DOFs."""
    nodes = dofs + max(supports, 1)
    require_memory(
        64.0 * dofs * (nodes - 1) * nodes,
        f"model.elements=all: {dofs * (nodes - 1)} pairs of {nodes} nodes",
        "name the pairs that are joined",
    )
    names = [f"x{i + 1}" for i in range(dofs)]
    fixed = [f"s{j + 1}" for j in range(supports)] or ["ground"]
    found = [[node, name] for name in names for node in fixed]
    return found + [list(pair) for pair in combinations(names, 2)]


def incidence(elements: Sequence[Sequence[str]], dofs: int, supports: int) -> tuple[Tensor, Tensor]:
    """B (E, n) and B_s (E, p). Raises ValueError for nodes that there are not, or that repeat."""
    number = node_numbers(dofs, supports)
    full = np.zeros((len(elements), dofs + supports + 1))
    for row, nodes in zip(full, elements, strict=True):
        if not 1 < len(set(nodes)) == len(nodes) or not set(nodes) <= set(number):
            *moving, ground = number
            raise ValueError(
                f"model.elements holds {list(nodes)}: expected two different ones of "
                f"{', '.join(moving)} and {ground}, or three, at whose middle one it bends, or more"
            )
        order = len(nodes) - 1
        row[[number[node] for node in nodes]] = [
            (-1.0) ** (order - i) * comb(order, i) for i in range(order + 1)
        ]
    return torch.tensor(full[:, :dofs]), torch.tensor(full[:, dofs : dofs + supports])


def is_open(settings: Mapping[str, Any], data: Data) -> bool:
    """Whether elements between unknown masses are left to the records, and these can tell.

    settings: of the model's config; with heights of storeys it is a chain.
    """
    unknown = all(settings.get(key, "") is None for key in ("elements", "masses"))
    unknown &= settings.get("heights") is None
    few = 1 < data.dofs <= MOST_PAIRED and data.quantity == "acceleration"
    forced = forced_of(settings, data)
    count = 1 if forced == "base" else len(forced or [])
    driven = data.measured and 0 < count == data.inputs
    if driven and forced != "base":
        driven = set(forced or []) <= set(range(1, data.dofs + 1))
    support = data.forced == [] and data.inputs == 2  # its displacement and velocity
    return unknown and few and (driven or support)


def forced_of(settings: Mapping[str, Any], data: Data) -> Sequence[int] | str | None:
    """Which DOFs carry the forces: as the model's config says, else as the data say."""
    said: Sequence[int] | str | None = settings.get("forced")
    return data.forced if said is None else said


def rival_of(topology: str, error: float | None) -> str | None:
    """The other topology; None where it need not be fitted.

    error: relative, of the free run on held-back motion; None where nothing was held back. A chain
    that leaves next to no error has no rival.
    """
    enough = error is None or (topology == "chain" and error < ENOUGH)
    return None if enough else OTHER[topology]


def select_topology(errors: Mapping[str, float | None]) -> str:
    """The better one on held-back motion, all pairs only if clearly. errors: as in `rival_of`."""
    chain, pairs = (errors[name] or math.inf for name in ("chain", "all"))
    return "all" if pairs < WORTH * chain else "chain"


def comparison(errors: Mapping[str, float | None]) -> str:
    """The errors in words, in percent."""
    return ", ".join(f"{IN_WORDS[n]} {100.0 * (e or math.inf):.3g}" for n, e in errors.items())


def topology_of(records: Sequence[Record], forced: Sequence[int] | str | None) -> str:
    """ "all" where masses of records (T, n) move as no chain explains, else "chain".

    forced: numbers of the DOFs that carry the forces, or "base", which moves: accelerations are
    relative to it. Without x and v these are integrated; one support moves, and they are measured:
    where they are not, it is a chain.
    """
    if any(r.s is not None and (r.x is None or r.v is None) for r in records):
        return "chain"
    motions = [_nodes_of(record, forced) for record in records]
    for i in range(records[0].a.shape[-1]):
        chain, pairs = (_unexplained(motions, i, near) for near in (True, False))
        if chain > UNEXPLAINED and pairs < BETTER * chain:
            return "all"
    return "chain"


# displacements, velocities (T, 1 + n), absolute accelerations, forces (T, n)
Nodes = tuple[Tensor, Tensor, Tensor, Tensor]


def _nodes_of(record: Record, forced: Sequence[int] | str | None) -> Nodes:
    """Of a record; a base that moves is at rest, and accelerations are then absolute."""
    force = torch.zeros_like(record.a)
    if record.s is not None:
        u = record.signals()
        places, speeds = [u["s"], u["x"]], [u["s_dot"], u["v"]]
        return torch.cat(places, dim=1), torch.cat(speeds, dim=1), record.a, force
    x, v, absolute = record.x, record.v, record.a
    if forced == "base" or x is None or v is None:
        x, v = reconstructed(record.a, record.f, record.dt)
    if forced == "base":
        absolute = record.a - record.f[:, :1]
    elif forced is not None and not isinstance(forced, str):
        force[:, [number - 1 for number in forced]] = record.f
    return pad(x, (1, 0)), pad(v, (1, 0)), absolute, force


def _unexplained(motions: Sequence[Nodes], i: int, near: bool) -> float:
    """Share of the absolute acceleration of mass i that no elements explain."""
    rows, targets = [], []
    for places, speeds, absolute, force in motions:
        y, rate = (u - u[:, i + 1 : i + 2] for u in (places, speeds))
        n = absolute.shape[1]
        others = [j for j in range(n + 1) if j != i + 1 and (not near or abs(j - i - 1) == 1)]
        columns = [_columns(y[:, j], rate[:, j]) for j in others]
        rows.append(torch.cat([*columns, force[:, i : i + 1]], dim=1))
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
