"""How well do sensors on the ground and a few floors determine the drift of every storey?

    python -m benchmarks.few_sensors                    # 13 buildings, an hour and a half
    python -m benchmarks.few_sensors --sensors 5        # the roof alone
    python -m benchmarks.few_sensors --sensors 5 --drifts 2  # and a draw wire in storey 2
    python -m benchmarks.few_sensors --masses-off 0.05  # the methods are given wrong masses
    python -m benchmarks.few_sensors --usual            # without the model, a minute
    python -m benchmarks.few_sensors --quick            # a building, a minute
    python -m benchmarks.few_sensors --filter 1000      # records of planted fits, followed on line

Random five-storey shear buildings of 0.4 to 1.1 s, with 3 % of damping and ductilities up to 6:
steel, concrete and smooth Bouc–Wen in turn, and a third as many that pinch. A method is given
masses and two motions, with noise of 5 % in each channel. Then it estimates the drifts in unseen
motions and in the same 1.5 times as large: simulations from the noisy ground alone, interpolation
and the smoother from the noisy floors as well. Prints median and 90 % quantile, over storeys and
motions, of the error of the peak drift [%]; 90 % quantile of the error of the residual drift, in
yield drifts; share of the true peaks within the 95 % intervals; `wrong`: fits with a larger error
in training than the structure itself, which are local minima; seconds of the processor for a fit.
The row `the structure itself` is what the noise of the ground costs.
E storeys, S sensors on floors, T samples; m, s, kg
"""

from __future__ import annotations

import math
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import torch

from benchmarks.drift_filters import show_filters
from benchmarks.table import show
from benchmarks.unplanted import DT, FARTHER, ground
from benchmarks.usual_drifts import (
    NOISE,
    SPLINES,
    Chain,
    Estimate,
    Event,
    Smoother,
    interpolated,
    of_period,
    shear,
)
from data import BaberNoori, MenegottoPinto, Polynomial, Structure, Takeda
from data.arguments import Parser
from data.record import stack
from data.sample import samples_of
from data.simulation.laws.element import Element
from data.simulation.motion import simulate
from models import ElementNetwork
from models.online.drift_stream import smoothed
from models.uncertainty.drifts import storeys_of
from runner.config.command_line import command_errors

STOREYS, SAMPLES, QUICK = 5, 2500, 1000
QUIET, LAST = (0.68, 0.76), 200  # of the record: the ground comes to rest; samples of residuals
WEAKEST = 0.1, 100.0  # [m/s²]: ground motions between which all of these buildings yield so
TRAINED = 1, 2  # numbers of motions; odd ones are earthquakes, even ones random
KINDS = ("steel", "concrete", "smooth")


@dataclass(frozen=True)
class Building:
    kind: str
    structure: Structure
    yields: np.ndarray  # drifts (E,)
    peak: float  # of the ground acceleration

    def shaken(self, a: np.ndarray, sensors: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Absolute accelerations of floors (T, S) and drifts (T, E) under that of the ground."""
        masses = self.structure.masses
        motion = simulate(self.structure, np.ascontiguousarray(-a[:, None] * masses), DT)
        floors = motion.a[:, [floor - 1 for floor in sensors]] + a[:, None]
        return floors, motion.y[:, : len(masses)]

    def event(
        self,
        seed: int,
        sensors: Sequence[int],
        samples: int,
        times: float = 1.0,
        storeys: Sequence[int] = (),
    ) -> Event:
        """Under a motion, with wires in some storeys, whose zeros are up to a tenth of a metre."""
        rng = np.random.default_rng(seed)
        begin, end = (round(share * samples) for share in QUIET)
        share = np.clip((end - np.arange(samples)) / (end - begin), 0.0, 1.0)
        s = ground(rng, seed % 2 == 1, samples) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        a = np.gradient(np.gradient(s, DT, edge_order=2), DT, edge_order=2)
        a *= times * self.peak / np.abs(a).max()
        floors, drifts = self.shaken(a, sensors)
        noise = [NOISE * u.std(axis=0) * rng.standard_normal(u.shape) for u in (a, floors)]
        wires = {}
        for e in storeys:
            y, zero = drifts[:, e - 1], rng.uniform(-0.1, 0.1)
            wires[f"drift{e}"] = y + NOISE * y.std() * rng.standard_normal(samples) + zero
        return Event(a + noise[0], floors + noise[1], drifts, wires)


def storey(kind: str, rng: np.random.Generator, pair: Sequence[str], k: float, y: float) -> Element:
    """The law of a storey of stiffness k that yields at y."""
    own: dict[str, Any] = {"between": pair, "stiffness": k}
    hardening = rng.uniform(0.02, 0.08)
    if kind in ("steel", "concrete"):
        own |= {"yield_displacement": y, "hardening_ratio": hardening}
    if kind == "steel":
        return MenegottoPinto(**own, sharpness=rng.uniform(10.0, 20.0), a1=0.0, a3=0.0)
    if kind == "concrete":
        return Takeda(**own, unloading_exponent=rng.uniform(0.2, 0.5))
    own |= {"post_yield_ratio": hardening, "beta": 0.6 / y, "gamma": 0.4 / y}
    if kind == "pinching":
        work = k * y**2
        own |= {"eta_rate": 0.008 / work, "nu_rate": 0.002 / work, "pinching_rate": 0.1 / work}
        own |= {"pinching": rng.uniform(0.6, 0.85), "pinching_place": 0.1, "pinching_lambda": 0.1}
        own |= {"pinching_width": y, "pinching_spread": 0.003 * y / work}
    return BaberNoori(**own)


def building(kind: str, number: int, samples: int = SAMPLES) -> Building:
    rng = np.random.default_rng([number, *kind.encode()])
    masses = 3e4 * rng.uniform(0.8, 1.2, STOREYS) * 10.0 ** rng.uniform(-1.0, 1.0)
    period, scatter = rng.uniform(0.4, 1.1), np.exp(0.1 * rng.standard_normal((2, STOREYS)))
    k = of_period(shear(masses) ** rng.uniform(0.3, 1.0) * scatter[0], masses, period)
    weakest = rng.uniform(1.0, 3.0) * masses.sum()
    yields = weakest * shear(masses) ** rng.uniform(0.6, 1.0) * scatter[1] / k
    nodes, w = ["ground", *(f"x{i + 1}" for i in range(STOREYS))], 2.0 * np.pi / period
    parts = {
        f"r{i + 1}": storey(kind, rng, nodes[i : i + 2], k[i], yields[i]) for i in range(STOREYS)
    }
    damper = partial(Polynomial, stiffness=0.0)
    for i, node in enumerate(nodes[1:]):  # 2 % of damping by the storeys, 1 % by the masses
        parts[f"c{i + 1}"] = damper(between=(nodes[i], node), damping=0.04 / w * k[i])
        parts[f"d{i + 1}"] = damper(between=("ground", node), damping=0.02 * w * masses[i])
    case = Building(kind, Structure(masses.tolist(), parts), yields, 0.0)
    ductility = rng.uniform(2.0, 6.0)  # of the storey that yields most, in training

    def too_strong(peak: float) -> bool:
        shaken = replace(case, peak=peak)
        events = [shaken.event(1000 * number + i, [STOREYS], samples) for i in TRAINED]
        return max(float((np.abs(e.drifts) / yields).max()) for e in events) > ductility

    low, high = WEAKEST
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if too_strong(middle) else (middle, high)
    return replace(case, peak=high)


@dataclass(frozen=True)
class Method:
    name: str
    drifts: Estimate
    seconds: float = 0.0  # of the processor, for the fit
    wrong: bool | None = None  # its fit
    half: Callable[[Event], np.ndarray] | None = None  # of the 95 % interval of each peak (E,)


def network(
    case: Building, train: Sequence[Event], masses: np.ndarray, options: Namespace
) -> Iterator[Method]:
    """The model, identified, then on line beside it; prints the laws that it chose."""
    begin, sensors = time.process_time(), options.sensors
    laws = [type(case.structure.elements["r1"]).__name__] if options.quick else "named"
    model: Any = ElementNetwork(
        STOREYS, 1, DT, "chain", masses=masses.tolist(), forced="base", laws=laws,
        from_accelerations=True, sensors=sensors, others=[f"drift{e}" for e in options.drifts],
    )  # fmt: skip
    facts = model.identify([stack([event.record for event in train])])
    seconds = time.process_time() - begin
    traces = [model.trace(event.record.drive()) for event in train]
    left = [trace.response.a - e.record.a for trace, e in zip(traces, train, strict=True)]
    own = [case.shaken(e.ground, sensors)[0] - e.floors for e in train]
    misfit, noise = float(torch.cat(left).norm()), float(np.linalg.norm(own))
    found = ", ".join(dict.fromkeys(str(facts.get("laws", "")).split(", ")))
    print(f"  {found}; {misfit / noise:.3f} times the structure's own training error", flush=True)

    def half(event: Event) -> np.ndarray:
        rows = storeys_of(model, event.record.drive())
        return np.array([row["peak_half"] for row in rows], dtype=float)

    @lru_cache(1)
    def followed(event: Event) -> tuple[np.ndarray, np.ndarray]:
        stream, rows = model.stream(), []
        for sample in samples_of(event.record):
            stream.step(sample)
            rows.append(stream.drifts[0])
        return np.array(rows), stream.drifts[3]

    drifts = lambda e: model.trace(e.record.drive()).deformations.numpy()
    yield Method("network, named laws", drifts, seconds, misfit > noise, half)
    on_line = lambda event: followed(event)[0]
    yield Method("network, on line", on_line, half=lambda event: followed(event)[1])

    @lru_cache(1)
    def by_all(event: Event) -> tuple[np.ndarray, np.ndarray]:
        y, halves = drifts(event), np.full(1, np.nan)  # where the sensors contradict the model
        if (found := smoothed(model, event.record)) is not None:
            y, halves = found[0], found[1][np.abs(found[0]).argmax(axis=0), np.arange(STOREYS)]
        return y, halves

    yield Method("network, smoothed", lambda e: by_all(e)[0], half=lambda e: by_all(e)[1])


def methods(
    case: Building, train: Sequence[Event], masses: np.ndarray, options: Namespace
) -> Iterator[Method]:
    sensors: list[int] = options.sensors
    yield Method("the structure itself", lambda e: case.shaken(e.ground, sensors)[1])
    if not options.usual:
        yield from network(case, train, masses, options)
    for name, spline in SPLINES.items():
        yield Method(name, partial(interpolated, sensors=sensors, storeys=STOREYS, spline=spline))
    begin = time.process_time()
    chain = Chain(masses, sensors).fitted(train)
    yield Method("linear", chain.drifts, time.process_time() - begin)
    channels = np.concatenate([np.column_stack([e.ground, e.floors]) for e in train])
    smoother = Smoother(chain, channels.std(axis=0)).fitted(train)
    yield Method("linear, smoothed", smoother.drifts, time.process_time() - begin)


@dataclass(frozen=True)
class Outcome:
    """Of a method and a building."""

    method: Method
    peaks: Sequence[np.ndarray]  # errors (B, E) [%] in unseen motions and in larger ones
    residual: np.ndarray  # errors (B, E) of residual drifts, over yield drifts
    held: Sequence[np.ndarray]  # whether intervals hold the true peaks (E,), by motion


def outcomes(kind: str, number: int, options: Namespace) -> Iterator[Outcome]:
    """All methods on the building of a kind and number."""
    samples = QUICK if options.quick else SAMPLES
    case, first = building(kind, number, samples), 1000 * number
    event = partial(case.event, sensors=options.sensors, samples=samples, storeys=options.drifts)
    train = [event(first + i) for i in TRAINED]
    reached = np.max([np.abs(e.drifts).max(axis=0) for e in train], axis=0) / case.yields
    span = f"{reached.min():.1f} to {reached.max():.1f}"
    print(f"{kind}, building {number}, ductilities {span}", flush=True)
    unseen = [
        [event(first + 101 + i, times=t) for i in range(options.unseen)] for t in (1.0, FARTHER)
    ]
    rng, masses = np.random.default_rng(first), case.structure.masses
    believed = masses * np.exp(options.masses_off * rng.standard_normal(STOREYS))
    for method in methods(case, train, believed, options):
        pairs = [[(method.drifts(e), e.drifts) for e in events] for events in unseen]
        peaks = [
            np.array([np.abs(np.abs(y).max(0) / np.abs(true).max(0) - 1.0) for y, true in part])
            for part in pairs
        ]
        left = [(y[-LAST:] - true[-LAST:]).mean(axis=0) / case.yields for y, true in pairs[0]]
        sizes = [[np.abs(u).max(axis=0) for u in both] for both in pairs[0]]
        held = [
            np.abs(own - true) <= method.half(event)
            for (own, true), event in zip(sizes, unseen[0], strict=True)
            if method.half is not None
        ]
        yield Outcome(method, [100.0 * p for p in peaks], np.abs(left), held)


def row(some: Sequence[Outcome]) -> list[str]:
    """A method's errors over some buildings."""
    peaks = [np.concatenate(parts) for parts in zip(*(o.peaks for o in some), strict=True)]
    cells = [f"{np.median(p):.1f}/{np.quantile(p, 0.9):.1f}" for p in peaks]
    residual = np.quantile(np.concatenate([o.residual for o in some]), 0.9)
    wrong = [o.method.wrong for o in some if o.method.wrong is not None]
    counted = f"{sum(wrong)}/{len(wrong)}" if wrong else ""
    held = [one for o in some for one in o.held]
    share = f"{100.0 * np.mean(held):.0f} %" if held else ""
    seconds = np.mean([o.method.seconds for o in some])
    return [some[0].method.name, *cells, f"{residual:.2f}", share, counted, f"{seconds:.1f}"]


def main() -> None:
    parser = Parser(description=(__doc__ or "").partition("\n\n")[0])
    add = parser.add_argument
    add("--structures", type=int, default=10, help="of the three kinds; a third as many pinch")
    add("--sensors", type=int, nargs="+", default=[3, 5], metavar="FLOOR", help="that have sensors")
    add("--drifts", type=int, nargs="+", default=[], metavar="STOREY", help="with a draw wire")
    add("--unseen", type=int, default=10, metavar="MOTIONS", help="of each building")
    add("--masses-off", type=float, default=0.0, metavar="SHARE", help="by which masses are wrong")
    add("--usual", action="store_true", help="without the model")
    add("--seed", type=int, default=0, help="of the first building")
    add("--quick", action="store_true", help="a building, the kind of its laws known")
    add("--filter", type=int, metavar="RECORDS", help="of planted fits, which are followed on line")
    options = parser.parse_args()
    for key in ("sensors", "drifts"):
        if not set(getattr(options, key)) <= set(range(1, STOREYS + 1)):
            raise ValueError(f"--{key} {getattr(options, key)}: numbers are 1 to {STOREYS}")
    options.sensors = sorted(set(options.sensors))
    if options.filter:
        show_filters(options.filter, KINDS, building, options.sensors)
        return
    if options.quick:
        options.structures, options.unseen = 1, 2
    count = options.structures
    cases = [(KINDS[i % len(KINDS)], options.seed + i) for i in range(count)]
    cases += [("pinching", options.seed + i) for i in range(count // len(KINDS))]
    found = [(kind, o) for kind, number in cases for o in outcomes(kind, number, options)]
    groups = {kind: (kind,) for kind in KINDS} | {"all three": KINDS, "pinching": ("pinching",)}
    head = ("method", "peak [%]", "1.5 times", "residual", "in 95 %", "wrong", "s")
    for title, kinds in groups.items():
        own = [o for kind, o in found if kind in kinds]
        names = dict.fromkeys(o.method.name for o in own)
        if own and (len(kinds) == 1 or not options.quick):
            show(title, head, [row([o for o in own if o.method.name == name]) for name in names])


if __name__ == "__main__":
    with command_errors():
        main()
