"""What an identified model holds of physics: masses, springs, dampers, yield, gaps, with units.

Names have the form part.quantity or part.term.quantity: x1.mass, r2.stiffness,
r2.unit_1.yield_displacement. Parts: DOFs x1, …, elements r1, …, modes mode_1, …, the structure.
A black box has none: the list is empty.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from models.branch_element import BranchElement
from models.composition.branch_run import Branches
from models.composition.composite import Composite
from models.composition.other_inputs import OtherInputs
from models.composition.stated import Stated
from models.element_network import ElementNetwork
from models.element_network_branch import ElementNetworkBranch
from models.element_network_named import ElementNetworkNamed
from models.estimator import Estimator
from models.hysteretic_element import HystereticElement
from models.latent_hysteresis_network import LatentHysteresisNetwork
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion
from models.modal_network import ModalNetwork
from models.named_element import NamedElement
from models.physical.laws import branch_law, composed_laws, named_law
from models.prandtl_ishlinskii import PrandtlIshlinskii
from models.sliders.fit import LINEAR


@dataclass(frozen=True)
class Parameter:
    """A physical parameter of an identified model.

    about: what its part is, such as the nodes that an element joins. derived: it follows from
    others of the list, as a yield force from stiffness and yield displacement.
    """

    name: str
    value: float
    unit: str  # SI; "" where it has none
    about: str = ""
    derived: bool = False


@torch.no_grad()
def parameters_of(estimator: Estimator) -> list[Parameter]:
    """Physical parameters of an identified estimator, in SI units; none of a black box.

    Where `scale_is_open`, masses and forces are known but for a factor that all of them share.
    Raises ValueError for an estimator that is not identified.
    """
    return [Parameter(*values) for values in _of(estimator)]


def scale_is_open(estimator: Estimator) -> bool:
    """Whether masses and forces share an unknown factor: no force, mass or prior was given."""
    if isinstance(estimator, ElementNetwork):
        given = estimator.forced or any(map(sets_scale, estimator.stated))
        return estimator.known_masses is None and not given
    return False


def sets_scale(prior: Stated) -> bool:
    """Whether a stated prior says how heavy or how stiff something is."""
    return prior.name.endswith((".mass", "stiffness", "damping"))


Values = tuple[str, float, str, str, bool]


def _of(estimator: Estimator) -> Iterator[Values]:
    if isinstance(estimator, Composite):
        estimator.require_identified(estimator.identified)
        yield from _composite(estimator)
    elif isinstance(estimator, BranchElement):
        estimator.require_identified(estimator.scale)
        branches = Branches(estimator.theta, estimator.sizes, estimator.scale[:4])
        for e in range(estimator.dofs):
            yield from branch_law(branches, e, f"r{e + 1}", "under s and its rate")
    elif isinstance(estimator, NamedElement):
        estimator.require_identified(estimator.laws.numbers)
        yield from named_law(estimator.laws[0], "r1", "under s and its rate")
    elif isinstance(estimator, PrandtlIshlinskii):
        yield from _sliders(estimator)
    elif isinstance(estimator, LinearMotion):
        yield from _linear(estimator.system)
    elif isinstance(estimator, EquivalentLinear):
        yield from _linear(estimator)
    elif isinstance(estimator, ModalNetwork):
        yield from _modes(estimator)


def _composite(model: Composite) -> Iterator[Values]:
    if isinstance(model, ElementNetwork):
        for i, mass in enumerate(model.mass().tolist(), start=1):
            yield f"x{i}.mass", mass, "kg", "", False
        pairs = ["–".join(pair) for pair in model.elements]
        if (alpha := _mass_damping(model)) > 0.0:
            yield "mass_damping", alpha, "1/s", "of Rayleigh's", False
        for e, pair in enumerate(pairs):
            name = f"r{e + 1}"
            if isinstance(model, ElementNetworkBranch):
                yield from branch_law(model.branches, e, name, pair)
            elif isinstance(model, ElementNetworkNamed):
                yield from named_law(model.named[e], name, pair)
            else:
                yield from composed_laws(model.laws, e, name, pair)
    elif isinstance(model, LatentHysteresisNetwork):
        rates = zip(model.stiffness().tolist(), model.damping().tolist(), strict=True)
        for i, (square, rate) in enumerate(rates, start=1):
            yield from _mode(f"mode_{i}", square, rate, "without the elements")
        for e, direction in enumerate(model.directions().tolist()):
            along = "along " + ", ".join(f"{d:.3g}" for d in direction[:4])
            yield from composed_laws(model.laws, e, f"r{e + 1}", along)
    elif isinstance(model, HystereticElement) and model.others is not None:
        yield from _under_other_inputs(model, model.others)
    elif isinstance(model, HystereticElement):
        for e in range(model.dofs):
            yield from composed_laws(model.laws, e, f"r{e + 1}", "under s and its rate")


def _mass_damping(model: ElementNetwork) -> float:
    if isinstance(model, ElementNetworkNamed):
        return float(model.mass_damping)
    if isinstance(model, ElementNetworkBranch) and model.drag is not None:
        return float(model.drag().detach())
    return 0.0


def _under_other_inputs(model: HystereticElement, others: OtherInputs) -> Iterator[Values]:
    """Laws at values of the other inputs, between which the force is interpolated."""
    for i, lag in enumerate(others.lag().tolist(), start=1):
        yield f"u{i}.lag", lag, "s", "", False
    for e, offset in enumerate(others.offset().tolist(), start=1):
        yield f"r{e}.offset", offset, "N", "under s and its rate", False
    nodes = others.places.shape[1]
    places = others.range.centre[:, None] + others.range.reach[:, None] * others.places
    for j in range(others.laws):
        i, node = divmod(j, nodes)
        if node >= int(others.used[i]):  # no data were near it
            continue
        value = float(places[i, node])
        for e in range(model.dofs):
            row, name = j * model.dofs + e, f"r{e + 1}.law_{j + 1}"
            about = f"under s and its rate, at u{i + 1} = {value:.3g}"
            yield from composed_laws(model.laws, row, name, about)
            pairs = zip(others.rate_force()[row], others.rate_knee()[row], strict=True)
            for m, (force, knee) in enumerate(pairs, start=1):
                yield f"{name}.rate_{m}.force", float(force), "N", about, False
                yield f"{name}.rate_{m}.saturates_at", float(knee), "m/s", about, False
            yield f"{name}.rate_lag", float(others.rate_lag()[row]), "s", about, False


def _linear(model: EquivalentLinear) -> Iterator[Values]:
    """Entries of M⁻¹K, M⁻¹C and of what the excitation does: a fit to the motion knows no more."""
    model.require_identified(model.weights)
    damping, stiffness, inputs = model.matrices()
    if stiffness.ndim != 2:
        return
    about = "" if type(model) is EquivalentLinear else "of the linear system beneath the rest"
    for name, matrix, unit in (
        ("stiffness_by_mass", stiffness, "1/s²"), ("damping_by_mass", damping, "1/s"),
    ):  # fmt: skip
        for i, row in enumerate(matrix.tolist(), start=1):
            for j, value in enumerate(row, start=1):
                yield f"x{i}.{name}.x{j}", value, unit, about, False
    for i, row in enumerate(inputs.tolist(), start=1):
        for j, value in enumerate(row, start=1):
            yield f"x{i}.acceleration_by_input.u{j}", value, "m/s² per unit", about, False


def _modes(model: ModalNetwork) -> Iterator[Values]:
    parts, time = model.layout.split(model.values), model.scale.time
    for i, (k, c) in enumerate(zip(parts["log_k"], parts["log_c"], strict=True), start=1):
        square, rate = float(torch.tensor(k).exp()), float(torch.tensor(c).exp())
        yield from _mode(f"mode_{i}", square / time**2, rate / time, "without the elements")


def _mode(name: str, square: float, rate: float, about: str) -> Iterator[Values]:
    """Frequency and damping ratio of a mode: ω² [1/s²] and 2ζω [1/s]."""
    omega = square**0.5
    yield f"{name}.frequency", omega / (2.0 * torch.pi), "Hz", about, False
    yield f"{name}.damping_ratio", 0.5 * rate / omega, "", about, False


def _sliders(model: PrandtlIshlinskii) -> Iterator[Values]:
    """r₀, k, c and half widths; the springs in series are curves, and have no single number."""
    model.require_identified(model.weights)
    way, fastest, force = model.scale.tolist()
    about = "under s and its rate"
    units = ((force, "N", "offset"), (force / way, "N/m", "stiffness_beside_the_sliders"),
             (force / fastest, "N s/m", "damping"))  # fmt: skip
    for value, (size, unit, name) in zip(model.weights[:LINEAR].tolist(), units, strict=True):
        yield f"r1.{name}", value * size, unit, about, False
    for j, width in enumerate(w for w in model.widths.tolist() if w > 0.0):
        yield f"r1.slider_{j + 1}.half_width", width * way, "m", about, False
