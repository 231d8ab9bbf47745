"""The stop operator, compiled.   T samples, J sliders."""

from __future__ import annotations

from pathlib import Path

from data.numba_cache import compilers

compiled, _ = compilers(Path(__file__))


@compiled
def follow(s, widths, first, z):
    """Fill z (T, J) under a motion s (T,), from `first` (J,), of half widths (J,)."""
    for j in range(widths.size):
        limit, now = widths[j], first[j]
        for k in range(s.size):
            if k > 0:
                now += s[k] - s[k - 1]
            now = min(max(now, -limit), limit)
            z[k, j] = now
