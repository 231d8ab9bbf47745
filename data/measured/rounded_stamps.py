"""Stamps of even samples that were rounded when they were written.   T samples.

0.01, 0.02, 0.02, 0.03 at 120 Hz: neither uneven nor doubled.  A file written with so many
significant digits (five, in many programs) rounds ever more coarsely, by decades of its times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FINE = 0.01  # of dt: a finer rounding is none
GAP = 1.5  # times dt: longer steps have lost samples, where rounding does not explain them
MOST_LEVELS = 40  # different steps of rounded stamps, gaps apart
FEWEST = 20  # odd steps that stand for a rounding and not for lost samples
TINY = 1e-30  # s


@dataclass(frozen=True)
class Lattice:
    """Even samples behind rounded stamps."""

    dt: float  # [s], slope of a line through all stamps
    resolution: float  # [s], the coarsest of the stamps
    places: np.ndarray  # (T,) number of each sample; leaps where samples are lost

    @property
    def lost(self) -> np.ndarray:
        """Samples lost in each step (T − 1,)."""
        return np.diff(self.places) - 1


def lattice_of(time: np.ndarray) -> Lattice | None:
    """The even samples behind stamps (T,) [s] that never go back; None where none explain them."""
    steps = np.diff(time)
    if len(steps) < 8 or not steps.max() > TINY:
        return None
    stamps = np.floor(np.log10(np.maximum(np.abs(time), 0.01))).astype(int) + 2  # decades
    decade, inside = stamps[1:], stamps[1:] == stamps[:-1]
    coarse = np.zeros(len(steps))  # resolution of the stamps around each step
    for value in np.unique(decade[inside]):
        coarse[decade == value] = _resolution(steps[inside & (decade == value)])
    if not coarse.any():
        return None
    coarse[coarse == 0.0] = coarse[coarse > 0.0].min()  # too few stamps to tell
    dt = _mean_step(steps, coarse)
    if dt is None:
        return None
    long = steps > np.maximum(GAP * dt, dt + 1.01 * coarse)
    places = np.concatenate(([0], np.cumsum(np.where(long, np.rint(steps / dt), 1)))).astype(int)
    piece = np.concatenate(([0], np.cumsum(long)))
    dt = _slope(time, places, piece)
    places = _stepped(time, places, piece, dt)
    off = time - dt * places
    if not _explained(off, piece, stamps, np.concatenate((coarse[:1], coarse)), dt):
        return None
    usual = np.median(steps)
    odd = ~long & ((steps > GAP * usual) | (steps < 0.5 * usual))
    if 0 < odd.sum() < FEWEST and float(coarse.max()) > 0.5 * dt:
        return None  # few odd steps among many even ones: lost or doubled samples
    return Lattice(dt, float(coarse.max()), places)


def _resolution(steps: np.ndarray) -> float:
    """What the stamps behind some steps are multiples of [s]; 0 for finer ones than `FINE`."""
    usual = float(np.median(steps))
    dt = float(steps[steps <= 2.5 * usual].mean()) if usual > 0.0 else float(steps.mean())
    if not dt > TINY:
        return 0.0
    short = steps[steps <= max(3.0 * dt, 1.01 * float(steps[steps > 0.0].min()))][:1_000_000]
    levels = np.unique(np.rint(short * (1000.0 / dt))) * (dt / 1000.0)
    levels = levels[np.concatenate(([True], np.diff(levels) > 0.5 * FINE * dt))]
    if not 2 <= len(levels) <= MOST_LEVELS:
        return 0.0
    return float(np.diff(levels).min())


def _mean_step(steps: np.ndarray, coarse: np.ndarray) -> float | None:
    """Mean of the steps that have lost no sample."""
    fine = steps[coarse == coarse.min()]
    dt = float(np.median(fine)) or float(fine.mean())
    for _ in range(10):
        kept = steps <= np.maximum(GAP * dt, dt + 1.01 * coarse)
        mean = float(steps[kept].mean()) if kept.any() else 0.0
        if not mean > TINY:
            return None
        if mean == dt:
            break
        dt = mean
    return dt


def _slope(time: np.ndarray, places: np.ndarray, piece: np.ndarray) -> float:
    """Slope of lines through the stamps of all pieces, each with its own offset."""
    count = np.bincount(piece)
    k = places - (np.bincount(piece, places) / count)[piece]
    t = time - (np.bincount(piece, time) / count)[piece]
    return float(k @ t / (k @ k))


def _stepped(time: np.ndarray, places: np.ndarray, piece: np.ndarray, dt: float) -> np.ndarray:
    """Places with the gaps that whole pieces ask for, not one rounded stamp on each side."""
    count = np.bincount(piece)
    middle = np.bincount(piece, time - dt * places) / count
    more = np.rint(np.diff(middle) / dt)
    return places + np.concatenate(([0], np.cumsum(more))).astype(int)[piece]


def _explained(
    off: np.ndarray, piece: np.ndarray, decade: np.ndarray, coarse: np.ndarray, dt: float
) -> bool:
    """Whether stamps leave the line by no more than their rounding, piece by piece."""
    cell = piece * (decade.max() + 1) + decade
    edges = np.flatnonzero(np.diff(cell, prepend=-1))
    spread = np.maximum.reduceat(off, edges) - np.minimum.reduceat(off, edges)
    return bool((spread <= 1.2 * coarse[edges] + FINE * dt).all())
