"""Structures under forces, whose motion the benchmarks of the simulation measure; and printing.

The structures are those of conf/system; the forces stand here, so that the numbers stay comparable
when the calibration of the systems changes.
"""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from omegaconf import OmegaConf

from benchmarks.timing import seconds_of
from data.simulation.elements import Bilinear
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.motion import Motion, simulate
from data.simulation.records import EXCITATION, stream
from data.simulation.structure import Structure
from tests.reference import paper_structure, reference_response

FORCES = {  # standard deviation [N] and highest frequency [Hz]
    "bilinear": (1.7, 4.5),
    "polynomial": (12.0, 3.4),
    "bouc_wen": (1.2, 3.0),
}
CONF = Path(__file__).parents[2] / "conf" / "system"
DT, COARSE_DT = 0.01, 0.1  # [s]
TOLERANCES = 10.0 ** np.arange(-4, -11, -1)


@dataclass(frozen=True)
class Size:
    """How much to run; durations and budget in seconds."""

    duration: float  # of a record
    reference_duration: float  # of a record that has an event-located reference
    peer_duration: float  # of the record that scipy integrates
    peer_budget: float  # for scipy to reach our error
    seeds: int  # records with a reference
    records: int  # simulated together
    distinct: int  # of these, the others repeat them
    dofs: Sequence[int]
    repeats: int


FULL = Size(50.0, 10.0, 5.0, 20.0, 3, 1000, 50, (1, 3, 10, 30, 100), 7)
QUICK = Size(10.0, 1.0, 0.5, 0.5, 1, 10, 2, (1, 3, 10), 1)


def relative_rms(a: np.ndarray, reference: np.ndarray) -> float:
    """Error of accelerations (T, n) relative to a reference."""
    return float(np.linalg.norm(a - reference) / np.linalg.norm(reference))


def show(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table of text, columns aligned to the right."""
    table = [tuple(header), *map(tuple, rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    print(f"\n{title}\n")
    for row in table:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells).rstrip(), flush=True)


@dataclass(frozen=True)
class Case:
    """One structure under one force (T, n), sampled every `dt`."""

    structure: Structure
    force: np.ndarray
    dt: float

    def motion(self, tolerance: float = 1e-7) -> Motion:
        return simulate(self.structure, self.force, self.dt, tolerance=tolerance)

    def seconds(self, repeats: int, tolerance: float = 1e-7) -> float:
        return statistics.median(seconds_of(lambda: self.motion(tolerance), repeats))

    def reference(self, system: str) -> np.ndarray:
        """Event-located acceleration (T, n)."""
        return reference_response(*paper_structure(system), self.dt, self.force)["a"]


def load(system: str) -> tuple[Structure, Excitation]:
    """Structure of a system as its config has it, and its forces."""
    cfg, (std, highest) = OmegaConf.load(CONF / f"{system}.yaml"), FORCES[system]
    force = BandLimitedGaussian(std, (0.0, highest))
    return instantiate(cfg.structure, _convert_="all"), Excitation(force=force)


def case_of(
    system: str, duration: float, seed: int = 0, dt: float = DT, chain: Structure | None = None
) -> Case:
    """The training motion of one seed, or that of a chain under the forces of the system."""
    structure, excitation = load(system)
    structure = structure if chain is None else chain
    rng = stream(seed, "train", 0, EXCITATION)
    return Case(structure, excitation.draw(structure, round(duration / dt), dt, 0, rng)[0], dt)


def bilinear_chain(dofs: int) -> Structure:
    """Masses of 1 kg in a row, joined by the bilinear system's element r1, held by a support."""
    law = load("bilinear")[0].elements["r1"]
    assert isinstance(law, Bilinear)
    ends = itertools.pairwise(["s1", *(f"x{i + 1}" for i in range(dofs))])
    springs = {f"r{i + 1}": replace(law, between=pair) for i, pair in enumerate(ends)}
    return Structure(np.ones(dofs).tolist(), springs)
