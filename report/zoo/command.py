"""`python -m models.zoo`: list, show, verify, publish, page."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from data.arguments import key_values, plain, print_any_text, suggestion
from data.plain_data import read_text
from models.zoo.index import PREFIX, ROOT, entry_of
from runner.config.command_line import command_errors
from runner.folder.run_folder import CONFIG, METRICS, require_finished

Words = tuple[list[str], dict[str, str]]


def read(words: Sequence[str], keys: Sequence[str], most: int) -> Words:
    """Names, and values by key. Raises ValueError for other words."""
    names = [word for word in words if "=" not in word.partition("/")[0]]
    given = key_values([w for w in words if w not in names], dict.fromkeys(keys, "…"))
    if len(names) > most:
        raise ValueError(f"{names[most]} is one name too many; see --help")
    return names, given


def show_list(words: Sequence[str]) -> None:
    _, given = read(words, ("system", "model"), 0)
    print(importlib.import_module("models.zoo.table").list_pretrained(**given))


def show_card(words: Sequence[str], root: Path = ROOT) -> None:
    names, _ = read(words, (), 1)
    if not names:
        raise ValueError("show which? give MODEL/SYSTEM; python -m models.zoo list has the names")
    entry = entry_of(names[0], root)
    entry.require_untouched()
    for line in read_text(entry.folder / "card.md").splitlines():
        print(plain(line))


def verify(words: Sequence[str]) -> None:
    names, given = read(words, ("records",), 1000)
    chosen = [entry_of(name) for name in names]  # a mistyped name is reported before PyTorch loads
    records = Path(given["records"]) if "records" in given else None
    if records is not None and not records.is_dir():
        raise ValueError(f"records={records} is no folder")
    late("report.zoo.verify").verify(chosen, records)


def publish(words: Sequence[str]) -> None:
    names, given = read(words, ("licence", "data_licence", "source", "command"), 2)
    if not names:
        raise ValueError("publish what? give the folder that train.py wrote")
    folder = Path(names[0])
    runs = [folder]
    if not (folder / CONFIG).exists() and len(names) == 1:  # of a sweep
        runs = sorted(path.parent for path in folder.glob(f"*/{METRICS}")) or runs
    for run in runs:
        require_finished(run)
    licence = {"weights": "licence", "data": "data_licence", "source": "source"}
    said = {field: given[key] for field, key in licence.items() if key in given}
    room, licence_of = late("report.zoo.publish"), late("report.zoo.card").Licence
    for run in runs:
        name = names[1].removeprefix(PREFIX) if len(names) == 2 else None
        try:
            said_of = room.publish(run, name, licence_of(**said), given.get("command"))
        except ValueError as error:
            if len(runs) == 1:
                raise
            said_of = f"not published ({error})"
        print(f"{said_of}  from {run}", flush=True)


def page(words: Sequence[str]) -> None:
    read(words, (), 0)
    print(late("report.zoo.publish").write_page())


def late(module: str) -> Any:
    """A module that loads PyTorch, which takes seconds: a mistyped word is reported before."""
    return importlib.import_module(module)


VERBS: dict[str, Callable[[Sequence[str]], None]] = {
    "list": show_list,
    "show": show_card,
    "verify": verify,
    "publish": publish,
    "page": page,
}


def cli(help_text: str | None) -> None:
    """What the command line runs: bad input ends in one line and exit status 1."""
    words = sys.argv[1:]
    if not words or {"-h", "--help"} & set(words):
        print_any_text()
        print(help_text)
        return
    with command_errors():
        if words[0] not in VERBS:
            raise ValueError(
                f"{words[0]}: expected {', '.join(VERBS)}{suggestion(words[0], VERBS)}"
            )
        print_any_text()
        VERBS[words[0]](words[1:])
