"""What happens before any estimator sees a number: structures, motions, sensors, records.

Every public class by its name, loaded when it is first used: `from data import Structure`. The same
names appear in configs as `_target_: data.Structure`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

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
    "BaberNoori": "data.simulation.elements.baber_noori",
    "BandLimitedGaussian": "data.simulation.excitation",
    "Bilinear": "data.simulation.elements.bilinear",
    "BoucWen": "data.simulation.elements.bouc_wen",
    "Composed": "data.simulation.scenario",
    "EscapedMotionError": "data.simulation.motion",
    "Excitation": "data.simulation.excitation",
    "FrictionPendulum": "data.simulation.elements.friction_pendulum",
    "FullState": "data.simulation.scenario",
    "Given": "data.simulation.excitation",
    "Hysteretic": "data.simulation.elements.hysteretic",
    "HystereticDegradation": "data.simulation.damage",
    "Integrated": "data.simulation.scenario",
    "LimitedSlip": "data.simulation.elements.limited_slip",
    "MenegottoPinto": "data.simulation.elements.menegotto_pinto",
    "Multisine": "data.simulation.excitation",
    "Noisy": "data.simulation.scenario",
    "Pinching4": "data.simulation.elements.pinching4",
    "Polynomial": "data.simulation.elements.polynomial",
    "RecordedEarthquake": "data.simulation.earthquake",
    "SelfCentering": "data.simulation.elements.self_centering",
    "SimulatedData": "data.simulation.datamodule",
    "Simulation": "data.simulation.records",
    "SineSweep": "data.simulation.excitation",
    "SlackBrace": "data.simulation.elements.slack_brace",
    "StiffnessLoss": "data.simulation.damage",
    "Structure": "data.simulation.structure",
    "Takeda": "data.simulation.elements.takeda",
    "UnevenHysteretic": "data.simulation.elements.hysteretic",
    "UnevenPinching4": "data.simulation.elements.pinching4",
    # measured records, public benchmarks, streams
    "BenchmarkData": "data.public.datamodule",
    "MeasuredData": "data.measured.datamodule",
    "Mending": "data.measured.mend",
    "SampleLines": "data.stream.lines",
    "WholeRecords": "data.measured.datamodule",
}
__all__ = list(PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'data' has no {name!r}; public are {', '.join(PUBLIC)}")
    return getattr(import_module(PUBLIC[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *PUBLIC]
