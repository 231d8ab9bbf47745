"""Heavy packages loaded quickly."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points, version
from types import ModuleType
from typing import Any

LIGHTNING, COMPILER, METRICS = "lightning.pytorch", "torch._dynamo", "torchmetrics"


@contextmanager
def loading() -> Iterator[None]:
    """For imports that take seconds: what they load is never searched for garbage.

    Lightning is among them, without PyTorch's compiler and without torchmetrics. Once in a process:
    garbage of earlier runs must not be kept with what was loaded.
    """
    if LIGHTNING in sys.modules:
        yield
        return
    gc.disable()
    try:
        with without_compiler(), _without_metrics():
            import_module(LIGHTNING)
        # a trainer asks all that is installed for callbacks: once in a process will do
        registry = import_module("lightning.fabric.utilities.registry")
        registry.entry_points = cache(entry_points)  # type: ignore[attr-defined]
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
    compiled = type("OptimizedModule", (), {})  # what torch.compile returns
    with _standing_in(COMPILER, OptimizedModule=compiled, disable=_as_it_is):
        yield


@contextmanager
def _without_metrics() -> Iterator[None]:
    """torchmetrics, which loads SciPy and matplotlib, is not loaded to ask what is a metric.

    Lightning does when it is imported. Nothing is one until somebody else imports torchmetrics.
    """
    kinds = {name: _Metric(name, (), {}) for name in ("Metric", "MetricCollection")}
    with _standing_in(METRICS, __version__=version(METRICS), **kinds):
        yield


class _Metric(type):
    """A class of torchmetrics by its name, asked only for what its instances are."""

    def __instancecheck__(cls, value: Any) -> bool:
        true = getattr(sys.modules.get(METRICS), cls.__name__, cls)
        return true is not cls and isinstance(value, true)


@contextmanager
def _standing_in(name: str, **attributes: Any) -> Iterator[None]:
    """A module of that name which has these attributes alone, unless the true one is loaded."""
    if name in sys.modules:
        yield
        return
    stand_in = ModuleType(name)
    vars(stand_in).update(attributes)
    sys.modules[name] = stand_in
    try:
        yield
    finally:
        sys.modules.pop(name, None)


def _as_it_is(function: Any = None, *_: Any, **__: Any) -> Any:
    """What is not to be compiled, called or as a decorator with choices."""
    return _as_it_is if function is None else function
