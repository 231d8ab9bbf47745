"""What the residual of a fit still holds: a missing element, an element whose law falls short.

A term that the model lacks, such as a spring between two nodes, would change the run by D θ, D its
derivative where the term is nil. If the model is right, s = D⊥ᵀe is noise, where D⊥ is what of D
the model's own parameters cannot do:   sᵀ V⁻¹ s ~ χ²,   V = Σ_ω D⊥ᴴ S D⊥.
                                        Rao (1948), the score or Lagrange multiplier test
The share of the residual's energy that the term would take away is the gain.
P free parameters, T samples, n channels, k columns of a term.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data.record import Record, singles
from models.composition.coefficients import Coefficients, Numbering
from models.composition.topology import all_pairs
from models.element_network import ElementNetwork
from models.fit.problem import FreeRunProblem
from models.uncertainty.laplace import Laplace

FAINT = 1e-6  # of the median stiffness: that of an element whose effect is asked for
PLACES = (0.15, 0.4, 0.7)  # of the largest deformation: where terms begin that are asked for
MOST_MISSING = 60  # pairs of nodes; of more, those that leave out one node
DEPENDENT = 1e-10  # of the largest eigenvalue: columns that are sums of others
LEVEL = 0.01  # of all tests of a kind together
LEAST_GAIN = 0.005  # of the residual's energy: what is worth a word
ELEMENT, LAW, INPUT = "a missing element", "the law of an element", "the excitation"
LAGS = (0, 1, 2, 3, 5, 8, 13, 21)  # samples, of the excitation


@dataclass(frozen=True)
class Finding:
    """What a term outside the model would take from the residual.

    kind: ELEMENT, LAW or INPUT; name: two nodes, or an element, or a channel. p: probability of
    such a score by noise alone. gain: share of the residual's energy.
    """

    kind: str
    name: str
    p: float
    gain: float
    significant: bool = False


def score_test(found: Laplace, term: Sequence[np.ndarray]) -> tuple[float, float]:
    """p and gain of a term with derivatives (T, n, k) in each record, weighted as the residual."""
    from scipy.stats import chi2  # slow to import

    pairs = list(zip(term, found.jacobians, strict=True))
    size = np.sqrt(sum((D**2).sum(axis=(0, 1)) for D in term))
    if not (size > 0.0).all() or not np.isfinite(size).all():
        return 1.0, 0.0
    shared = found.inverse @ sum(np.einsum("tnp,tnk->pk", J, D) for D, J in pairs) / size
    across = [D / size - J @ shared for D, J in pairs]
    score = sum(np.einsum("tnk,tn->k", D, e)
                for D, e in zip(across, found.residuals, strict=True))  # fmt: skip
    gram = sum(np.einsum("tnk,tnl->kl", D, D) for D in across)
    values, vectors = np.linalg.eigh(gram)
    kept = vectors[:, values > DEPENDENT]
    if not kept.shape[1]:
        return 1.0, 0.0
    own = kept.T @ score
    covariance = kept.T @ found.noise.score_covariance(across) @ kept
    statistic = float(own @ np.linalg.lstsq(covariance, own, rcond=None)[0])
    energy = sum(float((e**2).sum()) for e in found.residuals)
    gain = float((own**2 / values[values > DEPENDENT]).sum()) / energy
    return float(chi2.sf(statistic, kept.shape[1])), min(gain, 1.0)


def criticism_of(
    estimator: ElementNetwork, found: Laplace, batches: Sequence[Record]
) -> list[Finding]:
    """Terms that the residual was asked for, those with the largest gain first.

    Significant: the chance of any such finding of its kind, were the model right, is below 1 %.
    Where further terms of an element that there is take more of it, no other element is asked for.
    """
    records = list(singles(batches))
    asked = {
        ELEMENT: missing_elements(estimator, records),
        LAW: further_laws(estimator, records),
        INPUT: excitation(records),
    }
    findings = []
    for kind, terms in asked.items():
        for name, term in terms.items():
            p, gain = score_test(found, [found.weight[:, None] * D for D in term])
            clear = p * len(terms) < LEVEL and gain >= LEAST_GAIN
            findings.append(Finding(kind, name, p, gain, clear))
    best_law = max((f.gain for f in findings if f.kind == LAW), default=0.0)
    findings = [
        replace(f, significant=False) if f.kind == ELEMENT and f.gain < best_law else f
        for f in findings
    ]
    return sorted(findings, key=lambda f: -f.gain)


def asks_for_more(findings: Iterable[Finding]) -> bool:
    """Whether an element or a part of a law is missing: intervals of noise alone are of no worth.

    They are those of a model that is right. Where it lacks something, or its fit ended in a poor
    minimum, which shows in the same way, those by parts of the records are to be believed.
    """
    return any(f.significant and f.kind in (ELEMENT, LAW) for f in findings)


Terms = dict[str, list[np.ndarray]]


def missing_elements(estimator: ElementNetwork, records: Sequence[Record]) -> Terms:
    """Derivatives (T, n, 2) by spring and damper of every pair of nodes that is not joined."""
    joined = {frozenset(pair) for pair in estimator.elements}
    every = all_pairs(estimator.floors, estimator.supports)
    pairs = [pair for pair in every if frozenset(pair) not in joined]
    if len(pairs) > MOST_MISSING:
        pairs = [pair for pair in pairs if _apart(pair) == 2]
    if not pairs:
        return {}
    laws = estimator.laws
    wider = _like(estimator, [*estimator.elements, *pairs], *laws.counts)
    E = len(estimator.elements)
    with torch.no_grad():
        stiffness = laws.stiffness().detach()
        typical, largest = stiffness.median(), _largest(estimator, records)
        more = torch.ones(len(pairs), dtype=torch.float64)
        wider.laws.start(
            torch.cat([stiffness, FAINT * typical * more]),
            torch.cat([laws.damping(), FAINT * laws.damping().median() * more]),
            torch.cat([largest, largest.median() * more]),
        )
        _copy(laws, wider.laws)
    wanted = (wider.laws.stiffness, wider.laws.damping)
    columns, places = _derivatives(wider, wanted, records)
    own = torch.stack(places, dim=1)[E:].tolist()
    return {
        "–".join(pair): [D[..., at] for D in columns] for pair, at in zip(pairs, own, strict=True)
    }


def _apart(pair: Sequence[str]) -> int:
    """How far two nodes of a chain are apart; ground and supports come before the first."""
    place = [int(node[1:]) if node[0] == "x" else 0 for node in pair]
    return abs(place[0] - place[1])


def further_laws(estimator: ElementNetwork, records: Sequence[Record]) -> Terms:
    """Derivatives (T, n, k) by a cubic spring, hinges and units that an element does not have."""
    laws, more = estimator.laws, len(PLACES)
    hinges, units = laws.counts
    wider = _like(estimator, estimator.elements, hinges + more, units + more)
    with torch.no_grad():
        largest = _largest(estimator, records)
        wider.laws.start(laws.stiffness(), laws.damping(), largest)
        _copy(laws, wider.laws)
        places = largest[:, None] * torch.tensor(PLACES, dtype=torch.float64)
        wider.laws.hinge_gap.unit[:, hinges:] = places
        wider.laws.unit_limit.unit[:, units:] = places
    own = wider.laws
    wanted = [own.hinge_stiffness, own.unit_stiffness]
    if not laws.cubic.learned:
        wanted.insert(0, own.cubic)
    columns, numbers = _derivatives(wider, wanted, records)
    each = [at[:, None] if at.ndim == 1 else at[:, -more:] for at in numbers]
    of_laws = torch.cat(each, dim=1).tolist()  # (E, k)
    return {f"r{e}": [D[..., at] for D in columns] for e, at in enumerate(of_laws, start=1)}


def excitation(records: Sequence[Record]) -> Terms:
    """The excitation itself, at some lags: what is left of it in the residual of every channel."""
    terms: Terms = {}
    for channel in range(records[0].excitation.shape[-1]):
        term = []
        for record in records:
            u = record.excitation[:, channel].numpy()
            late = np.stack([np.concatenate([np.zeros(lag), u[: len(u) - lag]]) for lag in LAGS], 1)
            columns = np.kron(np.eye(record.a.shape[-1])[None], late[:, None])  # (T, n, n k)
            term.append(columns[record.warmup :])
        terms[f"u{channel + 1}"] = term
    return terms


def _like(
    estimator: ElementNetwork, elements: Sequence[Sequence[str]], hinges: int, units: int
) -> ElementNetwork:
    """A network of the same masses and channels with other elements and more terms."""
    known = estimator.known_masses
    wider = ElementNetwork(
        estimator.floors,
        estimator.inputs,
        estimator.dt,
        elements,
        None if known is None else [None if m != m else m for m in known.tolist()],
        "base" if estimator.base else [number + 1 for number in estimator.forced],
        hinges,
        units,
        True,
        estimator.substeps,
        estimator.from_accelerations,
        sensors=estimator.sensors,
    )
    for name in ("identified", "measures", "bound"):
        getattr(wider, name).copy_(getattr(estimator, name))
    with torch.no_grad():
        wider.mass.unit.copy_(estimator.mass())
    wider.drag = deepcopy(estimator.drag)  # with further pairs it is no chain, which alone has one
    return wider


def _copy(old: torch.nn.Module, new: torch.nn.Module) -> None:
    """The laws of the elements that there are, term by term; what goes beyond these stays nil."""
    others = dict(new.named_children())
    for name, own in old.named_children():
        assert isinstance(own, Coefficients)
        for part, value in (("unit", own.unit), ("theta", own.spread(own.theta))):
            target: Tensor = getattr(others[name], part)
            target.data[tuple(map(slice, value.shape))] = value.data


def _derivatives(
    network: ElementNetwork, wanted: Sequence[Coefficients], records: Sequence[Record]
) -> tuple[list[np.ndarray], list[Tensor]]:
    """∂run/∂θ (T, n, ·) by some coefficients alone, and the columns of every θ of each of them."""
    for c in network._coefficients():
        c.theta.requires_grad_(c in wanted)
    first, columns = Numbering(network).first, []
    with torch.no_grad():
        for record in records:
            problem = FreeRunProblem(network, record, None)
            _, jacobian = network.restarted_jacobian(problem.record, None)
            columns.append(jacobian[problem.counted].numpy())
    each = (torch.arange(c.theta.numel()).view(c.theta.shape) for c in wanted)
    return columns, [first[id(c.theta)] + at for c, at in zip(wanted, each, strict=True)]


@torch.no_grad()
def _largest(estimator: ElementNetwork, records: Sequence[Record]) -> Tensor:
    """Deformations (E,) [m] that the elements reach in the runs of some records."""
    reached = [estimator.element_loops(record)[0].abs().amax(dim=0) for record in records]
    largest = torch.stack(reached).amax(dim=0)
    return torch.where(largest > 0.0, largest, largest.max())
