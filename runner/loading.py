"""Heavy packages loaded quickly; `python -m benchmarks.start_up` measures it."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

LIGHTNING, COMPILER = "lightning.pytorch", "torch._dynamo"


@contextmanager
def loading() -> Iterator[None]:
    """For imports that take seconds: what they load is never searched for garbage.

    Lightning is among them, without PyTorch's compiler. Once in a process: garbage of earlier runs
    must not be kept with what was loaded.
    """
    if LIGHTNING in sys.modules:
        yield
        return
    gc.disable()
    try:
        with without_compiler():
            import_module(LIGHTNING)
        yield
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def without_compiler() -> Iterator[None]:
    """PyTorch's compiler is not loaded by those who only ask whether something was compiled.

    Lightning does when it is imported, an optimizer of PyTorch when the first one is made. Both
    find a stand-in that knows of nothing. Who imports the compiler afterwards gets the true one.
    """
    if COMPILER in sys.modules:
        yield
        return
    stand_in: Any = ModuleType(COMPILER)
    stand_in.OptimizedModule = type("OptimizedModule", (), {})  # what torch.compile returns
    stand_in.disable = _as_it_is
    sys.modules[COMPILER] = stand_in
    try:
        yield
    finally:
        sys.modules.pop(COMPILER, None)


def _as_it_is(function: Any = None, *_: Any, **__: Any) -> Any:
    """What is not to be compiled, called or as a decorator with choices."""
    return _as_it_is if function is None else function
