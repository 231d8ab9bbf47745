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
import math
import re
import sys
import zipfile
from pathlib import Path
from typing import Any

dependencies = ["torch", "numpy", "numba", "omegaconf", "safetensors", "lightning"]

_CLONE = Path(__file__).resolve().parent
_OURS = ("data", "models")
_EXPORTED = "exported.pt2.xz"


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
    is not published, for a model without such a program, for a file that was changed, and for a
    program that could run code.
    """
    import torch

    known = {
        n: f[_EXPORTED] for n, f in _entries().items() if isinstance(f, dict) and _EXPORTED in f
    }
    fitting = [n for n in known if name in (n, n.rpartition(".v")[0])]
    if not fitting:
        raise ValueError(f"{name!r} has no exported program; there are {', '.join(known)}")
    newest = max(fitting, key=lambda n: int(n.rpartition(".v")[2]))
    packed = _read(_CLONE / "zoo" / newest / _EXPORTED, _LARGEST)
    own, published = hashlib.sha256(packed).hexdigest(), known[newest]
    expected = published.get("sha256") if isinstance(published, dict) else None
    if own != expected:
        raise ValueError(f"{newest}/{_EXPORTED}: SHA-256 {own}, expected {expected}")
    try:
        return torch.export.load(_plain_program(packed))
    except Exception as error:  # whatever torch.export makes of a damaged graph
        raise ValueError(f"{newest}/{_EXPORTED} is no exported program: {error}") from None


# torch.export unpickles members of an archive, evaluates its symbolic sizes and guards as Python,
# and looks its operators up anywhere below `torch`. So it is given a new archive, of members that
# hold numbers, and of texts that are names but for those below.
_MEMBERS = re.compile(
    r"archive/(archive_format|archive_version|byteorder|\.data/version|\.data/serialization_id"
    r"|models/model\.json|data/(weights|constants)/model_(weights|constants)_config\.json"
    r"|data/weights/weight_\d+|data/sample_inputs/model\.pt)",
    re.ASCII,
)
_UNPICKLED = "archive/data/sample_inputs/model.pt"
_ATEN = (
    "abs.default add.Tensor cat.default chunk.default clone.default contiguous.default div.Tensor "
    "eq.Scalar exp.default ge.Scalar gt.Scalar log.default logical_and.default logical_not.default "
    "logical_or.default matmul.default maximum.default minimum.default mul.Tensor neg.default "
    "ones_like.default relu.default select.int sign.default slice.Tensor sub.Tensor "
    "sum.dim_IntList tanh.default transpose.int unflatten.int unsqueeze.default where.self "
    "zeros_like.default"
)
_SYMBOL, _SIZE = r"Symbol\('s\d{1,4}', positive=True, integer=True\)", r"L\['\w+'\]\.size\(\)\[\d\]"
_LEAF = r'\{"type": null, "context": null, "children_spec": \[\]\}'
_TUPLE = (
    rf'\{{"type": "builtins.tuple", "context": "null", "children_spec": \[{_LEAF}(, {_LEAF})*\]\}}'
)
_DICT = r'\{"type": "builtins.dict", "context": "\[\]", "children_spec": \[\]\}'
_BOTH = (
    rf'\{{"type": "builtins.tuple", "context": "null", "children_spec": \[{_TUPLE}, {_DICT}\]\}}'
)
_TEXTS = {  # by key
    "target": "|".join(
        ["torch.ops.higher_order.scan", *(f"torch.ops.aten.{name}" for name in _ATEN.split())]
    ).replace(".", r"\."),
    "expr_str": rf"{_SYMBOL}|(Add|Mul)\({_SYMBOL}, Integer\(-?\d{{1,9}}\)\)"
    rf"|(Add|Mul)\(Integer\(-?\d{{1,9}}\), {_SYMBOL}\)",
    "guards_code": rf"{_SIZE} (==|>=|<=) ({_SIZE}|\d{{1,9}})",
    "in_spec": rf"\[1, {_BOTH}\]",
    "out_spec": rf"\[1, {_TUPLE}\]",
    "torch_version": r"[\w.+]{1,40}",
}


def _plain_program(packed: bytes) -> io.BytesIO:
    """The archive of a packed program anew, as far as it cannot run code. Raises ValueError."""
    unpacker = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=2**27)
    content = unpacker.decompress(packed, _LARGEST)
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError(f"it does not unpack to {_LARGEST} bytes at most")
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(found, "w") as new:
        names = old.namelist()
        for name in names:
            if not _MEMBERS.fullmatch(name) or names.count(name) > 1:
                raise ValueError(f"it holds {name!r}")
            if old.getinfo(name).compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"its {name} is packed once more")
            member = b"" if name == _UNPICKLED else old.read(name)
            if name.endswith(".json"):
                _require_numbers(json.loads(member), "")
            new.writestr(name, member)
    found.seek(0)
    return found


def _require_numbers(value: Any, key: str) -> None:
    """Raise ValueError for a text that is none of those above, a pickle, and arrays of any size."""
    if key == "use_pickle" and value is not False:
        raise ValueError("it holds a pickle")
    if key == "sizes" and isinstance(value, list):
        sizes = [size.get("as_int", 1) for size in value if isinstance(size, dict)]
        if (
            not all(type(size) is int and 0 <= size <= _LARGEST for size in sizes)
            or math.prod(sizes) > _LARGEST
        ):
            raise ValueError(f"it holds an array of {sizes[:8]} numbers")
    if isinstance(value, dict):
        for name, inner in value.items():
            _require_numbers(name, "")
            _require_numbers(inner, name)
    elif isinstance(value, list):
        for inner in value:
            _require_numbers(inner, key)
    elif isinstance(value, str) and not re.fullmatch(_TEXTS.get(key, r"\w*"), value, re.ASCII):
        raise ValueError(f"it holds {key}={value[:60]!r}")


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
