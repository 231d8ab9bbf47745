"""Where a nonlinear element may sit: directions that explain what a model leaves of the outputs.

For a deformation y = D q of the present run, the forces φ(y, ẏ) of all terms act on all modes; the
effect of each is linear in its strength, so least squares says how much of the error they take
away. What the parameters that are there could make up for is projected out. Then the strengths
(J, K) are brought to one direction and one law, G wᵀ.   J modes, K terms, T samples, o outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.modal.layout import Layout
from models.modal.problem import Motion, State
from models.modal.run import blocks, exact_steps, outputs
from models.modal.run_compiled import driven, features
from models.modal.units_compiled import HINGE, TERMS, UNIT

MOST_ROWS = 12_000  # of the least squares; samples are left out evenly
RIDGE = 1e-6
HINGES, WIDTH = (0.35, -0.35), -2.0  # places and log width of hinges that are tried
UNITS = (0.7, 1.6, 2.5)  # β of units that are tried, with κ = 0
ALIKE = 0.9  # cosine of two directions that are one
RADII = (0.6, 0.3, 0.15)  # of directions around the best


@dataclass(frozen=True)
class Element:
    """A direction, the forces' direction, the coefficients of a law, the error that it leaves."""

    D: np.ndarray  # (J,)
    G: np.ndarray  # (J,)
    law: np.ndarray  # (L,)
    left: float  # share of the squared error


class ElementSearch:
    """The error of a model in training, and what elements would take of it."""

    def __init__(
        self, layout: Layout, state: State, motions: Sequence[Motion], learned: np.ndarray
    ) -> None:
        self.layout, self.motions = layout, motions
        self.parts = layout.split(state.values)
        rows = sum(motion.stop * layout.outputs for motion in motions)
        self.every = -(-rows // MOST_ROWS)
        self.states, errors, tangents = [], [], []
        for number, motion in enumerate(motions):
            begin = state.begins[number]
            states = outputs(layout, state.values, motion.excited, begin)[1]
            self.states.append(states[: motion.first + motion.stop, : 2 * layout.modes])
            last, own = motion.first + motion.stop, motion.unknown
            runs = list(blocks(layout, state.values, motion.excited, begin, learned, own, last))
            out, J = (np.concatenate([run[i] for run in runs])[motion.first :] for i in (0, 2))
            e = (motion.weight * (out - motion.y[: motion.stop]))[:: self.every]
            J = (motion.weight[:, None] * J)[:: self.every].reshape(e.size, -1)
            errors.append(e.ravel())
            tangents.append(J)
        self.basis = _orthogonal(tangents, int(learned.sum()))
        self.e = self._beyond(np.concatenate(errors))

    def _beyond(self, columns: np.ndarray) -> np.ndarray:
        """What the parameters that are there cannot make up for."""
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def largest(self, D: np.ndarray) -> float:
        """The largest deformation D q."""
        J = self.layout.modes
        return max(float(np.abs(states[:, :J] @ D).max()) for states in self.states)

    def directions(self, rng: np.random.Generator, count: int) -> list[np.ndarray]:
        """Directions (J,) of deformations up to 1: of the outputs, and a number of random ones."""
        if self.layout.modes == 1:
            drawn = [np.ones(1)]
        else:
            Cq, k = self.parts["Cq"], np.exp(self.parts["log_k"])
            drawn = [*Cq, *(Cq / k), *(self.parts["Cv"] / np.sqrt(k))]
            size = np.concatenate([s[:, : self.layout.modes] for s in self.states]).std(axis=0)
            drawn += list(rng.standard_normal((count, self.layout.modes)) / size)
        return [D / self.largest(D) for D in drawn if self.largest(D) > 0.0]

    def near(self, D: np.ndarray, radius: float, rng: np.random.Generator) -> np.ndarray:
        """A direction near another."""
        size = np.concatenate([s[:, : self.layout.modes] for s in self.states]).std(axis=0)
        moved = D + radius * np.linalg.norm(D * size) / np.sqrt(
            len(D)
        ) / size * rng.standard_normal(len(D))
        return moved / self.largest(moved)

    def effects(self, D: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normal equations (J·K, J·K), (J·K,) of all strengths, and which term (K,) is which."""
        J, o = self.layout.modes, self.layout.outputs
        found = []
        for motion, states in zip(self.motions, self.states, strict=True):
            y, rate = states[:, :J] @ D, states[:, J:] @ D
            phi = features(y, rate, np.array(HINGES), WIDTH, np.array(UNITS))
            core = exact_steps(self.parts["log_k"], self.parts["log_c"], motion.excited.dt)
            moved = driven(np.ascontiguousarray(core[:, 0]), phi, motion.first, self.every)
            weighted = [motion.weight[:, None] * self.parts[name] for name in ("Cq", "Cv")]
            A = np.einsum("oj,tjk->tojk", weighted[0], moved[..., 0])  # (rows, o, J, K)
            A += np.einsum("oj,tjk->tojk", weighted[1], moved[..., 1])
            found.append(A.reshape(len(moved) * o, -1))
        A = self._beyond(np.concatenate(found))
        kinds = np.r_[np.arange(TERMS), np.full(len(HINGES), -1), np.full(len(UNITS), -2)]
        return A.T @ A, A.T @ self.e, kinds

    def element(self, D: np.ndarray, effects: tuple[np.ndarray, ...], terms: np.ndarray) -> Element:
        """One element of direction D with the terms (K,) that are allowed."""
        gram, right, kinds = effects
        J, K = self.layout.modes, len(kinds)
        chosen = np.tile(terms, J)
        gram, right = gram[np.ix_(chosen, chosen)], right[chosen]
        size = np.sqrt(gram.diagonal().clip(1e-30))
        scaled = gram / size / size[:, None] + RIDGE * np.eye(len(size))
        strengths = np.linalg.solve(scaled, right / size) / size
        # one law: terms are weighed by their own effects
        by_term = size.reshape(J, -1).max(axis=0)
        U, s, V = np.linalg.svd(strengths.reshape(J, -1) * by_term)
        g, w = U[:, 0], s[0] * V[0] / by_term
        blocks4 = (gram + RIDGE * np.diag(size**2)).reshape(J, terms.sum(), J, terms.sum())
        rows = right.reshape(J, -1)
        for _ in range(20):  # in turns, to the best product of both
            w = np.linalg.lstsq(np.einsum("jkli,j,l->ki", blocks4, g, g), g @ rows, rcond=1e-12)[0]
            g = np.linalg.lstsq(np.einsum("jkli,k,i->jl", blocks4, w, w), rows @ w, rcond=1e-12)[0]
            scale = np.abs(g).max()
            g, w = g / max(scale, 1e-300), w * scale
        x = np.outer(g, w).ravel()
        total = float(self.e @ self.e)
        left = (total - 2.0 * float(x @ right) + float(x @ gram @ x)) / total
        whole = np.zeros(K)
        whole[terms] = w
        return Element(D, g, self._law(whole), left)

    def _law(self, weights: np.ndarray) -> np.ndarray:
        """Coefficients (L,) of a law with these strengths of the terms that were tried."""
        law = np.zeros(self.layout.law)
        law[:TERMS] = weights[:TERMS]
        for h in range(self.layout.hinges):
            at, places = TERMS + HINGE * h, HINGES
            law[at + 1], law[at + 2] = places[h % len(places)] * (1.0 + h // len(places)), WIDTH
            law[at] = weights[TERMS + h] if h < len(HINGES) else 0.0
        for unit in range(self.layout.units):
            at = TERMS + HINGE * self.layout.hinges + UNIT * unit
            law[at + 1] = UNITS[unit % len(UNITS)]
            law[at] = weights[TERMS + len(HINGES) + unit] if unit < len(UNITS) else 0.0
        return law

    def best(
        self, families: Sequence[str], rng: np.random.Generator, count: int
    ) -> dict[str, list[Element]]:
        """Elements of each family of laws, the best first; directions around the best are tried."""
        tried = [(D, self.effects(D)) for D in self.directions(rng, count)]
        found: dict[str, list[Element]] = {}
        for family in families:
            terms = self._terms(family, tried[0][1][2])
            some = [self.element(D, effects, terms) for D, effects in tried]
            some.sort(key=lambda one: one.left)
            for radius in RADII if self.layout.modes > 1 else ():
                for _ in range(count // 3):
                    D = self.near(some[0].D, radius, rng)
                    some.append(self.element(D, self.effects(D), terms))
                some.sort(key=lambda one: one.left)
            found[family] = self.apart(some)
        return found

    def apart(self, elements: list[Element]) -> list[Element]:
        """Of elements in their order those whose deformations differ from all before."""
        size = np.concatenate([s[:, : self.layout.modes] for s in self.states]).std(axis=0)
        kept: list[Element] = []
        for element in elements:
            D = element.D * size / np.linalg.norm(element.D * size)
            others = [one.D * size / np.linalg.norm(one.D * size) for one in kept]
            if all(abs(float(D @ other)) < ALIKE for other in others):
                kept.append(element)
        return kept

    def _terms(self, family: str, kinds: np.ndarray) -> np.ndarray:
        """Which of the terms that are tried (K,) a family has."""
        has, own = self.layout.has(family), self.layout.kinds
        return np.array([bool(has[own == kind].any()) for kind in kinds])


def _orthogonal(tangents: list[np.ndarray], P: int) -> np.ndarray:
    """What P parameters, and each motion's own first state, can do to the errors of all motions.

    tangents: derivatives (rows, P + S or P) of each motion. Returns orthonormal columns.
    """
    own = [J.shape[1] - P for J in tangents]
    whole = np.zeros((sum(len(J) for J in tangents), P + sum(own)))
    row, column = 0, P
    for J, S in zip(tangents, own, strict=True):
        rows = slice(row, row + len(J))
        whole[rows, :P], whole[rows, column : column + S] = J[:, :P], J[:, P:]
        row, column = row + len(J), column + S
    size = np.linalg.norm(whole, axis=0)
    seen = size > 1e-12 * size.max()
    basis, triangle = np.linalg.qr(whole[:, seen] / size[seen])
    basis[:, np.abs(triangle.diagonal()) < 1e-9] = 0.0
    return np.asarray(basis)
