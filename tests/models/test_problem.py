"""What a solver minimises: Eq. 21 squared, and normal equations against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

import models.fit.problem
from data.record import Record, Truth, stack
from data.windows import WindowDataset
from models.element_network import ElementNetwork
from models.estimator import Estimator
from models.fit.problem import FreeRunProblem, Problem
from models.fit.trainable import Trainable
from models.mlp import GlobalMLP, ResidualMLP


class OnePole(Trainable):
    """y[k] = p y[k−1] + g f[k] for every mass: an estimate that remembers the whole past."""

    reads = ("f",)

    def __init__(self, dofs: int, inputs: int, dt: float) -> None:
        super().__init__(dofs, inputs, dt)
        self.pole = nn.Parameter(torch.tensor(0.6, dtype=torch.float64))
        self.frozen = nn.Parameter(torch.tensor(1.1, dtype=torch.float64), requires_grad=False)
        self.gain = nn.Parameter(torch.tensor([[0.5], [0.8]], dtype=torch.float64))

    def forward(self, record: Record) -> Tensor:
        assert record.truth is None
        y, history = torch.zeros_like(record.f[..., 0, :]), []
        for k in range(record.samples):
            y = self.pole * y + self.frozen * self.gain[:, 0] * record.f[..., k, :]
            history.append(y)
        return torch.stack(history, dim=-2)


MODELS = {
    "global": lambda: GlobalMLP(2, 2, 0.01, hidden=(3, 2)),
    "residual": lambda: ResidualMLP(2, 2, 0.01, hidden=(3,)),
    "one_pole": lambda: OnePole(2, 2, 0.01),
}


def motion(samples: int = 30, seed: int = 0) -> Record:
    """Random motion of two masses on cubic springs."""
    x, v, f = torch.from_numpy(np.random.default_rng(seed).standard_normal((3, samples, 2)))
    a = f - 4.0 * x - 0.3 * v - 2.0 * x**3
    return Record(dt=0.01, a=a, f=f, x=x, v=v, truth=Truth(x, v, a, x, x))


def windows() -> Record:
    """A batch of windows that warm up for some samples."""
    return stack(list(WindowDataset([motion(), motion(seed=1)], 12, warmup=4)))


RECORDS = {"record": motion, "warming_up": lambda: replace(motion(), warmup=7), "windows": windows}
PAIRS = [("global", "warming_up"), ("residual", "windows"), ("one_pole", "windows")]


def identified(model: str, record: Record) -> Estimator:
    torch.manual_seed(3)
    estimator = MODELS[model]()
    estimator.identify([record])
    return estimator


def free_of(estimator: Estimator) -> list[nn.Parameter]:
    return [p for p in estimator.parameters() if p.requires_grad]


def jacobian(estimator: Estimator, problem: Problem, step: float = 1e-6) -> np.ndarray:
    """∂e/∂θ (N, P) by central differences."""
    free, columns = free_of(estimator), []
    here = parameters_to_vector(free).detach().clone()
    with torch.no_grad():
        for unit in torch.eye(here.numel(), dtype=here.dtype):
            sides = []
            for sign in (1.0, -1.0):
                vector_to_parameters(here + sign * step * unit, free)
                sides.append(problem.errors().numpy())
            columns.append((sides[0] - sides[1]) / (2.0 * step))
        vector_to_parameters(here, free)
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("block", [1, 60, 1 << 22])
@pytest.mark.parametrize(("model", "kind"), PAIRS)
def test_normal_equations_are_those_of_finite_differences(model, kind, block, monkeypatch):
    """In blocks of one sample or parameter, of some, and of all."""
    monkeypatch.setattr(models.fit.problem, "BLOCK_ELEMENTS", block)
    record = RECORDS[kind]()
    estimator = identified(model, record)
    problem = Problem(estimator, record)
    J, e = jacobian(estimator, problem), problem.errors().detach().numpy()
    matrix, vector = problem.normal_equations()
    assert matrix.shape == (J.shape[1], J.shape[1])
    assert np.allclose(matrix, J.T @ J, rtol=0.0, atol=1e-7 * np.abs(J.T @ J).max())
    assert np.allclose(vector, J.T @ e, rtol=0.0, atol=1e-7 * np.abs(J.T @ e).max())


@pytest.mark.parametrize("model", MODELS)
def test_the_truth_of_a_simulation_is_not_looked_at(model):
    record = motion()
    estimator = identified(model, record)
    lies = replace(record, truth=Truth(*(torch.full_like(record.a, torch.nan) for _ in range(5))))
    losses = [float(Problem(estimator, r).loss().detach()) for r in (record, lies)]
    assert losses[0] == losses[1]


@pytest.mark.parametrize("model", MODELS)
def test_a_structure_at_rest_has_nothing_to_fit(model):
    """Also where it moves only in samples that are not counted."""
    estimator = identified(model, motion())
    record = replace(motion(), warmup=5)
    for moving in (0, 5):
        a = record.a.clone()
        a[moving:] = 0.0
        with pytest.raises(ValueError, match="measured acceleration is zero"):
            Problem(estimator, replace(record, a=a))


def test_records_one_after_the_other_give_the_normal_equations_of_all(
    monkeypatch, bilinear_records
):
    model = ElementNetwork(3, 3, 0.01, "chain", hinges=1, units=1)
    batch = stack([record.window(0, 200) for record in bilinear_records[:3]])
    model.identify([batch])
    together = FreeRunProblem(model, batch, None).normal_equations(2)
    monkeypatch.setattr(models.fit.problem, "MOST_DERIVATIVES", 1)
    apart = FreeRunProblem(model, batch, None).normal_equations(2)
    for one, other in zip(together, apart, strict=True):
        assert torch.allclose(one, other, rtol=1e-9, atol=1e-12 * float(one.abs().max()))
