"""Functions mean in C what they mean in Python, and what cannot be translated is told."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import FunctionType

import numpy as np
import pytest
import torch

from data.record import Drive
from export.step import Step, run
from export.translate.program import Program, array_of
from export.translate.values import Value
from tests.export.compiling import needs_gcc, run_in_c

TABLE = (0.5, -1.5, 2.0)
PLACES = np.array([2, 0, 1])
WEIGHTS = np.array([[0.1, -1 / 3, 2.0], [1e-9, 7.0, -0.0]])
SINGLE = np.array([0.1, 0.2], np.float32)
ROWS, FAR = 2, 1e3


def nothing(out):
    out[:] = 0.0


def moved(last, t):
    t[0] += 1.0


def pair(a, b):
    if a > b:
        return a, b
    return b, a


def nested(a):
    return (a, 2.0 * a), 3


def arithmetic(u, t, out):
    """Signs, powers, remainders, comparisons in a row."""
    out[:] = 0.0
    a, b = u[0], u[1]
    n = math.floor(3.0 * a)
    out[0] = a - (b - 2.0) * a / (1.0 + b**2) - a**3
    out[1] = float(n // 2) + 10.0 * float(n % 2) + 2 / 4
    out[2] = 1.0 if 0.0 < a <= b < FAR else -1.0
    out[3] = -(a + b) if not a > b else +a
    out[4] = max(a, b, 0.0) + min(a, -b) * abs(a) + abs(n)
    out[5] = math.copysign(2.0, a) * math.hypot(a, b) + np.tanh(a)
    out[6] = float((n & 1) + (5 >> 1))


def control(u, t, out):
    """Loops, breaks, choices between numbers and between tuples."""
    out[:] = 0.0
    total, count = 0.0, 0
    for i in range(6, 0, -2):
        if i == 4 and u[0] > 0.0:
            continue
        total += i
    while True:
        count += 1
        if count > 3 or total < 0.0:
            break
    first, second = (u[0], u[1]) if u[0] > u[1] else (u[1], u[0])
    first, second = second, first
    out[0], out[1], out[2] = total, float(count), first - second
    high, low = pair(u[0], u[1])
    (one, two), three = nested(high)
    out[3], out[4] = one - low, two * three
    for weight in TABLE:
        out[5] += weight * u[0]
    out[6] = TABLE[count % 3]


def arrays(u, t, out):
    """Rows, fills, parts."""
    out[:] = 0.0
    work = np.zeros(4)
    both = np.empty((ROWS, 3))
    one = np.zeros(3)
    two = np.zeros(3)
    both[0, :] = 1.5
    both[1] = both[0]
    row = both[1]
    row[2] = u[0]
    part = work[1:3]
    part[0] = 2.0
    part[1] += u[1]
    one[:] = both[1]
    two[1:] = 4.0
    for i in range(both.shape[1]):
        out[i] += one[i] + two[i]
    out[3], out[4] = work[1] + work[2], float(len(work) + both.size)
    out[5] = one[-1]


def weighted(row, u):
    return row[0] * u[0] + row[2] * u[1]


def weighted_sum(u):
    return WEIGHTS[0, 1] * u[0] + WEIGHTS[1, 1] * u[1]


elsewhere = FunctionType(weighted_sum.__code__, {"WEIGHTS": WEIGHTS[:, ::-1] ** 2})


def tables(u, t, out):
    """Arrays of a module by places, by rows, given to a function, and another's of that name."""
    out[:] = 0.0
    n = math.floor(abs(u[0])) % 3
    out[0] = WEIGHTS[1, PLACES[n]] + WEIGHTS[0, n]
    row = WEIGHTS[n % 2]
    for j in range(WEIGHTS.shape[1]):
        out[1] += row[j] * u[0]
    out[2], out[3], out[4] = weighted(WEIGHTS[0], u), weighted_sum(u), elsewhere(u)
    out[5:] = WEIGHTS[1]


def step(observe: Callable[..., None]) -> Step:
    return Step(
        nothing, observe, moved, 0.1, {"out": np.zeros(8), "t": np.zeros(1)}, {},
        [("u1", ""), ("u2", "")], [("out", [f"o{i}" for i in range(8)], "")],
    )  # fmt: skip


@needs_gcc
@pytest.mark.parametrize("function", [arithmetic, control, arrays, tables])
def test_c_gives_the_same_bits(function, tmp_path):
    u = 3.0 * torch.randn(60, 2, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    u[5] = u[6] = 0.0
    rest = torch.zeros(8, dtype=torch.float64)
    given = Drive(0.1, u, rest, rest)
    python, c = run(step(function), given)["out"], run_in_c(step(function), given, tmp_path)["out"]
    np.testing.assert_allclose(c, python, rtol=4e-16, atol=0.0)
    assert np.abs(python).max() > 1.0


def translated(function: Callable[..., None], **arguments: Value) -> str:
    program = Program()
    found = program.function(function, {"a": array_of("a", np.zeros((2, 3))), **arguments})
    return program.text([found])


def lists(a):
    a[0, 0] = sum([1.0, 2.0])


def unknown(a):
    a[0, 0] = missing  # noqa: F821


def whole(a):
    a[0, 0] = a * 2.0


def named(a):
    a[0, 0] = math.lgamma(a[0, 1])


def growing(a):
    n = int(a[0, 0])
    b = np.zeros(n)
    a[0, 1] = b[0]


def endless(a):
    endless(a)


def constant(a):
    WEIGHTS[0, 0] = a[0, 0]


def constant_elsewhere(a):
    moved(0.0, WEIGHTS[1])


def single(a):
    a[0, 0] = SINGLE[0]


def several(a):
    b, c = np.zeros((2, 3))
    a[0, 0] = b[0] + c[0]


@pytest.mark.parametrize(
    ("function", "said"),
    [
        (lists, "List|list"),
        (unknown, "missing is not known"),
        (whole, "element by element"),
        (named, "lgamma"),
        (growing, "must be known"),
        (endless, "calls itself"),
        (constant, "table_weights is an array of its module, which cannot be set"),
        (constant_elsewhere, "table_weights is an array of its module, which cannot be set"),
        (single, "SINGLE is not known"),
        (several, "assigned to one name"),
    ],
)
def test_what_cannot_be_translated_is_told(function, said):
    with pytest.raises(ValueError, match=said) as told:
        translated(function)
    assert function.__name__ in str(told.value) or "endless" in str(told.value)
