"""A lumped structure: masses, the elements that join them, and its equation of motion.

M ẍ + Bᵀ r = f,   y = B x + B_s s                       Brewick & Masri (2016), Eqs. 1 and 18

n DOFs, m supports, E elements.  B is (E, n), B_s is (E, m), see data/topology.py.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from data.annotations import MOST
from data.checked import checked
from data.simulation.laws.element import PARAMETERS, Element
from data.topology import incidence, node_numbers

SUPPORT = r"s[1-9]\d{0,8}"  # a support's name; longer numbers are of no structure


@checked
class Structure:
    """Masses [kg] of DOFs x1 … xn and named elements between DOFs, supports s1 … sm and ground.

    Raises ValueError for masses that are not positive, unknown nodes, and DOFs from which no chain
    of elements leads to a support or ground.
    """

    def __init__(self, masses: Sequence[float], elements: Mapping[str, Element]) -> None:
        self.masses = np.array(masses, dtype=float)  # (n,)
        if self.masses.ndim != 1 or self.masses.size == 0:
            raise ValueError(f"masses={masses!r}: expected a list of masses in kg, one per DOF")
        for i, mass in enumerate(self.masses, start=1):
            if not (np.isfinite(mass) and mass > 0.0):
                raise ValueError(f"mass of x{i} is {mass:g} kg; masses must be positive")
        if not elements:
            raise ValueError("the structure has no elements; give at least one restoring force")
        self.elements = dict(elements)
        self.dofs = self.masses.size
        nodes = {node for e in self.elements.values() for node in e.between}
        self.supports = max((int(s[1:]) for s in nodes if re.fullmatch(SUPPORT, s)), default=0)
        if self.dofs + self.supports > MOST:
            raise ValueError(
                f"the structure has {self.dofs} masses and supports up to s{self.supports}: "
                f"{MOST} nodes are possible; number the supports from s1 on, lump masses"
            )
        self.ends = self._node_numbers()  # (E, 2): start, end
        self._check_held()

    def _node_numbers(self) -> np.ndarray:
        """Numbers of the nodes (E, 2) where elements start and end."""
        number = node_numbers(self.dofs, self.supports)
        for name, element in self.elements.items():
            for node in element.between:
                if node not in number:
                    raise ValueError(
                        f"element {name} joins the unknown node {node!r}; this structure has "
                        f"x1 … x{self.dofs}, supports s1, s2, … and ground"
                    )
        pairs = [[number[node] for node in e.between] for e in self.elements.values()]
        return np.array(pairs, dtype=np.int64)

    def _check_held(self) -> None:
        joined: dict[int, list[int]] = {}
        for start, end in self.ends.tolist():
            joined.setdefault(start, []).append(end)
            joined.setdefault(end, []).append(start)
        held = set(range(self.dofs, self.dofs + self.supports + 1))
        reached = list(held)
        while reached:
            new = set(joined.get(reached.pop(), ())) - held
            held |= new
            reached += new
        loose = [f"x{i + 1}" for i in range(self.dofs) if i not in held]
        if loose:
            raise ValueError(
                f"disconnected structure: no chain of elements leads from {', '.join(loose)} "
                "to a support or ground; add an element or drop the mass"
            )

    @property
    def law(self) -> np.ndarray:
        """Law number of each element (E,)."""
        return np.array([e.law for e in self.elements.values()], dtype=np.int64)

    @property
    def parameters(self) -> np.ndarray:
        """Law parameters, padded with zeros, (E, P)."""
        rows = [e.parameters for e in self.elements.values()]
        table = np.zeros((len(rows), PARAMETERS))
        for row, values in zip(table, rows, strict=True):
            row[: len(values)] = values
        return table

    def incidence(self) -> tuple[np.ndarray, np.ndarray]:
        """B (E, n) and B_s (E, m) of y = B x + B_s s."""
        return incidence(self.ends, self.dofs, self.supports)

    def linearised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M [kg], C [N s/m], K [N/m], each (n, n), for small motions about rest."""
        B, _ = self.incidence()
        stiffness, damping = np.array([e.tangent() for e in self.elements.values()]).T
        return np.diag(self.masses), (B.T * damping) @ B, (B.T * stiffness) @ B

    def natural_frequencies(self) -> np.ndarray:
        """Undamped natural frequencies [Hz] of the linearised structure, ascending (n,)."""
        from scipy.linalg import eigh  # slow to import, seldom needed

        M, _, K = self.linearised()
        squares = eigh(K, M, eigvals_only=True)
        if squares[0] < -1e-9 * abs(squares[-1]):
            raise ValueError("the structure is unstable at rest: its stiffness has a negative mode")
        return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
