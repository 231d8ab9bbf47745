"""What the settings outside of the choices must be: held against types and ranges before any work.

Settings inside a choice, such as model.cutoff, are checked in models/choice.py.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from omegaconf import DictConfig, OmegaConf

from data.annotations import Fraction, NotNegative, Positive, Range, Whole, fits, require, shown
from data.plain_data import MISSING
from models.stored.schema import LARGEST_SEED, MOST_THREADS

Group = Mapping[str, Any]
TEXTS = str | list[str] | None


@dataclass(frozen=True)
class Setting:
    """Type and range of a value, and the range in words."""

    annotation: Any
    inside: Callable[[Any], bool] = lambda value: True
    words: str = ""
    endless: bool = False  # infinity is a value

    def check(self, key: str, value: Any) -> None:
        """Raise ValueError, naming `key`, for a value of another type or out of range."""
        require(key, value, self.annotation, "see --help")
        numbers = value if isinstance(value, list) else [value]
        if not self.endless and any(isinstance(n, float) and math.isinf(n) for n in numbers):
            raise ValueError(f"{key}={shown(value)} must be finite; see --help")
        if not self.inside(value):
            raise ValueError(f"{key}={shown(value)} must be {self.words}")


def _is_name(value: str) -> bool:
    return 0 < len(value) <= 100 and not set(value) & set("/\\\n\t") and value.strip(". ") == value


NAME = Setting(str, _is_name, "a name: text that can be part of a folder's name, without / or \\")
THREADS = Setting(
    int | None, lambda n: n is None or 1 <= n <= MOST_THREADS, f"1 to {MOST_THREADS}, or null"
)
SEED = Setting(int, lambda n: 0 <= n <= LARGEST_SEED, f"between 0 and {LARGEST_SEED}")
BUDGET = re.compile(r"(\d+(?:\.\d*)?) *(s|min|h|)")
UNITS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


def seconds_of(budget: str | float | None) -> float | None:
    """A budget in seconds: 90, "90s", "10min", "2h"; None without one."""
    found = None if budget is None else BUDGET.fullmatch(str(budget).strip())
    return float(found[1]) * UNITS[found[2]] if found else None


TRAIN = {
    **dict.fromkeys(("system", "scenario", "data", "model", "solver", "objective"), Setting(Group)),
    **dict.fromkeys(("adaptation", "baselines", "trainer"), Setting(Group)),
    **dict.fromkeys(("excitation", "damage", "logger"), Setting(Group | None)),
    "threads": THREADS,
    "figures": Setting(bool),
    "checkpoint_seconds": Setting(float, lambda s: s >= 0.0, "0 or more, inf to save none", True),
    "budget": Setting(
        str | float | int | None,
        lambda b: b is None or (seconds_of(b) or 0.0) > 0.0,
        "a time, such as 90s, 10min or 2h, or null",
    ),
    "max_fail": Setting(int, lambda n: n >= 1, "1 or more"),
    "grid": Setting(str | None),
    "start": Setting(str | None),
    "records": Setting(str | None),  # of experiments on measured records: their folder
    "seed": SEED,
}

# What evaluate.py and predict.py are asked: settings of conf/evaluate.yaml and conf/predict.yaml.


@dataclass(frozen=True)
class Conditions:
    """Under which a run is scored again; None and {}: as it was trained.

    seeds: of test motions; data: settings of the records.
    """

    seeds: list[int] | None
    data: Mapping[str, Any]
    figures: bool
    scenario: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Question:
    """How sure is a run? uncertainty: laplace, profile or smc; others as in conf/evaluate.yaml."""

    uncertainty: Literal["laplace", "profile", "smc"] | None
    parameter: str | list[str] | None
    priors: Mapping[str, Any]
    particles: Annotated[int, Range(50, 100_000)]
    begin: Literal["fit", "prior"]
    seed: int
    threads: int | None

    @property
    def names(self) -> list[str]:
        """Of the parameters that are asked for."""
        return [self.parameter] if isinstance(self.parameter, str) else list(self.parameter or [])


@dataclass(frozen=True)
class Written:
    """What is written, and whether of any model: settings of conf/predict.yaml."""

    figures: bool = True
    histories: bool | None = None
    threads: int | None = None
    anyway: bool = False
    samples: Annotated[int, Range(2, 10_000)] | None = None  # draws of the parameters
    seed: int = 0
    limits: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Wanted:
    """The motions that a command asks for: `excitation` of conf/predict.yaml, which has words."""

    path: str | list[str] | None
    events: str | int | list[str | int] | None
    kind: str | None
    std: Positive | None
    band: list[float] | None
    seed: int
    duration: Positive | None  # [s]
    scale: float | list[float]
    peak: Positive | None  # [g]
    lag: Fraction  # [s]
    quiet: Annotated[float, Range(0.0, 1e5)] | None  # [s]
    hold: str | None
    channels: Mapping[str, Any] | None
    units: Mapping[str, Any]
    dt: Positive | None  # [s]
    start: NotNegative | None  # [s]
    stop: float | None  # [s]
    align: str | None
    skip_rows: Whole | None
    delimiter: str | None
    decimal: str | None
    group: str | None
    header: bool | None
    mend: Mapping[str, Any] | None
    delay: Mapping[str, Any] | None = None  # [s]

    @property
    def label(self) -> str:
        """Name of a folder for it: "quake,scale=2" for excitation.path=dir/quake.csv."""
        given = self.path if self.path is not None else self.events
        if given is None:
            duration = "" if self.duration is None else f",duration={self.duration:g}"
            words = f"{self.kind or 'as_in_training'},seed={self.seed}{duration}"
        else:
            names = [str(g) for g in ([given] if isinstance(given, str | int) else given)]
            words = "+".join(Path(name).stem.replace("*", "all") for name in names)
        for key, usual in (("scale", 1.0), ("peak", None), ("start", None), ("stop", None)):
            if getattr(self, key) != usual:
                words += f",{key}={getattr(self, key)}"
        return re.sub(r"[^\w.,+=\[\]-]", "", words)[:80]


def settings_of(kind: type, **own: Setting) -> dict[str, Setting]:
    """A setting for each field of a class, as its annotation says, but for those given."""
    hints = get_type_hints(kind, include_extras=True)
    return {one.name: Setting(hints[one.name]) for one in fields(kind)} | own


SEEDS = Setting(list[int] | None, lambda seeds: seeds != [], "null, or a list such as [5,6]")
FILES = Setting(TEXTS, lambda p: p != [], "null, or files")
EVENTS = Setting(str | int | list[str | int] | None, lambda e: e != [], "null, or events")
EVALUATE = {
    **settings_of(Conditions, seeds=SEEDS),
    **settings_of(Question, seed=SEED, threads=THREADS),
    **dict.fromkeys(("label", "output", "run"), Setting(str | None)),
    **dict.fromkeys(("metric", "split"), Setting(str)),
    **dict.fromkeys(("runs", "by"), Setting(TEXTS)),
    "change": Setting(bool),
    "page": Setting(Literal["html"] | None),
}
PREDICT = {
    **settings_of(Written, seed=SEED, threads=THREADS),
    **dict.fromkeys(("run", "output"), Setting(str | None)),
    "excitation": Setting(Group),
}
EXCITATION = settings_of(Wanted, path=FILES, events=EVENTS, seed=SEED)
MENDING = {
    **dict.fromkeys(("resample", "fill", "low_pass", "high_pass", "order"), Setting(float | None)),
    "detrend": Setting(str | None),
}
TRAINER = {
    "accelerator": Setting(Literal["cpu", "gpu", "cuda", "auto"]),
    "devices": Setting(
        int | list[int] | Literal["auto"],
        lambda d: d in (1, "auto") or (isinstance(d, list) and len(d) == 1 and d[0] >= 0),
        "1, or a list of one device; more runs at once: -m and hydra/launcher=joblib",
    ),
    "max_epochs": Setting(
        int, lambda n: n == -1 or n >= 1, "-1 (the solver says when) or 1 or more"
    ),
    "num_sanity_val_steps": Setting(int, lambda n: n >= 0, "0 or more"),
    "log_every_n_steps": Setting(int, lambda n: n >= 1, "1 or more"),
    "enable_progress_bar": Setting(bool),
    "detect_anomaly": Setting(bool),
    "deterministic": Setting(bool),
    "profiler": Setting(Literal["simple"] | None),
}
LOGGER = {
    "name": Setting(Literal["tensorboard", "csv", "mlflow", "wandb", "none"]),
    **dict.fromkeys(("experiment", "project"), Setting(str)),
    "uri": Setting(str | None),
    "mode": Setting(Literal["offline", "online", "disabled"]),
}
NAMED = ("system", "scenario", "model")  # choices whose names stand in the run's folder


def check_settings(cfg: DictConfig, settings: Mapping[str, Setting] = TRAIN) -> None:
    """Raise ValueError, naming the key, for a setting that is unknown or cannot be used."""
    values = OmegaConf.to_container(cfg, resolve=True)
    _check(values, settings, "")
    if isinstance(values, dict) and "path" in (data := values.get("data") or {}):
        FILES.check("data.path", data["path"])
    if settings is TRAIN:
        _check(OmegaConf.to_container(cfg.trainer, resolve=True), TRAINER, "trainer.")
        _check(OmegaConf.to_container(cfg.logger or {}, resolve=True), LOGGER, "logger.")
        for key in NAMED:
            if "name" not in cfg[key]:
                raise ValueError(f"{key} lacks a name; choose one of conf/{key}, see --help")
            NAME.check(f"{key}.name", cfg[key].name)
        for name, model in cfg.baselines.items():
            Setting(Group).check(f"baselines.{name}", OmegaConf.to_container(model))


def check_excitation(excitation: DictConfig) -> None:
    """Raise ValueError, naming the key, for a motion of a prediction that cannot be used."""
    _check(OmegaConf.to_container(excitation, resolve=True), EXCITATION, "excitation.")
    _check(excitation.mend or {}, MENDING, "excitation.mend.")
    check_files(OmegaConf.create({"excitation": excitation}))


def _check(values: Any, settings: Mapping[str, Setting], prefix: str) -> None:
    for key, value in values.items():
        if key not in settings:
            near = difflib.get_close_matches(str(key), settings, n=1)
            known = ", ".join(settings)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"there are {known}"
            raise ValueError(f"there is no setting {prefix}{shown(key)}; {hint}")
        settings[key].check(f"{prefix}{key}", value)
    for key in settings.keys() - values.keys() if settings not in (TRAINER, LOGGER) else ():
        if not fits(None, settings[key].annotation):
            raise ValueError(f"the config lacks {key}; see --help")


def check_files(cfg: DictConfig) -> None:
    """Raise ValueError where a record or a table of forces that the config names is not there."""
    for key, path in _paths(OmegaConf.to_container(cfg, resolve=True), ""):
        if not set(path) & set("*?[") and path != MISSING and not Path(path).exists():
            raise ValueError(
                f"{key}={shown(path)}: there is no such file or folder (seen from {Path.cwd()})"
            )


def _paths(node: Any, key: str) -> Iterator[tuple[str, str]]:
    """(key, path) of every file that a config names as such."""
    if isinstance(node, dict):
        for name, value in node.items():
            yield from _paths(value, f"{key}.{name}".lstrip("."))
    elif key.endswith(".path"):
        paths = node if isinstance(node, list) else [node]
        yield from ((key, path) for path in paths if isinstance(path, str))
