"""What is the exact response of a lumped structure with hysteretic and clearance elements?

A slow, very accurate reference that shares no code with the simulator it verifies. It solves

    M x'' + B^T r = f(t),    y = B x - Bs s,    x(0) = x'(0) = 0,

where y is the deformation of each element (position of its end less position of its start), r
its restoring force, f a force that is linear between samples and s the motion of the supports,
a cubic Hermite curve through the sampled displacement and velocity. The right-hand side is not
smooth where an element yields, unloads, closes its gap or changes sign in the Bouc-Wen law, nor
at the samples. So each smooth piece is integrated on its own with the eighth-order method DOP853
of Hairer, Norsett & Wanner (Solving Ordinary Differential Equations I, 1993, sec. II.5): every
corner is located by root finding and the integration restarts there and at every sample.

The laws and the three example systems follow Brewick & Masri (2016), Nonlinear Dynamics 85,
1297-1318, doi:10.1007/s11071-016-2761-x, structure of Eq. 18; the Bouc-Wen law with stiffness
and strength degradation is that of Baber & Wen (1981), J. Eng. Mech. Div. ASCE 107, 1069-1087.

Units: any consistent set, e.g. kg, m, s, N; the corner tolerance CORNER assumes one in which the
deformations, their rates and the Bouc-Wen forces are of order 1e-3 to 1e2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Element = dict[str, str | float]

CORNER = 1e-14  # how far beyond a corner the solution may run before the branch changes
PROBES = 32  # points per smooth piece at which a missed corner is looked for
MAX_PIECES = 200  # smooth pieces allowed between two samples


@dataclass
class Branch:
    """The smooth piece of its law that an element is on."""

    direction: int = 1  # sign of the deformation rate
    slip: int = 0  # side on which the element yields or slips, 0 while it sticks
    gap: int = 0  # side on which the gap is closed, 0 while it is open
    pull: int = 1  # sign of the Bouc-Wen force

    def turn(self, corner: str, y: float) -> None:
        """Move to the branch behind a corner."""
        if corner == "direction":
            self.direction, self.slip = -self.direction, 0
        elif corner == "slip":
            self.slip = self.direction
        elif corner == "gap":
            self.gap = 0 if self.gap else int(np.sign(y))
        else:
            self.pull = -self.pull


def restoring_force(e: Element, branch: Branch, y, rate, z):
    """Restoring force of one element on a given branch."""
    if e["law"] == "polynomial":
        return e["p1"] * y + e["p2"] * rate + e["p3"] * y**3
    if e["law"] == "bouc_wen":
        return z
    damping = (e["c2"] if branch.slip else e["c1"]) * rate
    if e["law"] == "bilinear":
        return e["k2"] * y + (e["k1"] - e["k2"]) * z + damping
    stop = e["k2"] * (y - branch.gap * e["zg"]) if branch.gap else 0.0
    return e["k1"] * z + stop + damping


def internal_rates(e: Element, branch: Branch, rate, z, energy):
    """z' and E' of one element.

    In the Bouc-Wen law the signs of y' and r are those of the branch, so that the right-hand side
    stays smooth in the one step that runs across a corner.
    """
    if e["law"] == "polynomial":
        return 0.0, 0.0
    if e["law"] != "bouc_wen":
        return (0.0 if branch.slip else rate), 0.0
    eta = e["eta"] + e["eta_rate"] * energy
    nu = e["nu"] + e["nu_rate"] * energy
    size, n = branch.pull * z, float(e["n"])
    power = size ** int(n) if n.is_integer() else np.sign(size) * abs(size) ** n  # |r|^n
    aligned = branch.direction * branch.pull
    return rate * (e["A"] - nu * (e["beta"] * aligned - e["gamma"]) * power) / eta, z * rate


def margins(e: Element, branch: Branch, y, rate, z) -> dict:
    """Distances to the corners of the branch, positive inside it.

    The reversal of y' is a corner of every hysteretic element, although nothing changes there
    while it sticks: between reversals z and y are monotone, so a brief visit to the yield level
    or to the gap cannot begin and end unseen within one step.
    """
    if e["law"] == "polynomial":
        return {}
    out = {"direction": branch.direction * rate}
    if e["law"] == "bouc_wen":
        return out | {"pull": branch.pull * z}
    if not branch.slip:
        # One-sided: an element that unloads leaves z = zy and must not be caught again at once.
        out["slip"] = e["zy"] - branch.direction * z
    if e["law"] == "limited_slip":
        out["gap"] = branch.gap * y - e["zg"] if branch.gap else e["zg"] - abs(y)
    return out


@dataclass
class Structure:
    """Equation of motion in u = [x, x', z, E]; E is the energy of the Bouc-Wen laws."""

    masses: Array
    elements: list[Element]
    to_dof: Array  # B, (elements, degrees of freedom)
    to_support: Array  # Bs, (elements, supports)
    branches: list[Branch]
    inputs: Array  # polynomials [f, Bs s, Bs s'] in the time after the last sample

    def split(self, u: Array) -> list[Array]:
        n, m = self.to_dof.T.shape
        return np.split(u, [n, 2 * n, 2 * n + m])

    def deformation(self, t, u: Array) -> list[Array]:
        """Force f, deformation y and its rate y' at time t after the sample, or times t."""
        n, m = self.to_dof.T.shape
        f, support, support_rate = np.split(polyval(t, self.inputs), [n, n + m])
        x, v, _, _ = self.split(u)
        return [f, self.to_dof @ x - support, self.to_dof @ v - support_rate]

    def response(self, t: float, u: Array) -> dict[str, Array]:
        f, y, rate = self.deformation(t, u)
        x, v, z, _ = self.split(u)
        laws = zip(self.elements, self.branches, y, rate, z, strict=True)
        r = np.array([restoring_force(*law) for law in laws])
        return {"x": x, "v": v, "a": (f - self.to_dof.T @ r) / self.masses, "y": y, "r": r}

    def slope(self, t: float, u: Array) -> Array:
        """u' on the current branches."""
        _, _, rate = self.deformation(t, u)
        _, v, z, energy = self.split(u)
        laws = zip(self.elements, self.branches, rate, z, energy, strict=True)
        inner = np.transpose([internal_rates(*law) for law in laws])
        return np.concatenate([v, self.response(t, u)["a"], *inner])

    def corners(self, t, u: Array) -> dict[tuple[int, str], Array]:
        """Margins of all elements, by element and corner."""
        _, y, rate = self.deformation(t, u)
        laws = zip(self.elements, self.branches, y, rate, self.split(u)[2], strict=True)
        return {(i, k): g for i, law in enumerate(laws) for k, g in margins(*law).items()}

    def pass_corner(self, t: float, u: Array, corner: tuple[int, str]) -> None:
        i, kind = corner
        self.branches[i].turn(kind, self.deformation(t, u)[1][i])
        if kind == "slip":  # z is held at the yield level itself
            self.split(u)[2][i] = self.branches[i].slip * self.elements[i]["zy"]


def smooth_piece(structure: Structure, u: Array, start: float, stop: float, **tolerances):
    """Integrate to the next corner, or to stop; returns time, state and the corner if any.

    At a restart the margin just crossed is zero up to rounding, of either sign. Each margin may
    therefore fall CORNER below zero, or below its starting value if that is negative: a branch
    chosen wrongly, at rest or at simultaneous corners, is left after an excursion of CORNER and
    needs no case of its own.
    """
    allowance = {k: max(-g, 0.0) + CORNER for k, g in structure.corners(start, u).items()}

    def nearest(t, u):
        gaps = [g + allowance[k] for k, g in structure.corners(t, u).items()]
        return np.min(gaps, axis=0) if gaps else np.ones(np.shape(t))

    nearest.terminal, nearest.direction = True, -1
    path = solve_ivp(structure.slope, (start, stop), u, "DOP853", events=nearest,
                     dense_output=True, first_step=(stop - start) / 2, **tolerances)  # fmt: skip
    if not path.success:
        raise RuntimeError(path.message)
    t, u_end = path.t[-1], path.y[:, -1]
    probes = np.linspace(start, t, PROBES)[1:-1]
    beyond = nearest(probes, path.sol(probes)) < 0
    if beyond.any():  # crossed and crossed back within a step: end where the crossing shows
        return smooth_piece(structure, u, start, probes[np.argmax(beyond)], **tolerances)
    reached = {k: g + allowance[k] for k, g in structure.corners(t, u_end).items()}
    return t, u_end, min(reached, key=reached.get) if path.status == 1 else None


def to_next_sample(structure: Structure, u: Array, dt: float, **tolerances) -> Array:
    """Integrate over one sampling interval, corner by corner."""
    t = 0.0
    for _ in range(MAX_PIECES):
        # Half the interval, because the dense output that locates corners has no error control.
        t, u, corner = smooth_piece(structure, u, t, dt, max_step=dt / 2, **tolerances)
        if corner is not None:
            structure.pass_corner(t, u, corner)
        if t >= dt:
            return u
    raise RuntimeError(f"more than {MAX_PIECES} corners between two samples")


def connectivity(elements: list[Element], n_dof: int, n_support: int) -> tuple[Array, Array]:
    """B and Bs of y = B x - Bs s."""
    b, bs = np.zeros((len(elements), n_dof)), np.zeros((len(elements), n_support))
    for i, e in enumerate(elements):
        for node, sign in ((e["end"], 1), (e["start"], -1)):
            if node != "ground":
                matrix, entry = (b, sign) if node[0] == "x" else (bs, -sign)
                matrix[i, int(node[1:]) - 1] += entry
    return b, bs


def input_polynomials(dt: float, force: Array, s: Array, sdot: Array) -> Array:
    """Coefficients of [f, s, s'] in the time after each sample, (T - 1, 4, columns)."""
    f = np.stack([force[:-1], np.diff(force, axis=0) / dt], axis=1)
    chord, v0, v1 = np.diff(s, axis=0) / dt, sdot[:-1], sdot[1:]
    hermite = [s[:-1], v0, (3 * chord - 2 * v0 - v1) / dt, (v0 + v1 - 2 * chord) / dt**2]
    slope = [v0, 2 * hermite[2], 3 * hermite[3], np.zeros_like(v0)]
    f = np.pad(f, ((0, 0), (0, 2), (0, 0)))
    return np.concatenate([f, np.stack(hermite, axis=1), np.stack(slope, axis=1)], axis=2)


def reference_response(
    masses: Array,
    elements: list[Element],
    dt: float,
    force: Array,
    support: Array | None = None,
    support_velocity: Array | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-13,
    change: tuple[int, list[Element], Array] | None = None,
) -> dict[str, Array]:
    """Response from rest at the samples: x, v, a (T, dof) and y, r (T, elements).

    change = (k, laws, factors): from sample k on these laws hold, and z is multiplied by factors.

    force is (T, dof); support and support_velocity are (T, supports), fixed supports if None.
    """
    force, n, m = np.asarray(force, float), len(masses), len(elements)
    nodes = [e[k] for e in elements for k in ("start", "end")]
    fixed = np.zeros((len(force), max([int(k[1:]) for k in nodes if k[0] == "s"], default=0)))
    s, sdot = (fixed if q is None else np.asarray(q, float) for q in (support, support_velocity))
    b, bs = connectivity(elements, n, s.shape[1])
    intervals = input_polynomials(dt, force, s @ bs.T, sdot @ bs.T)

    branches = []
    for e, y, rate in zip(elements, -bs @ s[0], -bs @ sdot[0], strict=True):
        closed = abs(y) > e.get("zg", np.inf)  # the supports may be displaced at t = 0
        branches.append(Branch(-1 if rate < 0 else 1, gap=int(np.sign(y)) if closed else 0))
    structure = Structure(np.asarray(masses, float), elements, b, bs, branches, intervals[0])
    u = np.zeros(2 * n + 2 * m)
    samples = [structure.response(0.0, u)]
    for k, interval in enumerate(intervals, start=1):
        structure.inputs = interval
        u = to_next_sample(structure, u, dt, rtol=rtol, atol=atol)
        if change is not None and k == change[0]:
            structure.elements = change[1]
            structure.split(u)[2][:] *= change[2]
        samples.append(structure.response(dt, u))
    return {k: np.array([now[k] for now in samples]) for k in samples[0]}


def paper_structure(system: str) -> tuple[Array, list[Element]]:
    """Masses and elements of the 'bilinear', 'polynomial' or 'bouc_wen' three-mass structure."""
    k0, c0 = 4 * np.pi**2, np.pi / 4
    bilinear = {"law": "bilinear", "k1": k0, "k2": 0.5 * k0, "c1": 0.01, "c2": 0.01, "zy": 0.02}
    slip = {"k1": k0, "k2": k0, "c1": 0.1 * c0, "c2": 0.1 * c0, "zy": 0.01, "zg": 0.03}
    wen = {"A": k0, "beta": k0 / 4, "n": 1, "eta": 1, "nu": 1, "eta_rate": 0, "nu_rate": 0}
    polynomial = {"law": "polynomial", "p1": k0, "p2": np.pi / 5}
    outer, inner = {  # laws of the elements 1, 5, 6 and of the elements 2, 3, 4
        "bilinear": (bilinear, slip | {"law": "limited_slip"}),
        "polynomial": [polynomial | {"p3": sign * 0.5 * k0} for sign in (1, -1)],
        "bouc_wen": [wen | {"law": "bouc_wen", "gamma": sign * k0 / 3} for sign in (1, -1)],
    }[system]
    laws = [outer, inner, inner, inner, outer, outer]
    nodes = [("s1", "x1"), ("x1", "x2"), ("x1", "x3"), ("x2", "x3"), ("x3", "s3"), ("s2", "x2")]
    ends = [{"start": start, "end": end} for start, end in nodes]
    return np.array([0.8, 2.0, 1.2]), [law | end for law, end in zip(laws, ends, strict=True)]
