"""How accurate is the simulation, what does it cost against scipy, how does the cost grow?

    python -m benchmarks.simulation            # three minutes
    python -m benchmarks.simulation --quick    # seconds: shorter and fewer records

The paper's three systems under random forces. Accuracy: relative RMS error of the acceleration by
tolerance against a reference that locates every event (tests/reference.py), and milliseconds of a
record of 50 s. Scipy: the loosest rtol of solve_ivp, over the whole record with steps of at most a
sample, that comes as near to the reference as we do, and how much longer it takes. Growth: 1,000
records on all cores.   times are medians
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median

import numpy as np
from hydra.utils import instantiate
from omegaconf import OmegaConf
from scipy.integrate import solve_ivp

from benchmarks.table import seconds_of, show
from data.arguments import Parser
from data.parallel import in_threads
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.laws import NUMBERS
from data.simulation.motion import simulate
from data.simulation.records import Purpose, stream
from data.simulation.structure import Structure
from runner.config.command_line import command_errors
from runner.config.compose import CONF
from tests.reference import paper_structure, reference_response

FORCES = {"bilinear": (1.7, 4.5), "polynomial": (12.0, 3.4), "bouc_wen": (1.2, 3.0)}  # N, Hz
DT, TOLERANCE = 0.01, 1e-7  # [s]; as train.py has it
TOLERANCES = (1e-4, 1e-6, 1e-7, 1e-8, 1e-10)
METHODS = ("RK45", "LSODA", "DOP853")
GIVE_UP = 20.0  # seconds of scipy


def load(system: str) -> Structure:
    """The structure of conf/system; the forces are given here, so that numbers stay comparable."""
    cfg = OmegaConf.load(CONF / "system" / f"{system}.yaml")
    structure: Structure = instantiate(cfg.structure, _convert_="all")
    return structure


def force_of(system: str, structure: Structure, duration: float, seed: int = 0) -> np.ndarray:
    """Forces (T, n) of the training motion of a seed."""
    std, highest = FORCES[system]
    excitation = Excitation(force=BandLimitedGaussian(std, (0.0, highest)))
    rng = stream(seed, "train", 0, Purpose.EXCITATION)
    return excitation.draw(structure, round(duration / DT), DT, 0, rng)[0]


def relative(a: np.ndarray, reference: np.ndarray) -> float:
    return float(np.linalg.norm(a - reference) / np.linalg.norm(reference))


def accuracy(duration: float, quick: bool) -> Iterator[list[str]]:
    for system in FORCES:
        structure = load(system)
        forces = [force_of(system, structure, duration, seed) for seed in range(1 if quick else 3)]
        exact = [reference_response(*paper_structure(system), DT, f)["a"] for f in forces]
        long = force_of(system, structure, 50.0)
        for tolerance in TOLERANCES:
            errors = [
                relative(simulate(structure, f, DT, tolerance=tolerance).a, a)
                for f, a in zip(forces, exact, strict=True)
            ]
            times = seconds_of(partial(simulate, structure, long, DT, tolerance=tolerance), 5)
            numbers = f"{median(errors):.1e}", f"{max(errors):.1e}", f"{1e3 * median(times):.1f}"
            yield [system, f"{tolerance:.0e}", *numbers]


def law_of(law: int, p: np.ndarray) -> Callable[..., tuple[np.ndarray, np.ndarray | float]]:
    """(y, ẏ, z) → (r, ż) of elements with parameters p (E, P), for scipy."""
    if law == NUMBERS["polynomial"]:
        p1, p2, p3 = p.T[:3]
        return lambda y, ydot, z: ((p1 + p3 * y * y) * y + p2 * ydot, 0.0)
    if law == NUMBERS["bouc_wen"]:  # n = 1, no degradation, as in the paper
        A, beta, gamma, _, eta, nu = p.T[:6]
        return lambda y, ydot, z: (
            z,
            (A * ydot - nu * (beta * np.abs(ydot) * z - gamma * ydot * np.abs(z))) / eta,
        )
    assert law in (NUMBERS["bilinear"], NUMBERS["limited_slip"])
    z_y, k1, k2, c1, c2 = p.T[:5]
    gap = p[:, 5] if law == NUMBERS["limited_slip"] else None

    def slider(y: np.ndarray, ydot: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sliding = (np.abs(z) >= z_y) & (z * ydot > 0.0)
        if gap is None:
            springs = k2 * y + (k1 - k2) * z
        else:
            springs = k1 * z + k2 * np.sign(y) * np.maximum(np.abs(y) - gap, 0.0)
        return springs + np.where(sliding, c2, c1) * ydot, np.where(sliding, 0.0, ydot)

    return slider


def rate_of(structure: Structure, force: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """q̇(t, q) for q = [x, v, z], the force linear between samples."""
    n, B = structure.dofs, structure.incidence()[0]
    law, p, last = structure.law, structure.parameters, len(force) - 2
    groups = [(np.flatnonzero(law == k), law_of(k, p[law == k])) for k in np.unique(law)]
    drive = force / structure.masses
    rise, back = np.diff(drive, axis=0), B.T / structure.masses[:, None]

    def rate(t: float, q: np.ndarray) -> np.ndarray:
        sample = min(int(t / DT), last)
        y, ydot, z = B @ q[:n], B @ q[n : 2 * n], q[2 * n :]
        r, dq = np.empty_like(y), np.empty_like(q)
        for e, element in groups:
            r[e], dq[2 * n + e] = element(y[e], ydot[e], z[e])
        dq[:n] = q[n : 2 * n]
        dq[n : 2 * n] = drive[sample] + (t / DT - sample) * rise[sample] - back @ r
        return dq

    return rate


class GaveUpError(Exception):
    """Raised in a solver of scipy that chatters at a corner of a law and would never end."""


def until(
    rate: Callable[[float, np.ndarray], np.ndarray], end: float
) -> Callable[[float, np.ndarray], np.ndarray]:
    """q̇(t, q) that raises GaveUpError once the clock is past `end`."""

    def watched(t: float, q: np.ndarray) -> np.ndarray:
        if time.perf_counter() > end:
            raise GaveUpError
        return rate(t, q)

    return watched


def against_scipy(duration: float, budget: float) -> Iterator[list[str]]:
    """Ours, then every method at the loosest rtol that is as accurate, or its last in budget.

    budget: seconds that a method has, and each of its runs; one that would take longer is stopped.
    """
    for system in FORCES:
        structure = load(system)
        force = force_of(system, structure, duration)
        exact = reference_response(*paper_structure(system), DT, force)["a"]
        motion = simulate(structure, force, DT)
        ours, error = median(seconds_of(partial(simulate, structure, force, DT), 9)), 0.0
        error = relative(motion.a, exact)
        yield [system, f"{TOLERANCE:.0e}", f"{error:.1e}", f"{1e3 * ours:.2f}", "1"]
        n, t, rate = structure.dofs, DT * np.arange(len(force)), rate_of(structure, force)
        yielding = structure.law == NUMBERS["bouc_wen"]
        z = np.where(yielding, np.abs(motion.r).max(axis=0), structure.parameters[:, 0])
        peaks = [np.full(n, np.abs(u).max()) for u in (motion.x, motion.v)]
        sizes = np.concatenate([*peaks, z])
        for method in METHODS:
            start, reached, took, used = time.perf_counter(), np.inf, np.inf, np.inf
            for rtol in 10.0 ** np.arange(-5, -14, -1):
                begin = time.perf_counter()
                options = {"method": method, "rtol": rtol, "atol": rtol * sizes, "max_step": DT}
                watched, rest = until(rate, begin + budget), np.zeros(len(sizes))
                try:
                    q = solve_ivp(watched, (0.0, t[-1]), rest, t_eval=t, **options).y.T
                except GaveUpError:
                    break
                took, used = time.perf_counter() - begin, rtol
                a = np.array([rate(*at)[n : 2 * n] for at in zip(t, q, strict=True)])
                reached = relative(a, exact)
                if reached <= 1.1 * error or time.perf_counter() - start > budget:
                    break
            equal = "" if reached <= 1.1 * error else " given up"
            numbers = f"{reached:.1e}", f"{1e3 * took:.2f}", f"{took / ours:.0f}{equal}"
            yield [f"  {method}", f"{used:.0e}", *numbers]


def growth(quick: bool) -> Iterator[list[str]]:
    count, duration = (10, 10.0) if quick else (1000, 50.0)
    for system in FORCES:
        structure = load(system)
        many = [force_of(system, structure, duration, seed) for seed in range(count)]
        run = partial(in_threads, partial(simulate, structure, dt=DT), many)
        took = median(seconds_of(run, 1 if quick else 3))
        yield [f"{count} records of {duration:g} s, {system}", f"{took:.2f}"]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="shorter and fewer records")
    quick = parser.parse_args().quick
    reference = 1.0 if quick else 10.0
    head = ("system", "tolerance", "median", "worst", "ms of 50 s")
    show(f"Error in {reference:g} s", head, accuracy(reference, quick))
    peer, budget = (0.5, 0.5) if quick else (5.0, GIVE_UP)
    head = ("system", "tolerance", "error", "ms", "× ours")
    show(f"Beside scipy at equal error, {peer:g} s", head, against_scipy(peer, budget))
    show(f"Growth, {os.cpu_count()} cores", ("what", "seconds"), growth(quick))


if __name__ == "__main__":
    with command_errors():
        main()
