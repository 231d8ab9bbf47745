"""Drifts of elements whose deformation no sensor measured, responses of storeys, and intervals.

Accelerations hold next to nothing of what stays: noise and an offset, integrated twice, outgrow it
within seconds. So a drift comes from the law, and is as sure as that is.

    Var = g M (S + σ⁴/w²) M gᵀ + mean (Δ²),   M = (JᵀJ + σ²/w²)⁻¹

The first part is what the records leave open of the parameters, g the slope of the drift by θ: θ is
Normal about its start, w wide, S the covariance of the scores under noise with the spectrum of the
residual (laplace.py). How far the fit is from the mode of that counts as a bias. The second part is
of what the model does not explain: e = ẍ − ẍ_run is put back as forces on the masses, block by
block with random weights (wild bootstrap; Liu 1988, Shao 2010), which moves the drift by Δ.
T samples, n DOFs, E elements, P parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.parallel import in_threads
from data.record import Drive, Record
from data.simulation.element_test import force
from data.simulation.laws.element import Element
from data.simulation.motion import EscapedMotionError, Motion
from data.simulation.structure import Structure
from models.composition.coefficients import DISPLACEMENT, Part
from models.element_network import ElementNetwork
from models.fit.trained_range import names_of
from models.online.drift_filter import DRAWS
from models.online.drift_stream import smoothed
from models.uncertainty.intervals import along, off_centre
from models.uncertainty.laplace import FEWEST_BLOCKS, NORMAL, OPEN, Laplace, stated_widths

LAST = 0.05  # of a motion, at its end, whose mean is called residual
STOREY = ("peak", "residual", "floor_acceleration", "dissipated_energy", "stiffness_left")
SMALL = 0.01  # of the peak drift: cycles of half and twice that differ by 0.02, in steel by 0.07
CYCLE = 100  # samples


def residual_of(signal: np.ndarray) -> np.ndarray:
    """Mean (…) of the last part of a signal (T, …)."""
    return np.asarray(signal[-max(1, round(LAST * len(signal))) :].mean(axis=0))


@torch.no_grad()
def drifts(estimator: ElementNetwork, found: Laplace, record: Record) -> list[dict[str, Any]]:
    """Peak and residual of every element in the free run of a record, and their `half` widths [m].

    [] where the record begins in a motion that is not known; without elements whose drift diverges
    in a run that is as likely.
    """
    if record.initial_state == "unknown":
        return []
    drive = record.drive()
    run = estimator.trace(drive)
    y = run.deformations.cpu().numpy()
    own, by_theta = _sizes(run.deformations), _slopes(estimator, drive, y)
    covariance, step = _posterior(estimator, found)
    deviation = np.sqrt(along(by_theta, covariance))
    bias = np.abs(by_theta @ step) + np.abs(by_theta @ found.numerical)
    left_out = (record.a - run.response.a)[record.warmup :]
    moved = [_sizes(y) - own for y in _put_back(estimator, drive, left_out)]
    half = np.hypot(off_centre(deviation, bias), NORMAL * np.sqrt(np.square(moved).mean(axis=0)))
    return _rows(estimator, STOREY[:2], own.reshape(2, -1), half.reshape(2, -1))


@torch.no_grad()
def storeys_of(
    estimator: Any, drive: Drive, carried: np.ndarray | float = 0.0
) -> list[dict[str, Any]]:
    """The response of every storey of an ElementNetworkNamed in a motion, and `half` widths.

    Of elements that are no chain, peak and residual deformation alone.

    By the spread of its laws that are as likely; [] without them. Each runs with another noise in
    the measured motion of a base, as large as it was in training. Drifts are in m, the absolute
    acceleration [m/s²] is that of the floor above, the energy [J] what the storey does not give
    back, the stiffness a share of what it was; None: not known. carried (T,) [m/s²]: acceleration
    of the frame that masses move in, where the drive is not that of a base.
    """
    likely = list(estimator.likely())
    if not likely:
        return []
    keys = STOREY if estimator.is_chain else STOREY[:2]
    draw, noise = torch.Generator().manual_seed(0), float(estimator.noise_of_ground)

    def noisy(laws: Any) -> tuple[Structure, Drive]:
        u = drive.u.clone()
        if noise:
            u[..., 0] += noise * torch.randn(len(u), generator=draw, dtype=u.dtype)
        return laws.structure(), replace(drive, u=u)

    def response(job: tuple[Structure, Drive]) -> np.ndarray:
        structure, driven = job
        (motion,) = estimator.motions_of(structure, driven)
        ground = -driven.u[:, 0].numpy() if estimator.base else np.asarray(carried)
        found = _response(structure, len(estimator.elements), motion, ground[..., None], drive.dt)
        return found[: len(keys)]

    jobs = [(estimator.structure(), drive), *map(noisy, likely)]
    own, *others = in_threads(response, jobs)
    half = NORMAL * np.sqrt(np.square(np.array(others) - own).mean(axis=0))
    if estimator.scale_is_open and estimator.is_chain:
        own[STOREY.index("dissipated_energy")] = np.nan
    return _rows(estimator, keys, own, half)


@torch.no_grad()
def storeys_by_sensors(estimator: Any, record: Record) -> list[dict[str, Any]]:
    """Peak and residual drifts of storeys in a recorded event, given its sensors; half widths.

    For records that the fit has not seen. [] without likely laws or accelerations, and where the
    sensors contradict the model: the drifts are then those of `storeys_of` alone.
    """
    known = estimator.is_chain and bool(estimator.noise_of_sensors.any())
    if not known or record.quantity != "acceleration":
        return []
    if list(record.others) != estimator.others:  # some lack, or nobody reads them
        o = record.a.new_full((record.samples, len(estimator.others)), math.nan)
        for j, name in enumerate(estimator.others):
            if name in record.others and record.o is not None:
                o[:, j] = record.o[:, list(record.others).index(name)]
        record = replace(record, o=o, others=tuple(estimator.others))
    found = smoothed(estimator, record)
    if found is None:
        return []
    (y, half), own = found, np.full((2, len(STOREY), found.shape[2]), np.nan)
    at = np.abs(y).argmax(axis=0)[None]
    own[0, :2] = np.abs(y).max(axis=0), residual_of(y)
    own[1, :2] = np.take_along_axis(half, at, axis=0)[0], residual_of(half)
    return _rows(estimator, STOREY, *own)


def _response(
    structure: Structure, E: int, motion: Motion, ground: np.ndarray, dt: float
) -> np.ndarray:
    """The quantities of STOREY (5, E) of storeys, whose ground has some acceleration (·, 1).

    Of other elements the acceleration of a floor means nothing.
    """
    if motion.escape_time is not None:
        return np.full((len(STOREY), E), np.inf)
    floors, storeys = np.abs(motion.a + ground).max(axis=0), []
    for e in range(E):
        parts = [i for i, name in enumerate(structure.elements) if name.startswith(f"r{e + 1}_")]
        laws = [list(structure.elements.values())[i] for i in parts]
        y, end = np.ascontiguousarray(motion.y[:, parts[0]]), motion.r[-1, parts].sum()
        before, after = stiffness_of(laws, y, dt)
        held = 0.5 * end**2 / after if after > 0.0 else 0.0
        spent = motion.work[-1, parts].sum() - held
        left = after / before if before > 0.0 else math.nan
        floor = floors[e] if e < len(floors) else math.nan
        storeys.append([np.abs(y).max(), residual_of(y), floor, spent, left])
    return np.array(storeys).T


def stiffness_of(laws: Sequence[Element], y: np.ndarray, dt: float) -> tuple[float, float]:
    """Secant stiffness [N/m] of parallel laws in small cycles, before and after a drift y (T,) [m].

    Frequencies of small vibrations show the same; what has yielded and holds as before has lost
    nothing. The secant at the peak drift would call that a loss. NaN without a drift, or where laws
    cannot be followed.
    """
    small = SMALL * np.abs(y).max() * np.sin(2.0 * np.pi * np.arange(2 * CYCLE + 1) / CYCLE)
    top, bottom = -3 * CYCLE // 4 - 1, -CYCLE // 4 - 1  # of the second cycle

    def secant(path: np.ndarray) -> float:
        r = np.sum([force(law, path, dt) for law in laws], axis=0)
        return float((r[top] - r[bottom]) / (path[top] - path[bottom]))

    if not small.any():
        return math.nan, math.nan
    try:
        return secant(small), secant(np.concatenate([y, y[-1] + small[1:]]))
    except EscapedMotionError:
        return math.nan, math.nan


def _sizes(deformations: Tensor) -> np.ndarray:
    """Peak and residual (2E,) of every element."""
    y = deformations.cpu().numpy()
    return np.concatenate([np.abs(y).max(axis=0), residual_of(y)])


def _rows(
    estimator: ElementNetwork, keys: Sequence[str], own: np.ndarray, half: np.ndarray
) -> list[dict[str, Any]]:
    """A row of quantities own and half (Q, E) for each element whose drifts are known."""
    rows, heights = [], getattr(estimator, "heights", None)
    names = [*keys, *(f"{key}_half" for key in keys)]
    for e, pair in enumerate(names_of(estimator)):
        pairs = np.where(np.isfinite(own[:, e] + half[:, e]), [own[:, e], half[:, e]], np.nan)
        values = [None if math.isnan(value) else value for value in pairs.ravel().tolist()]
        found = dict(zip(names, values, strict=True))
        if None not in (found["peak"], found["residual"]):
            height = {"height": heights[e]} if heights else {}
            rows.append({"element": f"r{e + 1} {pair}", **height, **found})
    return rows


def _slopes(estimator: ElementNetwork, drive: Drive, y: np.ndarray) -> np.ndarray:
    """∂/∂θ (2E, P) of peaks and residuals of deformations y (T, E), exact: y = D x + supports."""
    of_x = estimator.measures.new_full((estimator.floors,), DISPLACEMENT)
    every = torch.eye(estimator.floors).to(estimator.B)
    seen = replace(estimator.composition(), measures=of_x, outputs=Part.fixed(every))
    first = [part @ estimator.seen(every) for part in (drive.x0, drive.v0)]
    drive = replace(drive, x0=first[0], v0=first[1])
    J = estimator.traced(seen, drive, estimator.substeps, derivatives=True).jacobian.cpu().numpy()
    D, at, each = seen.D.value.cpu().numpy(), np.abs(y).argmax(axis=0), np.arange(y.shape[1])
    peaks = np.sign(y[at, each])[:, None] * np.einsum("en,enp->ep", D, J[at])
    return np.concatenate([peaks, D @ residual_of(J)])


def _posterior(estimator: ElementNetwork, found: Laplace) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (P, P) of θ about its mode, and the step (P,) from the fit to that."""
    width = np.full(len(found.step), OPEN)
    for number, stated in stated_widths(estimator).items():
        width[number] = stated
    squares = sum(float((e**2).sum()) for e in found.residuals)
    variance = squares / max(found.samples - found.determined, 1.0)
    held = variance / width**2
    inverse = np.linalg.inv(variance * found.information + np.diag(held))
    score = sum(
        np.einsum("tn,tnp->p", e, J) for e, J in zip(found.residuals, found.jacobians, strict=True)
    )
    away = estimator.pull(True)[1].detach().cpu().numpy()
    scatter = found.noise.score_covariance(found.jacobians) + np.diag(variance * held)
    return inverse @ scatter @ inverse, inverse @ (score - held * away)


def _put_back(estimator: ElementNetwork, drive: Drive, left_out: Tensor) -> Iterator[Tensor]:
    """Deformations (T, E) of runs in which what the model left out [m/s²] acts on the masses."""
    composed = estimator.composition()
    n, E = left_out.shape[1], composed.supports.shape[1]
    masses = estimator.seen(torch.eye(estimator.floors, dtype=torch.float64)).T  # (·, n)
    inputs = torch.cat([composed.inputs.value, masses], dim=1)
    supports = torch.cat([composed.supports, composed.supports.new_zeros(2, E, n)], dim=2)
    more = replace(composed, inputs=Part.fixed(inputs), supports=supports)
    place = torch.arange(len(left_out)) * FEWEST_BLOCKS // len(left_out)
    before = left_out.new_zeros(drive.samples - len(left_out), n)
    draw = torch.Generator().manual_seed(0)
    for _ in range(DRAWS):
        weights = torch.randn(FEWEST_BLOCKS, generator=draw, dtype=torch.float64)[place, None]
        u = torch.cat([drive.u, torch.cat([before, weights * left_out])], dim=1)
        run = estimator.traced(more, replace(drive, u=u), estimator.substeps)
        yield run.deformations
