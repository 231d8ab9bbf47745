"""Calls of the library with arguments, records and batches that do not fit, or hardly.

Classes that simulate and identify are built with good arguments of which some are changed, then
used as far as they go. What is accepted is held against what was promised: shapes, finite values
or a motion that is declared lost, a checkpoint that gives the same estimates.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import data
import models
from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from data.record import Drive, Record, stack
from data.simulation.motion import simulate
from models.checkpoint import load_estimator, save_estimator
from models.training.problem import FreeRunProblem, Problem

DT = 0.01
HUGE = 1e60  # signals beyond may overflow in products
STRANGE: list[Any] = [
    *(0, -1, 1, 2, 3, 7, 1000, 10**6, 10**9, 10**30, -(10**30)),
    *(0.0, -0.5, 0.5, 1.5, 1e-300, 1e-12, 1e6, 1e12, 1e300, -1e300),
    *(math.nan, math.inf, -math.inf, True, False, None, "", "3", "x1", "a\nb", b"3", 1j),
    *([], [0], [1, 2], [math.nan], [[1.0], [2.0]], (), (1.0, 2.0, 3.0), [10**9] * 3, ["x1", "x1"]),
    *({}, {"x": 1}, object(), np.float32(2.0), np.int64(2), np.array([1.0, 2.0]), torch.ones(2)),
    *([5] * 100_000, "long " * 1000, ["s1"] * 3, [1e9, 1e-9], {1, 2}, np.nan, print, int),
]


def _structure(draw: random.Random, n: int = 0) -> data.Structure:
    n = n or draw.randint(1, 3)
    nodes = ["s1", *(f"x{i + 1}" for i in range(n))]
    pairs = [(nodes[i], nodes[i + 1]) for i in range(n)]
    elements = {f"r{i + 1}": _element(draw, pair) for i, pair in enumerate(pairs)}
    return data.Structure([1.0 + 0.1 * i for i in range(n)], elements)


def _element(draw: random.Random, between: tuple[str, str]) -> Any:
    name = draw.choice(["Bilinear", "LimitedSlip", "Polynomial", "BoucWen"])
    return getattr(data, name)(between=between, **ELEMENTS[name])


ELEMENTS: dict[str, dict[str, Any]] = {
    "Bilinear": {"yield_displacement": 0.02, "stiffness": 40.0, "post_yield_stiffness": 20.0},
    "LimitedSlip": {
        **{"yield_displacement": 0.01, "stiffness": 40.0, "gap_stiffness": 40.0, "gap": 0.03},
        **{"damping": 0.1, "slip_damping": 0.1},
    },
    "Polynomial": {"stiffness": 40.0, "damping": 0.6, "cubic_stiffness": 20.0},
    "BoucWen": {"stiffness": 40.0, "beta": 10.0, "gamma": 13.0},
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
    "RestoringForceSurface": {"order": 2, "ridge": 1e-8},
    "LastValue": {},
    "TwoPoint": {},
    "FilteredExtrapolation": {"cutoff": 50.0},
    "Online": {"estimator": None, "law": None, "guard": None},
}


def _small_element(name: str) -> Callable[[random.Random], dict[str, Any]]:
    return lambda d: {"between": ("s1", "x1"), **ELEMENTS[name]}


IMPOSED = ("HystereticElement", "RestoringForceSurface")  # elements under an imposed motion
SMALL: dict[str, Callable[[random.Random], dict[str, Any]]] = {  # other classes
    **{name: _small_element(name) for name in ELEMENTS},
    "Structure": lambda d: {
        "masses": [1.0, 2.0],
        "elements": {"r1": _element(d, ("s1", "x1")), "r2": _element(d, ("x1", "x2"))},
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


def motion(draw: random.Random, n: int, m: int, samples: int = 300) -> Record:
    """A good record: a damped oscillator's motion, near enough."""
    generator = torch.Generator().manual_seed(draw.randrange(1000))
    noise = torch.randn(samples, m, generator=generator, dtype=torch.float64)
    f = torch.cumsum(noise, 0) * 0.1
    f = f - f.mean(dim=0)
    first = f[:, :1] if m else torch.randn(samples, 1, generator=generator, dtype=torch.float64)
    x = torch.cumsum(torch.cumsum(0.01 * first, 0), 0) * DT
    x = x - torch.linspace(0, 1, samples, dtype=torch.float64)[:, None] * x[-1:]
    x = x.repeat(1, n) * torch.linspace(1.0, 2.0, n, dtype=torch.float64)
    x = x + 0.01 * torch.randn(samples, n, generator=generator, dtype=torch.float64)
    v = torch.gradient(x, spacing=DT, dim=0)[0]
    pushed = f.repeat(1, n)[:, :n] if m else torch.zeros(samples, n, dtype=torch.float64)
    return Record(DT, pushed - 30.0 * x - 0.5 * v, f, x, v)


def imposed(draw: random.Random, samples: int = 300) -> Record:
    """A good test of one element."""
    t = DT * torch.arange(samples, dtype=torch.float64)[:, None]
    s = torch.sin(draw.uniform(1.0, 9.0) * t) * t
    rate = torch.gradient(s, spacing=DT, dim=0)[0]
    return Record(DT, 3.0 * s + 0.1 * rate + s**3, s[:, :0], s=s, s_dot=rate, quantity="force")


def _spoilt(draw: random.Random, u: Tensor) -> Any:
    """A signal with something the matter."""
    k = draw.randrange(u.shape[-2])
    wild = draw.choice([math.nan, math.inf, -math.inf, 1e300, 1e30, 1e9])
    ways: list[Callable[[], Any]] = [
        lambda: u.float(),
        lambda: u.half(),
        lambda: u.long(),
        lambda: u.bool(),
        lambda: u.to(torch.complex128),
        lambda: u.numpy(),
        lambda: u.tolist(),
        lambda: u.to("meta"),
        lambda: u.clone().requires_grad_(),
        lambda: u.T.contiguous().T,
        lambda: torch.stack([u, u], dim=-1)[..., 0],
        lambda: u.expand(2, *u.shape),
        lambda: u[:0],
        lambda: u[:1],
        lambda: u[:2],
        lambda: u[..., :0],
        lambda: u[:, :1].flatten(),
        lambda: u[None],
        lambda: u[None][:0],
        lambda: u[:-1],
        lambda: torch.cat([u, u], dim=-1),
        lambda: u * 0.0,
        lambda: u * 1e-300,
        lambda: u * 1e150,
        lambda: u.index_fill(-2, torch.tensor([k]), wild),
        lambda: u.to_sparse(),
        lambda: None,
        lambda: draw.choice(STRANGE),
    ]
    return draw.choice(ways)()


def spoilt(draw: random.Random, record: Record) -> Record:
    """A record some signals of which, or all, have something the matter."""
    way = draw.randrange(6)
    if way == 0:
        return record
    if way == 1:
        return replace(record, **changed(draw, {"dt": DT, "warmup": 0, "hold": "linear"}))
    if way == 2:
        kind = draw.choice(["periodic", "given", "rest", "never"])
        return replace(record, initial_state=kind, hold=draw.choice(["zero_order", "band_limited"]))
    if way == 3:
        state = draw.getstate()

        def alike(u: Tensor) -> Any:
            draw.setstate(state)
            return _spoilt(draw, u)

        return record.map(alike)
    names = draw.sample(sorted(record.signals()), draw.randint(1, 2))
    return replace(record, **{name: _spoilt(draw, getattr(record, name)) for name in names})


def _largest(*signals: Tensor | None) -> float:
    sizes = [float(u.detach().abs().max()) for u in signals if u is not None and u.numel()]
    return max((s for s in sizes if math.isfinite(s)), default=0.0)


def require(condition: bool, words: str) -> None:
    if not condition:
        raise WronglyAcceptedError(words)


def used(model: Any, records: list[Record], draw: random.Random) -> None:
    """Identify, estimate and simulate; what comes is as it must be."""
    model.identify(records)
    if not records:
        return  # a model that learns nothing needs none
    record = draw.choice(records)
    with torch.set_grad_enabled(draw.random() < 0.3):
        estimate = model(record)
        require(estimate.shape == record.a.shape, f"estimates {tuple(estimate.shape)}")
        require(estimate.dtype == torch.float64, f"estimates of {estimate.dtype}")
        tame = _largest(record.a) > 1e-100 and _largest(*record.signals().values()) < HUGE
        sound = bool(torch.isfinite(estimate).all()) or isinstance(model, models.Recurrent)
        free = isinstance(model, (models.ElementNetwork, models.LatentHysteresisNetwork,
                                  models.HystereticElement, models.NeuralStateSpace))  # fmt: skip
        require(sound or free or not tame, "estimates that are not finite, from signals that are")
        drive = record.drive()
        response = model.free_run(drive)
        for u in (response.x, response.v, response.a):
            require(u.shape[:-1] == record.a.shape[:-1], f"a free run of {tuple(u.shape)}")


class Target:
    name = "library"

    def __init__(self) -> None:
        """Compile, or read what is compiled, once for all forks."""
        torch.set_num_threads(1)
        for front in (data, models):
            for name in front.PUBLIC:
                getattr(front, name)
        draw = random.Random(0)
        structure = _structure(draw, 3)
        simulate(structure, np.ones((50, 3)), DT)
        made = data.SimulatedData(
            structure, data.Excitation(data.Multisine(1.0)), data.Integrated(), 0, duration=1.0
        )
        made.setup()
        next(iter(made.train_dataloader()))
        for name in ("VWNN", "ElementNetwork", "Online"):
            model, record = getattr(models, name)(1, 1, DT), motion(draw, 1, 1)
            with torch.no_grad(), suppress(ValueError):
                used(model, [record], draw)
        for name in ("GlobalMLP", "NeuralStateSpace"):
            model = _built(name, 1, 1, DT, MODELS[name])
            model.identify([record])
            for solver in ("Adam", "LBFGS", "LevenbergMarquardt"):
                method = getattr(models, solver)(list(model.parameters()), **SETTINGS[solver])
                method.solve(FreeRunProblem(model, record, 20))

    def prepare(self, folder: Path) -> None:
        pass

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        ways = [_estimator] * 5 + [_settings, _part, _motion, _data, _checkpoint, _training] * 2
        return draw.choice(ways)(draw)


def _built(name: str, dofs: Any, inputs: Any, dt: Any, arguments: dict[str, Any]) -> Any:
    return getattr(models, name)(dofs, inputs, dt, **arguments)


def _sizes(draw: random.Random, name: str) -> tuple[int, int, Record]:
    if name in IMPOSED:
        return 1, 2, imposed(draw)
    n = draw.randint(1, 3)
    m = n if name == "ModalPolynomial" else draw.choice([n, n, 1, 0 if name != "VWNN" else 1])
    return n, m, motion(draw, n, m, draw.choice([300, 300, 40]))


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 300 else f"{text[:300]}…"


def _estimator(draw: random.Random) -> Attempt:
    """An estimator with strange arguments, or on strange records."""
    name = draw.choice(sorted(MODELS))
    n, m, good = _sizes(draw, name)
    strange_model = draw.random() < 0.5
    arguments = changed(draw, MODELS[name]) if strange_model else MODELS[name]
    sizes = {"dofs": n, "inputs": m, "dt": DT}
    if draw.random() < 0.15:
        sizes = changed(draw, sizes, 1)
    state = draw.getstate()

    def act() -> None:
        draw.setstate(state)
        model = getattr(models, name)(**sizes, **arguments)
        records: Any = [good, good.window(0, good.samples // 2)]
        if draw.random() < 0.2:
            records = [stack([good, good])]
        if not strange_model or draw.random() < 0.3:
            records = [spoilt(draw, records[0]), *records[1:]][: draw.randint(0, 2) or None]
        if draw.random() < 0.05:
            records = draw.choice([[], good, None, iter(records), [None], 3])
        if isinstance(records, list):
            used(model, records, draw)
        else:
            model.identify(records)
            model(good)
        model.free_run(draw.choice([good.drive(), good, None, _drive_of(draw, good)]))

    return Attempt(f"models.{name}(**{_shown({**sizes, **arguments})}) on a record", act)


def _drive_of(draw: random.Random, record: Record) -> Any:
    whole = record.drive()
    names = draw.sample(["u", "x0", "v0", "dt", "hold"], draw.randint(1, 2))
    new: dict[str, Any] = {}
    for name in names:
        value = getattr(whole, name)
        spoil = isinstance(value, Tensor) and draw.random() < 0.7
        new[name] = _spoilt(draw, value if value.ndim > 1 else value[None]) if spoil else (
            draw.choice(STRANGE)
        )  # fmt: skip
    return Drive(**{**vars(whole), **new})


def _settings(draw: random.Random) -> Attempt:
    """Solvers, objectives, laws, guards and detectors."""
    name = draw.choice(sorted(SETTINGS))
    arguments = changed(draw, SETTINGS[name], 3)
    n, m, good = _sizes(draw, "EquivalentLinear")

    def act() -> None:
        first: dict[str, Any] = {}
        if name in ("Adam", "LBFGS", "LevenbergMarquardt"):
            first = {"parameters": [torch.nn.Parameter(torch.ones(2, dtype=torch.float64))]}
        thing = getattr(models, name)(**first, **arguments)
        if name == "HighPass":
            thing.record(good)
        if isinstance(thing, models.Frozen.__mro__[1]):
            model = models.Online(n, m, DT, models.EquivalentLinear(n, m, DT), thing)
            model.identify([good])
            model(good)
        if name == "Guard":
            models.Online(n, m, DT, models.EquivalentLinear(n, m, DT), None, thing).identify([good])

    return Attempt(f"models.{name}(**{_shown(arguments)})", act)


def _part(draw: random.Random) -> Attempt:
    """Parts of a simulation, strange ones, and what becomes of it."""
    name = draw.choice(sorted(SMALL))
    arguments = changed(draw, SMALL[name](draw))
    structure = _structure(draw, 2)

    def act() -> None:
        thing = getattr(data, name)(**arguments)
        excitation, scenario, damage = data.Excitation(data.Multisine(1.0)), data.FullState(), None
        frame = structure
        if name in ELEMENTS:
            other = data.Polynomial(between=("x1", "ground"), stiffness=10.0)
            frame = data.Structure(
                [1.0, 1.0], {"r1": thing, "r2": other, "r3": replace(other, between=("x1", "x2"))}
            )
        if name == "Structure":
            frame = thing
        elif isinstance(thing, data.Multisine.__mro__[1]):
            support = draw_support
            excitation = data.Excitation(**{"support" if support else "force": thing})
        elif name == "Excitation":
            excitation = thing
        elif isinstance(thing, data.FullState.__mro__[1]):
            scenario = thing
        elif name in ("StiffnessLoss", "HystereticDegradation"):
            damage = thing
        simulated(data.Simulation(frame, excitation, scenario, DT, 1.0, damage=damage))

    draw_support = draw.random() < 0.3 or name == "RecordedEarthquake"
    return Attempt(f"data.{name}(**{_shown(arguments)}) simulated", act)


def simulated(simulation: Any) -> None:
    for split in ("train", "test"):
        records, _ = simulation.records(split, 1, 0, 0 if split == "train" else 1)
        for record in records:
            require(record.samples == simulation.samples, f"{record.samples} samples")
            for signal, u in record.signals().items():
                require(bool(torch.isfinite(u).all()), f"{signal} of a motion is not finite")


def _motion(draw: random.Random) -> Attempt:
    """The integrator, under strange forces and laws."""
    n = draw.randint(1, 3)
    name = draw.choice(sorted(ELEMENTS))
    law = dict(ELEMENTS[name])
    for key in draw.sample(sorted(law), draw.randint(0, 2)):
        law[key] = abs(law[key]) * 10.0 ** draw.uniform(-12, 14)
    masses = [10.0 ** draw.uniform(-8, 8) for _ in range(n)]
    size, samples = 10.0 ** draw.uniform(-6, 9), draw.choice([2, 3, 100, 1000])
    dt = draw.choice([DT, DT, 1e-6, 1.0, 100.0])
    tolerance: Any = draw.choice([1e-7, 1e-3, 1e-12, 0.0, 1e-20, math.nan, "x", None, 1.0])
    generator = np.random.default_rng(draw.randrange(1000))
    force: Any = size * generator.standard_normal((samples, n))
    if draw.random() < 0.2:
        ways = [force[:, :-1], force[:0], force.T, np.nan * force, force.tolist(), force[::2]]
        force = draw.choice([*ways, force.astype(np.float32), force.astype(int), None, force[0]])

    def act() -> None:
        nodes = ["ground", *(f"x{i + 1}" for i in range(n))]
        elements = {
            f"r{i}": getattr(data, name)(between=(nodes[i], nodes[i + 1]), **law) for i in range(n)
        }
        whole = simulate(data.Structure(masses, elements), force, dt, tolerance=tolerance)
        require(whole.x.shape == np.shape(force), f"motion {whole.x.shape}")
        for signal in (whole.x, whole.v, whole.a, whole.r):
            sound = bool(np.isfinite(signal).all())
            require(sound or whole.escape_time is not None, "a motion is not finite, and not lost")

    words = f"{name} {law}, masses {masses}, force {_shown(np.shape(force))} of {size}, dt={dt}"
    return Attempt(f"simulate: {words}, tolerance={tolerance}", act)


def _data(draw: random.Random) -> Attempt:
    """Data of a run, strange ones, as a trainer asks for them."""
    arguments = changed(draw, SIMULATED, 3)
    structure = _structure(draw)

    def act() -> None:
        excitation = data.Excitation(data.Multisine(1.0))
        made = data.SimulatedData(structure, excitation, data.FullState(), **arguments)
        steps = made.simulation.samples * (made.train_records + made.test_records)
        if steps > 20_000:  # as asked for, and as long
            return
        made.setup()
        for loader in (made.train_dataloader(), *made.test_dataloader()):
            batch = next(iter(loader))
            require(bool(torch.isfinite(batch.a).all()), "a batch is not finite")
        require(math.isfinite(made.own_error()), "the simulation's own error is not finite")

    return Attempt(f"data.SimulatedData(**{_shown(arguments)})", act)


def _checkpoint(draw: random.Random) -> Attempt:
    """Weights that are loaded by a model of the same settings, or of others."""
    name = draw.choice([n for n in sorted(MODELS) if MODELS[n] and n != "Online"])
    n, m, good = _sizes(draw, name)
    other = changed(draw, {"dt": DT, **MODELS[name]}, 1)

    def act() -> None:
        first = _built(name, n, m, DT, MODELS[name])
        first.identify([good])
        save_estimator(first, Path("model.safetensors"), name)
        second = _built(name, n, m, other["dt"], {k: v for k, v in other.items() if k != "dt"})
        load_estimator(second, Path("model.safetensors"), name)
        with torch.no_grad():
            one, two = first(good), second(good)
        require(torch.equal(one, two), "a loaded model estimates otherwise")

    return Attempt(f"checkpoint of {name} loaded with {_shown(other)}", act)


def _training(draw: random.Random) -> Attempt:
    """A few iterations of a solver on strange records."""
    name = draw.choice(["GlobalMLP", "ResidualMLP", "Recurrent", "NeuralStateSpace",
                        "ElementNetwork", "LatentHysteresisNetwork"])  # fmt: skip
    solver = draw.choice(["Adam", "LBFGS", "LevenbergMarquardt"])
    settings = changed(draw, SETTINGS[solver], 1)
    n = draw.randint(1, 2)
    good = motion(draw, n, n, 60)
    horizon = draw.choice([None, 20, 1, 7, 1000])
    state = draw.getstate()

    def act() -> None:
        draw.setstate(state)
        model = _built(name, n, n, DT, MODELS[name])
        model.identify([good])
        record = spoilt(draw, good) if draw.random() < 0.5 else good
        model(record)
        free = [p for p in model.parameters() if p.requires_grad]
        method = getattr(models, solver)(free, **settings)
        one_step = name.endswith("MLP") and draw.random() < 0.5
        problem: Any = Problem(model, record) if one_step else FreeRunProblem(
            model, record, horizon
        )  # fmt: skip
        for _ in range(2):
            losses = method.solve(problem)
            require(all(math.isfinite(loss) for loss in losses), f"losses {losses}")
        require(all(bool(torch.isfinite(p).all()) for p in free), "weights that are not finite")

    return Attempt(f"{name} trained by {solver} {_shown(settings)}, horizon {horizon}", act)
