"""Files of every format, good, odd and damaged, inspected or trained on."""

from __future__ import annotations

import os
import random
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from benchmarks.attack.record_files.case import Case, escaped
from benchmarks.attack.record_files.drawn import drawn
from data.inspect.__main__ import main as inspect
from data.measured.files.table import read_table
from models.training.assemble import assembled
from runner.config.command_line import one_line_errors
from runner.config.compose import composed, prepare_hydra

NAMES = (
    *("record", "a b", "[red]x[/red]", "=cmd|'x'!A1", "-rf", "@x", "a\nb", "a\x1b[31mb", "\u202ex"),
    *("${oc.env:ATTACK_SECRET}", "2024", "null", "ünï", "x;touch executed", "$(touch executed)"),
    *("*", "[a]", "?", "measured", "%s%n", "'", '"', "a:b", "a,b", "{x}", "~", "\udcff", "x" * 200),
)
COLUMNS = (
    *("Load", "${acc}", "${oc.env:ATTACK_SECRET}", "\\${a}", "???", "a: b", "[x]", "null", "yes"),
    *("1e5", "=1+1", "$x_{$", "\x1b[31mred", "[red]r[/red]", "é", "'", "a,b", "#", "-", "~", "\\"),
    *("${oc.create:{_target_:os.system,command:'touch executed'}}", "x" * 300, "\u202eacc", "a\tb"),
)
SETTINGS: dict[str, tuple[Any, ...]] = {
    "dt": (0.01, 1e-300, 1e300, 0.0, -1.0, float("nan"), float("inf"), 5e-324, 1e-12),
    "start": (0.5, float("nan"), float("inf"), -5.0, 1e300, 1e-300),
    "stop": (1.0, float("nan"), float("inf"), -5.0, 1e300, 0.0),
    "split": (0.1, 0.999999, 1e-300, 0.5),
    "window": (2, 10, 0, -3, 10**9),
    "stride": (1, 0, -1, 10**12),
    "warmup": (3, -1, 10**9),
    "batch": (1, 4, 10**9),
    "validation": (0.2, 0.999999, 1e-300),
    "skip_rows": (1, 10**9, -1),
    "delimiter": (";", "\t", "'", "\x00", "é", "\ud800"),
    "decimal": (",", "x"),
    "header": (False,),
    "group": ("g", "/", "..", "g/../..", "x" * 10_000, "a\0b"),
    "quantity": ("displacement", "force", "velocity"),
    "initial_state": ("given", "periodic", "unknown", "unknown"),
    "hold": ("zero_order",),
    "train": ("record", "nothing*"),
    "align": ("start", "motion", "both", ""),
    "onset": (False,),
    "accelerations": ("relative", "absolute", "both"),
    "units": ({"a": "g"}, {"f": "kN"}, {"time": "ms"}, {"a": "9" * 30}, {"a": "(" * 30}),
}
MENDS: dict[str, tuple[Any, ...]] = {
    "resample": (50.0, 1e12, 1e-12, 1e300, 5e-324, float("nan"), 33.3),
    "fill": (0.05, 1e300, 1e-300, 1e9),
    "detrend": ("mean", "linear"),
    "low_pass": (10.0, 1e-300, 1e300, 49.999),
    "high_pass": (1.0, 1e-300),
    "order": (2, 20),
}


class Target:
    name = "records"

    def __init__(self) -> None:
        self.config: DictConfig | None = None

    def prepare(self, folder: Path) -> None:
        cfg = composed("data=measured", "model=linear", "data.path=record.csv")
        OmegaConf.save(cfg, folder / "train.yaml")

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        if self.config is None:
            prepare_hydra()
            loaded = OmegaConf.load(folder / "train.yaml")
            assert isinstance(loaded, DictConfig)
            self.config = loaded
        case = drawn(draw, COLUMNS)
        name = draw.choice(NAMES) if draw.random() < 0.3 else "record"
        place = Path(name + case.suffix)
        if draw.random() < 0.5:
            words = _words(draw, place, case)
            act, how = lambda: _inspected(place, case, words), f"inspect {words}"
        else:
            changes = _changes(draw, place, case)
            config = self.config
            act, how = lambda: _trained(config, place, case, changes), f"train {changes}"
        return Attempt(f"{case.what}; {how}"[:500], act)


def _words(draw: random.Random, place: Path, case: Case) -> list[str]:
    words = [str(place if draw.random() < 0.9 else draw.choice((Path("."), Path("*"))))]
    if case.mapped and draw.random() < 0.6:
        words += ["--channels", *(f"{channel}={column}" for channel, column in case.mapped.items())]
    for options in (
        *(["--picture"], ["--picture", "p.png"], ["--picture", "p.xyz"], ["--config"]),
        *(["--config", "c/x y.yaml"], ["--skip-rows", "1"], ["--decimal", ","], ["--no-header"]),
        *(["--delimiter", ";"], ["--group", "g"], ["--units", "a=g", "time=ms"]),
    ):
        if draw.random() < (0.05 if options[0] == "--picture" else 0.06):
            words += options
    return words


def _changes(draw: random.Random, place: Path, case: Case) -> dict[str, Any]:
    changes: dict[str, Any] = {"path": str(place)}
    if draw.random() < 0.05:
        changes["path"] = draw.choice((".", "*", "nothing*", "", "\0", "x" * 5000, "empty", "**"))
    if case.mapped:
        changes["channels"] = dict(case.mapped)
    if draw.random() < 0.3:
        for key in draw.sample(sorted(SETTINGS), draw.choice((1, 1, 2))):
            changes[key] = draw.choice(SETTINGS[key])
    if draw.random() < 0.25:
        key = draw.choice(sorted(MENDS))
        changes["mend"] = {key: draw.choice(MENDS[key])}
    if changes.get("initial_state") == "unknown" and draw.random() < 0.7:
        changes["warmup"] = draw.choice((0, 3, 20, 1000))
    return changes


def _write(place: Path, case: Case) -> None:
    os.mkdir("empty")
    try:
        case.write(place)
    except (UnicodeEncodeError, OSError):
        raise SystemExit("error: this name cannot be written here") from None


def _inspected(place: Path, case: Case, words: list[str]) -> None:
    _write(place, case)
    inspect(words)
    _check_table(place, case, words)
    configs = [path for path in Path.cwd().rglob("*.yaml") if path.parent.name == "data"]
    mapped = case.mapped if "--channels" in words else {}
    for path in configs:
        data: Any = OmegaConf.to_container(OmegaConf.load(path), resolve=True)
        found = data["data"]
        if found["path"] != str(place.resolve()) or (found.get("channels") or {}) != mapped:
            raise WronglyAcceptedError(f"the config says {found}")


def _check_table(place: Path, case: Case, words: list[str]) -> None:
    """Against what was written, where the file is good and was read without options."""
    if case.truth is None or any(word.startswith("--") for word in words):
        return
    _compare(dict(read_table(place).columns), case.truth)


def _compare(found: dict[str, np.ndarray], truth: dict[str, np.ndarray]) -> None:
    for name, values in truth.items():
        if name not in found or not np.array_equal(found[name], values, equal_nan=True):
            raise WronglyAcceptedError(f"{name!r} is {found.get(name)}, written was {values}")


def _trained(config: DictConfig, place: Path, case: Case, changes: dict[str, Any]) -> None:
    _write(place, case)
    escaped = {key: _escaped(value) for key, value in changes.items()}
    with one_line_errors("train"):
        cfg = OmegaConf.merge(config, {"data": escaped})
        assert isinstance(cfg, DictConfig)
        data, _, _ = assembled(cfg)
        data.setup()
    records = [record for split in ("train", "test") for record in data.records[split]]
    for record in records:
        record.require_finite()
    if case.truth is not None and set(changes) <= {"path", "channels"}:
        columns = case.mapped or {name: name for name in ("f1", "a1")}
        driven = columns.get("a1") in case.truth and columns.get("f1") in case.truth
        for letter in "fa" if driven else "":
            joined = np.concatenate([np.asarray(getattr(r, letter)[:, 0]) for r in records])
            _compare({letter: joined}, {letter: case.truth[columns[f"{letter}1"]]})


def _escaped(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _escaped(inner) for key, inner in value.items()}
    return escaped(value) if isinstance(value, str) else value
