"""What is minimised of a modal network: its slopes are those of its loss, motion by motion."""

from __future__ import annotations

import numpy as np
import torch

from models.modal.problem import ModalProblem, Motion, State
from tests.models.test_modal_network import excited, layout_and_values

STEP = 1e-3  # the loss is a number of single precision


def test_normal_equations_are_the_slope_of_the_loss_by_parameters_and_every_first_state():
    """Two motions begin unknown and one at rest between them; a prior pulls at the parameters."""
    layout, values = layout_and_values(2, 1)
    rng = np.random.default_rng(3)
    motions = [
        Motion(excited(n), rng.standard_normal((n, 2)), np.array([1.0, 0.5]), unknown, n - 20)
        for n, unknown in ((120, True), (90, False), (150, True))
    ]
    begins = np.zeros((3, layout.states))
    begins[[0, 2]] = 0.2 * rng.standard_normal((2, layout.states))
    learned = rng.random(layout.size) < 0.7
    problem = ModalProblem(layout, motions, State(values, begins), learned, prior=0.1)
    matrix, vector = problem.normal_equations()
    numbers = [problem.theta.data, problem.own[0]]
    assert len(vector) == len(matrix) == sum(map(len, numbers))
    found = []
    for part in numbers:
        for i in range(len(part)):
            sides, here = [], float(part[i])
            for step in (STEP, -STEP):
                part[i] = here + step
                sides.append(float(problem.loss()))
            part[i] = here
            found.append((sides[0] - sides[1]) / (2.0 * STEP))
    wanted = torch.tensor(found).double()
    slope = 2.0 / len(problem.y) * vector
    assert torch.allclose(slope, wanted, atol=1e-3 * float(wanted.abs().max()))
