"""What a run is made of: its choices, and the data, model, solver and objective that they describe.

A config is read once, by `Experiment.of`; what is below takes these objects.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch
from lightning.pytorch import seed_everything
from torch import nn
from torch.optim import Optimizer

import models
from data.annotations import shown
from data.datamodule import Data
from data.measured.channels import signal_of
from data.sample import Sensors
from data.simulation.damage import Damage
from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import Excitation
from data.simulation.scenario import Scenario
from data.simulation.structure import Structure
from models.choice import Choice, arguments_of, class_of
from models.composition.topology import OTHER, comparison, select_topology
from models.estimator import Estimator
from models.fit.identification import Identification
from models.fit.objective import Objective
from models.fit.solvers.solver import Solver

USUAL = Sensors(dt=1e-3, dofs=3, inputs=3)  # for which every baseline can be built


class Model(Choice):
    """The choice of an estimator."""

    def estimator(self, data: Data | Sensors) -> Estimator:
        """An estimator of the size of the data, or of what sensors send, not yet identified.

        Raises ValueError for settings that do not fit together, or not the data.
        """
        if not isinstance(self.values, Mapping):
            raise ValueError(f"{shown(self.values)!r} is not a model; see --help")
        chosen: Any = class_of(self.values)
        stated = self.values.get("priors") or self.values.get("ties")
        if stated and "priors" not in arguments_of(chosen):
            raise ValueError(
                f"model.priors and model.ties are for {_choices_with('priors')}; "
                f"model={self.name} has no parameters that they could be of: leave them out"
            )
        sensors = data.sensors if isinstance(data, Data) else data
        more = self._from_sensors(sensors, chosen)
        if "forced" in self.values and self.values["forced"] is None:
            more["forced"] = data.forced
        if "estimator" in self.values:  # one that wraps another
            inner = Model(f"{self.key}.estimator", self.values["estimator"])
            more["estimator"] = inner.estimator(data)
        more = {"dofs": data.dofs, **more}
        return self.build(Estimator, inputs=data.inputs, dt=data.dt, **more)

    def _from_sensors(self, sensors: Sensors, chosen: Any) -> dict[str, Any]:
        """Arguments that the channels say, where the config leaves them open."""
        more: dict[str, Any] = {}
        others = [] if "y1" in sensors.channels else sensors.channels  # u1 drives a benchmark's y1
        others = [c for c in others if signal_of(c) == "u"]
        if others and not getattr(chosen, "takes_other_inputs", True):
            raise ValueError(
                f"model={self.name} has no place for the other inputs {', '.join(others)}; take "
                f"them out of data.channels, or choose {chosen.reading_other_inputs}"
            )
        if "other_inputs" in self.values and self.values["other_inputs"] is None:
            more["other_inputs"] = len(others)
        if "elements" in self.values and self.values["elements"] is None and sensors.topology:
            more["elements"] = sensors.topology
        if "dofs" in self.values:
            more |= self._hidden(sensors)
        return more

    def _hidden(self, sensors: Sensors) -> dict[str, Any]:
        """The number of DOFs, which of them have a sensor, and what is measured beside.

        Raises ValueError for fewer DOFs, or masses, than the highest channel's number.
        """
        numbers, highest, stated = sensors.numbers, sensors.highest, self.values["dofs"]
        others = sensors.others if "others" in arguments_of(class_of(self.values)) else []
        least = [("model.dofs", stated)]
        if isinstance(masses := self.values.get("masses"), list):
            least.append(("number of model.masses", len(masses)))
        channels = ", ".join(c for c in sensors.channels if c.endswith(str(highest)))
        at = f"DOF {highest}" + f" ({channels})" * bool(channels)
        for key, value in least:
            if value is not None and not (type(value) is int and value >= highest):
                raise ValueError(
                    f"{key}={shown(value)}: there is a sensor on {at}; give the number of all "
                    f"DOFs, {highest} or more, or say which column is which (data.channels)"
                )
        dofs = stated or highest
        hidden = {"sensors": numbers} if len(numbers) < dofs else {}
        return {"dofs": dofs} | hidden | ({"others": others} if others else {})

    def topology(self, data: Data) -> str | None:
        """The topology of the model's elements that the records show, where it is open."""
        chosen = class_of(self.values)
        return chosen.topology_from(self.values, data) if issubclass(chosen, Estimator) else None

    def or_why_not(self, data: Data) -> Estimator | ValueError:
        """The estimator, or why it is none for these data. Raises ValueError for wrong settings."""
        try:
            return self.estimator(data)
        except ValueError as error:
            self.estimator(USUAL)
            return error


def _choices_with(setting: str) -> str:
    """The elements that have a setting, as a person chooses them."""
    return " or ".join(
        f"model={re.sub('(?<=.)(?=[A-Z])', '_', front).lower()} model.laws={laws}"
        for front, kinds in models.KINDS.items()
        for laws, name in kinds.items()
        if setting in arguments_of(getattr(models, name))
    )


@dataclass(frozen=True)
class Experiment:
    """The choices of a run. Of runs by older code some are missing: None, or no baselines."""

    system: Choice
    scenario: Choice
    data: Choice
    model: Model
    baselines: Mapping[str, Model]
    excitation: Choice | None
    damage: Choice | None
    solver: Choice | None
    objective: Choice | None
    adaptation: Choice | None
    max_fail: int
    seed: int
    threads: int | None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """The experiment that the resolved values of a config describe."""

        def optional(key: str) -> Choice | None:
            return Choice(key, values[key]) if values.get(key) else None

        baselines = values.get("baselines") or {}
        return cls(
            system=Choice("system", values["system"]),
            scenario=Choice("scenario", values["scenario"]),
            data=Choice("data", values["data"]),
            model=Model("model", values["model"]),
            baselines={name: Model(f"baselines.{name}", of) for name, of in baselines.items()},
            excitation=optional("excitation"),
            damage=optional("damage"),
            solver=optional("solver"),
            objective=optional("objective"),
            adaptation=optional("adaptation"),
            max_fail=values.get("max_fail", 1),
            seed=values["seed"],
            threads=values["threads"],
        )

    @property
    def simulated(self) -> bool:
        """Whether the motions are those of a structure of known laws."""
        return self.system.values.get("structure") is not None

    def make_data(self) -> Data:
        """Training and test records. Raises ValueError for choices that do not fit together."""
        more: dict[str, Any] = {"scenario": self.scenario.build(Scenario), "seed": self.seed}
        if self.simulated:
            if self.excitation is None or not self.excitation.target:
                raise ValueError(
                    f"excitation=none is for measured records, and system={self.system.name} is "
                    "simulated; choose excitation=gaussian"
                )
            structure = Choice("system.structure", self.system.values["structure"])
            more["structure"] = structure.build(Structure)
            more["excitation"] = self.excitation.build(Excitation)
            if self.damage is not None:
                more["damage"] = self.damage.build(Damage)
        elif self.data.target.endswith(".SimulatedData"):
            raise ValueError(
                f"system={self.system.name} has no structure to simulate; choose data=measured and "
                "data.path, or another system"
            )
        elif self.damage is not None:
            raise ValueError(
                f"damage is simulated, and system={self.system.name} was measured; choose "
                "damage=none"
            )
        return self.data.build(Data, name=self.system.name, **more)

    def set_up_data(self) -> Data:
        """The data with their records, simulated or read."""
        data = self.make_data()
        data.setup()
        return data

    def make_simulated_data(self) -> SimulatedData:
        """Records of a structure of known laws. Raises ValueError for measured ones."""
        data = self.make_data()
        if not isinstance(data, SimulatedData):
            raise ValueError(
                f"{self.system.name} was measured, not simulated: its laws are not known"
            )
        return data

    def make_solver(self) -> Callable[[Iterable[nn.Parameter]], Solver]:
        """A function from free parameters to the solver. Raises ValueError for bad settings."""
        assert self.solver is not None
        chosen = self.solver
        chosen.build(Optimizer, parameters=[nn.Parameter(torch.zeros(1))])  # its settings, checked
        return lambda parameters: chosen.build(Optimizer, parameters=parameters)

    def make_objective(self) -> Objective:
        """What the solver minimises."""
        assert self.objective is not None
        return self.objective.build(Objective)

    def make_identification(self, data: Data) -> Identification:
        """The model with solver and objective, its starting weights drawn from the seed."""
        seed_everything(self.seed, verbose=False)
        estimator = self.model.estimator(data)
        return Identification(estimator, self.make_solver(), self.max_fail, self.make_objective())

    def assemble(
        self, data: Data | None = None
    ) -> tuple[Data, Identification, dict[str, Estimator | ValueError]]:
        """Everything that a run needs: its data, its model with solver and objective, baselines.

        A baseline that cannot be built for these data is the reason why. data: those that a run
        before this one made. Raises ValueError for settings that do not fit together, before any
        work is done.
        """
        data = data or self.make_data()
        data.topology = self.model.topology(data)
        module = self.make_identification(data)
        return data, module, {name: one.or_why_not(data) for name, one in self.baselines.items()}

    def make_rival(self, data: Data, fitted: Identification) -> Identification | None:
        """The same model of another topology, which becomes that of the data; None of most models.

        Where nothing was held back that could choose between both, there is none.
        """
        if data.topology is None:
            return None
        other = fitted.estimator.rival_topology(data.topology, fitted.held_back_error)
        if other is None:
            return None
        data.topology = other
        return self.make_identification(data)


def select_fit(data: Data, first: Identification, rival: Identification) -> Identification:
    """The better of two fits on held-back motion, which names the other's error.

    Its topology becomes that of the data, which is the rival's.
    """
    assert data.topology is not None
    fits = {OTHER[data.topology]: first, data.topology: rival}
    errors = {name: fit.held_back_error for name, fit in fits.items()}
    data.topology = select_topology(errors)
    chosen = fits[data.topology]
    chosen.solution["held_out_error_by_topology_percent"] = comparison(errors)
    chosen.fit_seconds = sum(fit.fit_seconds for fit in fits.values())
    return chosen
