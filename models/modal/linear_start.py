"""The linear start of a modal network: poles from spectra, all else by least squares in time.

T samples, J modes, m inputs, o outputs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.modal.layout import Layout
from models.modal.problem import Motion, State
from models.modal.rational import Lines, first_poles, oscillators, relocated
from models.modal.run import Excited, blocks, outputs, steady_state

RIDGE = 1e-12, 1e-5  # of the squares of columns; of several inputs, such as s and its rate
STEPS = 8  # of Gauss and Newton, for a first state
RELOCATIONS = (6, 20)  # of poles; the better
MOST_MOTIONS = 6  # whose spectra give the poles, those with most samples


def by_spectra(motions: Sequence[Motion], modes: int) -> tuple[Layout, State] | None:
    """Layout without elements, parameters and first states; None where the lines tell no so many.

    The motions' outputs are those of a linear system of so many modes, or what another model
    leaves of outputs.
    """
    lines = [
        Lines.of(motion.of(motion.excited.u), motion.y * motion.weight)
        for motion in sorted(motions, key=lambda motion: -len(motion.y))[:MOST_MOTIONS]
    ]
    rows, m = 2 * sum(len(one.z) for one in lines), motions[0].excited.u.shape[1]
    if rows < (2 * modes + 1) * (m + 1 + len(lines)):
        return None
    found = []
    with np.errstate(all="ignore"):
        for iterations in RELOCATIONS:
            poles = relocated(lines, first_poles(lines, modes), iterations)
            k, c = oscillators(poles, motions[0].excited.dt)
            layout, state = _by_least_squares(motions, k, c)
            found.append((held_back_error(layout, state, motions), layout, state))
    return min(found, key=lambda one: one[0])[1:]


def held_back_error(
    layout: Layout, state: State, motions: Sequence[Motion], bound: float = 1e3
) -> float:
    """RMS of the weighted error after `stop`, of all of it where nothing is held back."""
    squares, count = 0.0, 0
    for motion, begin in zip(motions, state.begins, strict=True):
        with np.errstate(all="ignore"):
            out, _ = outputs(layout, state.values, motion.excited, begin, bound)
        first = motion.stop if motion.stop < len(motion.y) else 0
        e = (motion.weight * (motion.of(out) - motion.y))[first:]
        squares, count = squares + float((e * e).sum()), count + e.size
    return float(np.sqrt(squares / count)) if np.isfinite(squares) else float("inf")


def settled(layout: Layout, state: State, motions: Sequence[Motion]) -> State:
    """The state with the periods among the motions begun in their steady state."""
    state = state.copy()
    for number, motion in enumerate(motions):
        if motion.periodic:
            with np.errstate(all="ignore"):
                begin = steady_state(layout, state.values, motion.excited, motion.first)
            state.begins[number] = begin if np.isfinite(begin).all() else 0.0
    return state


def _modal(k: np.ndarray, c: np.ndarray, excited: Excited, begin: float) -> np.ndarray:
    """q and q̇ (T, 2J) of modes under the one input of `excited`, from q = `begin`."""
    J = len(k)
    layout = Layout(J, 0, 1, 1, 0, 0)
    parts = {name: np.zeros(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": np.log(k), "log_c": np.log(c), "gamma": np.ones((J, 1))}
    first = np.r_[np.full(J, begin), np.zeros(J)]
    return outputs(layout, layout.join(parts), excited, first)[1]


def _columns(motion: Motion, k: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(stop, m·2J + m + 1 + 2J): modes forced by each input, inputs, 1, free decays."""
    whole, m = motion.excited, motion.excited.u.shape[1]
    forced = [
        _modal(
            k,
            c,
            Excited(whole.u[:, [i]], np.ascontiguousarray(whole.fine[..., [i]]), whole.dt),
            0.0,
        )
        for i in range(m)
    ]
    still = Excited(0.0 * whole.u[:, :1], 0.0 * whole.fine[..., :1], whole.dt)
    one = np.ones((len(whole.u), 1))
    decays = _modal(k, c, still, 1.0) if motion.unknown else np.zeros((len(one), 2 * len(k)))
    whole_run = np.concatenate([*forced, whole.u, one, decays], axis=1)
    return motion.of(whole_run)[: motion.stop]


def _by_least_squares(
    motions: Sequence[Motion], k: np.ndarray, c: np.ndarray
) -> tuple[Layout, State]:
    """All linear parameters beside k and c, from the outputs up to `stop`."""
    J, m, o = len(k), motions[0].excited.u.shape[1], motions[0].y.shape[1]
    shared, own = 2 * J * m + m + 1, 2 * J
    width = shared + own * len(motions)
    gram, right = np.zeros((o, width, width)), np.zeros((o, width))
    squares, samples = np.zeros(shared), 0
    for number, motion in enumerate(motions):
        A = _columns(motion, k, c)
        place = np.r_[:shared, shared + own * number : shared + own * (number + 1)]
        square, side = A.T @ A, A.T @ motion.y[: motion.stop]
        for output in range(o):
            gram[output][np.ix_(place, place)] += motion.weight[output] ** 2 * square
            right[output, place] += motion.weight[output] ** 2 * side[:, output]
        squares, samples = squares + square.diagonal()[:shared], samples + motion.stop
    solved = np.stack([_solve(gram[output], right[output], RIDGE[m > 1]) for output in range(o)])
    size = np.sqrt(squares / samples)
    rms = size[: 2 * J * m].reshape(m, 2, J).clip(1e-12)
    R = solved[:, : 2 * J * m].reshape(o, m, 2, J)
    layout = Layout(J, 0, m, o)
    parts = {name: np.zeros(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": np.log(k), "log_c": np.log(c)}
    for j in range(J):  # the direction of the inputs that moves a mode most
        scale = rms[:, :, j].max(axis=0)  # of q and q̇
        V = np.linalg.svd((R[..., j] * scale).transpose(0, 2, 1).reshape(2 * o, m))[2]
        parts["gamma"][j] = V[0] / np.sqrt(((V[0] * rms[:, 0, j]) ** 2).sum())
    together = _together(parts["gamma"], width)
    solved = np.stack(
        [
            _solve(together.T @ gram[output] @ together, right[output] @ together, RIDGE[m > 1])
            for output in range(o)
        ]
    )
    parts["Cq"], parts["Cv"], parts["Du"] = np.split(solved[:, : 2 * J + m], [J, 2 * J], axis=1)
    parts["o0"] = solved[:, 2 * J + m]
    values = layout.join(parts)
    begins = np.stack([first_state(layout, values, motion) for motion in motions])
    return layout, State(values, begins)


def _together(gamma: np.ndarray, width: int) -> np.ndarray:
    """From 2J columns of modes, forced by all inputs as Γ says, to those of each input alone."""
    J, m = gamma.shape
    by_mode = np.zeros((width, 2 * J + width - 2 * J * m))
    for n in range(m):
        for part in range(2):
            place = np.arange(J) + part * J
            by_mode[2 * J * n + place, place] = gamma[:, n]
    rest = np.arange(2 * J * m, width)
    by_mode[rest, rest - 2 * J * (m - 1)] = 1.0
    return by_mode


def _solve(gram: np.ndarray, right: np.ndarray, ridge: float) -> np.ndarray:
    """Least squares from normal equations, every column in units of its size."""
    size = np.sqrt(gram.diagonal())
    seen = size > 1e-12 * size.max()
    scale = np.where(seen, size, 1.0)
    scaled = gram / scale / scale[:, None] + ridge * np.eye(len(gram))
    scaled[~seen, :] = scaled[:, ~seen] = 0.0
    scaled[~seen, ~seen] = 1.0
    x: np.ndarray = np.linalg.lstsq(scaled, np.where(seen, right / scale, 0.0), rcond=1e-13)[0]
    return np.where(seen, x / scale, 0.0)


def first_state(
    layout: Layout,
    values: np.ndarray,
    motion: Motion,
    deviation: np.ndarray | None = None,
) -> np.ndarray:
    """The first state (S,) with which the run follows the samples before `stop` best.

    deviation (S,): of first states, in units of which Σ s² is kept small beside the squares of
    w (o − y); None: nothing is known of them. At rest where the motion says so.
    """
    state = np.zeros(layout.states)
    if motion.periodic:
        return steady_state(layout, values, motion.excited, motion.first)
    if not motion.unknown:
        return state
    pull = np.zeros(layout.states) if deviation is None else 1.0 / np.maximum(deviation, 1e-12)
    best, damping = np.inf, 1e-9
    kept = state
    for _ in range(STEPS):
        matrix, vector, loss = (
            np.diag(pull**2),
            pull**2 * state,
            float((pull * state) @ (pull * state)),
        )
        at = 0
        for out, _, jacobian in blocks(
            layout, values, motion.excited, state, None, True, motion.stop
        ):
            e = motion.weight * (out - motion.y[at : at + len(out)])
            rows = (motion.weight[:, None] * jacobian).reshape(e.size, -1)
            matrix += rows.T @ rows
            vector += rows.T @ e.ravel()
            loss, at = loss + float((e * e).sum()), at + len(out)
        if not np.isfinite(loss) or loss > best * (1.0 + 1e-9):
            break
        gain, best, kept = 1.0 - loss / best if np.isfinite(best) else 1.0, loss, state
        if gain < 1e-6:
            break
        size = np.sqrt(matrix.diagonal().clip(1e-30))
        scaled = matrix / size / size[:, None] + damping * np.eye(len(size))
        state = state - np.linalg.lstsq(scaled, vector / size, rcond=None)[0] / size
    return kept
