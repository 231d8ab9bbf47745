"""Multilayer perceptrons: sizes, formulas, what an estimate may see, a planted network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from data.record import Record
from models.fit.problem import Problem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.layers.perceptron import Perceptron
from models.mlp import GlobalMLP, ResidualMLP

MODELS = {"global": GlobalMLP, "residual": ResidualMLP}
NUMPY = {
    "tanh": np.tanh,
    "sigmoid": lambda z: 1.0 / (1.0 + np.exp(-z)),
    "relu": lambda z: np.maximum(z, 0.0),
    "silu": lambda z: z / (1.0 + np.exp(-z)),
}


def motion(dofs: int, forces: int | None = None, samples: int = 120, seed: int = 0) -> Record:
    """Random motion of masses on cubic springs to the ground; f drives the first masses."""
    rng = np.random.default_rng(seed)
    forces = dofs if forces is None else forces
    x, v = 0.3 * rng.standard_normal((2, samples, dofs))
    f = rng.standard_normal((samples, forces))
    a = -(4.0 + np.arange(dofs)) * x - 0.2 * v - 9.0 * x**3
    a[:, : min(dofs, forces)] += f[:, :dofs]
    a, f, x, v = map(torch.from_numpy, (a, f, x, v))
    return Record(dt=0.01, a=a, f=f, x=x, v=v)


def identified(model: str, record: Record, seed: int = 0, **choices) -> GlobalMLP | ResidualMLP:
    """Closed form done, weights as they start."""
    torch.manual_seed(seed)
    estimator = MODELS[model](record.dofs, record.excitation.shape[-1], record.dt, **choices)
    estimator.identify([record])
    return estimator


def scale_by(u: np.ndarray, of: np.ndarray) -> np.ndarray:
    low, high = of.min(axis=0), of.max(axis=0)
    return 2.0 * (u - low) / (high - low) - 1.0


def numpy_network(net: Perceptron, activation: str, u: np.ndarray) -> np.ndarray:
    """The layers alone: scaled inputs → scaled outputs."""
    weights = [p.detach().numpy() for p in net.parameters()]
    *hidden, (W_out, b_out) = list(zip(weights[::2], weights[1::2], strict=True))
    for W, b in hidden:
        u = NUMPY[activation](u @ W.T + b)
    return u @ W_out.T + b_out


def numpy_linear(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Columns [ẋ, x, f] and the acceleration that least squares makes of them."""
    state = np.concatenate([record.v, record.x, record.f], axis=1)
    return state, state @ np.linalg.lstsq(state, record.a.numpy(), rcond=None)[0]


def unscale(u: np.ndarray, of: np.ndarray) -> np.ndarray:
    low, high = of.min(axis=0), of.max(axis=0)
    return low + (high - low) * (u + 1.0) / 2.0


# sizes


def test_the_papers_networks_have_243_weights_and_27_of_the_linear_system():
    """12-15-3: 12·15 + 15 + 15·3 + 3; 9-10-10-3: 9·10 + 10 + 10·10 + 10 + 10·3 + 3."""
    residual, whole = ResidualMLP(3, 3, 0.01), GlobalMLP(3, 3, 0.01)
    assert residual.identified_parameters == 243 + 27
    assert whole.identified_parameters == 243
    for estimator in residual, whole:
        assert sum(p.numel() for p in estimator.parameters() if p.requires_grad) == 243


# formulas


@pytest.mark.parametrize("activation", NUMPY)
def test_the_global_network_is_its_formula(activation):
    record, unseen = motion(2), motion(2, seed=9)
    estimator = identified("global", record, hidden=(5, 3, 2), activation=activation)
    columns = [np.concatenate([r.x, r.v, r.f], axis=1) for r in (record, unseen)]
    scaled = numpy_network(estimator.network, activation, scale_by(columns[1], of=columns[0]))
    wanted = unscale(scaled, of=record.a.numpy())
    assert np.allclose(estimator(unseen).detach(), wanted, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("activation", NUMPY)
def test_the_residual_network_is_its_formula(activation):
    record = motion(2)
    estimator = identified("residual", record, hidden=(5, 3), activation=activation)
    state, linear = numpy_linear(record)
    residual = linear - record.a.numpy()
    delayed = np.concatenate([np.zeros((1, 2)), residual[:-1]])
    columns = np.concatenate([state, delayed], axis=1)
    scaled = numpy_network(estimator.network, activation, scale_by(columns, of=columns))
    wanted = linear - unscale(scaled, of=residual)
    assert np.allclose(estimator(record).detach(), wanted, rtol=0.0, atol=1e-11)


def test_its_own_residual_is_fed_back_sample_by_sample():
    record = motion(2)
    estimator = identified("residual", record)
    state, linear = numpy_linear(record)
    residual = linear - record.a.numpy()
    columns = np.concatenate([state, [[0.0, 0.0], *residual[:-1]]], axis=1)
    own, wanted = np.zeros(2), []
    for k in range(record.samples):
        u = scale_by(np.concatenate([state[k], own]), of=columns)
        own = unscale(numpy_network(estimator.network, "tanh", u), of=residual)
        wanted.append(linear[k] - own)
    estimates = estimator.estimates(record)
    assert np.allclose(estimates["own_residual"].detach(), wanted, rtol=0.0, atol=1e-11)
    assert not np.allclose(estimates[""].detach(), wanted, rtol=0.0, atol=1e-3)


# what an estimate may see


def changed_samples(estimator: nn.Module, record: Record, way: str, name: str) -> list[int]:
    """Samples of an estimate that change with sample 50 of a signal."""
    other = record.map(lambda u: u.clone())
    getattr(other, name)[50] += torch.tensor([0.4, -0.7])
    difference = estimator.estimates(other)[way] - estimator.estimates(record)[way]
    return torch.nonzero(difference.abs().amax(dim=-1)).flatten().tolist()


def test_the_residual_network_sees_the_acceleration_of_the_sample_before_alone():
    estimator = identified("residual", motion(2))
    seen = {name: changed_samples(estimator, motion(2), "", name) for name in "axvf"}
    assert seen == {"a": [51], "x": [50, 51], "v": [50, 51], "f": [50, 51]}


# planting


def planted(record: Record) -> tuple[GlobalMLP, Record]:
    """A network with random weights, and the record whose acceleration it is."""
    truth = identified("global", record, hidden=(4,))
    with torch.no_grad():
        for p in truth.network.parameters():
            p.copy_(torch.randn_like(p))
    return truth, replace(record, a=truth(record).detach())


def equivalent(truth: GlobalMLP, record: Record) -> GlobalMLP:
    """The same function, its last layer in the scale of the planted acceleration."""
    estimator = identified("global", record, hidden=(4,))
    estimator.network.layers.load_state_dict(truth.network.layers.state_dict())
    old, new = truth.network.output_scale, estimator.network.output_scale
    layer = estimator.network.layers[-1]
    with torch.no_grad():
        layer.weight *= (old.reach / new.reach)[:, None]
        layer.bias.copy_((old.inverse(layer.bias) - new.centre) / new.reach)
    return estimator


def relative_error(estimate: Tensor, wanted: Tensor) -> float:
    return float((estimate.detach() - wanted).norm() / wanted.norm())


def test_a_planted_network_is_found_from_a_start_nearby():
    truth, record = planted(motion(2, samples=200))
    estimator = equivalent(truth, record)
    with torch.no_grad():
        for p in estimator.network.parameters():
            p.add_(0.05 * torch.randn_like(p))
    assert relative_error(estimator(record), record.a) > 1e-2
    free = estimator.network.parameters()
    solver = LevenbergMarquardt(free, iterations=200, gradient=0.0)
    while not solver.finished and relative_error(estimator(record), record.a) > 1e-10:
        solver.solve(Problem(estimator, record))
    assert relative_error(estimator(record), record.a) < 1e-8
    unseen = motion(2, seed=5)
    assert relative_error(estimator(unseen), truth(unseen).detach()) < 1e-6
