"""Networks of elements with drawn laws, at any size: an export needs no identification."""

from __future__ import annotations

import numpy as np
import torch

from data import BaberNoori, FrictionPendulum, MenegottoPinto, Takeda
from data.simulation.laws.candidate import Units
from data.simulation.laws.element import Element
from data.simulation.structure import Structure
from models.element_network import ElementNetwork
from models.element_network_branch import ElementNetworkBranch
from models.element_network_named import ElementNetworkNamed
from models.hysteretic_element import HystereticElement
from models.latent_hysteresis_network import LatentHysteresisNetwork
from models.named_laws.candidates import CANDIDATES

DT = 0.01


def drawn_laws(model, stiffness: float, largest: float) -> None:
    """Laws with hinges and units that all act."""
    generator = torch.Generator().manual_seed(1)
    E = len(model.laws.stiffness.theta)
    k = torch.full((E,), stiffness).double() / (1.0 + 0.1 * torch.arange(E))
    with torch.no_grad():
        model.identified.fill_(1.0)
        model.laws.start(k, 2e-3 * k, torch.full((E,), largest).double(), (0.5, 0.5))
        for c in model.laws.modules():
            if hasattr(c, "theta"):
                more = torch.randn(c.theta.shape, generator=generator, dtype=torch.float64)
                c.theta.add_(0.1 * more)


def network(dofs: int, elements: str = "chain", **choices) -> ElementNetwork:
    model = ElementNetwork(dofs, dofs, DT, elements=elements, **choices)
    with torch.no_grad():
        model.mass.start(torch.full((dofs,), 1e3).double())
    drawn_laws(model, 4e5, 0.05)
    return model


def base_network(dofs: int) -> ElementNetwork:
    """On a moving support, whose displacement and velocity are given."""
    model = ElementNetwork(dofs, 2, DT, elements="chain", forced=[], masses=[1e3] * dofs)
    with torch.no_grad():
        model.mass.start(torch.full((dofs,), 1e3).double())
    drawn_laws(model, 4e5, 0.05)
    return model


def latent(dofs: int) -> LatentHysteresisNetwork:
    model = LatentHysteresisNetwork(dofs, dofs, DT, elements=dofs + 1)
    drawn_laws(model, 20.0, 0.05)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for name, c in model.named_modules():
            if hasattr(c, "theta") and not name.startswith("laws"):
                shape = c.theta.shape
                c.start(torch.rand(shape, generator=generator, dtype=torch.float64) + 0.1)
    return model


def element(units: int = 3) -> HystereticElement:
    """Under an imposed motion."""
    model = HystereticElement(2, 4, DT, units=units)
    drawn_laws(model, 4e5, 0.5)
    return model


def damper(elements: int = 1, others: int = 2) -> HystereticElement:
    """Under an imposed motion and other inputs."""
    model = HystereticElement(elements, 2 * elements + others, DT, other_inputs=others)
    drawn_laws(model, 4e5, 0.5)
    assert model.others is not None
    generator = torch.Generator().manual_seed(3)
    e = torch.rand(400, others, generator=generator, dtype=torch.float64)
    size = torch.full((elements,), 1e4).double()
    with torch.no_grad():
        model.others.start(e, size, size / 1e4, DT)
        for c in (model.others.rate_force, model.others.offset):
            c.theta.copy_(0.3 * torch.randn(c.theta.shape, generator=generator).double())
    return model


def branches(dofs: int, ramps: int = 6, sides: bool = False) -> ElementNetworkBranch:
    model = ElementNetworkBranch(dofs, dofs, DT, elements="chain", ramps=ramps, unsymmetric=sides)
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        model.identified.fill_(1.0)
        model.mass.start(torch.full((dofs,), 1e3).double())
        E = len(model.elements)
        none = torch.full((E,), 1e-30).double()
        model.laws.start(none, none, torch.ones(E).double(), (0.5, 0.5))
        for row, size in enumerate((0.05, 0.5, 2e4, 0.7)):
            model.scale[row] = size
        drawn = torch.randn(model.theta.shape, generator=generator, dtype=torch.float64)
        model.theta.copy_(0.2 * drawn)
        model.theta[:, 1] = 1.0
        model.theta[:, -4], model.theta[:, -3] = 0.3, 0.1
    return model


LAWS = {
    "steel": lambda pair, k: MenegottoPinto(
        between=pair, stiffness=k, yield_displacement=0.01, hardening_ratio=0.03, sharpness=18.5,
        a1=0.03, a3=0.03, damping=0.003 * k,
    ),
    "concrete": lambda pair, k: Takeda(
        between=pair, stiffness=k, yield_displacement=0.01, hardening_ratio=0.05,
        unloading_exponent=0.3, damping=0.003 * k,
    ),
    "pinching": lambda pair, k: BaberNoori(
        between=pair, stiffness=k, post_yield_ratio=0.1, beta=60.0, gamma=40.0, eta_rate=1e-5,
        nu_rate=1e-6, pinching=0.7, pinching_rate=2e-4, pinching_place=0.1, pinching_width=0.01,
        pinching_spread=5e-8, pinching_lambda=0.1,
    ),
    "pendulum": lambda pair, k: FrictionPendulum(
        between=pair, weight=0.3 * k, radius=1.8, friction_fast=0.09, friction_slow=0.04,
        rate=25.0, yield_displacement=0.001, spring_share=0.6, curvature=0.4,
    ),
}  # fmt: skip


def elements_of(law: str, pair: list[str]) -> list[Element]:
    """Of one of LAWS, or of a candidate of this name in the middle of its ranges."""
    if law in LAWS:
        return [LAWS[law](pair, 2e7)]
    candidate, units = CANDIDATES[law], Units(0.01, 0.1, 2e5, 2e7)
    q = np.zeros(len(candidate.parameters))
    return candidate.elements(q, units, pair)


def named(dofs: int, *laws: str) -> ElementNetworkNamed:
    """A chain on a moving support; the structure that an identification would have made.

    laws: of all storeys, or of each from below.
    """
    masses = [3e4] * dofs
    model = ElementNetworkNamed(dofs, 2, DT, elements="chain", forced=[], masses=masses)
    nodes = ["s1", *(f"x{i + 1}" for i in range(dofs))]
    of = laws * (dofs // len(laws))
    made = {
        f"r{i + 1}_{j}": element
        for i in range(dofs)
        for j, element in enumerate(elements_of(of[i], nodes[i : i + 2]), start=1)
    }
    structure = Structure(masses, made)
    with torch.no_grad():
        model.named.numbers.fill_(0.0)
        model.mass.start(torch.tensor(masses).double())
        E = len(model.elements)
        model.laws.start(*torch.ones(3, E).double(), (0.5, 0.5))
    model.structure = lambda: structure  # type: ignore[method-assign]
    return model
