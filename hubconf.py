"""torch.hub: the published models of this clone, by the name of their kind.

    model = torch.hub.load(CLONE, "element_network", source="local", weights="bouc_wen")
    table = torch.hub.load(CLONE, "list_pretrained", source="local")

The packages here are called `data` and `models`, as many others are. Where a package of that name
is there already, the entries say so in one line.
"""

import importlib
import json
import re
import sys
from pathlib import Path
from typing import Any

dependencies = ["torch", "numpy", "numba", "omegaconf", "safetensors", "lightning"]

_CLONE = Path(__file__).resolve().parent
_OURS = ("data", "models")


_LARGEST = 2**24  # bytes of a file, packed or not
_NAME = re.compile(r"\w{1,64}/[\w-]{1,64}\.v[1-9]\d{0,8}", re.ASCII)


def _entries() -> dict[str, Any]:
    """{name: {file: {sha256, bytes}}}. Raises ValueError where the index is none."""
    path = _CLONE / "zoo" / "index.json"
    try:
        content = json.loads(_read(path, _LARGEST))
        entries = {name: entry["files"] for name, entry in content["entries"].items()}
        if odd := [name for name in entries if not _NAME.fullmatch(name)]:
            raise ValueError(f"{odd[0]!r}, expected MODEL/SYSTEM.vN")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path} is damaged ({error!r}); git checkout -- zoo") from None
    return entries


def _read(path: Path, limit: int) -> bytes:
    """Content of a file. Raises ValueError for a link, what is no file, and more than `limit`."""
    for place in (path, *path.relative_to(_CLONE / "zoo").parents):
        if (_CLONE / "zoo" / place).is_symlink() and place != Path():
            raise ValueError(f"{path} is reached by a link")
    if not path.is_file() or path.stat().st_size > limit:
        raise ValueError(f"{path} is no file of {limit} bytes at most")
    with path.open("rb") as file:
        return file.read(limit)


def _require_ours() -> None:
    """Raise ImportError where another package has the name of ours."""
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
    """The published models: name, errors, parameters, size, licence, what they were given."""
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


_FREE = {kind: systems for kind, systems in _kinds().items() if kind not in globals()}
globals().update({kind: _entrypoint(kind, systems) for kind, systems in _FREE.items()})
