"""Laws of storeys under a weight P, whose overturning takes away stiffness: P–Δ.

    r = law(y, ẏ; q) − k_g y,   k_g = P/h [N/m] for a storey of height h

Where a law hardens by more than k_g, both are alike a law that hardens less: so k_g is tried where
a law was left with next to no hardening.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from data.simulation.laws.candidate import Candidate, Parameter, Values
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit

GRAVITY = "gravity_stiffness"  # k_g
STIFFNESS = Parameter(0.003, 0.1, lambda units: units.slope, symbol="N/m")
HARDENING = ("hardening_ratio", "post_yield_ratio")
WEIGHT_SHARES = (0.01, 0.05)  # of the stiffness: starts of what a weight takes away, less hardening
NONE_LEFT, HARDENS = 0.01, 0.03  # of the stiffness: a law that hardens less may lean; its start


def _under_weight(law: Candidate) -> Candidate:
    """The law under a weight: k_g goes before its own numbers, so that others may follow them."""

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        own = {name: values[name] for name in law.parameters}
        over = Polynomial(between=between, stiffness=-values[GRAVITY])
        return [*law.made(own, between), over]

    return replace(
        law,
        name=f"{law.name} with P-Delta",
        parameters={GRAVITY: STIFFNESS, **law.parameters},
        made=made,
        sized=[*law.sized, GRAVITY],
        uneven=_under_weight(law.uneven) if law.uneven is not None else None,
    )


BY_LAW = {
    name: _under_weight(law)
    for name, law in CANDIDATES.items()
    if any(key in law.parameters for key in HARDENING)
}
P_DELTA_LAWS = {law.name: law for law in BY_LAW.values()}


def with_p_delta(fit: Fit, share: float) -> Fit:
    """The law hardening again, by less than k_g; itself where it hardens, or cannot lean.

    share: what is left to k_g, of the stiffness. At next to no hardening a law does not feel it.
    """
    law, values = BY_LAW.get(fit.candidate.name), fit.candidate.values(fit.q, fit.units)
    name = next((key for key in HARDENING if key in values), None)
    if law is None or name is None or values[name] > NONE_LEFT:
        return fit
    q = fit.q.copy()
    q[list(fit.candidate.parameters).index(name)] = math.log(HARDENS / (1.0 - HARDENS))
    weight = (share + HARDENS) * values["stiffness"] / fit.units.slope
    return Fit(law, fit.units, np.append(math.log(weight), q))
