"""Physical parameters of one element, by the kind of its law: springs, dampers, yield, gaps.

Names have the form part.quantity or part.term.quantity: x1.mass, r2.stiffness,
r2.unit_1.yield_displacement. Parts: DOFs x1, …, elements r1, …, modes mode_1, …, the structure.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from models.composition.branch_law import LEAST_DAMPER, TAIL, branch_forces, ramp
from models.composition.branch_run import Branches
from models.composition.coefficients import Coefficients
from models.composition.laws import GROUPS, NAMED, ElementLaws
from models.estimator import Parameter
from models.named_laws.fit import Fit
from models.named_laws.pairs import halves

UNITS = {  # of the parameters of named laws (models/named_laws/candidates.py)
    **dict.fromkeys(
        ("activation_displacement", "yield_displacement", "gap", "largest", "pinching_width"), "m"
    ),
    **dict.fromkeys(("stiffness", "spring", "gravity_stiffness"), "N/m"),
    **dict.fromkeys(("slow", "faster"), "N"),
    **dict.fromkeys(("eta_rate", "nu_rate", "pinching_rate"), "1/J"),
    "curvature": "1/m",
    "damping": "N s/m",
    "rate": "s/m",
    "pinching_spread": "m/J",
}
WORDS = {  # of parameters whose names in code say too little beside others
    "spring": "parallel_stiffness",
    "slow": "friction_slow",
    "faster": "friction_fast_less_slow",
    "largest": "largest_hysteretic_displacement",
    "above_one": "exponent_less_one",
    "rate": "friction_rate",
}
YIELDS = ("yield_displacement", "activation_displacement", "largest")  # at a force of k times it
STEPS = 100  # of a push
SMALL = 0.05  # of an element's stiffness: hinges and units that are told term by term alone


def composed_laws(laws: ElementLaws, e: int, part: str, about: str) -> Iterator[Parameter]:
    """Of element e: stiffness and damping of small motions, gaps, hysteretic units by their limits.

    A unit bears its stiffness up to its yield displacement, and then its yield force; `rising` and
    `falling` bend its way there (models/composition/laws.py). Once all have yielded the element
    has its post-yield stiffness, springs beyond gaps aside. Gap, yield displacement and yield force
    of the element are those of its stiffest hinge and unit, where they are no small part of it.
    """
    for attribute, name, unit in NAMED:
        coefficients = getattr(laws, attribute)
        if _acts(coefficients, e):
            yield Parameter(f"{part}.{name}", float(coefficients()[e]), unit, about)
    for group, all_columns in GROUPS:
        columns = [c for c in all_columns if _acts(getattr(laws, c[0]), e)]
        table = [getattr(laws, attribute)()[e].tolist() for attribute, *_ in columns]
        rows = sorted(zip(*table, strict=True))
        for i, row in enumerate(rows, start=1):
            for value, (_, name, unit) in zip(row, columns, strict=True):
                yield Parameter(f"{part}.{group}_{i}.{name}", value, unit, about)
            if group == "unit":
                yield Parameter(
                    f"{part}.unit_{i}.yield_force", row[0] * row[1], "N", about, derived=True
                )
    k, (hinges, _, units) = float(laws.stiffness()[e]), laws.counts
    if hinges and (gap := _main(laws.hinge_stiffness()[e], laws.hinge_gap()[e], k)):
        yield Parameter(f"{part}.gap", gap, "m", about, derived=True)
    if units:
        left = k - float(laws.unit_stiffness()[e].sum())
        yield Parameter(f"{part}.post_yield_stiffness", left, "N/m", about, derived=True)
        if k > 0.0:
            yield Parameter(f"{part}.post_yield_ratio", left / k, "", about, derived=True)
        if place := _main(laws.unit_stiffness()[e], laws.unit_limit()[e], k):
            yield Parameter(f"{part}.yield_displacement", place, "m", about, derived=True)
            yield Parameter(f"{part}.yield_force", k * place, "N", about, derived=True)


def _acts(coefficients: Coefficients, e: int) -> bool:
    return coefficients.learned or bool(coefficients()[e].any())


def _main(stiffness: Tensor, place: Tensor, k: float) -> float | None:
    """Where the stiffest of several terms acts; None where it is a small part of the element."""
    size = stiffness.abs()
    strongest = int(size.argmax())
    return float(place[strongest]) if float(size[strongest]) > SMALL * abs(k) > 0.0 else None


def branch_law(branches: Branches, e: int, part: str, about: str) -> Iterator[Parameter]:
    """Of element e: its force under a slow push from rest to the largest deformation of training.

    A branch law is curves and has no parameter of its own that is physical, its dampers aside
    (models/composition/branch_law.py). Stiffness: the secant at a twentieth of the way; after
    yielding that over the last fifth; it yields where these two lines meet. Means of both ways.
    """
    theta = branches.theta[e].detach()
    Y, V, F, log_k0 = (float(value) for value in branches.scale[:, e])
    tail = theta[-TAIL:]
    y = torch.linspace(0.0, 1.0, STEPS + 1, dtype=torch.float64)
    turns = torch.zeros(STEPS + 1, dtype=torch.int64)
    r = torch.zeros_like(y)
    for side in (1, -1):
        turns[0] = side
        pushed = branch_forces(theta, branches.sizes, side * y, torch.zeros_like(y), turns, log_k0)
        r += 0.5 * side * pushed
    first, last = round(0.05 * STEPS), round(0.8 * STEPS)
    k, slope = float(r[first] / y[first]), float((r[-1] - r[last]) / (y[-1] - y[last]))
    yield Parameter(f"{part}.stiffness", k * F / Y, "N/m", about, derived=True)
    damper = float(ramp(tail[2], LEAST_DAMPER))
    yield Parameter(f"{part}.damping", damper * F / V, "N s/m", about)
    yield Parameter(f"{part}.growth_with_rate", float(tail[3].exp()) - 1.0, "", about)
    yield Parameter(f"{part}.rate_of_growth", float(tail[4].exp()) * V, "m/s", about)
    yield Parameter(f"{part}.largest_deformation", Y, "m", about)
    yield Parameter(f"{part}.force_there", F * float(r[-1]), "N", about, derived=True)
    yield Parameter(f"{part}.post_yield_stiffness", slope * F / Y, "N/m", about, derived=True)
    if k > 0.0:
        yield Parameter(f"{part}.post_yield_ratio", slope / k, "", about, derived=True)
    corner = (float(r[-1]) - slope) / (k - slope) if k > slope else 0.0
    if 0.0 < corner < 1.0:  # else it does not yield on this way
        yield Parameter(f"{part}.yield_displacement", corner * Y, "m", about, derived=True)
        yield Parameter(f"{part}.yield_force", k * corner * F, "N", about, derived=True)


def named_law(fit: Fit, part: str, about: str) -> Iterator[Parameter]:
    """Of an element with a named law: the law's own parameters, and its yield force."""
    if fit.candidate.halves:
        for number, half in enumerate(halves(fit), start=1):
            yield from named_law(half, f"{part}.law_{number}", about)
        return
    name, values = fit.candidate.name, fit.candidate.values(fit.q, fit.units)
    about = f"{about}, {name}"
    for key, value in values.items():
        yield Parameter(f"{part}.{WORDS.get(key, key)}", value, UNITS.get(key, ""), about)
    for key in YIELDS:
        if key in values and not name.endswith("FrictionPendulum"):
            share = 1.0 - values.get("post_yield_ratio", 0.0)
            force = share * values["stiffness"] * values[key]
            word = "activation_force" if name == "SelfCentering" else "yield_force"
            yield Parameter(f"{part}.{word}", force, "N", about, derived=True)


def modal(name: str, square: float, rate: float, about: str) -> Iterator[Parameter]:
    """Frequency and damping ratio of a mode: ω² [1/s²] and 2ζω [1/s]."""
    omega = square**0.5
    yield Parameter(f"{name}.frequency", omega / (2.0 * torch.pi), "Hz", about)
    yield Parameter(f"{name}.damping_ratio", 0.5 * rate / omega, "", about)
