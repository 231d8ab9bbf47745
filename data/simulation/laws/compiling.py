"""How the laws are compiled: with each other and with the integrator, which calls them.

A change in any of these files compiles all of them again.
"""

from __future__ import annotations

from pathlib import Path

from data.numba_cache import compilers

ROOM = Path(__file__).parent
CALLERS = tuple(ROOM.with_name(f"{n}.py") for n in ("element_test", "integrator"))
SOURCES = (*sorted(ROOM.glob("*.py")), *CALLERS)
compiled, inlined = compilers(*SOURCES, allocate=False)
