"""The compiled run as a kernel of a GPU, one thread a run, from the Python of simulate_compiled.py.

n coordinates, E elements, N runs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import lru_cache
from types import FunctionType
from typing import Any

from numba import cuda, float64
from torch import Tensor

from models.composition.simulate_compiled import (
    Course,
    Elements,
    Equation,
    Histories,
    Sensors,
    Term,
    run,
)

is_there = cuda.is_available  # with the extra [gpu], and a GPU
BLOCK = 64  # threads that a GPU takes together


@lru_cache
def of_device(function: Any) -> Any:
    """A function that numba compiles, and those that it calls, for a GPU."""
    python = function.py_func
    names = {
        name: of_device(own) if hasattr(own, "py_func") else own
        for name, own in python.__globals__.items()
        if name in python.__code__.co_names
    }
    alike = FunctionType(python.__code__, {**python.__globals__, **names}, python.__name__)
    return cuda.jit(device=True)(alike)


@lru_cache
def kernel_of(n: int, E: int, hinges: int, units: int) -> Callable[[float, list[Tensor]], None]:
    """What fills the last of its arrays, (T, o, N), with runs of networks of one size."""
    follow, places = of_device(run), max(units, 1)

    @cuda.jit
    def kernel(
        dt, u, between, start, begin, core, inputs, G, D, laws, outputs, back, supports, measures,
        bound, measured,
    ):  # fmt: skip
        i = cuda.grid(1)
        if i < measured.shape[2]:
            q, rate = cuda.local.array(n, float64), cuda.local.array(n, float64)
            acc, new = cuda.local.array(n, float64), cuda.local.array(n, float64)
            ahead, z = cuda.local.array(n, float64), cuda.local.array((E, places), float64)
            y, r = cuda.local.array(E, float64), cuda.local.array(E, float64)
            for e in range(E):
                for unit in range(places):
                    z[e, unit] = 0.0
            equation = Equation(
                Term(core[:, :, i], None, None),
                Term(inputs[:, :, i], None, None),
                Term(G[:, :, i], None, None),
                Term(D[:, :, i], None, None),
                Term(laws[:, :, i], None, None),
                supports,
                (hinges, units),
            )
            Phi = Term(outputs[:, :, i], None, None)
            sensors = Sensors(Phi, back[:, :, i], measures, bound)
            elements = Elements(y, z, r, None, None, None, None, None)
            room = (q, rate, ahead, acc, new), (None, None, None, None, None), elements
            histories = Histories(None, None, None, None, None, None, measured[:, :, i])
            course = Course(u, between, dt, 0, start, begin)
            follow(course, equation, (), sensors, room, histories, 0, 0, 0)

    def launch(dt: float, arrays: list[Tensor]) -> None:
        given = [array if array.is_cuda else array.numpy() for array in arrays]
        with warnings.catch_warnings():  # few runs leave lanes idle, and are still soonest there
            warnings.filterwarnings("ignore", message=".*under-utilization")
            kernel[-(-given[-1].shape[2] // BLOCK), BLOCK](dt, *given)

    return launch
