"""Composite networks that run as models/composition/simulate.py has it, and their channels."""

from __future__ import annotations

from models.composition.composite import Composite
from models.composition.trace import traced
from models.estimator import Estimator


def plain_composite(estimator: Estimator) -> Composite:
    """The estimator, where its free run is that of its composition.

    Raises ValueError for all others: networks of branch laws, imposed motions, other estimators.
    """
    own = isinstance(estimator, Composite) and type(estimator).free_run is Composite.free_run
    if not isinstance(estimator, Composite) or not own or type(estimator).traced is not traced:
        raise ValueError(
            f"{type(estimator).__name__} has another equation than an element network; choose "
            "to=c or to=fmu"
        )
    return estimator


def columns_of(network: Composite) -> list[tuple[str, str]]:
    """Name and unit of each channel of excitation, in the model's order."""
    forces, supports = getattr(network, "forces", None), getattr(network, "supports", None)
    if not isinstance(forces, int) or not isinstance(supports, int):
        return [(f"u{i + 1}", "N") for i in range(network.inputs)]
    unit = "m/s2" if getattr(network, "base", False) else "N"
    named = [(f"f{i + 1}", unit) for i in range(forces)]
    named += [(f"s{i + 1}", "m") for i in range(supports)]
    return named + [(f"s_dot{i + 1}", "m/s") for i in range(supports)]
