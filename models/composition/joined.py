"""Which nodes the elements of a network join, and the deformations that this makes.

y = B x + B_s s: of two nodes (i, j) y = x_j − x_i, a spring between them; of three (i, j, k)
y = x_i − 2 x_j + x_k, what bends at j; of more the difference of so much higher an order, by which
bending changes along the chain.  n DOFs, E elements, p moving supports.
Columns whose joints turn carry shear and bending: in a chain both are springs of positive
stiffness, where pairs of nodes alone need negative ones (x_i to x_k). Any symmetric stiffness is
such springs in one way, if all nodes that follow on one another are joined, n(n + 1)/2 elements.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from math import comb

import numpy as np
import torch
from torch import Tensor

from data.topology import node_numbers

MOST_NODES = 300  # all of whose pairs are elements
MOST_JOINED = 4  # nodes of an element of a frame: one of 6 storeys has its modes to some percent
TOLD = {"chain": "chain", "all": "all pairs", "frame": "chain that bends"}


def nodes_of(elements: Sequence[Sequence[str]] | str, dofs: int, supports: int) -> list[list[str]]:
    """The nodes that each element joins. Raises ValueError for names that are no topology."""
    if not isinstance(elements, str):
        return [list(nodes) for nodes in elements]
    if elements not in TOLD:
        raise ValueError(f"model.elements={elements}: expected nodes, or one of {', '.join(TOLD)}")
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
    if nodes > MOST_NODES:
        raise ValueError(
            f"{nodes} nodes make {dofs * (nodes - 1)} pairs; {MOST_NODES} nodes are "
            "possible with model.elements=all: name the pairs that are joined"
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
