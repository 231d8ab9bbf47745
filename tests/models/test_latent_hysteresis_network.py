"""Latent hysteresis networks: modes of the linear system, then directions and laws by training."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data import BoucWen
from data.record import Record, stack
from models.latent_hysteresis_network import LatentHysteresisNetwork
from tests.models.test_element_network import (
    DT,
    FORCES,
    MASSES,
    chain,
    free_run_error,
    linear,
    train,
)


def identified(record: Record, **choices) -> LatentHysteresisNetwork:
    few = {"elements": 8, "hinges": 2, "units": 2}
    model = LatentHysteresisNetwork(2, 2, DT, **(few | choices))
    model.identify([record])
    return model


def without_dampers(model: LatentHysteresisNetwork) -> LatentHysteresisNetwork:
    """All damping given to the modes."""
    with torch.no_grad():
        model.damping.start(modal_damping(model))
    model.laws.damping.unit.zero_()
    return model


def modal_damping(model: LatentHysteresisNetwork) -> torch.Tensor:
    """Diagonal of the damping matrix: the modes' own and the elements' share."""
    return model.damping() + (model.directions() ** 2).T @ model.laws.damping()


@pytest.fixture(scope="module")
def linear_motion(record_of) -> Record:
    return record_of(linear(damping=0.5), FORCES, 10.0)


@pytest.fixture(scope="module")
def hysteretic_motion(record_of) -> Record:
    first = BoucWen(between=("ground", "x1"), stiffness=40.0, beta=10.0, gamma=-10.0)
    return stack([record_of(chain(first), FORCES, 10.0, seed) for seed in range(2)])


def test_a_linear_structure_is_reproduced_without_training(linear_motion):
    model = without_dampers(identified(linear_motion, substeps=8))
    assert free_run_error(model, linear_motion) < 1e-3


def test_its_modes_are_those_of_the_structure(linear_motion):
    model = identified(linear_motion)
    shapes, squares, damping = model.shapes(), model.stiffness(), modal_damping(model)
    M, C, K = (torch.from_numpy(matrix) for matrix in linear(damping=0.5).linearised())
    assert torch.allclose(shapes.T @ M @ shapes, torch.eye(2).double(), atol=1e-6)
    assert torch.allclose(shapes.T @ K @ shapes, squares.diag(), atol=1e-4)
    assert torch.allclose(damping, (shapes.T @ C @ shapes).diagonal(), atol=1e-6)
    assert torch.allclose(model.inputs_to(), shapes.T, atol=1e-6)
    assert M.diagonal().tolist() == MASSES


def test_one_hysteretic_spring_is_found_by_training(hysteretic_motion):
    model = identified(hysteretic_motion, elements=2, hinges=0, units=1, cubic=False)
    before = free_run_error(model, hysteretic_motion)
    train(model, hysteretic_motion, 20, None, iterations=25)
    assert before > 0.1
    assert free_run_error(model, hysteretic_motion) < 0.1 * before


def test_left_alone_it_comes_to_rest(linear_motion):
    model = identified(linear_motion)
    model.laws.unit_stiffness.theta.data += 0.02
    drive = linear_motion.drive()
    pushed = replace(drive, u=torch.zeros(6000, 2).double(), v0=torch.tensor([0.3, -0.2]).double())
    with torch.no_grad():
        v = model.free_run(pushed).v
    assert v[-500:].abs().max() < 0.05 * v[:500].abs().max()


@pytest.mark.parametrize("wrong", [{"elements": 0}, {"units": -1}, {"substeps": 0}])
def test_a_network_that_cannot_be_built_is_refused(wrong):
    (name, value), *_ = wrong.items()
    with pytest.raises(ValueError, match=f"{name}={value}"):
        LatentHysteresisNetwork(2, 2, DT, **wrong)


@pytest.mark.parametrize("signal", ["f", "a"])
def test_a_record_of_which_nothing_moves_is_refused(linear_motion, signal):
    silent = replace(linear_motion, **{signal: 0.0 * getattr(linear_motion, signal)})
    with pytest.raises(ValueError, match="zero throughout every record"):
        identified(silent)


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_one_kind_of_sensor_is_enough_to_start_from(linear_motion, quantity):
    """Modes from filtered signals alone; the free run is close before any training."""
    signal = {"acceleration": "a", "displacement": "x", "velocity": "v"}[quantity]
    seen = getattr(linear_motion, signal)
    model = identified(replace(linear_motion, a=seen, x=None, v=None, quantity=quantity))
    with torch.no_grad():
        run = model.free_run(linear_motion.drive())
    assert (run.a - seen).norm() < 0.05 * seen.norm()
    assert (run.x - linear_motion.x).norm() < 0.05 * linear_motion.x.norm()


def test_all_damping_is_positive_whatever_the_parameters(linear_motion):
    model = identified(linear_motion)
    for part in (model.damping, model.stiffness, model.laws.damping, model.laws.unit_limit):
        part.theta.data -= 5.0
        assert (part() > 0.0).all()
