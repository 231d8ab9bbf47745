"""How does the cost of the simulation grow with records, DOFs and accuracy?"""

from __future__ import annotations

import itertools
import os
import statistics
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from benchmarks.simulation.cases import (
    COARSE_DT,
    DT,
    FORCES,
    TOLERANCES,
    Size,
    bilinear_chain,
    case_of,
    show,
)
from benchmarks.timing import seconds_of
from data.simulation.motion import Motion, simulate, simulate_many
from data.simulation.structure import Structure

SECONDS_FOR_1000 = 10.0  # target


def on_one_thread(structure: Structure, forces: Sequence[np.ndarray]) -> list[Motion]:
    """As simulate_many, with a single worker, so that both allocate memory in the same way."""
    with ThreadPoolExecutor(1) as pool:
        return list(pool.map(lambda force: simulate(structure, force, DT), forces))


def many_records(size: Size) -> None:
    """All records on all cores and on one thread."""
    rows = []
    for system in FORCES:
        cases = [case_of(system, size.duration, seed) for seed in range(size.distinct)]
        structure = cases[0].structure
        forces = [cases[i % size.distinct].force for i in range(size.records)]
        escaped = sum(case.motion().escape_time is not None for case in cases)
        together = statistics.median(seconds_of(partial(simulate_many, structure, forces, DT), 3))
        alone = statistics.median(seconds_of(partial(on_one_thread, structure, forces), 3))
        times = f"{together:.2f}", f"{alone:.2f}", f"{alone / together:.2f}"
        rows.append((system, *times, str(escaped)))
    show(
        f"{size.records} records of {size.duration:g} s on {os.cpu_count()} cores "
        f"(target for 1000 records of 50 s: {SECONDS_FOR_1000:g} s)",
        ("system", "s, all cores", "s, one thread", "speed-up", f"escaped of {size.distinct}"),
        rows,
    )  # fmt: skip


def show_growth(title: str, name: str, cases: Sequence[tuple[float, float]]) -> None:
    """Milliseconds by size, and the power of the size with which they grew."""
    rows = [(f"{cases[0][0]:g}", f"{1e3 * cases[0][1]:.1f}", "")]
    for (before, earlier), (now, seconds) in itertools.pairwise(cases):
        power = np.log(seconds / earlier) / np.log(now / before)
        rows.append((f"{now:g}", f"{1e3 * seconds:.1f}", f"{power:.2f}"))
    show(title, (name, "ms", "power"), rows)


def growth(size: Size) -> None:
    """Time against the number of records, of DOFs, and the tolerance."""
    case = case_of("bilinear", size.duration)
    counts = [count for count in (1, 10, 100, 1000) if count <= size.records]
    cases = []
    for n in counts:
        run = partial(simulate_many, case.structure, [case.force] * n, DT)
        cases.append((n, statistics.median(seconds_of(run, 1 if n > 100 else 5))))
    show_growth(f"Bilinear system, {size.duration:g} s, all cores", "records", cases)

    chains = [case_of("bilinear", 10.0, chain=bilinear_chain(n)) for n in size.dofs]
    cases = [(c.structure.dofs, c.seconds(size.repeats)) for c in chains]
    show_growth("Chain of bilinear elements, one record of 10 s", "DOFs", cases)

    case = case_of("bilinear", 10.0 * size.duration, dt=COARSE_DT)
    cases = [(t, case.seconds(size.repeats, t)) for t in TOLERANCES]
    title = f"Bilinear system, {10.0 * size.duration:g} s sampled every {COARSE_DT} s"
    show_growth(title, "tolerance", cases)
