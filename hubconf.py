"""torch.hub: the published models of this clone, by the name of their kind.

    model = torch.hub.load(CLONE, "element_network", source="local", weights="bouc_wen")
    table = torch.hub.load(CLONE, "list_pretrained", source="local")

The packages here are called `data` and `models`, as many others are. Where a package of that name
is there already, the entries say so in one line.
"""

import importlib
import json
import sys
from pathlib import Path
from typing import Any

dependencies = ["torch", "numpy", "numba", "omegaconf", "safetensors", "lightning"]

_CLONE = Path(__file__).resolve().parent
_OURS = ("data", "models")


def _entries() -> dict[str, Any]:
    index = json.loads((_CLONE / "zoo" / "index.json").read_text("utf-8"))
    entries: dict[str, Any] = index["entries"]
    return entries


def _require_ours() -> None:
    """Raise ImportError where somebody else's package stands where ours has to."""
    for name in _OURS:
        there = sys.modules.get(name)
        if there is None:
            continue
        places = [getattr(there, "__file__", None) or "", *getattr(there, "__path__", [])]
        if not any(Path(place).resolve().is_relative_to(_CLONE) for place in places if place):
            raise ImportError(
                f"a package {name!r} of {places[-1]} is imported already, and hides this hub's "
                f"{name!r}; load the hub's model before it, or in a process of its own"
            )


def _pretrained(name: str) -> Any:
    _require_ours()
    return importlib.import_module("models.zoo.pretrained").load_pretrained(name).model


def list_pretrained(system: str | None = None, model: str | None = None) -> Any:
    """The published models: name, errors, parameters, size, licence, what they were told."""
    _require_ours()
    return importlib.import_module("models.zoo.table").list_pretrained(system, model)


def _entrypoint(kind: str, systems: list[str]) -> Any:
    def load(weights: str) -> Any:
        return _pretrained(f"{kind}/{weights}")

    load.__name__ = kind
    load.__doc__ = (
        f"The published {kind}, an nn.Module; free_run(drive) simulates.\n\n"
        f"    weights: {', '.join(systems)}; .v1 after it pins a version\n"
    )
    return load


def _kinds() -> dict[str, list[str]]:
    kinds: dict[str, list[str]] = {}
    for name in _entries():
        kind, _, weights = name.rpartition(".v")[0].partition("/")
        systems = kinds.setdefault(kind, [])
        systems += [] if weights in systems else [weights]
    return kinds


globals().update({kind: _entrypoint(kind, systems) for kind, systems in _kinds().items()})
