"""Is the law of an element found by its name, and how far is it from unseen motion?

    python -m benchmarks.elements                      # 16 laws, 3 draws, noise 0 and 2 %
    python -m benchmarks.elements --seed 1             # other draws
    python -m benchmarks.elements --settings           # each setting of the race, half and double
    python -m benchmarks.elements --quick

Laws are those of benchmarks/planted.py, each number of a law drawn within a factor of 1.4 of it,
stiffness, deformation and time over many powers of ten. Three motions train, three are unseen;
noise is that of the force, of its standard deviation. Times are those of the processor.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planted import LAWS, harmonic, laws
from benchmarks.table import show, varied
from data.arguments import Parser
from data.parallel import take_threads
from data.simulation import element_test
from data.simulation.laws.element import Element
from data.simulation.motion import EscapedMotionError
from models.fit.race import Settings
from models.named_laws import choice
from models.named_laws.fit import Motion
from models.named_laws.learned import require_laws
from runner.config.command_line import command_errors
from runner.folder.run_folder import write_json

SAMPLES, FACTOR = 1500, 1.4
SIZES = (1.0, 0.8, 0.6), (0.9, 0.75, 0.5)  # of the largest motion: trained, unseen
NAMES = {  # of what is planted: the named law that has it, if there is one
    "linear": "Linear", "bilinear": "Bilinear", "steel": "MenegottoPinto", "flag": "SelfCentering",
    "concrete": "Takeda", "joint": "Hysteretic", "hardening": "HardeningSpring",
    "wall": "Pinching4", "timber": "BaberNoori", "limited slip": "LimitedSlip",
    "slack brace": "SlackBrace", "pendulum": "FrictionPendulum", "fluid damper": "PowerDamper",
    "relief valve": "TanhDamper", "damper on a brace": "BracedDamper",
}  # fmt: skip


def drawn(element: Element, rng: np.random.Generator) -> Element:
    """The law with other numbers, of which it allows all."""
    while True:
        more: dict[str, Any] = {}
        for field in fields(element):
            value = getattr(element, field.name)
            if isinstance(value, float) and value != 0.0:
                new = value * math.exp(rng.uniform(-1.0, 1.0) * math.log(FACTOR))
                more[field.name] = value if value < 1.0 <= new else new
        try:
            return replace(element, **more)
        except ValueError:  # as where a place of an envelope lies before the one before it
            continue


def case(name: str, seed: int, draw: int, noise: float) -> list[list[Motion]]:
    """Motions to train on, and unseen ones. noise: percent. Laws that escape are drawn again."""
    rng = np.random.default_rng([seed, draw, LAWS.index(name)])
    dt, k, y = 10.0 ** rng.uniform((-2.5, 0.0, -4.0), (-1.0, 9.0, 1.0))
    planted = laws(("ground", "x1"), k, y, y / (40.0 * dt))[name]
    while True:
        elements, reach = [drawn(one, rng) for one in planted], y * rng.uniform(2.5, 6.0)
        try:
            return [
                [motion(elements, share * reach, dt, noisy, rng) for share in sizes]
                for sizes, noisy in zip(SIZES, (noise, 0.0), strict=True)
            ]
        except EscapedMotionError:
            continue


def motion(
    elements: Sequence[Element], size: float, dt: float, noise: float, rng: np.random.Generator
) -> Motion:
    s = harmonic(rng, (0.0015 / dt, 0.02 / dt), dt * np.arange(SAMPLES))
    s *= size / np.abs(s).max()
    rate = np.gradient(s, dt, edge_order=2)
    r = np.sum([element_test.force(one, s, dt, rate) for one in elements], axis=0)
    r += 0.01 * noise * r.std() * rng.standard_normal(SAMPLES)
    return Motion(dt, s, rate, r, np.zeros((SAMPLES, 0)))


def found(name: str, seed: int, draw: int, noise: float) -> dict[str, Any]:
    """Which law was chosen, its error on unseen motion in percent, seconds of the processor."""
    train, unseen = case(name, seed, draw, noise)
    begin = time.process_time()
    fit, _ = choice.choose_law(train, require_laws("named"), seed)
    seconds = time.process_time() - begin
    right = name in NAMES and NAMES[name] in fit.kind
    error = 100.0 * fit.error_on(unseen)
    return {"law": name, "noise": noise, "draw": draw, "chosen": fit.kind, "right": right,
            "error": error, "seconds": seconds}  # fmt: skip


def row(name: str, cases: Sequence[dict[str, Any]]) -> list[str]:
    errors, known = [c["error"] for c in cases], [c for c in cases if c["law"] in NAMES]
    right = f"{sum(c['right'] for c in known)}/{len(known)}" if known else "not named"
    return [name, right, f"{np.median(errors):.3f}", f"{max(errors):.3f}",
            f"{np.mean([c['seconds'] for c in cases]):.1f}"]  # fmt: skip


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 2.0], help="percent")
    parser.add_argument("--laws", nargs="+", default=list(LAWS), choices=LAWS, metavar="LAW")
    parser.add_argument("--settings", action="store_true", help="half and double of each")
    parser.add_argument("--quick", action="store_true", help="two laws, one draw")
    parser.add_argument("--processes", type=int, default=-1, help="side by side; -1: all cores")
    parser.add_argument("--output", type=Path, help="a JSON file of all cases")
    options = parser.parse_args()
    if options.quick:
        options.laws, options.draws = ["flag", "slack brace"], 1
    take_threads(1)
    work = [
        (name, options.seed, draw, noise)
        for name in options.laws
        for draw in range(options.draws)
        for noise in options.noise
    ]
    head = ("law", "right", "median %", "most %", "seconds")
    if options.settings:
        all_settings = varied(Settings())
        show("settings", head, [row(word, _all(work, one, options)) for word, one in all_settings])
        return
    cases = _all(work, Settings(), options)
    for noise in options.noise:
        some = [one for one in cases if one["noise"] == noise]
        parts = [(name, [c for c in some if c["law"] == name]) for name in options.laws]
        show(f"noise {noise:g} %", head, [row(*part) for part in (*parts, ("all", some))])
    if options.output is not None:
        write_json(options.output, {"cases": cases})


def _all(work: Sequence[tuple[Any, ...]], settings: Settings, options: Any) -> list[dict[str, Any]]:
    """All cases, each of them printed as it ends."""
    from joblib import Parallel, delayed

    pool, choose = Parallel(options.processes, return_as="generator"), delayed(_found)
    cases = []
    for one in pool(choose(settings, *own) for own in work):
        cases.append(one)
        print(f"{one['law']}, draw {one['draw']}, noise {one['noise']:g} %: {one['chosen']}, "
              f"{one['error']:.3f} %, {one['seconds']:.0f} s", flush=True)  # fmt: skip
    return cases


def _found(settings: Settings, *one: Any) -> dict[str, Any]:
    take_threads(1)
    choice.SETTINGS = settings
    return found(*one)


if __name__ == "__main__":
    with command_errors():
        main()
