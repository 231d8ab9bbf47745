"""Good arguments of the public classes, and how they are changed into strange ones."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

import data

DT = 0.01
STRANGE: list[Any] = [
    *(0, -1, 1, 2, 3, 7, 1000, 10**6, 10**9, 10**30, -(10**30)),
    *(0.0, -0.5, 0.5, 1.5, 1e-300, 1e-12, 1e6, 1e12, 1e300, -1e300),
    *(math.nan, math.inf, -math.inf, True, False, None, "", "3", "x1", "a\nb", b"3", 1j),
    *([], [0], [1, 2], [math.nan], [[1.0], [2.0]], (), (1.0, 2.0, 3.0), [10**9] * 3, ["x1", "x1"]),
    *({}, {"x": 1}, object(), np.float32(2.0), np.int64(2), np.array([1.0, 2.0]), torch.ones(2)),
    *([5] * 100_000, "long " * 1000, ["s1"] * 3, [1e9, 1e-9], {1, 2}, np.nan, print, int),
]


def structure_of(draw: random.Random, n: int = 0) -> data.Structure:
    n = n or draw.randint(1, 3)
    nodes = ["s1", *(f"x{i + 1}" for i in range(n))]
    pairs = [(nodes[i], nodes[i + 1]) for i in range(n)]
    elements = {f"r{i + 1}": element_of(draw, pair) for i, pair in enumerate(pairs)}
    return data.Structure([1.0 + 0.1 * i for i in range(n)], elements)


def element_of(draw: random.Random, between: tuple[str, str]) -> Any:
    name = draw.choice(list(ELEMENTS))
    return getattr(data, name)(between=between, **ELEMENTS[name])


ELEMENTS: dict[str, dict[str, Any]] = {
    "Bilinear": {"yield_displacement": 0.02, "stiffness": 40.0, "post_yield_stiffness": 20.0},
    "LimitedSlip": {
        **{"yield_displacement": 0.01, "stiffness": 40.0, "gap_stiffness": 40.0, "gap": 0.03},
        **{"damping": 0.1, "slip_damping": 0.1},
    },
    "Polynomial": {"stiffness": 40.0, "damping": 0.6, "cubic_stiffness": 20.0},
    "BoucWen": {"stiffness": 40.0, "beta": 10.0, "gamma": 13.0},
    "MenegottoPinto": {
        **{"yield_displacement": 0.02, "stiffness": 40.0, "hardening_ratio": 0.02},
        **{"sharpness": 18.0, "sharpness_loss": 0.9, "loss_excursion": 0.15, "damping": 0.1},
        **{"a1": 0.04, "a2": 1.0, "a3": 0.04, "a4": 1.0},
    },
    "SelfCentering": {
        **{"activation_displacement": 0.02, "stiffness": 40.0, "hardening_ratio": 0.1},
        **{"flag": 0.8, "damping": 0.1},
    },
    "SlackBrace": {
        **{"yield_displacement": 0.02, "stiffness": 40.0, "hardening_ratio": 0.01, "gap": 0.01},
        "damping": 0.1,
    },
    "FrictionPendulum": {
        **{"weight": 10.0, "radius": 2.0, "friction_fast": 0.07, "friction_slow": 0.03},
        **{"rate": 30.0, "yield_displacement": 5e-4, "damping": 0.1},
    },
    "Takeda": {
        **{"yield_displacement": 0.02, "stiffness": 40.0, "hardening_ratio": 0.03},
        **{"unloading_exponent": 0.4, "damping": 0.1},
    },
    "Pinching4": {
        **{"stiffness": 40.0, "yield_displacement": 0.02, "displacement_2": 0.04},
        **{"displacement_3": 0.08, "displacement_4": 0.2, "strength_2": 1.5, "strength_3": 1.6},
        **{"strength_4": 1.2, "softening_by_energy": 0.1, "weakening_by_excursion": 0.1},
    },
    "UnevenPinching4": {
        **{"stiffness": 40.0, "yield_displacement": 0.02, "displacement_2": 0.04},
        **{"displacement_3": 0.08, "displacement_4": 0.2, "strength_2": 1.5, "strength_3": 1.6},
        **{"strength_4": 1.2, "softening_by_energy": 0.1, "back_yield_displacement": 0.03},
        **{"back_displacement_2": 0.06, "back_displacement_3": 0.1, "back_displacement_4": 0.2},
        **{"back_strength_1": 0.8, "back_strength_2": 1.1, "back_strength_3": 1.2},
        **{"back_strength_4": 0.9},
    },
    "Hysteretic": {
        **{"stiffness": 40.0, "yield_displacement": 0.02, "displacement_2": 0.05},
        **{"displacement_3": 0.2, "strength_2": 1.4, "strength_3": 1.2, "reloading_place": 0.7},
        **{"reloading_force": 0.4, "growth_by_energy": 0.02, "unloading_exponent": 0.2},
    },
    "UnevenHysteretic": {
        **{"stiffness": 40.0, "yield_displacement": 0.02, "displacement_2": 0.05},
        **{"displacement_3": 0.2, "strength_2": 1.4, "strength_3": 1.2},
        **{"growth_by_ductility": 0.01, "back_yield_displacement": 0.03},
        **{"back_displacement_2": 0.06, "back_displacement_3": 0.1, "back_strength_1": 0.8},
        **{"back_strength_2": 1.1, "back_strength_3": 1.2},
    },
    "BaberNoori": {
        **{"stiffness": 40.0, "post_yield_ratio": 0.05, "beta": 13.0, "gamma": 10.0},
        **{"asymmetry": 1.0, "exponent": 1.0, "eta_rate": 0.1, "nu_rate": 0.1, "pinching": 0.8},
        **{"pinching_rate": 1.0, "pinching_place": 0.1, "pinching_width": 0.1},
        **{"pinching_spread": 0.1, "pinching_lambda": 0.1},
    },
}
MODELS: dict[str, dict[str, Any]] = {  # what they are built with, beside sizes and dt
    "VWNN": {
        **{"cutoff": 50.0, "stages": 2, "sigmoid_weight": 0.05, "order": 2, "squares": True},
        **{"bias": True, "ridge": 1e-8, "unfiltered_excitation": False},
    },
    "ForwardVWNN": {
        **{"cutoffs": [0.3, 4.0, 50.0], "factors": 2, "sigmoid_weight": 0.5, "order": [1, 3]},
        **{"ridge": 1e-9, "refinements": 0},
    },
    "EquivalentLinear": {"ridge": 1e-8},
    "ModalPolynomial": {
        **{"fits": "residual", "basis": "power", "order": 2, "pairs": None, "ridge": 1e-8},
        "forced": None,
    },
    "GlobalMLP": {"hidden": [4], "activation": "tanh"},
    "ResidualMLP": {"hidden": [4], "activation": "relu", "ridge": 1e-8},
    "Recurrent": {"cell": "gru", "hidden": 4, "layers": 1},
    "NeuralStateSpace": {"memory": 2, "hidden": 4, "past": 3},
    "ElementNetwork": {
        **{"elements": None, "masses": None, "forced": None, "hinges": 1, "tanhs": 0, "units": 1},
        **{"cubic": True, "substeps": 2, "from_accelerations": False, "prior": 1e-10},
        "early_prior": None,
    },
    "LatentHysteresisNetwork": {
        **{"elements": 2, "hinges": 1, "tanhs": 1, "units": 1, "cubic": True, "substeps": 2},
        **{"prior": 1e-10, "from_accelerations": False},
    },
    "HystereticElement": {"hinges": 1, "tanhs": 0, "units": 1, "cubic": True, "prior": 1e-8},
    "BranchElement": {"ramps": 3, "bends": 2, "force_memory": True, "prior": 1e-7},
    "NamedElement": {"laws": ["SelfCentering"], "seed": 0},
    "PrandtlIshlinskii": {"sliders": 1, "nodes": 6, "ridge": 1e-6},
    "RestoringForceSurface": {"order": 2, "ridge": 1e-8},
    "LastValue": {},
    "TwoPoint": {},
    "FilteredExtrapolation": {"cutoff": 50.0},
    "Online": {"estimator": None, "law": None, "guard": None},
}


def _small_element(name: str) -> Callable[[random.Random], dict[str, Any]]:
    return lambda d: {"between": ("s1", "x1"), **ELEMENTS[name]}


IMPOSED = (
    "HystereticElement",
    "BranchElement",
    "NamedElement",
    "PrandtlIshlinskii",
    "RestoringForceSurface",
)  # elements under an imposed motion
SMALL: dict[str, Callable[[random.Random], dict[str, Any]]] = {  # other classes
    **{name: _small_element(name) for name in ELEMENTS},
    "Structure": lambda d: {
        "masses": [1.0, 2.0],
        "elements": {"r1": element_of(d, ("s1", "x1")), "r2": element_of(d, ("x1", "x2"))},
    },
    "BandLimitedGaussian": lambda d: {"std": 1.0, "band": (0.0, 3.0)},
    "Multisine": lambda d: {"std": 1.0, "band": (0.0, 3.0)},
    "SineSweep": lambda d: {"amplitude": 1.0, "band": (0.1, 3.0)},
    "Given": lambda d: {"values": np.zeros((500, 2))},
    "Excitation": lambda d: {
        **{"force": data.Multisine(1.0), "support": None, "dofs": [1], "ramp": 0.1},
    },
    "FullState": lambda d: {},
    "Noisy": lambda d: {"level": 0.1, "signals": ("x", "a")},
    "Integrated": lambda d: {"cutoff": 0.02, "order": 1, "causal": True},
    "Composed": lambda d: {"steps": [data.FullState(), data.Noisy()]},
    "StiffnessLoss": lambda d: {"element": "r1", "time": 0.5, "fraction": 0.2, "duration": 0.3},
    "HystereticDegradation": lambda d: {"element": "r1", "eta_rate": 0.1, "nu_rate": 0.1},
    "RecordedEarthquake": lambda d: {
        **{"events": ["1a", "3a"], "train_records": 1, "test_events": None, "seed": 0},
        **{"peak": 0.3, "scale": None, "lag": 0.0},
    },
    "Sensors": lambda d: {"dt": DT, "dofs": 2, "inputs": 2, "forced": [1, 2]},
}
SETTINGS: dict[str, dict[str, Any]] = {
    "Adam": {"iterations": 3, "rate": 0.01},
    "LBFGS": {
        **{"iterations": 3, "history": 5, "gradient": 1e-12, "change": 1e-6, "patience": 2},
    },
    "LevenbergMarquardt": {
        **{"iterations": 3, "damping": 1e-3, "decrease": 0.1, "increase": 10.0, "largest": 1e10},
        **{"gradient": 1e-7, "change": 0.0, "patience": 2, "every": 1, "scaled": False},
    },
    "FreeRun": {
        **{"horizons": [20, None], "restart": True, "records": None, "warmup": 0, "starts": 1},
        **{"start_iterations": 1, "finalists": 1, "seed": 0},
    },
    "RecursiveLeastSquares": {"forgetting": 0.999, "variance": 1e6, "limit": 1.0},
    "NormalisedGradient": {
        **{"gain": 0.1, "floor": 1e-3, "dead_zone": 0.0, "leakage": 0.0, "bound": None},
    },
    "RandomWalk": {"walk": 1e-6, "noise": 1e-2, "variance": 1e3, "limit": 1.0},
    "Guard": {"full_scale": None, "repeats": 3, "longest": 100, "settle": 10},
    "CumulativeSum": {"slack": 0.5, "settle": 0},
    "ResidualLevel": {"settle": 0},
    "WeightDistance": {"ridge": 1e-3, "settle": 0},
    "WeightDrift": {"slack": 1.0, "ridge": 1e-3, "settle": 0},
    "HighPass": {"cutoff": 0.5, "dt": DT, "order": 2},
}
SIMULATED = {
    **{"seed": 0, "name": "frame", "dt": DT, "duration": 1.0, "train_records": 1},
    **{"test_records": 1, "tolerance": 1e-7, "window": None, "stride": None, "warmup": 0},
    **{"batch": None, "validation": 0.0},
}


def changed(draw: random.Random, arguments: dict[str, Any], most: int = 2) -> dict[str, Any]:
    """Some of the arguments strange, or scaled."""
    new = dict(arguments)
    for name in draw.sample(sorted(new), min(len(new), draw.randint(0, most))):
        value = new[name]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and draw.random() < 0.5:
            factor = draw.choice([-1, 0, 0.1, 3, 10, 1e3, 1e6, 1e12, 1e-9])
            new[name] = type(value)(value * factor)
        elif isinstance(value, list | tuple) and value and draw.random() < 0.5:
            items = list(value)
            items[draw.randrange(len(items))] = draw.choice(STRANGE)
            new[name] = items * draw.choice([1, 1, 2])
        else:
            new[name] = draw.choice(STRANGE)
    return new
