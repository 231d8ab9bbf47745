"""Median, quartiles and range of a number over the runs of one case, and how a lost run counts.

One meaning everywhere:

diverged  an estimate overflowed or its free run left: infinite, the worst of all
failed    the run ended with an error: infinite too, where runs of its case have a number
escaped   the structure's own motion left every bound, before any estimator ran. That belongs to the
          draw: every method lacks the same seeds, and none of them can be judged there. Such runs
          are counted and take no part in median, quartiles and range

not identified  the run has numbers, which count as they are, but its model is no better than none,
          than a rigid body or than a linear system on its own training motion

A lost run is never dropped: half of the runs diverged is a median that diverged. Only the judgement
whether a value of somebody else lies inside a range takes the finite ends, because an infinite end
would let every value in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

DIVERGED, FAILED, ESCAPED = "diverged", "failed", "escaped"
NOT_IDENTIFIED = "not identified"
LARGE = 1e5  # from here on as a power of ten


def quantile(values: Sequence[float], q: float) -> float | None:
    """Linear between the values on either side, as numpy's; infinite where one of them is."""
    if not values:
        return None
    ordered, place = sorted(values), q * (len(values) - 1)
    low, high = ordered[math.floor(place)], ordered[math.ceil(place)]
    return high if math.isinf(high) else low + (place - math.floor(place)) * (high - low)


def percent(value: float | None) -> str:
    """Two decimals; none from a hundred on; "" for None."""
    if value is None:
        return ""
    if math.isinf(value):
        return DIVERGED
    if value >= LARGE:
        return f"{value:.0e}"
    return f"{value:.2f}" if value < 99.995 else f"{value:.0f}"


@dataclass(frozen=True)
class Spread:
    """Values of the runs of one case, infinite for those that diverged or failed.

    All statistics are None where there are no values.
    """

    values: tuple[float, ...] = ()
    failed: int = 0
    escaped: int = 0  # have no value
    without: int = 0  # ended, but have no such number: no free run, say
    unidentified: int = 0  # of any of these runs

    @property
    def runs(self) -> int:
        return len(self.values) + self.escaped + self.without

    @property
    def diverged(self) -> int:
        return max(0, sum(map(math.isinf, self.values)) - self.failed)

    @property
    def lost(self) -> str:
        """Word for an infinite value."""
        return DIVERGED if self.diverged else FAILED

    @property
    def finite(self) -> list[float]:
        return [value for value in self.values if math.isfinite(value)]

    @property
    def median(self) -> float | None:
        return quantile(self.values, 0.5)

    @property
    def quartiles(self) -> tuple[float | None, float | None]:
        return quantile(self.values, 0.25), quantile(self.values, 0.75)

    @property
    def range(self) -> tuple[float | None, float | None]:
        return quantile(self.values, 0.0), quantile(self.values, 1.0)

    def columns(self) -> dict[str, Any]:
        """Counts and statistics for a table with full precision."""
        counts = {"runs": self.runs, "failed": self.failed, "diverged": self.diverged}
        names = ("q25_percent", "q75_percent", "min_percent", "max_percent")
        ends = dict(zip(names, (*self.quartiles, *self.range), strict=True))
        return {**counts, "escaped": self.escaped, "median_percent": self.median, **ends}

    def holds(self, value: float) -> bool:
        """Whether a value lies between the smallest and the largest finite one."""
        return bool(self.finite) and min(self.finite) <= value <= max(self.finite)

    def counts(self) -> str:
        """How many runs, and how many of them were lost: "20, 2 escaped"."""
        counts = {DIVERGED: self.diverged, FAILED: self.failed, ESCAPED: self.escaped}
        counts[NOT_IDENTIFIED] = self.unidentified
        lost = (f"{count} {what}" for what, count in counts.items() if count)
        return ", ".join((str(self.runs), *lost))

    def words(self, value: float | None, write: Callable[[float], str] = percent) -> str:
        """A statistic of these values as text; – where there is none."""
        if value is None:
            return "–"
        return self.lost if math.isinf(value) else write(value)

    def between(self, ends: tuple[float | None, float | None]) -> str:
        """Quartiles or range, "9.00 – 11.00"; one word where both ends are lost."""
        low, high = map(self.words, ends)
        return low if low == high and not low[0].isdigit() else f"{low} – {high}"

    def text(self, write: Callable[[float], str] = percent) -> str:
        """Median and range: "10.00 (9.00 – 11.00)"; the median alone where all of them are one."""
        middle, low, high = (self.words(u, write) for u in (self.median, *self.range))
        return middle if middle == low == high else f"{middle} ({low} – {high})"
