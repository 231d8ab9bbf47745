"""Masses, incidence and the linearised equation of motion of Eqs. 1 and 18."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from data import Polynomial
from data.simulation.structure import Structure

K0, C0 = 4.0 * np.pi**2, np.pi / 4.0


def spring(start: str, end: str, stiffness: float = 1.0) -> Polynomial:
    return Polynomial(between=(start, end), stiffness=stiffness)


def test_natural_frequencies_are_those_of_the_paper(structure):
    assert_allclose(structure.natural_frequencies(), [0.847, 1.630, 2.092], atol=5e-4)


def test_incidence_rows_are_those_of_eq_18(structure):
    B, B_s = structure.incidence()
    assert_array_equal(B, [[1, 0, 0], [-1, 1, 0], [-1, 0, 1], [0, -1, 1], [0, 0, -1], [0, 1, 0]])
    assert_array_equal(B_s, [[-1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 1], [0, -1, 0]])


def test_linearised_matrices_equal_those_by_hand(structure, system):
    M, C, K = structure.linearised()
    outer, inner = {
        "bilinear": (0.01, 0.1 * C0),
        "polynomial": (np.pi / 5, np.pi / 5),
        "bouc_wen": (0.0, 0.0),
    }[system]
    assert_array_equal(M, np.diag([0.8, 2.0, 1.2]))
    assert_allclose(K, K0 * np.array([[3, -1, -1], [-1, 3, -1], [-1, -1, 3]]), atol=1e-12)
    own = outer + 2 * inner
    by_hand = [[own, -inner, -inner], [-inner, own, -inner], [-inner, -inner, own]]
    assert_allclose(C, by_hand, atol=1e-15)


def test_a_uniform_chain_of_five_has_the_textbook_frequencies():
    nodes = ["s1", "x1", "x2", "x3", "x4", "x5"]
    springs = {f"r{i}": spring(nodes[i], nodes[i + 1], 30.0) for i in range(5)}
    structure = Structure([1.5] * 5, springs)
    modes = np.arange(1, 6)
    omega = 2.0 * np.sqrt(30.0 / 1.5) * np.sin((2 * modes - 1) * np.pi / 22.0)
    assert_allclose(structure.natural_frequencies(), omega / (2 * np.pi), rtol=1e-12)


def test_a_chain_stands_whichever_way_and_in_whichever_order_its_elements_are_given():
    links = [("s1", "x1"), ("x1", "x2"), ("x2", "x3"), ("x3", "x4")]
    rng = np.random.default_rng(0)
    for _ in range(20):
        shuffled = [links[i][:: rng.choice([1, -1])] for i in rng.permutation(4)]
        Structure([1.0] * 4, {f"r{i}": spring(*ends) for i, ends in enumerate(shuffled)})


@pytest.mark.parametrize(
    ("masses", "elements", "message"),
    [
        ([1.0, 1.0], {"r": spring("s1", "x1")}, "disconnected.* x2 "),
        ([1.0] * 3, {"r": spring("s1", "x1"), "q": spring("x2", "x3")}, "disconnected.* x2, x3 "),
        ([1.0, 1.0], {"r": spring("x1", "x2")}, "disconnected.* x1, x2 "),
        ([1.0, -2.0], {"r": spring("s1", "x1")}, "mass of x2 is -2 kg"),
        ([0.0], {"r": spring("s1", "x1")}, "mass of x1 is 0 kg"),
        ([np.nan], {"r": spring("s1", "x1")}, "mass of x1 is nan kg"),
        ([], {"r": spring("s1", "x1")}, "list of masses"),
        ([1.0], {"r": spring("s1", "x2")}, "element r joins the unknown node 'x2'"),
        ([1.0], {"r": spring("s0", "x1")}, "unknown node 's0'"),
        ([1.0], {"r": spring("wall", "x1")}, "unknown node 'wall'"),
        ([1.0], {}, "no elements"),
    ],
)
def test_a_structure_that_cannot_stand_is_refused(masses, elements, message):
    with pytest.raises(ValueError, match=message):
        Structure(masses, elements)
