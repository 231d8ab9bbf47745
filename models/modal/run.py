"""Free runs of a modal network, a block of samples at a time, with derivatives where asked.

Modes take exact steps: matrix exponentials under a force that is linear, or a parabola.

q̈ = −k q − c q̇ + f;   s = (q, q̇),   s(h) = E s + P₀ f₀ + P₁ f₁ = E s + Q₀ f₀ + Q½ f½ + Q₁ f₁
Van Loan (1978): the integrals are blocks of a larger exponential. Slopes by log k and log c are
those of the exponential at a complex argument (Squire & Trapp 1998), to rounding.
J modes, T samples, m inputs, o outputs; P columns by parameters, S by the first state.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from models.modal.excitation import Excited
from models.modal.layout import Layout, columns
from models.modal.run_compiled import Elements, Filled, Modes, Parts, run

BLOCK = 4096  # samples
BOUND = 1e3  # times the RMS of the trained outputs: beyond, a run with elements has diverged
STEP = 1e-30  # into the complex plane


def _numbers(k: np.ndarray, c: np.ndarray, h: float) -> np.ndarray:
    """E, P₀, P₁, Q₀, Q½, Q₁ (N, 14) of oscillators k, c (N,) and a step h."""
    from scipy.linalg import expm  # slow to import

    M = np.zeros((len(k), 5, 5), dtype=complex)
    M[:, 0, 1], M[:, 1, 0], M[:, 1, 1] = h, -k * h, -c * h
    M[:, 1, 2] = h  # the force
    M[:, 2, 3] = M[:, 3, 4] = 1.0  # its slope and curvature, in a time that ends at 1
    whole = expm(M)
    held, slope, curve = (whole[:, :2, i] for i in (2, 3, 4))  # of 1, τ, τ²/2
    linear = [held - slope, slope]
    parabola = [held - 3.0 * slope + 4.0 * curve, 4.0 * slope - 8.0 * curve, 4.0 * curve - slope]
    E = whole[:, :2, :2].reshape(len(k), 4)
    return np.concatenate([E, *linear, *parabola], axis=1)


def exact_steps(log_k: np.ndarray, log_c: np.ndarray, h: float) -> np.ndarray:
    """(J, 3, 14): the numbers of a step, and their slopes by log k and by log c."""
    shifts = np.array([[0.0, 0.0], [1j * STEP, 0.0], [0.0, 1j * STEP]])
    k = np.exp(log_k[:, None] + shifts[:, 0]).ravel()
    c = np.exp(log_c[:, None] + shifts[:, 1]).ravel()
    numbers = _numbers(k, c, h).reshape(len(log_k), 3, -1)
    found: np.ndarray = numbers.imag / STEP
    found[:, 0] = numbers[:, 0].real
    return found


def blocks(
    layout: Layout,
    values: np.ndarray,
    excited: Excited,
    begin: np.ndarray,
    learned: np.ndarray | None = None,
    own: bool = False,
    stop: int | None = None,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Outputs (t, o), states (t, 2J + 2E), derivatives (t, o, P + S) of one block after the other.

    values: all parameters; learned: those by which derivatives are taken, None for none; own:
    derivatives by `begin` (S,) too, after those of the parameters. A run that diverged ends there.
    """
    split = {name: np.ascontiguousarray(part) for name, part in layout.split(values).items()}
    mask = np.zeros(layout.size, dtype=bool) if learned is None else learned
    at, moving = columns(layout, mask)
    derived = own or learned is not None
    S, static = (layout.states if own else 0), int(mask.sum()) - moving
    # the kernel has the columns with dynamics first, so those of the first state before the others
    at = {name: np.where(place >= moving, place + S, place) for name, place in at.items()}
    J, E, U = layout.modes, layout.elements, layout.units
    P = moving + S
    modes = Modes(begin[:J].copy(), begin[J : 2 * J].copy(), np.zeros((J, P)), np.zeros((J, P)))
    z, dz = begin[2 * J :].reshape(E, U).copy(), np.zeros((E, U, P))
    if own:
        each = np.eye(S)
        modes.dq[:, moving:], modes.dv[:, moving:] = each[:J], each[J : 2 * J]
        dz[..., moving:] = each[2 * J :].reshape(E, U, S)
    elements = at_rest(z, dz)
    core = exact_steps(split["log_k"], split["log_c"], excited.step)
    parts = Parts(core, *(split[name] for name in Parts._fields[1:]))
    places = np.stack([at["log_k"], at["log_c"]])
    columns_of = Parts(places, *(at[name] for name in Parts._fields[1:]))
    order = np.r_[np.arange(moving), np.arange(P, P + static), np.arange(moving, P)]
    T, bound = len(excited.u) if stop is None else stop, BOUND if E else np.inf  # modes decay
    for first in range(0, T, BLOCK):
        last = min(first + BLOCK, T)
        out = np.empty((last - first, layout.outputs))
        states = np.empty((last - first, 2 * (J + E)))
        jacobian = np.empty((last - first if derived else 0, layout.outputs, P + static))
        sound = run(
            excited.u, excited.fine, first, last, parts, columns_of,
            (layout.hinges, layout.units), modes, elements, bound, Filled(out, states, jacobian),
        )  # fmt: skip
        yield out, states, jacobian[..., order] if S else jacobian
        if not sound:
            return


def at_rest(z: np.ndarray, dz: np.ndarray) -> Elements:
    """Elements that have not moved, with the memory z (E, U) of units and its derivatives."""
    E, _, P = dz.shape
    y, rate, before, r, new = np.zeros((5, E))
    dy, drate, dbefore, dr, dnew = np.zeros((5, E, P))
    return Elements(y, rate, dy, drate, before, dbefore, z, dz, r, dr, new, dnew)


def outputs(
    layout: Layout, values: np.ndarray, excited: Excited, begin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (T, o) and states (T, 2J + 2E) of a whole run; NaN from where it diverged."""
    out = np.full((len(excited.u), layout.outputs), np.nan)
    states = np.full((len(excited.u), 2 * (layout.modes + layout.elements)), np.nan)
    at = 0
    for block, state, _ in blocks(layout, values, excited, begin):
        out[at : at + len(block)], states[at : at + len(block)] = block, state
        at += len(block)
    return out, states


def steady_state(layout: Layout, values: np.ndarray, excited: Excited, period: int) -> np.ndarray:
    """The first state (S,) of an excitation that repeats itself, after four periods from rest.

    Units begin without memory: it is short beside a period.
    """
    fine = np.concatenate([excited.fine[:period]] * 4)
    u = np.concatenate([excited.u[:period]] * 4 + [excited.u[:1]])
    _, states = outputs(layout, values, Excited(u, fine, excited.dt), np.zeros(layout.states))
    begin = np.zeros(layout.states)
    begin[: 2 * layout.modes] = states[-1, : 2 * layout.modes]
    return begin
