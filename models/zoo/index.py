"""Which models are published, and whether their files are the ones that were.

An entry `zoo/MODEL/SYSTEM.vN/` is a finished run without its logs. `zoo/index.json` has the SHA-256
of every file. A published version never changes: what is better becomes the next version.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data.arguments import suggestion
from data.plain_data import LARGEST, read_json
from data.whole_file import digest_of
from models.stored.schema import COUNT, NUMBER, PERCENT, Rule, needing, require, within

ROOT = Path(__file__).parents[2] / "zoo"
PREFIX = "zoo:"  # of a name where a run's folder may stand, too
FORMAT = 1
INDEX = "index.json"
NAME = re.compile(r"(\w{1,64})/([\w-]{1,64})\.v([1-9]\d{0,8})", re.ASCII)


BACK = "git checkout -- zoo brings it back"
FILES = (  # of an entry
    *("card.md", "config.yaml", "golden.npz", "metrics.json"),
    *("model.safetensors", "picture.svg", "sensors.json"),
)
NEEDED = ("card.md", "config.yaml", "metrics.json", "model.safetensors", "sensors.json")
SHA256 = re.compile(r"[0-9a-f]{64}")
FILE = needing(
    {
        "sha256": Rule(str, lambda own: "" if SHA256.fullmatch(own) else "is no SHA-256"),
        "bytes": within(int, 0, LARGEST),
    },
    *("sha256", "bytes"),
)


def _odd_files(files: Mapping[str, Any]) -> str:
    odd = sorted(set(files) - set(FILES))
    return f"has {odd[0]!r}, which is no file of an entry" if odd else ""


def _odd_names(names: Mapping[str, Any]) -> str:
    odd = [name for name in names if not NAME.fullmatch(name)]
    return f"has {odd[0]!r}, expected MODEL/SYSTEM.vN" if odd else ""


FACTS = needing(
    {
        "free_run_percent": (NUMBER, str),  # a word where there is none
        "one_step_percent": PERCENT,
        "parameters": COUNT,
        **dict.fromkeys(("quantity", "licence", "data_licence"), str),
        "files": Rule(needing({...: FILE}, *NEEDED), _odd_files),
    },
    *("free_run_percent", "one_step_percent", "parameters", "licence", "files"),
)
INDEX_KIND = needing(
    {
        "format": within(int, FORMAT, FORMAT),
        "told": {...: str},
        "entries": Rule({...: FACTS}, _odd_names),
    },
    *("format", "entries"),
)


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
        """Raise ValueError, naming the file, where one is not what was published.

        Links are not followed, and no file is read that has not its published size.
        """
        for place in (self.folder.parent, self.folder):
            if place.is_symlink() or not place.is_dir():
                raise ValueError(f"zoo:{self.name}: {place} is no folder; {BACK}")
        for name, published in self.facts["files"].items():
            path = self.folder / name
            if path.is_symlink() or not path.is_file():
                raise ValueError(f"zoo:{self.name} lacks {name}; {BACK}")
            if (size := path.stat().st_size) != published["bytes"]:
                told = f"{size} bytes, expected {published['bytes']}"
            elif (own := digest_of(path)) != published["sha256"]:
                told = f"SHA-256 {own}, expected {published['sha256']}"
            else:
                continue
            raise ValueError(f"zoo:{self.name}: {name} is not the published file: {told}; {BACK}")
        if more := {path.name for path in self.folder.iterdir()} - set(self.facts["files"]):
            raise ValueError(
                f"zoo:{self.name} holds {', '.join(sorted(more))}, which was not published; "
                "remove it"
            )


def entries(root: Path = ROOT) -> list[Entry]:
    """All published versions, by name. Raises ValueError where the index is no index."""
    path = root / INDEX
    if not os.path.lexists(path):
        return []
    try:
        if path.is_symlink():
            raise ValueError("it is a link")
        content = read_json(path)
        require(content, INDEX_KIND)
    except ValueError as error:
        raise ValueError(f"{path} is damaged ({error}); git checkout -- zoo") from None
    told = content.get("told", {})
    found = [
        Entry(name, root / name, facts, told.get(name.partition("/")[0], ""))
        for name, facts in content["entries"].items()
    ]
    return sorted(found, key=lambda entry: (entry.model, entry.system, entry.version))


def entry_of(name: str, root: Path = ROOT) -> Entry:
    """The newest version of MODEL/SYSTEM, or the one that MODEL/SYSTEM.vN names.

    Raises ValueError, with what comes near, for a name that is not published.
    """
    name = name.removeprefix(PREFIX)
    found = entries(root)
    fitting = [e for e in found if name in (e.name, f"{e.model}/{e.system}")]
    if fitting:
        return max(fitting, key=lambda entry: entry.version)
    plain = dict.fromkeys(f"{entry.model}/{entry.system}" for entry in found)
    near = suggestion(name, plain, most=3) or "; python -m models.zoo list has all names"
    raise ValueError(f"zoo:{name} is not published{near}")


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
