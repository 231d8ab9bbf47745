"""What a law remembers of its past: MEMORY numbers, of which it sets as many as it needs."""

from __future__ import annotations

from data.simulation.laws.compiling import inlined


@inlined
def memory(a, b=0.0, c=0.0, d=0.0, e=0.0, f=0.0, g=0.0, h=0.0, i=0.0, j=0.0, k=0.0, last=0.0):
    return a, b, c, d, e, f, g, h, i, j, k, last
