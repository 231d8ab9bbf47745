"""torch.hub: the published models of this clone, by the name of their kind.

    model = torch.hub.load(CLONE, "element_network", source="local", weights="bouc_wen")
    table = torch.hub.load(CLONE, "list_pretrained", source="local")
    program = torch.hub.load(CLONE, "exported", source="local", name="element_network/bouc_wen")

The packages here are called `data` and `models`, as many others are. `exported` imports none of
them; the others say so in one line where a package of that name is there already.
"""

import hashlib
import importlib
import io
import json
import lzma
import sys
from pathlib import Path
from typing import Any

dependencies = ["torch", "numpy", "numba", "omegaconf", "safetensors", "lightning"]

_CLONE = Path(__file__).resolve().parent
_OURS = ("data", "models")
_EXPORTED = "exported.pt2.xz"


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
                f"{name!r}; load the hub's model before it, in a process of its own, or take "
                'torch.hub.load(…, "exported", name=…), which imports nothing'
            )


def _pretrained(name: str) -> Any:
    _require_ours()
    return importlib.import_module("models.zoo.pretrained").load_pretrained(name).model


def list_pretrained(system: str | None = None, model: str | None = None) -> Any:
    """The published models: name, errors, parameters, size, licence, what they were told."""
    _require_ours()
    return importlib.import_module("models.zoo.table").list_pretrained(system, model)


def exported(name: str) -> Any:
    """torch.export.ExportedProgram of a model's free run; imports nothing of this project.

        x, v, a = exported("element_network/bouc_wen").module()(u, x0, v0)

    u (B, T, m), x0 and v0 (B, n), x, v and a (B, T, n), float64. Raises ValueError for a name that
    is not published, for a model without such a program, and for a file that was changed.
    """
    import torch

    known = {n: e["files"] for n, e in _entries().items() if _EXPORTED in e["files"]}
    fitting = [n for n in known if name in (n, n.rpartition(".v")[0])]
    if not fitting:
        raise ValueError(f"{name!r} has no exported program; there are {', '.join(known)}")
    newest = max(fitting, key=lambda n: int(n.rpartition(".v")[2]))
    packed = (_CLONE / "zoo" / newest / _EXPORTED).read_bytes()
    own, expected = hashlib.sha256(packed).hexdigest(), known[newest][_EXPORTED]["sha256"]
    if own != expected:
        raise ValueError(f"{newest}/{_EXPORTED}: SHA-256 {own}, expected {expected}")
    return torch.export.load(io.BytesIO(lzma.decompress(packed)))


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
