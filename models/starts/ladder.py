"""Ways to a linear structure to begin with, from the most to the least that a record has to tell.

1. least squares     the equations of motion, as they stand
2. bounded           the same, with no mass, spring or damper below zero
3. spectra           the structure whose frequency response is nearest (spectra.py)
4. typical           a uniform structure with the best frequency
The first is taken where it gives a structure that is near; else the one whose response is nearest.
Every way that was not taken says why. No way depends on units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from models.starts.spectra import (
    POLISHED,
    RATIO,
    Layout,
    LinearStructure,
    Spectra,
    places,
    polished,
)

STEEPEST = 2.0  # ω h beyond which substeps h of the integration run away
DOUBTFUL = 0.5  # relative error beyond which another start or way, or another sign, is tried
MARKED = 0.6  # times the error: a changed sign that leaves less is the right one
UNSURE = 0.05  # the same where least squares mistake noise: springs of either sign, free motions


@dataclass(frozen=True)
class Equations:
    """Rows of masses, springs and dampers (N, n + 2E) and forces (N,); names of the unknowns."""

    unknown: Tensor
    target: Tensor
    names: Sequence[str]


@dataclass(frozen=True)
class Start:
    """A structure to begin with, the way that found it, and why others did not."""

    structure: LinearStructure
    way: str
    told: list[str]
    rank: int
    left_open: list[str]

    def facts(self) -> dict[str, float | str]:
        """For `metrics.json`."""
        return {
            "start": "; ".join([self.way, *self.told]),
            "rank": self.rank,
            "undetermined": ", ".join(self.left_open) or "none",
        }


def linear_start(
    equations: Equations,
    spectra: Spectra,
    layout: Layout,
    substep: float,
    forces: Sequence[str],
    filtered: bool,
) -> Start:
    """The start that the record gives. substep: of the integration [s]; forces: names of channels.

    filtered: x and v are not measured, so that the free run is all there is to begin with; least
    squares then has to simulate, too.

    Raises ValueError where a changed sign of a channel explains the motion far better.
    """
    E, n = layout.B.shape
    whole = np.full(n + 2 * E, np.nan)
    if layout.open_scale:
        whole[0] = 1.0
    elif layout.masses is not None:
        whole[:n] = layout.masses
    asked = np.isnan(whole)
    target = equations.target - equations.unknown[:, ~asked] @ torch.as_tensor(whole[~asked])
    unknown = equations.unknown[:, asked]
    names = [name for name, open_one in zip(equations.names, asked, strict=True) if open_one]

    def structure(solution: np.ndarray) -> LinearStructure:
        found = whole.copy()
        found[asked] = solution
        return LinearStructure(*np.split(found, [n, n + E]))

    factor = triangle(unknown, target)
    rank, open_names = left_open(factor, names)
    first = structure(least_squares(unknown, target))
    fault = fault_of(first, layout, substep)
    off = spectra.error(first, layout) if filtered and not fault else 0.0
    sure = layout.either is None and not spectra.free
    if not fault and off < (DOUBTFUL if sure else UNSURE):
        return Start(first, "least squares", [], rank, open_names)
    told = [f"not least squares: {fault}"] if fault else []
    found = {"spectra": nearest_structure(spectra, layout)}
    errors = {"spectra": spectra.error(found["spectra"], layout)}
    if not fault:
        found["least squares"], errors["least squares"] = first, off
    if min(errors.values()) > DOUBTFUL and not spectra.free:
        require_signs(spectra, layout, spectra.error(found["spectra"], layout), forces)
    bounded = structure(not_negative(factor))
    fault = fault_of(bounded, layout, substep)
    if fault:
        told.append(f"not bounded: {fault}")
    else:
        found["bounded least squares"] = damped(bounded, layout)
        errors["bounded least squares"] = spectra.error(found["bounded least squares"], layout)
    faults = {way: fault_of(s, layout, substep) for way, s in found.items()}
    told += [f"not {way}: {fault}" for way, fault in faults.items() if fault]
    found = {way: s for way, s in found.items() if not faults[way]}
    if not found:
        return Start(places(spectra, layout)[0], "typical structure", told, rank, open_names)
    way = min(found, key=lambda name: errors[name])
    told += [f"not {w}: its response is {100 * errors[w]:.3g} % off" for w in found if w != way]
    return Start(found[way], f"{way}, {100 * errors[way]:.3g} % off", told, rank, open_names)


def fault_of(structure: LinearStructure, layout: Layout, substep: float) -> str:
    """Why a solution is no structure to begin with, in words; "" where it is one."""
    if not (structure.mass > 0.0).all():
        return f"masses {_shown(structure.mass)} kg"
    if not (structure.stiffness > 0.0).any():
        return f"stiffnesses {_shown(structure.stiffness)} N/m"
    squares = structure.frequencies(layout.B)
    if not squares[0] > 0.0:
        return f"ω² from {squares[0]:.3g} 1/s²"
    if not np.sqrt(squares[-1]) * substep < STEEPEST:
        return f"a frequency of {np.sqrt(squares[-1]) / (2 * np.pi):.3g} Hz, too fast for the steps"
    return ""


def nearest_structure(spectra: Spectra, layout: Layout) -> LinearStructure:
    """The best of the polished structures of the best places."""
    ends = [polished(spectra, layout, place) for place in places(spectra, layout)[:POLISHED]]
    return min(ends, key=lambda end: spectra.error(end, layout))


def damped(structure: LinearStructure, layout: Layout) -> LinearStructure:
    """The structure with a little damping where it has none, in proportion to the springs."""
    lowest = np.sqrt(structure.frequencies(layout.B)[0])
    least = 0.1 * RATIO * 2.0 / lowest * structure.stiffness.max()
    damping = np.maximum(structure.damping, least)
    return LinearStructure(structure.mass, structure.stiffness, damping)


def require_signs(spectra: Spectra, layout: Layout, error: float, forces: Sequence[str]) -> None:
    """Raise ValueError for the channel whose changed sign explains the motion far better.

    Then it does so for a typical structure, too: only such signs are looked at more closely.
    """
    changed = {f"a{i + 1}": flipped(spectra, layout, i, None) for i in range(layout.B.shape[1])}
    changed |= {name: flipped(spectra, layout, None, j) for j, name in enumerate(forces)}
    if len(forces) > 1:
        changed["all forces"] = flipped(spectra, layout, None, slice(None, len(forces)))
    usual = spectra.error(places(spectra, layout)[0], layout)
    errors = dict[str, float]()
    for name, one in changed.items():
        typical, *_ = places(one, layout)
        if one.error(typical, layout) < usual:
            errors[name] = one.error(polished(one, layout, typical), layout)
    name = min(errors, key=lambda key: errors[key], default="")
    if name and errors[name] < MARKED * error:
        raise ValueError(
            f"a linear structure is {100 * error:.0f} % off this motion, and "
            f"{100 * errors[name]:.0f} % off with the sign of {name} changed: check the signs and "
            "units of the signals"
        )


def flipped(
    spectra: Spectra, layout: Layout, output: int | None, force: int | slice | None
) -> Spectra:
    """The same motion with the sign of a sensor or of an excitation changed.

    Motion relative to a base is that of an absolute sensor less the base's: f = −s̈.
    """
    a, u = spectra.outputs.copy(), spectra.inputs.copy()
    ground = u[:, :1] if layout.base else np.zeros_like(u[:, :1])
    if output is not None:
        a[:, output] = 2.0 * ground[:, 0] - a[:, output]
    if force is not None:
        u[:, force] *= -1.0
        a -= 2.0 * ground
    return replace(spectra, outputs=a, inputs=u, size=float(np.linalg.norm(a)))


def _shown(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values[:8])


# The linear equations of motion solved, also with bounds, and what of them the record leaves open.
#
# [inertia | springs | dampers] [m; k; c] = f      columns are scaled to unit length: no unit counts
# N equations, P unknowns.

RANK = 1e-7  # of the largest singular value, of scaled columns
TAKES_PART = 0.1  # share of an unknown in a combination that is left open


def least_squares(unknown: Tensor, target: Tensor) -> np.ndarray:
    """The solution (P,) of N equations (N, P), whatever the units of the unknowns."""
    lengths = torch.linalg.vector_norm(unknown, dim=0)
    lengths = torch.where(lengths > 0.0, lengths, 1.0)
    solved = torch.linalg.lstsq(unknown / lengths, target[:, None], driver="gelsd").solution
    return np.asarray((solved[:, 0] / lengths).numpy())


def triangle(unknown: Tensor, target: Tensor) -> np.ndarray:
    """R (P + 1, P + 1) of [unknown, target]: all that least squares has to know of N equations."""
    rows = np.column_stack([unknown.numpy(), target.numpy()])
    factor = np.asarray(np.linalg.qr(rows, mode="r"))
    missing = rows.shape[1] - len(factor)
    return np.vstack([factor, np.zeros((missing, rows.shape[1]))]) if missing > 0 else factor


def not_negative(factor: np.ndarray) -> np.ndarray:
    """The solution (P,) with no unknown below zero."""
    from scipy.optimize import nnls  # slow to import

    lengths = _lengths(factor)
    solution, _ = nnls(factor[:, :-1] / lengths, factor[:, -1], maxiter=100 * len(lengths))
    return np.asarray(solution / lengths)


def left_open(factor: np.ndarray, names: Sequence[str]) -> tuple[int, list[str]]:
    """Number of unknowns that the equations determine, and the names of those that they do not."""
    _, sizes, directions = np.linalg.svd(factor[:, :-1] / _lengths(factor))
    rank = int((sizes > RANK * sizes[0]).sum()) if len(sizes) else 0
    share = (directions[rank:] ** 2).sum(axis=0)
    return rank, [name for name, part in zip(names, share, strict=True) if part > TAKES_PART]


def _lengths(factor: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(factor[:, :-1], axis=0)
    return np.where(lengths > 0.0, lengths, 1.0)
