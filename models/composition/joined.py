"""Which nodes the elements of a network join, and the deformations that this makes.

y = B x + B_s s: of two nodes (i, j) y = x_j − x_i, a spring between them; of three (i, j, k)
y = x_i − 2 x_j + x_k, what bends at j.  n DOFs, E elements, p moving supports.
Columns whose joints turn carry shear and bending: in a chain of two and three nodes each both are
springs of positive stiffness, where pairs of nodes alone need negative ones (x_i to x_k).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
import torch
from torch import Tensor

from data.topology import node_numbers

MOST_NODES = 300  # all of whose pairs are elements
TOLD = {"chain": "chain", "all": "all pairs", "frame": "chain that bends"}
SHARES = {2: (-1.0, 1.0), 3: (1.0, -2.0, 1.0)}  # of the motion of two, or three, nodes in y


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
            f"model.elements={elements} stands on one support, there are {supports}; name the "
            "pairs that are joined"
        )
    nodes = ["s1" if supports else "ground", *(f"x{i + 1}" for i in range(dofs))]
    chain = [list(pair) for pair in pairwise(nodes)]
    if elements == "chain":
        return chain
    return chain + [nodes[i : i + 3] for i in range(dofs - 1)]


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
        shares = SHARES.get(len(nodes))
        if shares is None or len(set(nodes)) < len(nodes) or not set(nodes) <= set(number):
            *moving, ground = number
            raise ValueError(
                f"model.elements holds {list(nodes)}: expected two different ones of "
                f"{', '.join(moving)} and {ground}, or three, at whose middle one it bends"
            )
        row[[number[node] for node in nodes]] = shares
    return torch.tensor(full[:, :dofs]), torch.tensor(full[:, dofs : dofs + supports])
