"""What happens before any estimator sees a number: structures, motions, sensors, records.

Every public class by its name, loaded when it is first used: `from data import Structure`. The same
names appear in configs as `_target_: data.Structure`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from data.simulation.laws import FILES

PUBLIC = {  # class → the module that defines it
    # records and samples
    "Data": "data.datamodule",
    "Drive": "data.record",
    "Escape": "data.record",
    "Record": "data.record",
    "Response": "data.record",
    "Sample": "data.sample",
    "Sensors": "data.sample",
    "Truth": "data.record",
    "WindowDataset": "data.windows",
    # simulation
    "BandLimitedGaussian": "data.simulation.excitation",
    "Composed": "data.simulation.scenario",
    "EscapedMotionError": "data.simulation.motion",
    "Excitation": "data.simulation.excitation",
    "FullState": "data.simulation.scenario",
    "Given": "data.simulation.excitation",
    "HystereticDegradation": "data.simulation.damage",
    "Integrated": "data.simulation.scenario",
    "Multisine": "data.simulation.excitation",
    "Noisy": "data.simulation.scenario",
    "RecordedEarthquake": "data.simulation.earthquake",
    "SimulatedData": "data.simulation.datamodule",
    "Simulation": "data.simulation.records",
    "SineSweep": "data.simulation.excitation",
    "StiffnessLoss": "data.simulation.damage",
    "Structure": "data.simulation.structure",
    **{name: f"data.simulation.laws.{file}" for file, names in FILES.items() for name in names},
    # measured records, public benchmarks, streams
    "BenchmarkData": "data.public.datamodule",
    "MeasuredData": "data.measured.datamodule",
    "Mending": "data.measured.mend",
    "SampleLines": "data.stream",
    "WholeRecords": "data.measured.datamodule",
}
FRONT = {**PUBLIC, "read_record": "data.measured.reading"}  # of scripts; configs name classes alone
__all__ = list(FRONT)


def __getattr__(name: str) -> Any:
    if name not in FRONT:
        raise AttributeError(f"module 'data' has no {name!r}; public are {', '.join(FRONT)}")
    return getattr(import_module(FRONT[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *FRONT]
