"""A Hydra plugin that replaces a class of ours until that class is needed."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any, get_type_hints

from omegaconf import OmegaConf

from data.annotations import require, shown
from runner.loading import loading


class LoadedLate:
    """Hands over to the class of the same name in `module`, which `setup` loads.

    Hydra imports all plugins whenever a config is composed. PyTorch takes seconds to load, and a
    mistyped word is reported before.
    """

    module: str
    key: str  # of its settings

    def __init__(self, **settings: Any) -> None:
        self.settings = {
            name: OmegaConf.to_object(value) if OmegaConf.is_config(value) else value
            for name, value in settings.items()
        }

    def setup(self, **context: Any) -> None:
        """Load the class. Raises ValueError for a setting that it does not know or cannot use."""
        with loading():
            module = import_module(self.module)
        loaded = getattr(module, type(self).__name__)
        hints: dict[str, Any] = {}
        for base in reversed(loaded.__mro__):
            hints |= get_type_hints(base.__init__)
        for name, value in self.settings.items():
            key = f"{self.key}.{name}"
            require(key, value, hints.get(name, Any), "see docs/sweeps.md")
            if isinstance(value, float) and math.isinf(value):
                raise ValueError(f"{key}={shown(value)} must be finite; see docs/sweeps.md")
        try:
            self.loaded = loaded(**self.settings)
        except TypeError as error:  # a setting of another class
            words = str(error).partition(".__init__() ")[2] or str(error)
            raise ValueError(f"{self.key} {words}; see docs/sweeps.md") from None
        self.loaded.setup(**context)
