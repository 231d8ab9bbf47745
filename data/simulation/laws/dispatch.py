"""The law of an element, asked by what `entry` gives for its number: three compiled functions.

The laws of the paper are compiled into the integrator's loop. The others are compiled when they
are first needed, each by itself, and called by address.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

import numpy as np
from numba import config
from numba.types import Tuple, UniTuple, float64, int64

from data.numba_cache import address_of, call_entry
from data.simulation.laws import CALLED, INLINED, NUMBERS
from data.simulation.laws.compiling import SOURCES, inlined
from data.simulation.laws.element import MEMORY

LAST_INLINED = len(INLINED) - 1
_row, _past = float64[::1], UniTuple(float64, MEMORY)
QUESTIONS = {  # to a law: what compiled code hands to it, and takes
    "force": UniTuple(float64, 2)(_row, _row, int64, float64, float64, float64, float64),
    "margin": float64(_row, _row, int64, float64, float64, float64),
    "next_branch": Tuple([int64, float64, _past])(_row, _past, int64, float64, float64, float64),
}
_tables: dict[int, np.ndarray] = {}  # of addresses; they stay where they are


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


_paper_force, _paper_margin, _paper_next = (_join(one, list(INLINED)) for one in QUESTIONS)
_called_force, _called_margin, _called_next = (
    call_entry(place, signature, _join(one, list(CALLED)))
    for place, (one, signature) in enumerate(QUESTIONS.items())
)


def entry(number: int) -> int:
    """What compiled code calls a law by: its number, or the address of a table of functions.

    Compiles these when the law is first asked for.
    """
    if number <= LAST_INLINED or config.DISABLE_JIT:
        return number
    if number not in _tables:
        law = import_module(f"{__package__}.{list(NUMBERS)[number]}")
        addresses = [
            address_of(getattr(law, question), signature, *SOURCES, allocate=False)
            for question, signature in QUESTIONS.items()
        ]
        _tables.setdefault(number, np.array(addresses, dtype=np.int64))  # of threads, the first
    return int(_tables[number].ctypes.data)


def entries(numbers: np.ndarray) -> np.ndarray:
    """The laws of elements (E,) by number, as the integrator takes them."""
    return np.array([entry(int(number)) for number in numbers], dtype=np.int64)


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
