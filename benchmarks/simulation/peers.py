"""What does the simulation cost beside scipy.integrate.solve_ivp, at equal error?

The same equations for scipy, vectorised over the elements of a law, without events.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.simulation.cases import DT, FORCES, Case, Size, case_of, relative_rms, show
from data.simulation.elements.bilinear import BILINEAR
from data.simulation.elements.bouc_wen import BOUC_WEN
from data.simulation.elements.limited_slip import LIMITED_SLIP
from data.simulation.elements.polynomial import POLYNOMIAL

EQUAL = 1.1  # errors within this factor count as equal
FASTER = 100.0  # target


def law_of(law: int, p: np.ndarray) -> Callable[..., tuple[np.ndarray, np.ndarray | float]]:
    """(y, ẏ, z) → (r, ż) of elements with parameters p (E, P), see data/simulation/elements."""
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
    rows: list[tuple[str, ...]] = [
        (system, "ours", "1e-07", f"{error:.1e}", f"{1e3 * ours:.2f}", "1", "")
    ]
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
