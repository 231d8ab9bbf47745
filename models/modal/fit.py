"""Training of a modal network: linear, then element by element, judged on what was held back.

The linear start is polished by Levenberg–Marquardt. An element is tried with several laws and
directions, each trained for some iterations; the one with the least error on held-back motion
stays if it gains enough. At last all of the motion is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from models.fit.blocks import PATIENCE
from models.fit.extrapolation import BOUND
from models.fit.held_back import unless_worse
from models.fit.minimise import minimise
from models.fit.progress import announce, leaves_out
from models.modal.element_start import Element, ElementSearch
from models.modal.layout import Layout
from models.modal.linear_start import by_spectra, held_back_error, settle
from models.modal.problem import ModalProblem, Motion, State
from models.modal.run import outputs

ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 24)  # numbers of modes that are tried
MORE_MODES = (1, 2, 4)  # numbers that are added to a model with elements
ENOUGH = 1.1  # times the least error of any number of modes: then the smallest is taken
GAIN = 0.97  # of the error before, that an element or a mode may leave at most
SIMPLER = 1.02  # times the least error: of such laws the first is taken
WEAKER = (1.0, 0.5, 0.2, 0.05)  # of an element's first strength, the first that helps
MORE = 3.0  # times the excitation that a model has to stand
LINEAR, FIRST = 6, 12  # iterations of a linear model, and of a new element or mode
PRIOR = 1e-9  # weight of Σ θ² beside the mean square error
RUNAWAY = 100.0  # times its error: of a model that does not
SETTINGS = {
    **{"damping": 1e-3, "decrease": 0.1, "increase": 5.0, "largest": 1e8, "scaled": True},
    **{"gradient": 0.0, "change": 1e-4, "patience": 4},
}


@dataclass(frozen=True)
class Plan:
    """What is tried: numbers of modes, elements, laws; directions and draws; iterations."""

    orders: Sequence[int] = ORDERS
    elements: int = 2
    families: Sequence[str] = ("cubic", "smooth", "hysteretic", "all")
    through: bool = True  # outputs may see the elements' forces at once, as accelerations do
    directions: int = 30
    draws: int = 3
    iterations: int = 60
    seed: int = 0


@dataclass
class Fit:
    """A model in training: what it has, its error on held-back motion, what was done."""

    layout: Layout
    state: State
    laws: list[str] = field(default_factory=list)  # of its elements
    error: float = np.inf


def learned(fit: Fit, plan: Plan) -> np.ndarray:
    """Which parameters (size,) are learned: not those that only fix units of the others."""
    layout = fit.layout
    mask = {name: np.ones(shape, dtype=bool) for name, shape in layout.shapes.items()}
    parts = layout.split(fit.state.values)
    modes = np.arange(layout.modes)
    if layout.inputs:
        mask["gamma"][modes, np.abs(parts["gamma"]).argmax(axis=1)] = False
    mask["u0"][:] = layout.elements > 0  # else the outputs' offsets say it all
    mask["Dr"][:] = plan.through
    for i, family in enumerate(fit.laws):
        mask["D"][i, np.abs(parts["D"][i]).argmax()] = False
        mask["G"][np.abs(parts["G"][:, i]).argmax(), i] = False
        mask["laws"][i] = layout.has(family)
    return layout.join(mask).astype(bool)


def extend(fit: Fit, element: Element, family: str, share: float) -> Fit:
    """The model with one more element, `share` as strong as it was found."""
    old = fit.layout
    layout = replace(old, elements=old.elements + 1)
    parts = {name: part.copy() for name, part in old.split(fit.state.values).items()}
    law = element.law.copy()
    weights = np.ones(len(law), dtype=bool)
    for kind in (-1, -2):
        places = np.flatnonzero(layout.kinds == kind)
        weights[places] = np.arange(len(places)) % 3 == 0
    law[weights] *= share
    before = parts["laws"] if old.elements else np.empty((0, layout.law))
    parts["laws"] = np.concatenate([before, law[None]])
    parts["D"] = np.concatenate([parts["D"], element.D[None]])
    parts["G"] = np.concatenate([parts["G"], element.G[:, None]], axis=1)
    parts["Dr"] = np.concatenate([parts["Dr"], np.zeros((layout.outputs, 1))], axis=1)
    begins = np.zeros((len(fit.state.begins), layout.states))
    begins[:, : fit.state.begins.shape[1]] = fit.state.begins
    return Fit(layout, State(layout.join(parts), begins), [*fit.laws, family])


def train(
    fit: Fit,
    motions: Sequence[Motion],
    plan: Plan,
    iterations: int,
    judged: Sequence[Motion] | None = None,
) -> Fit:
    """The model after a number of iterations on the samples that are not held back.

    Of a model that has been judged no iterations are kept that lose on held-back motion. judged:
    the same motions with what is held back of them, if others.
    """
    state = settle(fit.layout, fit.state, motions)
    problem = ModalProblem(fit.layout, motions, state, learned(fit, plan), PRIOR)
    with np.errstate(all="ignore"):
        minimise(problem, SETTINGS, iterations=iterations)
        state = problem.now()
    end = judge(replace(fit, state=state), motions if judged is None else judged)
    return unless_worse(end, fit, lambda one: one.error)


def judge(fit: Fit, motions: Sequence[Motion]) -> Fit:
    """The model with its error on held-back motion; one that runs away comes after all others."""
    state = settle(fit.layout, fit.state, motions)
    error = held_back_error(fit.layout, state, motions)
    stood = stays_in_bounds(replace(fit, state=state), motions)
    return replace(fit, state=state, error=error if stood else RUNAWAY * error)


def stays_in_bounds(fit: Fit, motions: Sequence[Motion]) -> bool:
    """Whether free runs stay in bounds under MORE times the excitation of each motion."""
    if not fit.laws:
        return True
    for motion, begin in zip(motions, fit.state.begins, strict=True):
        u, fine = (MORE * one for one in (motion.excited.u, motion.excited.fine))
        more = replace(motion.excited, u=u, fine=fine)
        with np.errstate(all="ignore"):
            out, _ = outputs(fit.layout, fit.state.values, more, MORE * begin)
        if not np.abs(out).max() < MORE * BOUND * np.abs(motion.y).max():  # NaN too
            return False
    return True


def loss(fit: Fit, motions: Sequence[Motion], plan: Plan) -> float:
    """Of the samples that are not held back."""
    with np.errstate(all="ignore"):
        state = settle(fit.layout, fit.state, motions)
        problem = ModalProblem(fit.layout, motions, state, learned(fit, plan))
        return float(problem.loss())


def start_with(
    fit: Fit, element: Element, family: str, motions: Sequence[Motion], plan: Plan
) -> Fit | None:
    """The model with an element as strong as helps; None where no strength does."""
    before = loss(fit, motions, plan)
    for share in WEAKER:
        tried = extend(fit, element, family, share)
        if loss(tried, motions, plan) < before:
            return tried
    return None


def with_element(fit: Fit, motions: Sequence[Motion], plan: Plan, rng: np.random.Generator) -> Fit:
    """The model with the best further element, of all laws and draws; as it is where none helps."""
    search = ElementSearch(fit.layout, fit.state, motions, learned(fit, plan))
    found: list[Fit] = []
    for family, elements in search.best(plan.families, rng, plan.directions).items():
        ends = []
        for element in elements[: plan.draws]:
            start = start_with(fit, element, family, motions, plan)
            if start is not None:
                ends.append(train(start, motions, plan, FIRST))
        if ends:
            best = min(ends, key=lambda end: end.error)
            found.append(train(best, motions, plan, 2 * FIRST))
    if not found:
        return fit
    least = min(end.error for end in found)
    chosen = next(end for end in found if end.error <= SIMPLER * least)
    return chosen if chosen.error < GAIN * fit.error else fit


def linear(motions: Sequence[Motion], plan: Plan) -> Fit:
    """The smallest linear model whose error on held-back motion is within 10 % of the least.

    Raises ValueError where no number of modes gives a run that is finite.
    """
    found: list[Fit] = []
    for modes in plan.orders:
        start = by_spectra(motions, modes)
        if start is None:
            break
        found.append(train(Fit(*start), motions, plan, LINEAR))
        earlier = [fit.error for fit in found[:-PATIENCE]]
        if earlier and min(fit.error for fit in found[-PATIENCE:]) > GAIN * min(earlier):
            break
    if not found:
        raise ValueError(
            "the excitation has too few lines to tell a mode: the records are too short, or "
            "nothing drives them; check its channels"
        )
    least = min(fit.error for fit in found)
    if not np.isfinite(least):
        raise ValueError("no linear system follows the motion; look for outliers in the record")
    chosen = next(fit for fit in found if fit.error <= ENOUGH * least)
    return train(chosen, motions, plan, plan.iterations)


def join_modes(fit: Fit, layout: Layout, state: State) -> Fit:
    """The model with the modes of a linear one beside its own, which elements do not see yet."""
    old = fit.layout
    wide = replace(old, modes=old.modes + layout.modes)
    parts, more = old.split(fit.state.values), layout.split(state.values)
    both = {n: np.concatenate([parts[n], more[n]]) for n in ("log_k", "log_c", "gamma")}
    both |= {n: np.concatenate([parts[n], more[n]], axis=1) for n in ("Cq", "Cv")}
    both["G"] = np.concatenate([parts["G"], np.zeros((layout.modes, old.elements))])
    both["D"] = np.concatenate([parts["D"], np.zeros((old.elements, layout.modes))], axis=1)
    both |= {n: parts[n] + more[n] for n in ("Du", "o0")}
    q, v, z = np.split(fit.state.begins, [old.modes, 2 * old.modes], axis=1)
    new_q, new_v = np.split(state.begins, 2, axis=1)
    begins = np.concatenate([q, new_q, v, new_v, z], axis=1)
    state = State(wide.join(parts | both), begins)
    return replace(fit, layout=wide, state=state, error=np.inf)


def with_modes(fit: Fit, motions: Sequence[Motion], plan: Plan) -> Fit:
    """The model with further modes, from the spectra of its errors; as it is where none helps."""
    left = []
    for motion, begin in zip(motions, fit.state.begins, strict=True):
        out, _ = outputs(fit.layout, fit.state.values, motion.excited, begin)
        left.append(replace(motion, y=motion.y - motion.of(out)))
    found = []
    for modes in MORE_MODES if np.isfinite(fit.error) else ():
        more = by_spectra(left, modes)
        if more is not None and fit.layout.modes + more[0].modes <= max(ORDERS):
            start = join_modes(fit, *more)
            found.append(train(start, motions, plan, FIRST))
    least = min((end.error for end in found), default=np.inf)
    if least > GAIN * fit.error:
        return fit
    chosen = next(end for end in found if end.error <= SIMPLER * least)
    return train(chosen, motions, plan, 2 * FIRST)


def fit_modal(motions: Sequence[Motion], plan: Plan) -> tuple[Fit, dict[str, Any]]:
    """A model of the motions, and its notes."""
    rng = np.random.default_rng(plan.seed)
    fit = linear(motions, plan)
    facts: dict[str, Any] = {"held_out_error_linear_percent": 100.0 * fit.error}
    while len(fit.laws) < plan.elements:
        announce(f"nonlinear element {len(fit.laws) + 1}")
        if leaves_out(f"more than {len(fit.laws)} nonlinear elements"):
            break
        more = with_element(fit, motions, plan, rng)
        if more is fit:
            break
        fit = with_modes(more, motions, plan) if len(plan.orders) > 1 else more
    facts |= {"modes": fit.layout.modes, "elements": ", ".join(fit.laws) or "none"}
    facts["held_out_error_percent"] = 100.0 * held_back_error(fit.layout, fit.state, motions)
    whole = [replace(motion, stop=len(motion.y)) for motion in motions]
    return train(fit, whole, plan, plan.iterations, judged=motions), facts
