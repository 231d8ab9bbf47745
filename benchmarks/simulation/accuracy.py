"""How accurate is the simulation by tolerance, and what does it cost?

Against the event-located reference of tests/reference.py and, for long records, against the
simulation itself at TIGHTEST.
"""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.simulation.cases import (
    COARSE_DT,
    DT,
    FORCES,
    TOLERANCES,
    Case,
    Size,
    case_of,
    relative_rms,
    show,
)

TIGHTEST = 1e-12


def errors_by_tolerance(case: Case, exact: np.ndarray) -> list[float]:
    return [relative_rms(case.motion(tolerance).a, exact) for tolerance in TOLERANCES]


def reference_errors(system: str, size: Size, dt: float) -> np.ndarray:
    """Errors against the event-located reference (tolerances, seeds)."""
    cases = [case_of(system, size.reference_duration, seed, dt) for seed in range(size.seeds)]
    return np.transpose([errors_by_tolerance(case, case.reference(system)) for case in cases])


def accuracy_rows(system: str, size: Size) -> list[tuple[str, ...]]:
    """One row per tolerance."""
    fine, coarse = (reference_errors(system, size, dt) for dt in (DT, COARSE_DT))
    case = case_of(system, size.duration)
    long = errors_by_tolerance(case, case.motion(TIGHTEST).a)
    rows = []
    for i, tolerance in enumerate(TOLERANCES):
        errors = np.median(fine[i]), fine[i].max(), np.median(coarse[i]), coarse[i].max(), long[i]
        ms = 1e3 * case.seconds(size.repeats, tolerance)
        rows.append((system, f"{tolerance:.0e}", *(f"{e:.1e}" for e in errors), f"{ms:.1f}"))
    return rows


def accuracy(size: Size) -> None:
    """Error and time by tolerance, for the project's sampling and for a coarse one."""
    show(
        f"Accuracy and cost: {size.seeds} record(s) of {size.reference_duration:g} s per system "
        f"against the event-located reference,\nsampled every {DT} s and every {COARSE_DT} s; "
        f"one record of {size.duration:g} s sampled every {DT} s against tolerance {TIGHTEST:g}",
        ("system", "tolerance", f"{DT} s: median", "worst", f"{COARSE_DT} s: median", "worst",
         f"{size.duration:g} s record", "ms"),
        itertools.chain.from_iterable(accuracy_rows(system, size) for system in FORCES),
    )  # fmt: skip
