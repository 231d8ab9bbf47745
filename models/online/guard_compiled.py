"""The numbers of a guard, and a sample that is as it should be, compiled; guard.py has all others.

The rows of the numbers, a column for each channel, are its ordinary range: the last value, the
largest value, step and innovation of late, and the smallest step so far but none at all, which is
the bit of a coarse converter. Accelerations also have the value before, how many in a row equalled
it, the largest so far, and Σ (a − â)² and Σ a² of sound samples in motion since the last review.
`limits`: of outliers (inf: none is judged), of the sensors' scale, of values that repeat.
No fast mathematics: a sample is judged as in Python, to the bit.
"""

from __future__ import annotations

import math
from pathlib import Path

from data.numba_cache import compilers

HERE = Path(__file__)
_, inlined = compilers(HERE)
FADE = 1000  # samples in which the largest of late falls to 1/e
KEPT = math.exp(-1.0 / FADE)
ROWS = range(10)
LAST, LEVEL, STEP, QUANTUM, ERROR, BEFORE, SAME, LARGEST, MISSED, MEASURED = ROWS


def far(value, size, usual, numbers, j, times):
    """Whether a value of channel j is far off: by its step, and its size over the row `usual`."""
    step = abs(value - numbers[LAST, j])
    if not step > numbers[STEP, j]:
        return False
    quantum = numbers[QUANTUM, j]
    bound = times * times * max(numbers[STEP, j], quantum) * max(numbers[usual, j], quantum)
    return step * abs(size) > bound


def take(value, numbers, j):
    """Widen the range of channel j by a sound value."""
    step, quantum = abs(value - numbers[LAST, j]), numbers[QUANTUM, j]
    if step > 0.0 and (step < quantum or quantum == 0.0):
        numbers[QUANTUM, j] = step
    numbers[STEP, j] = max(step, KEPT * numbers[STEP, j])
    numbers[LEVEL, j] = max(abs(value), KEPT * numbers[LEVEL, j])
    numbers[LAST, j] = value


_far, _take = inlined(far), inlined(take)


@inlined
def input_is_ordinary(f, numbers, limits):
    """Whether an excitation (m,) is finite and holds no outlier."""
    for j in range(f.size):
        if _far(f[j], f[j], LEVEL, numbers, j, limits[0]) or not math.isfinite(f[j]):
            return False
    return True


@inlined
def output_is_ordinary(a, estimate, moving, numbers, limits):
    """Whether an acceleration (n,) is sound, as `Watch.judge` in guard.py finds it."""
    for j in range(a.size):
        error = a[j] - estimate[j]
        strays = _far(a[j], error, ERROR, numbers, j, limits[0])
        if strays or not abs(a[j]) < limits[1] or not math.isfinite(error):
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
