"""The law of an element, asked by its number: all laws of the list as three compiled functions.

The laws of the paper are compiled into the integrator's loop, the others are called.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from data.simulation.laws import CALLED, INLINED, NUMBERS
from data.simulation.laws.compiling import compiled, inlined
from data.simulation.laws.element import MEMORY

LAST_INLINED = len(INLINED) - 1


def _join(question: str, files: Sequence[str]):
    """A question to the law of a number as one compiled function, which takes the number first.

    By halves: a law is compiled into every function on its way, so that there are few of these.
    """
    of_force = question == "force"
    if len(files) == 1:
        own = getattr(import_module(f"{__package__}.{files[0]}"), question)
        return _force_of_one(own) if of_force else _branch_of_one(own)
    middle = len(files) // 2
    halves = _join(question, files[:middle]), _join(question, files[middle:])
    number = NUMBERS[files[middle]]
    return _force_of(number, *halves) if of_force else _branch_of(number, *halves)


def _force_of_one(own):
    @inlined
    def one(law, p, m, branch, y, ydot, z, work):
        return own(p, m, branch, y, ydot, z, work)

    return one


def _force_of(number, before, after):
    @inlined
    def either(law, p, m, branch, y, ydot, z, work):
        if law < number:
            return before(law, p, m, branch, y, ydot, z, work)
        return after(law, p, m, branch, y, ydot, z, work)

    return either


def _branch_of_one(own):
    @inlined
    def one(law, p, m, branch, y, ydot, z):
        return own(p, m, branch, y, ydot, z)

    return one


def _branch_of(number, before, after):
    @inlined
    def either(law, p, m, branch, y, ydot, z):
        if law < number:
            return before(law, p, m, branch, y, ydot, z)
        return after(law, p, m, branch, y, ydot, z)

    return either


_paper_force, _paper_margin, _paper_next = (
    _join(question, list(INLINED)) for question in ("force", "margin", "next_branch")
)
_other_force, _other_margin, _other_next = (
    _join(question, list(CALLED)) for question in ("force", "margin", "next_branch")
)


@compiled
def _called_force(law, p, m, branch, y, ydot, z, work):
    return _other_force(law, p, m, branch, y, ydot, z, work)


@compiled
def _called_margin(law, p, m, branch, y, ydot, z):
    return _other_margin(law, p, m, branch, y, ydot, z)


@compiled
def _called_next(law, p, m, branch, y, ydot, z):
    return _other_next(law, p, m, branch, y, ydot, z)


@inlined
def force(law, p, m, e, branch, y, ydot, z, work):
    """Force r [N] and ż of element e. work: ∫ r ẏ dt [J] so far."""
    if law <= LAST_INLINED:
        return _paper_force(law, p[e], m[e], branch, y, ydot, z, work)
    return _called_force(law, p[e], m[e], branch, y, ydot, z, work)


@inlined
def margin(law, p, m, e, branch, y, ydot, z):
    """How far element e is from the end of its branch, negative beyond."""
    if law <= LAST_INLINED:
        return _paper_margin(law, p[e], m[e], branch, y, ydot, z)
    return _called_margin(law, p[e], m[e], branch, y, ydot, z)


@inlined
def next_branch(law, p, m, e, branch, y, ydot, z):
    """The branch and z of element e past the end of a branch; sets what it remembers."""
    if law <= LAST_INLINED:
        branch, z, _ = _paper_next(law, p[e], _memory(m, e), branch, y, ydot, z)
        return branch, z
    branch, z, past = _called_next(law, p[e], _memory(m, e), branch, y, ydot, z)
    for i in range(MEMORY):
        m[e, i] = past[i]
    return branch, z


@inlined
def _memory(m, e):
    return (m[e, 0], m[e, 1], m[e, 2], m[e, 3], m[e, 4], m[e, 5],
            m[e, 6], m[e, 7], m[e, 8], m[e, 9], m[e, 10], m[e, 11])  # fmt: skip
