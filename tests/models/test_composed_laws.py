"""Composed structures against known laws, the paper's systems and energy; settings refused."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data.record import Drive
from data.simulation.structure import Structure
from models.composition.coefficients import Composition, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import LINEAR, ElementLaws
from models.element_network import ElementNetwork
from tests.reference_networks import units

DT = 0.01

# Known laws


class Prescribed(Composite):
    """An element whose deformation is the support's: it pulls at nothing."""

    def __init__(self, stiffness: float, limit: float) -> None:
        super().__init__(1, 2, DT, substeps=1)
        self.laws = ElementLaws(1, 0, 1)
        each = torch.tensor([stiffness]).double()
        self.laws.start(each, 0.0 * each, torch.ones(1).double(), (0.5, 0.5))
        self.identified.fill_(1.0)
        self.laws.unit_stiffness.theta.data.fill_(1.0)
        self.laws.unit_limit.start(torch.tensor([[limit]]))

    def composition(self) -> Composition:
        numbering, zeros = Numbering(self), torch.zeros(2, 1, dtype=torch.float64)
        supports = torch.eye(2, dtype=torch.float64)[:, None, :]  # y = s, ẏ = ṡ
        return Composition(
            core=Part.fixed(zeros),
            inputs=Part.fixed(zeros.T),
            G=Part.fixed(zeros[:1]),
            D=Part.fixed(zeros[:1]),
            laws=self.laws.table(numbering),
            outputs=Part.fixed(torch.ones(1, 1, dtype=torch.float64)),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )


def test_an_elastoplastic_unit_encloses_the_area_of_the_bilinear_loop():
    """4 k z_y (y_max − z_y) of work is lost in a quasi-static cycle."""
    k, limit, largest = 50.0, 0.25, 1.0
    quarter = torch.linspace(0.0, largest, 401).double()
    way = torch.cat([quarter, quarter.flip(0), -quarter, -quarter.flip(0), quarter])
    rest = torch.zeros(1, dtype=torch.float64)
    drive = Drive(DT, torch.stack([way, torch.zeros_like(way)], dim=1), rest, rest)
    y, r = (s[:, 0] for s in Prescribed(k, limit).element_loops(drive))
    cycle = slice(400, None)  # from y_max back to y_max
    work = torch.trapezoid(r[cycle], y[cycle])
    assert float(work) == pytest.approx(4.0 * k * limit * (largest - limit), rel=1e-6)
    assert float(r.abs().max()) == pytest.approx(k * limit, rel=1e-12)


GROUNDED = [
    ["ground", "x1"],
    ["x1", "x2"],
    ["x1", "x3"],
    ["x2", "x3"],
    ["x3", "ground"],
    ["ground", "x2"],
]


def same_structure(structure: Structure, substeps: int) -> ElementNetwork:
    """The paper's structure (its supports at rest), element for element, in terms of learned laws.

    A unit whose weight is the stiffness itself, without a limit, is Bouc–Wen's law with z = r/A.
    """
    model = ElementNetwork(
        3, 3, DT, GROUNDED, structure.masses.tolist(), hinges=1, units=1, substeps=substeps
    )
    model.mass.start(torch.as_tensor(structure.masses))
    model.identified.fill_(1.0)
    model.laws.start(*torch.ones(3, 6).double(), (0.5, 0.5))
    for e, element in enumerate(structure.elements.values()):
        kind, stiffness = type(element).__name__, element.tangent()[0]
        cubic, hinge, gap, unit, limit, rising, falling = 0.0, 0.0, 1.0, 0.0, 1e3, 0.0, 0.0
        if kind == "Polynomial":
            cubic = element.cubic_stiffness
        elif kind == "Bilinear":
            unit, limit = stiffness - element.post_yield_stiffness, element.yield_displacement
        elif kind == "LimitedSlip":
            hinge, gap = element.gap_stiffness, element.gap
            unit, limit = stiffness, element.yield_displacement
        else:
            unit, rising = stiffness, -(element.beta - element.gamma)
            falling = -(element.beta + element.gamma)
        planted = {
            "stiffness": stiffness,
            "damping": element.tangent()[1],
            "cubic": cubic,
            "hinge_stiffness": hinge,
            "hinge_gap": gap,
            "unit_stiffness": unit,
            "unit_limit": limit,
            "unit_rising": rising,
            "unit_falling": falling,
        }
        for name, value in planted.items():
            part = getattr(model.laws, name)
            part.unit[e], part.theta.data[e] = value, 0.0 if part.positive else 1.0
    return model


def test_it_contains_the_papers_systems_and_converges_to_them_at_second_order(
    structure, excitation, record_of
):
    record = record_of(structure, excitation, 10.0)
    errors = []
    for substeps in (2, 4, 8):
        with torch.no_grad():
            run = same_structure(structure, substeps).free_run(record.drive())
        errors.append(float((run.a - record.a).norm() / record.a.norm()))
    assert errors[0] < 0.004
    slope = np.polyfit(np.log([2, 4, 8]), np.log(errors), 1)[0]
    assert -2.5 < slope < -1.7, errors


# Energy


def test_left_alone_a_dissipative_structure_never_gains_energy(bilinear_structure):
    """½ ẋᵀ M ẋ and what is stored: (k − w) y²/2 + w z²/2 and the hinges'."""
    model = same_structure(bilinear_structure, 1)
    rest = torch.zeros(3, dtype=torch.float64)
    v0 = torch.tensor([0.8, -0.5, 0.6]).double()
    drive = Drive(0.1 * DT, torch.zeros(4000, 3).double(), rest, v0)
    with torch.no_grad():
        motion, (y, _) = model.free_run(drive), model.element_loops(drive)
        table = model.composition().laws.value
        z, stored = torch.zeros(6, 1).double(), []
        for k in range(drive.samples):
            if k > 0:
                z = units(table, model.laws.counts, z, y[k] - y[k - 1])
            stored.append(z[:, 0])
        z = torch.stack(stored)
    k, weight, gap = table[:, 0], table[:, LINEAR + 2], table[:, LINEAR + 1]
    beyond = torch.relu(y.abs() - gap)
    potential = (k - weight) * y**2 + weight * z**2 + table[:, LINEAR] * beyond**2
    energy = 0.5 * ((motion.v**2) @ model.mass() + potential.sum(dim=-1))
    assert (energy[1:] - energy[:-1]).max() < 1e-4 * energy[0]
    assert energy[-1] < 0.1 * energy[0]
    assert (energy - torch.cummin(energy, dim=0).values).max() < 1e-3 * energy[0]
