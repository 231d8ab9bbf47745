"""How well do networks of elements learn structures whose laws they do not contain, in free run?

    python -m benchmarks.unplanted                     # some three hours
    python -m benchmarks.unplanted --cases "flag, 3 storeys" --models element_network_named
    python -m benchmarks.unplanted --noise 0.02        # accelerations alone, with noise
    python -m benchmarks.unplanted --noise 0.02 --masses-off 0.05  # and the masses that are given
    python -m benchmarks.unplanted --noise 0.02 --settings  # of the search, half and double
    python -m benchmarks.unplanted --quick             # a minute, once all is compiled

Chains on a shaking ground: steel with growing yield, flags, friction pendulums, slack braces,
pinching walls, concrete. A model is given the masses, the chain and six records of 30 s with
displacements, velocities and absolute accelerations; it simulates four unseen motions from rest,
and the same with 1.5 times the ground motion. Prints relative RMS errors of the accelerations [%]
and seconds of the processor. The row `1 % stiffer` is the structure itself with elements so much
stiffer: the yardstick. `element_network_named` searches among laws with a name, the true ones among
them; `element_network_branch` knows no law.   forces in N, lengths in m
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from benchmarks.fitting import fit, free_run_error
from benchmarks.table import show, varied
from data import (
    BaberNoori,
    FrictionPendulum,
    MenegottoPinto,
    Polynomial,
    SelfCentering,
    SlackBrace,
    Structure,
    Takeda,
)  # fmt: skip
from data.arguments import Parser
from data.record import Record
from data.simulation.laws.element import Element
from data.simulation.motion import simulate
from models.named_laws import storey
from runner.config.command_line import command_errors

DT, SAMPLES = 0.01, 3000
PEAK, FARTHER = 2.5, 1.5  # [m/s²] of the largest ground motion; times the unseen ones
TRAINED, UNSEEN = (1.0, 0.8, 0.6, 0.9, 0.5, 0.7), (0.95, 0.75, 0.85, 0.6)  # of the peak
PER_STIFFNESS = 0.003  # [s]: damping of a storey over its stiffness
MODELS = ("linear", "element_network", "element_network_branch", "element_network_named")
QUICK = {"element_network_named": ("model.laws=[SlackBrace]",)}
Law = Callable[[Sequence[str]], Element]  # of the nodes that it joins


@dataclass(frozen=True)
class Case:
    """Masses [kg], and the laws in parallel of every storey."""

    masses: Sequence[float]
    storeys: Sequence[Sequence[Law]]

    def structure(self, stiffer: float = 1.0) -> Structure:
        nodes = ["s1", *(f"x{i + 1}" for i in range(len(self.masses)))]
        elements = {
            f"r{i + 1}_{j + 1}": law(nodes[i : i + 2])
            for i, laws in enumerate(self.storeys)
            for j, law in enumerate(laws)
        }
        changed = {
            name: replace(e, **{fibre: stiffer * getattr(e, fibre) for fibre in e.fibres})
            for name, e in elements.items()
        }
        return Structure(list(self.masses), changed)


def steel(k: float, yielding: float, growth: float = 0.03) -> Law:
    return lambda pair: MenegottoPinto(
        between=pair, stiffness=k, yield_displacement=yielding, hardening_ratio=0.025,
        sharpness=18.5, a1=growth, a3=growth, damping=PER_STIFFNESS * k,
    )  # fmt: skip


def flag(k: float, opening: float) -> Law:
    return lambda pair: SelfCentering(
        between=pair, stiffness=k, activation_displacement=opening, hardening_ratio=0.07, flag=0.7,
        damping=PER_STIFFNESS * k,
    )  # fmt: skip


def slack(k: float) -> Law:
    return lambda pair: SlackBrace(
        between=pair, stiffness=k, yield_displacement=0.008, hardening_ratio=0.03, gap=0.0015
    )


def spring(k: float, damped: float = PER_STIFFNESS) -> Law:
    return lambda pair: Polynomial(between=pair, stiffness=k, damping=damped * k)


def bearing(weight: float) -> Law:
    return lambda pair: FrictionPendulum(
        between=pair, weight=weight, radius=1.8, friction_fast=0.09, friction_slow=0.035,
        rate=25.0, yield_displacement=0.0008,
    )  # fmt: skip


def pinching(k: float) -> Law:
    return lambda pair: BaberNoori(
        between=pair, stiffness=k, post_yield_ratio=0.06, beta=70.0, gamma=40.0, eta_rate=1.5e-5,
        nu_rate=4e-6, pinching=0.75, pinching_rate=2e-4, pinching_place=0.1, pinching_width=0.01,
        pinching_spread=5e-8, pinching_lambda=0.1,
    )  # fmt: skip


def concrete(k: float) -> Law:
    return lambda pair: Takeda(
        between=pair, stiffness=k, yield_displacement=0.007, hardening_ratio=0.05,
        unloading_exponent=0.35, damping=PER_STIFFNESS * k,
    )  # fmt: skip


CASES = {
    "steel, 3 storeys": Case([3e4] * 3, [[steel(k, 0.010)] for k in (2.0e7, 1.76e7, 1.52e7)]),
    "steel, 10 storeys": Case(
        [3e4] * 10, [[steel(k * 1e7, 0.008)] for k in np.linspace(6.0, 2.4, 10)]
    ),
    "flag, 3 storeys": Case([3e4] * 3, [[flag(k, 0.008)] for k in (2.4e7, 2.0e7, 1.6e7)]),
    "friction pendulum, 3 masses": Case(
        [3e5, 2.5e5, 2.5e5], [[bearing(7.85e6)], [spring(3.2e8)], [spring(2.2e8)]]
    ),
    "slack braces in frames, 2 storeys": Case(
        [3e4] * 2, [[slack(0.5 * k), spring(k, 0.006)] for k in (2.0e7, 1.6e7)]
    ),
    "pinching walls, 2 storeys": Case(
        [1.5e4, 1.0e4], [[pinching(k), spring(0.02 * k)] for k in (6e6, 4.5e6)]
    ),
    "concrete, 3 storeys": Case([3e4] * 3, [[concrete(k)] for k in (2.6e7, 2.2e7, 1.8e7)]),
    "steel and flag, 4 storeys": Case(
        [2.5e4] * 4,
        [[steel(2.6e7, 0.009, 0.0)], [flag(2.3e7, 0.008)], [steel(1.9e7, 0.008, 0.04)],
         [flag(1.5e7, 0.007)]],
    ),
}  # fmt: skip


def ground(rng: np.random.Generator, earthquake: bool, samples: int) -> np.ndarray:
    """Displacement (T,) of the ground from rest, its largest acceleration 1 m/s²."""
    frequency = np.fft.rfftfreq(2 * samples, DT)
    band = (frequency > 0.25) & (frequency < (8.0 if earthquake else 4.0))
    own = frequency / rng.uniform(1.5, 3.0)
    shape = np.ones_like(own)
    if earthquake:  # Kanai & Tajimi's ground
        shape = np.sqrt((1.0 + 1.44 * own**2) / ((1.0 - own**2) ** 2 + 1.44 * own**2))
    shape = np.where(band, shape / np.maximum(frequency, 0.25) ** 2, 0.0)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(frequency))
    t = DT * np.arange(samples)
    share = np.minimum(t / 3.0, 1.0)
    rise = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    if earthquake:
        rise = rise * np.exp(-0.5 * (np.maximum(t - 8.0, 0.0) / 5.0) ** 2)
    s = rise * np.fft.irfft(shape * np.exp(1j * phase))[:samples]
    return s / np.abs(np.gradient(np.gradient(s, DT, edge_order=2), DT)).max()


def record(structure: Structure, peak: float, seed: int, samples: int) -> Record:
    """The motion of a structure; even seeds are random ground motions, odd ones earthquakes."""
    s = peak * ground(np.random.default_rng(seed), seed % 2 == 1, samples)[:, None]
    s_dot = np.gradient(s, DT, axis=0, edge_order=2)
    motion = simulate(structure, np.zeros((samples, structure.dofs)), DT, s, s_dot)
    a, x, v = map(torch.from_numpy, (motion.a, motion.x, motion.v))
    ground_motion, rate = torch.from_numpy(s), torch.from_numpy(s_dot)
    return Record(DT, a, a.new_zeros(samples, 0), x, v, ground_motion, rate)


def noisy(record: Record, noise: float, seed: int) -> Record:
    """The accelerations alone, with noise; the record itself where there is none."""
    if noise == 0.0:
        return record
    drawn = torch.randn(record.a.shape, generator=torch.Generator().manual_seed(seed)).double()
    return replace(record, a=record.a + noise * record.a.std(dim=0) * drawn, x=None, v=None)


def apart(some: Sequence[Record], others: Sequence[Record]) -> float:
    """Relative RMS difference of motions [%]."""
    pairs = zip(some, others, strict=True)
    squares = sum(float(((one.a - two.a) ** 2).sum()) for one, two in pairs)
    return 100.0 * (squares / sum(float((other.a**2).sum()) for other in others)) ** 0.5


def rows(
    case: Case, models: Sequence[str], noise: float, off: float, seed: int, quick: bool
) -> Iterator[list]:
    """The yardstick, then each model: errors in training, unseen and larger motions, seconds."""
    samples = 600 if quick else SAMPLES

    def motions(stiffer: float = 1.0) -> list[list[Record]]:
        parts = (100, TRAINED, 1.0), (200, UNSEEN, 1.0), (200, UNSEEN, FARTHER)
        structure = case.structure(stiffer)
        return [
            [record(structure, t * PEAK * s, first + i, samples) for i, s in enumerate(sizes)]
            for first, sizes, t in parts
        ]

    true = motions()
    pairs = zip(motions(1.01), true, strict=True)
    yield ["1 % stiffer", *(f"{apart(some, others):.2f}" for some, others in pairs), ""]
    train = [noisy(r, noise, 1000 * (seed + 1) + i) for i, r in enumerate(true[0])]
    for model in models:
        words = [f"model={model}", f"seed={seed}", *(QUICK.get(model, ()) if quick else ())]
        if model != "linear":
            drawn = np.random.default_rng(seed).standard_normal(len(case.masses))
            masses = (np.array(case.masses) * np.exp(off * drawn)).tolist()
            words += ["model.elements=chain", "model.forced=[]", f"model.masses={masses}"]
        begin = time.process_time()
        estimator, _ = fit(words, train)
        seconds = time.process_time() - begin
        errors = [free_run_error(estimator, part) for part in (train, *true[1:])]
        yield [model, *(f"{error:.2f}" for error in errors), f"{seconds:.0f}"]


def by_settings(name: str, noise: float, off: float, seed: int, quick: bool) -> Iterator[list]:
    """Named laws of a case, found with each setting of the race in storeys half and double."""
    before = storey.SETTINGS
    try:
        for word, storey.SETTINGS in varied(before):
            *_, (_, *errors) = rows(CASES[name], MODELS[-1:], noise, off, seed, quick)
            yield [word, *errors]
    finally:
        storey.SETTINGS = before


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--cases", nargs="+", metavar="CASE", default=list(CASES), choices=CASES, help="structures")
    add("--models", nargs="+", metavar="MODEL", default=MODELS, choices=MODELS, help="estimators")
    add("--noise", type=float, default=0.0, help="of the standard deviation of accelerations")
    add("--masses-off", type=float, default=0.0, metavar="SHARE", help="by which masses are wrong")
    add("--seed", type=int, default=0)
    add("--settings", action="store_true", help="of the race of laws, each at half and double")
    add("--quick", action="store_true", help="one structure, 6 s of motion, two models")
    options = parser.parse_args()
    torch.set_num_threads(1)
    if options.quick:
        options.cases, options.models = ["slack braces in frames, 2 storeys"], MODELS[::3]
    if options.settings and options.noise == 0.0:
        raise ValueError("--settings varies the search from accelerations alone; add --noise 0.02")
    head = ("model", "training", "unseen", "1.5 times", "seconds")
    how = options.models, options.noise, options.masses_off, options.seed, options.quick
    for name in options.cases:
        if options.settings:
            show(name, ("settings", *head[1:]), by_settings(name, *how[1:]))
        else:
            show(name, head, rows(CASES[name], *how))


if __name__ == "__main__":
    with command_errors():
        main()
