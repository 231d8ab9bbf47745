"""A run's config as an entry keeps it: without folders of a machine; and the command it is of."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from data.plain_data import as_config
from runner.config.choices import dotted, plain
from runner.config.compose import CONF, composed
from runner.config.identity import INERT, with_class_of_laws

RECORDS = "RECORDS"  # stands for the folder that holds the folders of measured records
ABSOLUTE = re.compile(r"""(?:^|[\s"'=:(,\[])(~?/[\w.-]+/|[A-Za-z]:\\|\.\./)""")
NO_NUMBER = (*INERT, "records", "threads")  # settings that a command need not say
TRIED = ("baselines", "solver", "objective", "scenario", "excitation", "damage")


def without_folders(values: Any, folders: Mapping[str, str]) -> Any:
    """The same with each of these folders replaced. Raises ValueError for a remaining path."""
    if isinstance(values, dict):
        return {key: without_folders(value, folders) for key, value in values.items()}
    if isinstance(values, list):
        return [without_folders(value, folders) for value in values]
    if isinstance(values, str):
        for folder, word in folders.items():
            values = values.replace(folder, word)
        if ABSOLUTE.search(values):
            raise ValueError(f"{values!r} names a folder of this machine; say records=FOLDER")
    return values


def folders_of(cfg: DictConfig) -> dict[str, str]:
    """{folder: word} of a run's records: RECORDS/name of the folder that held them."""
    named = [cfg.get("records"), cfg.data.get("folder")]
    return {str(one): f"{RECORDS}/{Path(one).name}" for one in named if one}


def entry_config(cfg: DictConfig) -> dict[str, Any]:
    """Values of config.yaml without folders and without what only a terminal sees."""
    values = plain(cfg)
    values |= {"figures": False, "grid": None}
    values["model"].get("about", {}).pop("told", None)  # which conf/model has, and the card
    scrubbed: dict[str, Any] = without_folders(values, folders_of(cfg))
    return scrubbed


def with_records(values: Mapping[str, Any], records: Path) -> DictConfig:
    """An entry's config with its records where they are."""

    def placed(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: placed(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [placed(inner) for inner in value]
        return value.replace(RECORDS, str(records)) if isinstance(value, str) else value

    return as_config(placed(values))


def command_of(values: Mapping[str, Any]) -> str:
    """The command of train.py that gives these values.

    Raises ValueError where no choices of conf/ and settings do.
    """
    words = [f"model={values['model']['name']}", f"system={values['system']['name']}"]
    for group in TRIED:
        if any(key.startswith(f"{group}.") for key in _differing(words, values)):
            words = min(
                _with_choice(words, group), key=lambda tried: len(_differing(tried, values))
            )
    wanted = dotted(values)
    for key in _differing(words, values):
        if key not in wanted:
            raise ValueError(f"no command gives this config: {key} is not in it; say command=…")
        words.append(f"{key}={_typed(wanted[key])}")
    return " ".join(["python train.py", *words])


def require_command(command: str, values: Mapping[str, Any]) -> None:
    """Raise ValueError unless a command of train.py gives these values."""
    words = [word.strip("'\"") for word in command.removeprefix("python train.py ").split()]
    if left := _differing(words, values):
        raise ValueError(f"{command} gives other values of {', '.join(left[:5])}")


def _with_choice(words: list[str], group: str) -> Iterator[list[str]]:
    yield words
    for path in sorted((CONF / group).glob("*.yaml")):
        yield [*words, f"{group}={path.stem}"]


def _differing(words: list[str], values: Mapping[str, Any]) -> list[str]:
    """Dotted settings in which a command and these values differ, of those that change a number."""
    try:
        own, wanted = (
            dotted({**of, "model": with_class_of_laws(of["model"])})
            for of in (plain(composed(*words)), values)
        )
    except Exception:  # a choice that asks for more than stands there
        return ["?"] * 1000
    keys = dict.fromkeys([*wanted, *own])
    return [
        key
        for key in keys
        if key.partition(".")[0] not in (*NO_NUMBER, "trainer")
        and own.get(key) != wanted.get(key)  # null where older code had no such setting
    ]


def _typed(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ",".join(_typed(one) for one in value) + "]"
    return (
        "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    )
