"""The command line of a live run: its source of samples, and the choices of its model."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from data.arguments import Pairs
from models.choice import overlay
from models.stored.folder import read_values_of_run
from runner.config.choices import plain
from runner.config.compose import composed
from runner.folder.run_folder import run_folder

RECORDED = ("simulation", "test")
GROUPS = ("adaptation", "damage")  # choices that may differ from a finished run's,
KEYS = ("data", "seed")  # and settings


def add_source(parser: argparse.ArgumentParser) -> None:
    """Add the options that name a source of samples, and settings of the config."""
    parser.add_argument(
        "words",
        nargs="*",
        metavar="SOURCE | key=value",
        help="simulation, test (record of the run), - (standard input); settings as of train.py",
    )
    parser.add_argument(
        "--run",
        metavar="FOLDER",
        help="a finished run, or zoo:MODEL/SYSTEM; else an untrained model",
    )
    parser.add_argument("--replay", metavar="PATH", help="a record, as data=measured reads it")
    parser.add_argument("--speed", type=float, default=1.0, help="of records; inf does not wait")


def add_lines(parser: argparse.ArgumentParser) -> None:
    """Add the options of lines of text."""
    parser.add_argument("--listen", type=int, metavar="PORT", help="a socket on 127.0.0.1")
    parser.add_argument("--rate", type=float, metavar="HZ", help="of the lines; else the run's")
    parser.add_argument("--channels", nargs="+", action=Pairs, default={}, metavar="a1=COLUMN")
    parser.add_argument("--units", nargs="+", action=Pairs, default={}, metavar="a=g")


def split_words(args: argparse.Namespace) -> tuple[str, list[str]]:
    """The name of the source, and the settings. Raises ValueError unless one source is named."""
    named = [word for word in args.words if "=" not in word]
    if args.replay is not None:
        named.append("replay")
    if getattr(args, "listen", None) is not None:
        named.append("listen")
    known = (*RECORDED, "-", "replay", "listen")
    if len(named) != 1 or named[0] not in known:
        raise ValueError(
            f"{', '.join(named) or 'no source'} was given; expected one of simulation, test, - "
            "(standard input), --replay PATH, --listen PORT"
        )
    return named[0], [word for word in args.words if "=" in word]


def choices_of(kind: str, args: argparse.Namespace, settings: Sequence[str]) -> dict[str, Any]:
    """The choices of the finished run, or of a model that begins from nothing.

    Raises ValueError, OSError for a folder or a record that is not there.
    """
    pattern = args.replay is None or set(args.replay) & set("*?[")
    if not pattern and not Path(args.replay).exists():
        raise ValueError(f"--replay {args.replay}: there is no such file or folder")
    if args.run is None:
        return fresh_choices(settings, kind == "replay")
    return choices_of_run(run_folder(args.run), settings)


def fresh_choices(words: Sequence[str], replayed: bool) -> dict[str, Any]:
    """The choices of a model that begins from nothing, as train.py would compose it."""
    named = {word.partition("=")[0] for word in words}
    first = [] if "model" in named else ["model=online_vwnn"]
    if replayed and not named & {"data", "experiment"}:
        first.append("data=measured")
    return plain(composed(*first, *words))


def choices_of_run(folder: Path, words: Sequence[str]) -> dict[str, Any]:
    """A finished run's choices, with the law, damage, data or seed that the words name.

    Raises ValueError for other words: a run brings its model along.
    """
    choices, _ = read_values_of_run(folder)
    chosen = {word.partition("=")[0] for word in words} & set(GROUPS)
    for group in chosen:
        choices[group] = plain(composed(*(w for w in words if _head(w) == group)))[group]
    keys = [word for word in words if _head(word) in {*KEYS, *GROUPS} - chosen]
    other = [word for word in words if _head(word) not in (*GROUPS, *KEYS)]
    if other:
        raise ValueError(
            f"{other[0]}: the model is that of --run, which allows only "
            f"{', '.join(f'{name}=' for name in GROUPS)} seed= and data.…="
        )
    return overlay(choices, plain(OmegaConf.from_dotlist(keys)))


def _head(word: str) -> str:
    return word.partition("=")[0].partition(".")[0]
