"""A finished run as it leaves the house: its model, its name, its passport."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from data.sample import Sensors
from export.names import GROUND, channels_of, identifier, inputs_of, plain_unit, wrap
from export.passport import Passport, passport_of
from models.estimator import Estimator
from models.stored.run import read_run
from models.stored.schema import PERCENT, require
from runner.folder.run import restore
from runner.folder.run_folder import require_finished
from runner.scores.verdict import divergence

INTERVAL = {"name": str, "status": str, "half": PERCENT, "believed": PERCENT}
UNCERTAINTY = {"parameters": [INTERVAL]}


@dataclass(frozen=True)
class Exported:
    """An identified model, and what its files are called and say of it."""

    estimator: Estimator
    name: str  # a word that every language takes for the name of a function or a file
    passport: Passport
    sensors: Sensors
    config: Mapping[str, Any]  # the model's settings
    hold: str = "linear"  # of the excitation in training
    intervals: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # by parameter
    absolute: bool = False  # accelerations beside the ground's were measured so

    @cached_property
    def _channels(self) -> tuple[list[tuple[str, str]], list[str]]:
        names = self.passport.facts["trained_range"].get("excitation", {}).get("names")
        if not names or len(names) != self.estimator.inputs:
            names = [name for name, _ in inputs_of(self.estimator)]
        if self.ground:
            names = [GROUND, *names[1:]]
        units = ["m/s²" if name == GROUND else self.sensors.unit_of(name) for name in names]
        return channels_of(names, units)

    @property
    def ground(self) -> bool:
        """Whether the acceleration of the ground drives the model, which reads f1 = −s̈."""
        return self.sensors.forced == "base"

    @property
    def inputs(self) -> list[tuple[str, str]]:
        """Name, an identifier, and unit of each channel of excitation."""
        return self._channels[0]

    @property
    def plain_inputs(self) -> list[tuple[str, str]]:
        """The same with units of plain letters, for files that programs read."""
        return [(name, plain_unit(unit)) for name, unit in self.inputs]

    def lines(self) -> list[str]:
        """What every file says of the model: its passport, and how the run names its channels."""
        return [*self._frame(), *self.passport.lines(), *self._channels[1]]

    def _frame(self) -> list[str]:
        """What the ground's motion is, and against what the structure's is."""
        if not self.ground:
            return []
        how = "absolute (the ground's is added), as the sensors gave them"
        how = how if self.absolute else "relative to it"
        moved = "; accelerations a are " + how if self.sensors.quantity == "acceleration" else ""
        text = (
            f"{GROUND} is the acceleration of the ground, with the sign of its sensor; "
            f"displacements and velocities are relative to the ground{moved}"
        )
        return wrap([text])


def read_exported(folder: Path) -> Exported:
    """The model of a finished run.

    Raises ValueError for a folder without a finished run, and for a model that diverged or was not
    identified.
    """
    require_finished(folder)
    run = read_run(folder)
    require_sound(folder, run.metrics)
    estimator, model = restore(run), run.experiment.model
    passport = passport_of(run.experiment, run.metrics, run.sensors, type(estimator).__name__)
    return Exported(
        estimator,
        identifier(model.name),
        passport,
        run.sensors,
        {key: value for key, value in model.values.items() if key != "about"},
        passport.facts["trained_on"]["hold"],
        _intervals(run.metrics.get("uncertainty", {})),
        run.sensors.forced == "base"
        and run.sensors.quantity == "acceleration"
        and run.experiment.data.values.get("accelerations") == "absolute",
    )


def _intervals(uncertainty: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """What a run found of each parameter's interval; nothing of those that lack a part of it."""
    require(uncertainty, UNCERTAINTY, "metrics.json: uncertainty")
    listed = uncertainty.get("parameters", [])
    return {p["name"]: p for p in listed if {"name", "status", "half"} <= p.keys()}


def require_sound(folder: Path, metrics: Mapping[str, Any]) -> None:
    """Raise ValueError for a run whose model diverged or identified nothing."""
    verdict = metrics.get("verdict", {})
    if verdict.get("identified") is False:
        raise ValueError(
            f"{folder} identified nothing: {verdict.get('reason') or 'no reason is stored'}; a "
            "model that is no result is not exported: train on more motion, or another model"
        )
    if lost := divergence(metrics):
        raise ValueError(
            f"{folder}: {lost}; a model that diverges is not exported: train with "
            "objective=free_run, or another model"
        )
