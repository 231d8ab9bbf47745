"""Long compiled work hears Ctrl-C, and its errors arrive."""

from __future__ import annotations

import pytest

from data.parallel import BLINK, in_threads, interruptible, take_threads


@pytest.mark.parametrize("steps", [1, BLINK + 1])
def test_an_error_in_the_work_is_that_of_the_call(steps):
    with pytest.raises(ZeroDivisionError):
        interruptible(lambda: 1 / 0, steps)


@pytest.mark.parametrize("steps", [1, BLINK + 1])
@pytest.mark.parametrize("threads", [1, 3])
def test_results_are_in_the_order_of_the_items_and_errors_arrive(threads, steps):
    try:
        take_threads(threads)
        assert in_threads(lambda n: n * n, range(50), steps) == [n * n for n in range(50)]
        with pytest.raises(ZeroDivisionError):
            in_threads(lambda n: 1 / n, [2, 1, 0], steps)
    finally:
        take_threads(1)
