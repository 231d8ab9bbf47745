"""Which models are published, and whether their files are the ones that were.

An entry `zoo/MODEL/SYSTEM.vN/` is a finished run without its logs. `zoo/index.json` has the SHA-256
of every file. A published version never changes: what is better becomes the next version.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2] / "zoo"
PREFIX = "zoo:"  # of a name where a run's folder may stand, too
FORMAT = 1
INDEX, EMPTY = "index.json", '{"format": 1, "entries": {}}'
NAME = re.compile(r"(\w+)/([\w-]+)\.v([1-9]\d*)")


@dataclass(frozen=True)
class Entry:
    """One published version. facts: what the index says of it."""

    name: str  # MODEL/SYSTEM.vN
    folder: Path
    facts: Mapping[str, Any]
    told: str = ""  # what its kind of model knows of a structure before any data

    @property
    def model(self) -> str:
        return self.name.partition("/")[0]

    @property
    def system(self) -> str:
        return self.name.partition("/")[2].rpartition(".v")[0]

    @property
    def version(self) -> int:
        return int(self.name.rpartition(".v")[2])

    @property
    def bytes(self) -> int:
        """Size of all its files."""
        return sum(file["bytes"] for file in self.facts["files"].values())

    def require_untouched(self) -> None:
        """Raise ValueError, naming the file, where one is not what was published."""
        for name, published in self.facts["files"].items():
            path = self.folder / name
            if not path.is_file() or path.is_symlink():
                raise ValueError(
                    f"zoo:{self.name} lacks {name}; git checkout -- zoo brings it back"
                )
            own = digest_of(path)
            if own != published["sha256"]:
                raise ValueError(
                    f"zoo:{self.name}: {name} is not the published file: SHA-256 {own}, expected "
                    f"{published['sha256']}; git checkout -- zoo brings it back"
                )
        if more := {path.name for path in self.folder.iterdir()} - set(self.facts["files"]):
            raise ValueError(
                f"zoo:{self.name} holds {', '.join(sorted(more))}, which was not published; "
                "remove it"
            )


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def entries(root: Path = ROOT) -> list[Entry]:
    """All published versions, by name. Raises ValueError where the index is no index."""
    path = root / INDEX
    try:
        text = path.read_text("utf-8") if path.is_file() else EMPTY
        content = json.loads(text)
        if content["format"] != FORMAT:
            raise ValueError(f"format {content['format']!r}, this version reads {FORMAT}")
        told = content.get("told", {})
        found = [
            Entry(name, root / name, facts, str(told.get(name.partition("/")[0], "")))
            for name, facts in content["entries"].items()
        ]
        for entry in found:
            _require_plain(entry)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"{path} is damaged ({error}); git checkout -- zoo") from None
    return sorted(found, key=lambda entry: (entry.model, entry.system, entry.version))


def _require_plain(entry: Entry) -> None:
    """Raise ValueError for a name that could lead out of the zoo, and for facts of no entry."""
    names = list(entry.facts["files"])
    if not NAME.fullmatch(entry.name) or not all(re.fullmatch(r"[\w.-]+", n) for n in names):
        raise ValueError(f"{entry.name!r} holds {names}")
    for file in entry.facts["files"].values():
        if not (isinstance(file["sha256"], str) and isinstance(file["bytes"], int)):
            raise ValueError(f"{entry.name}: a file without its SHA-256 and size")


def entry_of(name: str, root: Path = ROOT) -> Entry:
    """The newest version of MODEL/SYSTEM, or the one that MODEL/SYSTEM.vN names.

    Raises ValueError, with what comes near, for a name that is not published.
    """
    name = name.removeprefix(PREFIX)
    found = entries(root)
    fitting = [e for e in found if name in (e.name, f"{e.model}/{e.system}")]
    if fitting:
        return max(fitting, key=lambda entry: entry.version)
    raise ValueError(f"zoo:{name} is not published{_near(name, found)}")


def _near(name: str, found: list[Entry]) -> str:
    """What may have been meant: the same model or structure first."""
    plain = dict.fromkeys(f"{entry.model}/{entry.system}" for entry in found)
    if not plain:
        return "; the zoo is empty"
    near = difflib.get_close_matches(name, plain, n=3, cutoff=0.6)
    model, _, system = name.partition("/")
    near = near or [n for n in plain if model and model == n.partition("/")[0]][:3]
    near = near or [n for n in plain if system and system == n.partition("/")[2]][:3]
    if near:
        return f"; did you mean {' or '.join(near)}?"
    return "; python -m models.zoo list has all names"


def is_name(word: str) -> bool:
    """Whether a word names an entry, and no folder."""
    return str(word).startswith(PREFIX)


def folder_of(word: str, root: Path = ROOT) -> Path:
    """The folder of `zoo:NAME`, all of its files as published. Raises ValueError otherwise."""
    entry = entry_of(word, root)
    entry.require_untouched()
    return entry.folder


def published(folder: Path, root: Path = ROOT) -> str | None:
    """Name of the entry that a folder is; None for a run of one's own."""
    inside = folder.resolve().is_relative_to(root.resolve())
    return folder.resolve().relative_to(root.resolve()).as_posix() if inside else None
