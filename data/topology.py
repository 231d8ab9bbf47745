"""Topology of a structure: which nodes an element joins, as numbers and as incidence matrices.

y = B x + B_s s           n DOFs, m supports, E elements; B is (E, n), B_s is (E, m).
Nodes are numbered: DOFs x1 … xn are 0 … n−1, supports s1 … sm are n … n+m−1, ground is n+m.
"""

from __future__ import annotations

import numpy as np


def node_numbers(dofs: int, supports: int) -> dict[str, int]:
    """Number of every node by its name."""
    names = [f"x{i + 1}" for i in range(dofs)] + [f"s{j + 1}" for j in range(supports)]
    return {name: number for number, name in enumerate([*names, "ground"])}


def incidence(ends: np.ndarray, dofs: int, supports: int) -> tuple[np.ndarray, np.ndarray]:
    """B (E, n) and B_s (E, m) of elements from and to the nodes `ends` (E, 2).

    +1 where an element ends and −1 where it starts: y is the position of its second node less that
    of its first.
    """
    rows = np.arange(len(ends))
    full = np.zeros((len(rows), dofs + supports + 1))
    full[rows, ends[:, 1]] += 1.0
    full[rows, ends[:, 0]] -= 1.0
    return full[:, :dofs], full[:, dofs : dofs + supports]
