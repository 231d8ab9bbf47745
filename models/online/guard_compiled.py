"""The guard of a sample that is as it should be, compiled: guard.py and outliers.py tell of others.

Rows of a guard's numbers, a column for each channel; channels of excitation have the first four.
`limits`: of outliers (inf: none is judged), of the sensors' scale, of values that repeat.
No fast mathematics: a sample is judged as in Python, to the bit.
"""

from __future__ import annotations

import math
from pathlib import Path

from data.numba_cache import compilers
from models.online.outliers import KEPT

HERE = Path(__file__)
_, inlined = compilers(HERE)
ROWS = range(10)
LAST, LEVEL, STEP, QUANTUM, ERROR, BEFORE, SAME, LARGEST, MISSED, MEASURED = ROWS


@inlined
def _far(step, size, usual, numbers, j, times):
    """As `Range.far` in outliers.py."""
    quantum = numbers[QUANTUM, j]
    bound = times * times * max(numbers[STEP, j], quantum) * max(usual, quantum)
    return step > numbers[STEP, j] and step * abs(size) > bound


@inlined
def _take(value, numbers, j):
    """As `Range.take` in outliers.py."""
    step, quantum = abs(value - numbers[LAST, j]), numbers[QUANTUM, j]
    if step > 0.0 and (step < quantum or quantum == 0.0):
        numbers[QUANTUM, j] = step
    numbers[STEP, j] = max(step, KEPT * numbers[STEP, j])
    numbers[LEVEL, j] = max(abs(value), KEPT * numbers[LEVEL, j])
    numbers[LAST, j] = value


@inlined
def input_is_ordinary(f, numbers, limits):
    """Whether an excitation (m,) is finite and holds no outlier."""
    for j in range(f.size):
        step = abs(f[j] - numbers[LAST, j])
        far = _far(step, f[j], numbers[LEVEL, j], numbers, j, limits[0])
        if far or not math.isfinite(f[j]):
            return False
    return True


@inlined
def output_is_ordinary(a, estimate, moving, numbers, limits):
    """Whether an acceleration (n,) is sound, as `Watch.judged` in guard.py finds it."""
    for j in range(a.size):
        step, error = abs(a[j] - numbers[LAST, j]), a[j] - estimate[j]
        far = _far(step, error, numbers[ERROR, j], numbers, j, limits[0])
        if far or not abs(a[j]) < limits[1] or not math.isfinite(error):
            return False
        again = numbers[SAME, j] + (moving or a[j] != 0.0)
        if a[j] == numbers[BEFORE, j] and again >= limits[2]:
            return False
    return True


@inlined
def take_input(f, numbers):
    """Widen the ranges by an excitation (m,)."""
    for j in range(f.size):
        _take(f[j], numbers, j)


@inlined
def take_output(a, estimate, moving, numbers):
    """Widen the ranges by an acceleration (n,), count values that repeat, and sum squares."""
    for j in range(a.size):
        error = a[j] - estimate[j]
        _take(a[j], numbers, j)
        numbers[ERROR, j] = max(abs(error), KEPT * numbers[ERROR, j])
        if moving or a[j] != 0.0:
            numbers[MISSED, j] += error * error
            numbers[MEASURED, j] += a[j] * a[j]
        if a[j] == numbers[BEFORE, j]:
            numbers[SAME, j] += moving or a[j] != 0.0
        else:
            numbers[SAME, j] = 0.0
            numbers[LARGEST, j] = max(numbers[LARGEST, j], abs(a[j]))
        numbers[BEFORE, j] = a[j]
