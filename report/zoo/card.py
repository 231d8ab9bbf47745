"""The card of a published model, from its run's files alone: inputs, outputs, errors, failures.

Front matter as huggingface_hub.ModelCard reads it, then Markdown.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import yaml

from data.datamodule import Data
from data.record import QUANTITIES, Record, stack
from data.sample import Sensors
from data.simulation.datamodule import SimulatedData
from data.simulation.motion import EscapedMotionError
from export.passport import passport_of, software, trained_on_words
from models.estimator import Estimator
from models.experiment import Experiment
from models.fit.metrics import FREE_RUNS, free_run_score, score
from models.fit.trained_range import warnings_of
from models.stored.schema import OTHER, SPECTRUM
from report.about import prior_knowledge
from report.output import markdown
from runner.scores.result import ERROR
from runner.scores.spread import DIVERGED, Spread

POOR = 20.0  # % in free run
FILES = "docs/zoo.md"  # where a card's numbers come from
IDENTIFIERS = {"MIT": "mit", "BSD-2-Clause": "bsd-2-clause", "CC-BY-SA-4.0": "cc-by-sa-4.0"}


@dataclass(frozen=True)
class Card:
    """Everything that a card says of one entry."""

    name: str
    experiment: Experiment
    metrics: Mapping[str, Any]
    sensors: Sensors
    kind: str  # class of the model
    licence: Licence
    command: str
    record: Record  # of the test motion

    def text(self) -> str:
        parts = (
            self._front(), self._head(), self._use(), self._signals(), self._envelope(),
            self._errors(), self._failures(), self._origin(), self._licences(),
        )  # fmt: skip
        return "\n\n".join(part.strip() for part in parts) + "\n"

    @property
    def _knowledge(self) -> str:
        return " ".join(prior_knowledge(self.experiment.model.name).split())

    @property
    def _quantity(self) -> str:
        return str(self.metrics["quantity"])

    @property
    def _source(self) -> str:
        if not self._rows:
            return f"python -m models.zoo verify {self.name} records=FOLDER"
        return f"python evaluate.py run=zoo:{self.name} seeds=[{','.join(map(str, SEEDS))}]"

    @property
    def _rows(self) -> Sequence[Mapping[str, Any]]:
        return tuple(self.metrics.get("over_seeds", ()))

    def _front(self) -> str:
        measured = [
            {"type": kind, "name": words, "value": round(value, 6)}
            for kind, words, value in self._numbers()
        ]
        model, _, system = self.name.partition("/")
        content = {
            "license": IDENTIFIERS.get(self.licence.weights, "other"),
            "library_name": "pytorch",
            "tags": ["structural-dynamics", "system-identification", "nonlinear", model],
            "model-index": [
                {
                    "name": self.name,
                    "results": [
                        {
                            "task": {"type": "time-series-forecasting", "name": "simulation"},
                            "dataset": {"type": system.rpartition(".v")[0], "name": self._data()},
                            "metrics": measured,
                            "source": {"name": self._source, "url": FILES},
                        }
                    ],
                }
            ],
        }
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=200)
        return f"---\n{text}---"

    def _numbers(self) -> Iterator[tuple[str, str, float]]:
        """(type, words, percent) of every error that is a number."""
        free = self.metrics[FREE_RUNS["test"]].get(ERROR)
        if free is not None:
            yield "relative-rms-percent-free-run", "free run on the test motion, %", free
        spread = self._spread("free_run_percent")
        if spread is not None and (median := spread.median) is not None and math.isfinite(median):
            words = f"free run, median of {len(spread.values)} test motions, %"
            yield "relative-rms-percent-free-run-median", words, median
        one = self.metrics["test"][ERROR]
        if one is not None:
            yield "relative-rms-percent-one-step", "one step ahead on the test motion, %", one

    def _spread(self, key: str) -> Spread | None:
        rows = [row for row in self._rows if "escaped" not in row]
        if not rows or (any("no_free_run" in row for row in rows) and key == "free_run_percent"):
            return None
        values = (math.inf if row[key] is None else float(row[key]) for row in rows)
        return Spread(tuple(values), escaped=len(self._rows) - len(rows))

    def _head(self) -> str:
        remark = "" if self._rows else " (true laws are those of simulated structures)"
        known = f"\n\nKnown beforehand{remark}: {self._knowledge}." if self._knowledge else ""
        return (
            f"# {self.name}\n\n`{self.kind}` identified on {self._data()}.{known}\n\n"
            "![measured motion and the model's own](picture.svg)"
        )

    def _data(self) -> str:
        system = self.experiment.system.name
        if self._rows:
            return f"the structure {system} of this project"
        return f"{system}, measured ({self.licence.source})"

    def _use(self) -> str:
        n, m = self.sensors.dofs, self.sensors.inputs
        motion = "excitation.seed=5" if self._rows else "excitation.path=motion.csv"
        return f"""## Use it

```python
import torch
from data import Drive
from models.zoo import load_pretrained

pretrained = load_pretrained("{self.name}")
u, rest = torch.zeros(1000, {m}), torch.zeros({n})
drive = Drive({self.sensors.dt!r}, u, rest, rest, hold="{self.record.hold}")
pretrained.inside(drive)  # warns outside the envelope below
motion = pretrained.model.free_run(drive)  # .x .v .a  (1000, {n})
```

Or in place of a run's folder: `python predict.py run=zoo:{self.name} {motion}`."""

    def _signals(self) -> str:
        unit = QUANTITIES[self._quantity][1]
        trained = self.metrics["trained_range"].get("excitation", {})
        names = trained.get("names") or [f"u{i + 1}" for i in range(self.sensors.inputs)]
        base = self.sensors.forced == "base"
        rows = [
            (f"u[:, {i}]", "−s̈ of the base" if base else name, self.sensors.unit_of(name) or "–")
            for i, name in enumerate(names)
        ]
        n, numbers = self.sensors.dofs, self.sensors.numbers
        dofs = f"x1 … x{n}" if numbers[-1] == n > 1 else ", ".join(f"x{i}" for i in numbers)
        rows.append((f"a (T, {self.sensors.dofs})", f"{self._quantity} of {dofs}", unit))
        if self._quantity == "acceleration":
            rows += [("x, v", "displacement and velocity, nil where the model has none", "m, m/s")]
        dt, held = self.sensors.dt, self.record.hold.replace("_", "-")
        return (
            "## Signals\n\n"
            + markdown(("signal", "what", "unit"), rows, None)
            + f"\n\nSampled every {dt:.9g} s ({1 / dt:.6g} Hz), float64; between samples the "
            f"excitation is {held}. Initial state in training: {self.record.initial_state}. "
            f"{self._placed()}"
        )

    def _placed(self) -> str:
        forced = self.sensors.forced
        if forced == "base":
            return "The base shakes: u is −s̈ of the ground, the same for all DOFs."
        if isinstance(forced, list) and forced:
            return f"Forces act on DOFs {', '.join(map(str, forced))}."
        return ""

    def _envelope(self) -> str:
        rows = []
        for kind, one in self.metrics["trained_range"].items():
            if kind == SPECTRUM:  # of many periods; the excitation is its limit at short ones
                continue
            pairs = zip(one["names"], one["largest"], strict=False)
            lows = one.get("lowest") if kind == OTHER else None
            values = [f"{name} {value:.3g}" for name, value in pairs]
            if lows:
                values = [f"{v} (from {low:.3g})" for v, low in zip(values, lows, strict=True)]
            own = [one["unit"] or self.sensors.unit_of(name) or "–" for name in one["names"]]
            rows.append((kind, ", ".join(values), ", ".join(dict.fromkeys(own))))
        return (
            "## Training envelope\n\nThe largest that it has seen, of each element where it has "
            "elements; beyond, nobody measured what the weights do.\n\n"
            + markdown(("what", "largest", "unit"), rows, None)
        )

    def _errors(self) -> str:
        free, one = self.metrics[FREE_RUNS["test"]], self.metrics["test"]
        rows = [
            ("free run, its own test motion", _percent(free)),
            ("one step ahead, the same motion", _percent(one)),
        ]
        if free.get("displacement_percent") is not None:
            rows.append(("displacement in free run", f"{free['displacement_percent']:.4g}"))
        spread = self._spread("free_run_percent")
        if spread is not None:
            words = f"free run, test motions of seeds {', '.join(map(str, SEEDS))}: median (range)"
            rows.append((words, f"{spread.text(_short)}; motions: {spread.counts()}"))
        return (
            f"## How well\n\nRelative RMS error of the {self._quantity} [%] on motions that it was "
            f"not trained on.\n\n"
            + markdown(("on", "error"), rows, None)
            + f"\n\nWeights of one training, seed {self.experiment.seed}. Held "
            f"against these numbers by `python -m models.zoo verify`; scored by `{self._source}`."
        )

    def _failures(self) -> str:
        lines = list(map(_as_text, self._known_failures()))
        lines.append(
            "Outside the envelope above, and on any other structure: nobody measured it. "
            "`inside(drive)` and predict.py say when a motion leaves it."
        )
        return "## Where it fails\n\n" + "\n".join(f"- {line}" for line in lines)

    def _known_failures(self) -> Iterator[str]:
        free, own = self.metrics[FREE_RUNS["test"]], self.metrics[FREE_RUNS["train"]]
        if "no_free_run" in free:
            yield f"It cannot simulate ({free['no_free_run']}): it estimates one step ahead alone."
        for where, percent in (("test", free), ("training", own)):
            if percent.get("diverged_after_s"):
                yield (
                    f"Its free run of the {where} motion diverges after "
                    f"{min(percent['diverged_after_s']):.3g} s: it is a model one step ahead, fed "
                    "with measured motion."
                )
        lost = [str(row["seed"]) for row in self._rows if row.get("free_run_percent", 0) is None]
        if lost and not free.get("diverged_after_s"):
            yield f"Its free run diverges on the test motions of seeds {', '.join(lost)}."
        error = free.get(ERROR)
        if error is not None and error > POOR:
            yield (
                f"Its free run of the test motion errs by {error:.3g} %: a bar for others, no "
                "simulator to rely on."
            )
        for line in warnings_of(self.metrics.get("outside_trained_range", ())):
            yield f"Its own test motion lies {line}."

    def _origin(self) -> str:
        facts = passport_of(self.experiment, self.metrics, self.sensors, self.kind).facts
        versions = self.metrics.get("versions", {})
        libraries = ", ".join(f"{name} {version}" for name, version in versions.items())
        way = self.metrics.get("training", {})
        solver = (
            f"{way['solver']}, {way['iterations']} iterations" if way.get("solver") else
            "closed form"
        )  # fmt: skip
        words = (
            f"Trained on {trained_on_words(facts['trained_on'])}: "
            f"{self.metrics['parameters']} parameters; {solver}, "
            f"{self.metrics['fit_seconds']:.3g} s. {software()}, results version "
            f"{facts['results']}, config {facts['config']}; {libraries}."
        )
        return f"## Made by\n\n```sh\n{self.command}\n```\n\n{_as_text(words)}"

    def _licences(self) -> str:
        source = f" ({self.licence.source})" if self.licence.source else ""
        return (
            f"## Licence\n\n- weights: {self.licence.weights}\n"
            f"- data that they were trained on: {self.licence.data}{source}\n- code: MIT"
        )


def _percent(scores: Mapping[str, Any]) -> str:
    if "no_free_run" in scores:
        return "it cannot simulate"
    return DIVERGED if scores[ERROR] is None else f"{scores[ERROR]:.4g}"


def _as_text(text: str) -> str:
    """Words of a run or a file, of which Markdown makes no HTML, no link and no code."""
    return re.sub(r"[<\[`]", r"\\\g<0>", text)


def _short(value: float) -> str:
    return f"{value:.3g}"


# Errors of a published model on its own test motion, and on motions of other seeds.

SEEDS = (0, 1, 2, 3, 4)  # of a card's test motions


def over_seeds(estimator: Estimator, run: Experiment) -> list[dict[str, Any]]:
    """For each seed: errors [%] of the free run and one step ahead, None where it diverges.

    Or why there is none: the structure's own motion escaped, or the model cannot simulate.
    """
    rows: list[dict[str, Any]] = []
    for seed in SEEDS:
        data = replace(run, seed=seed).make_simulated_data()
        try:
            records, _ = data.simulation.records("test", 1, seed, data.train_records)
        except EscapedMotionError as error:
            rows.append({"seed": seed, "escaped": str(error)})
            continue
        motions = [stack(records)]
        percent = free_run_score(estimator, motions)
        row = {"seed": seed, "one_step_percent": score(estimator, motions)[ERROR]}
        row |= {"no_free_run": percent["no_free_run"]} if "no_free_run" in percent else {}
        rows.append(row | {"free_run_percent": percent.get(ERROR)})
    return rows


def tested(run: Experiment) -> Data:
    """The data of a run with its test records; of a simulated structure no others are made."""
    data = run.make_data()
    if isinstance(data, SimulatedData):
        records, _ = data.simulation.records(
            "test", data.test_records, run.seed, data.train_records
        )
        data.records = {"test": records}
    else:
        data.setup()
    return data


@dataclass(frozen=True)
class Licence:
    """Of weights and of the data that they were trained on, apart."""

    weights: str = "MIT"
    data: str = "none is needed: simulated"
    source: str = ""  # of the data
