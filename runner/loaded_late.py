"""A Hydra plugin that stands for a class of ours until that class is needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from runner.loading import loading


class LoadedLate:
    """Hands over to the class of the same name in `module`, which `setup` loads.

    Hydra imports all plugins whenever a config is composed. PyTorch takes seconds to load, and a
    mistyped word is told before.
    """

    module: str

    def __init__(self, **settings: Any) -> None:
        self.settings = settings

    def setup(self, **context: Any) -> None:
        with loading():
            module = import_module(self.module)
        self.loaded = getattr(module, type(self).__name__)(**self.settings)
        self.loaded.setup(**context)
