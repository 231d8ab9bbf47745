"""Nodes and incidence: where an element ends its column is +1, where it starts −1."""

from __future__ import annotations

import numpy as np

from data.topology import incidence, node_numbers


def test_dofs_come_first_then_supports_then_ground():
    numbers = {"x1": 0, "x2": 1, "s1": 2, "ground": 3}
    assert node_numbers(2, 1) == numbers


def test_a_deformation_is_the_position_of_the_second_node_less_that_of_the_first():
    number = node_numbers(2, 1)
    pairs = [("ground", "x1"), ("x1", "x2"), ("x2", "s1")]
    ends = np.array([[number[node] for node in pair] for pair in pairs])
    B, B_s = incidence(ends, 2, 1)
    x, s = np.array([0.3, 0.5]), np.array([0.1])
    assert np.allclose(B @ x + B_s @ s, [0.3, 0.2, -0.4])
