"""How accurate is the simulation, what does it cost beside scipy, and how does the cost grow?

    python -m benchmarks.simulation            # a few minutes
    python -m benchmarks.simulation --quick    # under 30 s: shorter and fewer records
    python -m benchmarks.simulation accuracy   # one study: accuracy, scipy, records or growth

Errors are relative RMS errors of the acceleration, against the event-located reference of
tests/reference.py or, where a title says so, against the simulation itself at TIGHTEST. Times are
medians of repeated runs. The structures are those of conf/system; the forces stand here, so that
the numbers stay comparable when the calibration of the systems changes.
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numba
import numpy as np
import scipy
from hydra.utils import instantiate
from omegaconf import OmegaConf
from scipy.integrate import solve_ivp

from benchmarks.timing import seconds_of
from data.simulation.elements import BILINEAR, BOUC_WEN, LIMITED_SLIP, POLYNOMIAL, Bilinear
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.motion import Motion, simulate, simulate_many
from data.simulation.records import EXCITATION, stream
from data.simulation.structure import Structure
from tests.reference import paper_structure, reference_response

FORCES = {  # standard deviation [N] and highest frequency [Hz]
    "bilinear": (1.7, 4.5),
    "polynomial": (12.0, 3.4),
    "bouc_wen": (1.2, 3.0),
}
CONF = Path(__file__).parents[1] / "conf" / "system"
DT, COARSE_DT = 0.01, 0.1  # [s]
TOLERANCES = 10.0 ** np.arange(-4, -11, -1)
TIGHTEST = 1e-12
EQUAL = 1.1  # errors within this factor count as equal
FASTER, SECONDS_FOR_1000 = 100.0, 10.0  # targets


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
QUICK = Size(10.0, 2.0, 1.0, 1.0, 1, 20, 5, (1, 3, 10), 3)


# Measuring and printing.


def relative_rms(a: np.ndarray, reference: np.ndarray) -> float:
    return float(np.linalg.norm(a - reference) / np.linalg.norm(reference))


def show(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """A table of text, columns aligned to the right."""
    table = [tuple(header), *map(tuple, rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    print(f"\n{title}\n")
    for row in table:
        cells = (cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        print("  ".join(cells).rstrip(), flush=True)


# Systems and their forces.


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


# Accuracy and cost.


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


# The same equations for scipy, vectorised over the elements of a law, without events.


def law_of(law: int, p: np.ndarray) -> Callable[..., tuple[np.ndarray, np.ndarray | float]]:
    """(y, ẏ, z) → (r, ż) of elements with parameters p (E, P), see data/simulation/elements.py."""
    if law == POLYNOMIAL:
        p1, p2, p3 = p.T[:3]
        return lambda y, ydot, z: ((p1 + p3 * y * y) * y + p2 * ydot, 0.0)
    if law == BOUC_WEN:  # n = 1, no degradation, as in the paper
        A, beta, gamma, _, eta, nu = p.T[:6]
        return lambda y, ydot, z: (
            z,
            (A * ydot - nu * (beta * np.abs(ydot) * z - gamma * ydot * np.abs(z))) / eta,
        )
    assert law in (BILINEAR, LIMITED_SLIP)
    z_y, k1, k2, c1, c2 = p.T[:5]
    gap = p[:, 5] if law == LIMITED_SLIP else None

    def slider(y: np.ndarray, ydot: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sliding = (np.abs(z) >= z_y) & (z * ydot > 0.0)
        damping, rate = np.where(sliding, c2, c1) * ydot, np.where(sliding, 0.0, ydot)
        if gap is None:
            return k2 * y + (k1 - k2) * z + damping, rate
        return k1 * z + k2 * (y - np.minimum(np.maximum(y, -gap), gap)) + damping, rate

    return slider


def equation_of_motion(case: Case) -> Callable[[float, np.ndarray], np.ndarray]:
    """q̇(t, q) for q = [x, v, z], the force linear between samples."""
    structure, n, B = case.structure, case.structure.dofs, case.structure.incidence()[0]
    law, p, dt, last = structure.law, structure.parameters, case.dt, len(case.force) - 2
    groups = [(np.flatnonzero(law == k), law_of(k, p[law == k])) for k in np.unique(law)]
    drive = case.force / structure.masses
    rise, back = np.diff(drive, axis=0), B.T / structure.masses[:, None]

    def rate(t: float, q: np.ndarray) -> np.ndarray:
        sample = min(int(t / dt), last)
        y, ydot, z = B @ q[:n], B @ q[n : 2 * n], q[2 * n :]
        r, dq = np.empty_like(y), np.empty_like(q)
        for e, element in groups:
            r[e], dq[2 * n + e] = element(y[e], ydot[e], z[e])
        dq[:n] = q[n : 2 * n]
        dq[n : 2 * n] = drive[sample] + (t / dt - sample) * rise[sample] - back @ r
        return dq

    return rate


def sizes(case: Case) -> np.ndarray:
    """Peaks of x, v and z: scipy's errors are allowed relative to them, as ours are."""
    motion, structure = case.motion(), case.structure
    z = np.where(
        structure.law == BOUC_WEN, np.abs(motion.r).max(axis=0), structure.parameters[:, 0]
    )
    peaks = [np.full(structure.dofs, np.abs(u).max()) for u in (motion.x, motion.v)]
    return np.concatenate([*peaks, z])


@dataclass(frozen=True)
class Peer:
    """One use of solve_ivp: over the whole record with steps ≤ dt, or sample by sample."""

    method: str
    by_sample: bool

    @property
    def name(self) -> str:
        return f"{self.method}, {'sample by sample' if self.by_sample else f'max_step={DT}'}"

    def solve(
        self, rate: Callable[..., np.ndarray], t: np.ndarray, rtol: float, atol: np.ndarray
    ) -> np.ndarray:
        """States (T, len q) at the samples t, from rest."""
        q, options = np.zeros(atol.size), {"method": self.method, "rtol": rtol, "atol": atol}
        if not self.by_sample:
            return solve_ivp(rate, (t[0], t[-1]), q, t_eval=t, max_step=t[1], **options).y.T
        states = [q]
        for start, stop in itertools.pairwise(t):
            path = solve_ivp(rate, (start, stop), states[-1], first_step=stop - start, **options)
            states.append(path.y[:, -1])
        return np.array(states)

    def run(self, case: Case, rtol: float, budget: float) -> tuple[np.ndarray, float]:
        """Acceleration (T, n) and seconds. Raises TimeoutError past the budget [s]."""
        n, t, rate = (
            case.structure.dofs,
            case.dt * np.arange(len(case.force)),
            equation_of_motion(case),
        )
        atol = rtol * sizes(case)
        start = time.perf_counter()

        def watched(t: float, q: np.ndarray) -> np.ndarray:
            if time.perf_counter() - start > budget:
                raise TimeoutError
            return rate(t, q)

        states = self.solve(watched, t, rtol, atol)
        seconds = time.perf_counter() - start
        return np.array([rate(*at)[n : 2 * n] for at in zip(t, states, strict=True)]), seconds


PEERS = [Peer("RK45", False), Peer("RK45", True), Peer("LSODA", False), Peer("DOP853", False),
         Peer("DOP853", True)]  # fmt: skip


def loosest(
    peer: Peer, case: Case, exact: np.ndarray, wanted: float, budget: float
) -> tuple[float, float, float]:
    """Loosest rtol that reaches the wanted error, or the last one within budget; error, seconds."""
    last = np.nan, np.nan, np.nan
    for rtol in 10.0 ** np.arange(-5, -14, -1):
        try:
            a, seconds = peer.run(case, rtol, budget)
        except TimeoutError:
            break
        last = rtol, relative_rms(a, exact), seconds
        if last[1] <= wanted:
            break
    return last


def peer_rows(system: str, size: Size) -> list[tuple[str, ...]]:
    """Ours, then each peer at its loosest tolerance that is as accurate."""
    case = case_of(system, size.peer_duration)
    exact, ours = case.reference(system), case.seconds(5 * size.repeats)
    error = relative_rms(case.motion().a, exact)
    rows = [(system, "ours", "1e-07", f"{error:.1e}", f"{1e3 * ours:.2f}", "1", "")]
    best = size.peer_budget
    for peer in PEERS:
        rtol, reached, seconds = loosest(peer, case, exact, EQUAL * error, best)
        if equal := reached <= EQUAL * error:
            again = [peer.run(case, rtol, np.inf)[1] for _ in range(3)]
            seconds = statistics.median(again)
            best = min(best, 1.5 * seconds)
        numbers = f"{rtol:.0e}", f"{reached:.1e}", f"{1e3 * seconds:.2f}", f"{seconds / ours:.0f}"
        cells = (cell.replace("nan", "–") for cell in numbers)
        rows.append((system, peer.name, *cells, "" if equal else "given up"))
    return rows


def against_scipy(size: Size) -> None:
    """Each peer at equal error, and the fastest of them."""
    rows = {system: peer_rows(system, size) for system in FORCES}
    show(
        f"Against scipy.integrate.solve_ivp, one record of {size.peer_duration:g} s: the loosest "
        "rtol that reaches our error.\nGiven up: half as long again as the fastest so far, and not "
        "there yet; the numbers are its last",
        ("system", "method", "tolerance", "error", "ms", "× ours", ""),
        itertools.chain.from_iterable(rows.values()),
    )
    summary = []
    for system, methods in rows.items():
        equal = [row for row in methods[1:] if not row[-1]]
        row = min(equal, key=lambda row: float(row[4]), default=None)
        if row is not None:
            summary.append((system, row[1], row[5], f"{FASTER:g}"))
    show("Fastest of them at equal error", ("system", "method", "× ours", "target"), summary)


# Many records, and growth.


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


STUDIES = {
    "accuracy": accuracy,
    "scipy": against_scipy,
    "records": many_records,
    "growth": growth,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("studies", nargs="*", metavar="study", help=f"of {', '.join(STUDIES)}")
    parser.add_argument("--quick", action="store_true", help="a small run, under 30 s")
    options = parser.parse_args()
    if unknown := set(options.studies) - set(STUDIES):
        parser.error(f"unknown study {', '.join(sorted(unknown))}; choose of {', '.join(STUDIES)}")
    print(
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores; "
        f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, "
        f"numba {numba.__version__}"
    )
    first = case_of("bilinear", 1.0).seconds(1)
    print(f"first simulation, compiled or read from numba's cache: {first:.1f} s")
    for name in options.studies or STUDIES:
        STUDIES[name](QUICK if options.quick else FULL)


if __name__ == "__main__":
    main()
