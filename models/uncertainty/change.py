"""Has a structure changed? A model of before, fitted again to records of after, and what differs.

θ̂₁ − θ = A₁⁻¹ [J₁ᵀe₁ + w (θ̂₀ − θ)],   δ = log φ(θ̂₁) − log φ(θ̂₀),   G = ∂ log φ/∂θ
Var δ = κ₁² G₁ C₁ G₁ᵀ + κ₀² L C₀ Lᵀ + |L U₀|² + (G₁ d₁ − G₀ d₀)²,   L = G₀ − w G₁ A₁⁻¹

θ̂₀ is the earlier model, fitted once more to the records of before; the fit θ̂₁ to those of after
begins there, and has it as its prior, of weight w. C is the covariance by noise with the spectrum
of the residual, U₀ what θ̂₀ has from its own prior, d what the integrator errs by (all laplace.py):
what neither fit tells stays the same, and cancels, as does most of d. A model that errs moves both
by more than C: κ² is how far blocks of the records lie apart over what C says (Birge's ratio), with
one block counted for each motion, as a wrong law errs alike through a motion; 1 at least.
Stiffness, damping and yield force φ of all elements are held against no change together, by Holm's
procedure and Student's t with the freedom of the blocks: where nothing changed, something is called
changed in 5 % of all cases. Masses stay what they were.
Birge (1932), Phys. Rev. 40; Holm (1979), A simple sequentially rejective multiple test procedure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch

from data.record import Record, singles
from models.composition.composite import Composite
from models.element_network_branch import ElementNetworkBranch
from models.estimator import Estimator, Parameter
from models.fit.minimise import minimise
from models.fit.problem import FreeRunProblem, Joint
from models.uncertainty.intervals import MOST_OPEN, along
from models.uncertainty.laplace import OPEN, laplace, stated_widths
from models.uncertainty.parameters import slopes, values_of

LEVEL = 0.05  # of false alarms
JUDGED = re.compile(r"r\d+\.(stiffness|damping|yield_force)")  # of whole elements
USUAL = 0.3  # standard deviation of a change in θ, most of which are logarithms: a third or so
BEGINNING, GROWTH = 1 / 4**4, 4.0  # share of the motion's energy that is fitted first, its steps
SHORTER = 8  # steps, each the root of the one before: within the last no run diverges at once
ROUGH = {"change": 0.01, "patience": 1}  # beginnings need not be fitted to their end
SETTINGS = {"iterations": 40, "change": 1e-4, "patience": 3, "scaled": True, "longest": USUAL}


@dataclass(frozen=True)
class Change:
    """A quantity of an element before and after, in SI units.

    low, high: 95 % interval of after/before. chance: of a difference as large where nothing
    changed, for all quantities together.
    """

    name: str
    unit: str
    about: str  # the nodes that the element joins
    before: float
    after: float
    low: float
    high: float
    chance: float

    @property
    def changed(self) -> bool:
        """Whether it is more than these records leave open."""
        return self.chance <= LEVEL

    @property
    def factor(self) -> float:
        """After over before."""
        return self.after / self.before

    @property
    def element(self) -> int:
        """Number of the element, from 1 on."""
        return int(self.name[1 : self.name.index(".")])


@dataclass(frozen=True)
class Comparison:
    """Models of before and after, by fits alike, and what differs; the most certain first."""

    before: Composite
    after: Composite
    changes: list[Change]
    undetermined: list[str]  # quantities that the records of before or of after do not determine

    @property
    def changed(self) -> list[Change]:
        """What changed."""
        return [one for one in self.changes if one.changed]

    @property
    def places(self) -> list[int]:
        """Numbers of the elements that changed, the most certain first."""
        return list(dict.fromkeys(one.element for one in self.changed))


def compare(model: Estimator, before: Sequence[Record], after: Sequence[Record]) -> Comparison:
    """Fit a model of `before` to the records of `after`, and say what changed.

    before, after: records (…, T, n). The model stays as it is. Raises ValueError for a
    model without elements whose change could be told, for records that do not fit it, and where
    both tell nothing that can be compared.
    """
    free = [p for p in model.parameters() if p.requires_grad]
    if not isinstance(model, Composite) or isinstance(model, ElementNetworkBranch) or not free:
        raise ValueError(
            f"{type(model).__name__} has no springs, dampers and units that a fit could change; "
            "train model=element_network model.laws=units on the records of before, and take it "
            "with free parameters: run.stored.restore(), not run.model"
        )
    names = [p.name for p in model.physical_parameters() if JUDGED.fullmatch(p.name)]
    before, after = list(singles(before)), list(singles(after))
    for record in (*before, *after):
        model.check(record)
    with torch.no_grad():
        problems = Joint.of(model, before).problems
        errors = [p.errors().view(-1, model.dofs) / p.weight for p in problems]
    noise = float(torch.cat(errors).square().mean())
    earlier = deepcopy(model)
    refit(earlier, before, noise, 1.0)
    own = _Fit.of(earlier, names, before, noise)
    later = deepcopy(earlier)
    refit(later, after, noise)
    new = _Fit.of(later, names, after, noise)
    changes = _differences({p.name: p for p in earlier.physical_parameters()}, names, own, new)
    return Comparison(earlier, later, changes, sorted({*names} - {one.name for one in changes}))


def refit(
    model: Composite,
    records: Sequence[Record],
    noise: float,
    share: float = BEGINNING,
    masses: bool = False,
) -> None:
    """Fit a model to records from where it is, which is its prior; masses stay unless `masses`.

    noise: mean square of the errors [(m/s²)²], beside which the prior counts. Longer and longer
    beginnings are fitted, from a `share` of the energy of each record on: of a structure that
    changed, phases of the whole motion are off by too much. Raises ValueError where a run diverges.
    """
    model.keep_start()
    for name, parameter in model.named_parameters():
        if name.endswith("mass.theta") and not masses:
            parameter.requires_grad_(False)
    while True:
        changes = ROUGH if share < 1.0 else {}
        minimise(_problem(model, records, noise, share), SETTINGS, **changes)
        if share >= 1.0:
            return
        for step in GROWTH**0.5 ** np.arange(SHORTER):
            if math.isfinite(_problem(model, records, noise, step * share).loss()):
                break
        else:
            raise ValueError(
                "no fit of the earlier model to the later records runs through them: it diverges; "
                "train the earlier model on larger motions, or give smaller ones"
            )
        share = step * share


def _problem(model: Composite, records: Sequence[Record], noise: float, share: float) -> Joint:
    """The free runs of the beginnings of records that hold a share of their energy."""
    some = [_beginning(record, share) for record in records] if share < 1.0 else records
    weight = _weight(some, noise)
    return Joint([FreeRunProblem(model, record, None, prior=weight) for record in some])


def _weight(records: Sequence[Record], noise: float) -> float:
    """Of a prior of width USUAL, relative to the squared relative error of records."""
    return noise / USUAL**2 / sum(float((record.a**2).sum()) for record in records)


def _beginning(record: Record, share: float) -> Record:
    energy = (record.a**2).sum(dim=-1).cumsum(dim=0)
    length = int((energy < share * energy[-1]).sum()) + 1
    return record.window(0, max(length, record.warmup + 2), record.warmup)


@dataclass(frozen=True)
class _Fit:
    """Logarithms (Q,) of quantities by a fit, their slopes G (Q, P), and how far θ may be off.

    noisy (P, P): covariance by noise. unknown (P, P): what the prior holds back, a standard
    deviation of each parameter. kept (P, P): w A⁻¹. blocks (m, P): what blocks of the records ask
    for. numerical (Q,): what the integrator moves the quantities by. motions: number of records.
    """

    logarithms: np.ndarray
    slopes: np.ndarray
    noisy: np.ndarray
    unknown: np.ndarray
    kept: np.ndarray
    blocks: np.ndarray
    numerical: np.ndarray
    motions: int

    @staticmethod
    def of(model: Composite, names: Sequence[str], records: Sequence[Record], noise: float) -> _Fit:
        def logarithms() -> list[float]:
            values = values_of(model, names)
            return [math.log(value) if value > 0.0 else math.nan for value in values]

        weight = _weight(records, noise)
        with np.errstate(over="ignore", invalid="ignore"):  # of a run that nearly diverges
            found = laplace(model, records, weight)
        assert found is not None  # a Composite has exact derivatives
        kept = found.inverse * found.held
        stated = stated_widths(model)
        width, better = np.full(len(kept), OPEN), np.sqrt(weight * found.samples / found.held)
        width[list(stated)], better[list(stated)] = list(stated.values()), 1.0
        # what the solver left of the way to the minimum counts as if drawn
        noisy = found.coloured - (kept * width) @ (kept * width).T
        noisy += np.outer(found.step, found.step)
        # what is held harder, as units that would make energy, is so much better known
        unknown = kept * (width * better)
        G = np.nan_to_num(slopes(model, logarithms).numpy())
        logs, numerical = np.array(logarithms()), G @ found.numerical
        return _Fit(logs, G, noisy, unknown, kept, found.blocks, numerical, len(records))

    @property
    def told(self) -> np.ndarray:
        """Which quantities (Q,) the records determine."""
        deviation = np.sqrt(along(self.slopes, self.noisy + self.unknown @ self.unknown.T))
        return (deviation > 0.0) & (deviation <= MOST_OPEN) & np.isfinite(self.logarithms)


def _ratio(fit: _Fit, G: np.ndarray, variance: np.ndarray) -> float:
    """κ² of a fit, by quantities of slopes G (Q, P) and variances (Q,) by noise."""
    m, some = len(fit.blocks), variance > 0.0
    asked = m * (fit.blocks @ G[some].T).var(axis=0, ddof=1)
    return max(1.0, m / fit.motions * float((asked / variance[some]).mean()) if some.any() else 1.0)


def _differences(
    parameters: Mapping[str, Parameter], names: Sequence[str], own: _Fit, new: _Fit
) -> list[Change]:
    """What differs between two fits of quantities told by both, the most certain first."""
    from scipy.stats import t  # slow to import

    L = own.slopes - new.slopes @ new.kept
    told = own.told & new.told
    variance = along(L, own.unknown @ own.unknown.T) + (new.numerical - own.numerical) ** 2
    for fit, G in ((own, L), (new, new.slopes)):
        noise = along(G, fit.noisy)
        variance = variance + noise * _ratio(fit, G[told], noise[told])
    freedom = min(len(own.blocks), len(new.blocks)) - 1.0
    found = []
    for q in np.flatnonzero(told).tolist():
        law = t(freedom, scale=variance[q] ** 0.5)
        delta = float(new.logarithms[q] - own.logarithms[q])
        width, chance = float(law.isf(0.025)), 2.0 * float(law.sf(abs(delta)))
        p = parameters[names[q]]
        ends = math.exp(delta - width), math.exp(delta + width)
        after = p.value * math.exp(delta)
        found.append(Change(p.name, p.unit, p.about, p.value, after, *ends, chance))
    if not found:
        raise ValueError(
            "no stiffness, damping or yield force is told by both the records of before and those "
            "of after: give longer records, or larger motions"
        )
    return by_holm(found)


def by_holm(alone: Sequence[Change]) -> list[Change]:
    """Changes with the chance of each among all, by that of each alone; the most certain first."""
    chance, judged = 0.0, []
    for rank, one in enumerate(sorted(alone, key=lambda one: one.chance)):
        chance = max(chance, min((len(alone) - rank) * one.chance, 1.0))
        judged.append(replace(one, chance=chance))
    return judged
