"""What an exported model is and how far to trust it: what it learned from, its errors, its range.

The same facts twice: as data, for metadata, and as lines of plain words, for comments.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from data.public.benchmarks import BENCHMARKS
from data.sample import Sensors
from export.names import plain_values, wrap
from models.experiment import Experiment
from models.fit.metrics import FREE_RUNS
from models.stored.schema import OTHER, SPECTRUM
from runner.config.compose import CONF
from runner.scores.result import ERROR

MOST_NAMED = 12  # channels of a kind that are named one by one in words


@dataclass(frozen=True)
class Passport:
    """Facts of an exported model, plain values alone, all text printable: JSON takes them."""

    facts: dict[str, Any]

    def __post_init__(self) -> None:
        object.__setattr__(self, "facts", plain_values(self.facts))

    def lines(self) -> list[str]:
        """The facts in words, some 90 characters a line at most."""
        f = self.facts
        return wrap([
            f"{f['model']} ({f['class']}), identified with {f['software']}, results "
            f"version {f['results']}, config {f['config']}",
            f"trained on: {trained_on_words(f['trained_on'])}",
            f"error: {_errors(f['error_percent'], f['quantity'])}",
            *_range_lines(f["trained_range"]),
            f"licence: of this code {f['licence']['code']}; of the data {f['licence']['data']}",
        ])  # fmt: skip


def passport_of(
    experiment: Experiment, metrics: Mapping[str, Any], sensors: Sensors, kind: str
) -> Passport:
    """The passport of a finished run from its choices and metrics. kind: the estimator's class."""
    identity = metrics.get("identity", {})
    return Passport(
        {
            "model": experiment.model.name,
            "class": kind,
            "software": software(),
            "results": identity.get("results", "unknown"),
            "config": identity.get("config", "unknown"),
            "dt_s": sensors.dt,
            "quantity": sensors.quantity,
            "trained_on": _data(experiment, sensors),
            "error_percent": {
                "free_run_test": _error(metrics, FREE_RUNS["test"]),
                "free_run_training": _error(metrics, FREE_RUNS["train"]),
                "one_step_test": _error(metrics, "test"),
                "one_step_training": _error(metrics, "train"),
            },
            "identified": metrics.get("verdict", {}).get("identified"),
            "trained_range": {
                kind: one
                for kind, one in metrics.get("trained_range", {}).items()
                if kind != SPECTRUM  # what is exported compares no motion with it
            },
            "licence": {"code": "MIT", "data": _licence(experiment)},
        }
    )


@cache
def software() -> str:
    """Name and version of the zoo: an export is of a clone, which need not be installed."""
    project = tomllib.loads((Path(CONF).parent / "pyproject.toml").read_text("utf-8"))["project"]
    return f"{project['name']} {project['version']}"


def _data(experiment: Experiment, sensors: Sensors) -> dict[str, Any]:
    """Names, numbers and lengths of the records, as far as the choices know them."""
    data = experiment.data.values
    facts: dict[str, Any] = {
        "system": experiment.system.name,
        "scenario": experiment.scenario.name,
        "seed": experiment.seed,
        "dt_s": sensors.dt,
        "records": data.get("train_records"),
        "duration_s": data.get("duration"),
        "files": [],
        "benchmark": data.get("benchmark"),
        "hold": hold_of(data),
    }
    if data.get("path") is not None:
        paths = [data["path"]] if isinstance(data["path"], str) else data["path"]
        facts["files"] = [Path(path).name for path in paths]
    named = data.get("train")
    if named is not None:
        facts["parts"] = [named] if isinstance(named, str) else named
    elif facts["files"] and data.get("split") is not None:
        facts["share"] = float(data["split"])
    return facts


def hold_of(data: Mapping[str, Any]) -> str:
    """Hold of the excitation between samples in training, which a config may leave to its data."""
    benchmark = data.get("benchmark")
    usual = BENCHMARKS[benchmark].hold if benchmark in BENCHMARKS else "linear"
    return str(data.get("hold") or usual)


def trained_on_words(facts: Mapping[str, Any]) -> str:
    """In words."""
    if facts["files"]:
        what = ", ".join(facts["files"])
        if "share" in facts:
            what += f", the first {100.0 * facts['share']:g} % of a single record"
    elif facts["benchmark"]:
        what = f"the public benchmark {facts['benchmark']}"
    else:
        count = facts["records"] or 1
        length = f" of {facts['duration_s']:g} s" if facts["duration_s"] else ""
        what = f"{count} simulated record{'s' * (count > 1)}{length} of {facts['system']}"
    what += f", {', '.join(map(str, facts['parts']))}" if "parts" in facts else ""
    return f"{what}; scenario {facts['scenario']}, dt {facts['dt_s']:g} s, seed {facts['seed']}"


def _error(metrics: Mapping[str, Any], split: str) -> float | None:
    return metrics.get(split, {}).get(ERROR)


def _errors(errors: Mapping[str, float | None], quantity: str) -> str:
    words = {
        "free_run_test": "of its free run on the test motion",
        "free_run_training": "in training",
        "one_step_test": "one step ahead on the test motion",
        "one_step_training": "in training",
    }
    known = [f"{errors[key]:.3g} % {words[key]}" for key in words if errors[key] is not None]
    return f"relative RMS of the {quantity}: {', '.join(known) or 'unknown'}"


def _range_lines(ranges: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if not ranges:
        return ["range of training: not stored by this run"]
    lines = ["largest in training (beyond it nobody measured what the model does):"]
    for kind, one in ranges.items():
        unit = f" {one['unit']}" if one.get("unit") else ""
        lows, largest = one.get("lowest") if kind == OTHER else None, one.get("largest", [])
        values = [f"{v:.3g}" for v in largest]
        if lows is not None:
            values = [f"{low:.3g} to {value}" for low, value in zip(lows, values, strict=False)]
        pairs = [f"{n} {v}" for n, v in zip(one.get("names", []), values, strict=False)]
        more = len(pairs) - MOST_NAMED
        if more > 0:
            most = max(largest[MOST_NAMED:])
            pairs = [*pairs[:MOST_NAMED], f"{more} more, {most:.3g} at most"]
        lines.append(f"  {kind}: {', '.join(pairs)}{unit}")
    return lines


def _licence(experiment: Experiment) -> str:
    if "train_records" in experiment.data.values:
        return "none is needed: they were simulated"
    return "as the owner of the records says"
