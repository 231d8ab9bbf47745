"""Published weights: `from models.zoo import list_pretrained, load_pretrained`.

Loaded when first used: a name is looked up, or a mistyped one reported, before PyTorch is loaded.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

PUBLIC = {
    "Pretrained": "models.zoo.pretrained",
    "list_pretrained": "models.zoo.table",
    "load_pretrained": "models.zoo.pretrained",
}
__all__ = list(PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'models.zoo' has no {name!r}; public are {', '.join(PUBLIC)}")
    return getattr(import_module(PUBLIC[name]), name)
