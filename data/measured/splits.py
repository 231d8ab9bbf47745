"""Which records train and which test: never a sample in both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from glob import escape

from data.measured.raw_record import RawRecord, between

LAST = 0.2  # of several records, one at least: what is tested on where nobody says


def tested_last(names: Sequence[str]) -> list[str]:
    """The last of some records, as patterns of their names."""
    return [escape(name) for name in names[-max(1, round(LAST * len(names))) :]]


def split_records(
    raws: dict[str, RawRecord],
    train: str | Sequence[str] | None,
    test: str | Sequence[str] | None,
    split: float,
) -> dict[str, dict[str, RawRecord]]:
    """Records of both splits by name, no sample in both. Raises ValueError for other choices.

    Where nothing is said, the last of several records are tested on, LAST of them.
    """
    names = list(raws)
    if train is None and test is None and len(raws) > 1:
        test = tested_last(names)
    if train is None and test is None:
        ((name, raw),) = raws.items()
        first, last = raw.span
        middle = first + split * (last - first)
        return {
            "train": {f"{name} (first part)": between(raw, 0.0, middle, closed=False)},
            "test": {f"{name} (rest)": replace(between(raw, middle, None), whole=False)},
        }
    chosen = {"train": _matching(names, train, "train"), "test": _matching(names, test, "test")}
    for split_, other in (("train", "test"), ("test", "train")):
        if (train if split_ == "train" else test) is None:
            chosen[split_] = [name for name in names if name not in chosen[other]]
    both = set(chosen["train"]) & set(chosen["test"])
    if both or not all(chosen.values()):
        raise ValueError(
            f"data.train={train} and data.test={test} put {', '.join(sorted(both)) or 'nothing'} "
            f"into {'both' if both else 'one of them'}; the records are {', '.join(names)}"
        )
    return {s: {name: raws[name] for name in chosen[s]} for s in chosen}


def held_back(
    raws: dict[str, RawRecord],
    calibration: str | Sequence[str] | None,
    named: Mapping[str, str | Sequence[str] | None],
) -> tuple[dict[str, RawRecord], dict[str, RawRecord]]:
    """The records that bands are made from, and all others. None: no records are held back.

    named: those that were asked for by name, by split. Raises ValueError for one that is both.
    """
    chosen = _matching(list(raws), calibration, "calibration")
    if len(chosen) == len(raws):
        raise ValueError(f"data.calibration={calibration} leaves no record to train on and to test")
    for split, patterns in named.items():
        if both := set(chosen) & set(_matching(list(raws), patterns, split)):
            raise ValueError(
                f"data.calibration={calibration} and data.{split}={patterns} share "
                f"{', '.join(sorted(both))}; a band needs records of its own"
            )
    return (
        {name: raws[name] for name in chosen},
        {name: raw for name, raw in raws.items() if name not in chosen},
    )


def _matching(names: Sequence[str], wanted: str | Sequence[str] | None, key: str) -> list[str]:
    patterns = [] if wanted is None else [wanted] if isinstance(wanted, str) else list(wanted)
    for pattern in patterns:
        if not any(fnmatch(name, pattern) for name in names):
            raise ValueError(f"data.{key}: no record is called {pattern}; {', '.join(names)} are")
    return [name for name in names if any(fnmatch(name, p) for p in patterns)]
