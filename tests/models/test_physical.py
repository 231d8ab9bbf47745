"""The physical parameters of models: those that were planted, in their units, by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from data import Bilinear, Drive, Record
from data.simulation.element_test import force, growing_cycles
from data.simulation.laws.candidate import Units
from export.modes import modes_of
from models import BranchElement, ElementNetwork, EquivalentLinear, LinearMotion
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit
from models.named_laws.learned import named_law
from tests.models.zoo import DT, ESTIMATORS
from tests.reference_networks import units


def named(model):
    return {p.name: p for p in model.physical_parameters()}


def started(model, stiffness, damping, largest):
    model.laws.start(
        *(torch.as_tensor(t).double() for t in (stiffness, damping, largest)), (0.5,) * 2
    )
    model.identified.fill_(1.0)
    return model


def network(dofs=2, **more):
    """A chain of bilinear elements: k = 100, 200, …; half of it yields at 10 mm."""
    model = ElementNetwork(dofs, dofs, 0.01, elements="chain", hinges=1, units=1, **more)
    E = len(model.elements)
    k = 100.0 * (1.0 + torch.arange(E))
    started(model, k, 0.5 * torch.ones(E), 0.05 * torch.ones(E))
    model.mass.start(2.0 + torch.arange(dofs).double())
    laws = model.laws
    laws.unit_stiffness.start(0.5 * k[:, None].double(), 1.0)
    laws.unit_limit.start(torch.full((E, 1), 0.01).double())
    laws.hinge_stiffness.start(3.0 * k[:, None].double(), 1.0)
    laws.hinge_gap.start(torch.full((E, 1), 0.03).double())
    return model


@pytest.mark.parametrize("dofs", [1, 30])
def test_an_element_network_has_masses_and_laws_in_words(dofs):
    found = named(network(dofs))
    last = f"r{dofs}"
    assert found[f"x{dofs}.mass"].value == pytest.approx(1.0 + dofs)
    assert found[f"x{dofs}.mass"].unit == "kg"
    expected = {
        "stiffness": (100.0 * dofs, "N/m"),
        "damping": (0.5, "N s/m"),
        "yield_displacement": (0.01, "m"),
        "yield_force": (dofs * 1.0, "N"),
        "post_yield_ratio": (0.5, ""),
        "gap": (0.03, "m"),
        "hinge_1.stiffness": (300.0 * dofs, "N/m"),
        "unit_1.yield_force": (0.5 * dofs, "N"),
    }
    for name, (value, unit) in expected.items():
        assert found[f"{last}.{name}"].value == pytest.approx(value), name
        assert found[f"{last}.{name}"].unit == unit, name
    assert found["r1.stiffness"].about == "ground–x1"
    assert found["r1.yield_force"].derived
    assert not found["r1.stiffness"].derived
    assert len(found) == len(network(dofs).physical_parameters())  # no name twice


def test_a_rounded_unit_yields_where_it_tends_to_and_not_at_a_limit_that_it_never_reaches():
    """A slow push past all limits bears the forces that are told."""
    model = network(1)
    own = model.laws
    with torch.no_grad():
        own.hinge_stiffness.theta.zero_()
        own.unit_limit.theta.add_(math.log(20.0))  # from 0.01 m to 0.2 m
        own.unit_rising.start(torch.full((1, 1), -125.0, dtype=torch.float64), 1.0)
    found = named(model)
    k = found["r1.stiffness"].value
    assert found["r1.yield_displacement"].value == pytest.approx(0.008)
    assert found["r1.yield_force"].value == pytest.approx(0.008 * k)
    strength = found["r1.unit_1.yield_force"].value
    assert strength == pytest.approx(0.008 * found["r1.unit_1.stiffness"].value)
    push = torch.full((800, 1), 5e-5, dtype=torch.float64)
    z, laws = torch.zeros(1, 1, dtype=torch.float64), model.composition().laws.value.detach()
    for step in push:
        z = units(laws, own.counts, z, step)
    assert float(z[0, 0]) * found["r1.unit_1.stiffness"].value == pytest.approx(strength, rel=0.01)


def test_sides_of_a_law_that_differ_are_told_one_by_one():
    """In newtons, forward and backward, as an element that is pushed far each way bears them."""
    law = CANDIDATES["UnevenBoucWen"]
    scales = Units(length=0.03, rate=0.05, force=1e5, slope=3e7)
    values = {"stiffness": 3e7, "largest": 0.0026, "damping": 1.0, "uneven": 1.67,
              "above_one": 19.0}  # fmt: skip
    q = law.with_values(np.full(len(law.parameters), -12.0), values, scales)
    fit = Fit(law, scales, q)
    found = {p.name: p.value for p in named_law(fit, "r1", "")}
    for side, way in (("forward", 1.0), ("backward", -1.0)):
        y = way * np.linspace(0.0, 0.02, 400)
        r = sum(force(part, y, 0.01) for part in fit.candidate.elements(q, scales))
        assert found[f"r1.yield_force_{side}"] == pytest.approx(abs(r[-1]), rel=0.01)
    assert "r1.yield_force" not in found


def test_a_branch_law_is_told_by_a_slow_push():
    """What is told of it is what the model does itself when it is pushed."""
    dt, law = 0.01, Bilinear(
        between=("ground", "x1"), yield_displacement=0.02, stiffness=50.0, post_yield_stiffness=5.0
    )  # fmt: skip
    y = growing_cycles(0.1, 4, dt, 0.5)
    rate = np.gradient(y, dt)
    s, s_dot, r = (torch.from_numpy(u)[:, None] for u in (y, rate, force(law, y, dt, rate)))
    model = BranchElement(1, 2, dt, 2, 0, False, 0.0, 1)
    model.identify([Record(dt, r, s[:, :0], s=s, s_dot=s_dot, quantity="force")])
    found = named(model)
    Y = found["r1.largest_deformation"].value
    assert pytest.approx(np.abs(y).max()) == Y
    push = torch.linspace(0.0, Y, 401, dtype=torch.float64)[:, None]
    slow = torch.cat([push, 1e-9 * torch.ones_like(push)], dim=1)
    rest = torch.zeros(1, dtype=torch.float64)
    with torch.no_grad():
        runs = [model.free_run(Drive(dt, way * slow, rest, rest)).a[:, 0] for way in (1, -1)]
    pushed = 0.5 * (runs[0] - runs[1])
    assert found["r1.force_there"].value == pytest.approx(float(pushed[-1]), rel=1e-3)
    assert found["r1.stiffness"].value == pytest.approx(float(pushed[20]) / (0.05 * Y), rel=0.02)
    assert 0.5 < found["r1.yield_displacement"].value / 0.02 < 2.0  # where it starts, untrained


def test_linear_models_tell_what_a_motion_tells():
    model = EquivalentLinear(2, 2, 0.01)
    model.weights.data = torch.tensor(
        [[-0.1, 0.0], [0.0, -0.2], [-4.0, 1.0], [1.0, -9.0], [0.5, 0.0], [0.0, 1.0]]
    ).double()
    found = named(model)
    assert found["x1.stiffness_by_mass.x1"].value == pytest.approx(4.0)
    assert found["x2.stiffness_by_mass.x1"].value == pytest.approx(-1.0)
    assert found["x2.damping_by_mass.x2"].value == pytest.approx(0.2)
    motion = LinearMotion(2, 2, 0.01)
    motion.system = model
    assert [p.name for p in motion.physical_parameters()] == list(found)


def test_every_estimator_has_parameters_by_names_of_their_own(bilinear_record):
    """Of every model that a second identifies: finite values, no name twice, modes where due."""
    for name, make in ESTIMATORS.items():
        model = make(3, 3, DT)
        model.identify([bilinear_record])
        found = model.physical_parameters()
        assert len({p.name for p in found}) == len(found), name
        assert all(math.isfinite(p.value) for p in found), name
        assert (modes_of(model) is not None) == (name == "linear" or "element" in name), name
