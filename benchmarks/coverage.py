"""Do 95 % intervals and bands of a fit hold the truth, is a brace named that the model lacks?

    python -m benchmarks.coverage                # 200 cases a kind, 40 minutes on two cores
    python -m benchmarks.coverage --cases 20     # in small
    python -m benchmarks.coverage --quick        # one case a kind

A case is a chain of two or three masses drawn at random, its number the seed: elements that yield,
or springs that harden, under random forces; accelerations alone with noise of 5 %, white, coloured
or about one frequency. A network is fitted to two records of 15 s. Prints by kind of noise the
share of 95 % intervals of parameters that hold the truth, and the mean share of the samples of an
unseen motion inside its 95 % bands: acceleration, measurement, displacements and forces. Of
structures with a brace beyond the chain: how often the criticism names it first, or none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from statistics import mean
from typing import Any

import numpy as np
import torch
from joblib import Parallel, delayed
from scipy.signal import lfilter

from benchmarks.fitting import fit
from benchmarks.table import show
from data.arguments import Parser
from data.record import Record, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.laws.bilinear import Bilinear
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models.element_network import ElementNetwork
from models.physical.parameters import truth_of
from models.uncertainty.bands import DISPLACEMENT, FORCE, half_widths, unmeasured
from models.uncertainty.criticism import ELEMENT, LAW, criticism_of
from models.uncertainty.intervals import DETERMINED, intervals_of
from models.uncertainty.laplace import laplace
from runner.config.command_line import command_errors

DT, DURATION, TRAINING = 0.01, 15.0, 2  # [s], [s], records
LEVEL = 0.05  # of the noise, over the standard deviation of a channel
KINDS = ("white", "coloured", "brace", "hardening")
YIELDS, STAYS = (0.2, 0.5), (2.0, 4.0)  # of the elastic deformation: yield displacements
WORDS = (  # of train.py, as small as the structures are
    "model=element_network", "model/reads=accelerations", "model.hinges=0", "objective.starts=6",
    "objective.finalists=2", "objective.start_iterations=10", "objective.horizons=[300,null]",
)  # fmt: skip
UNITS, CUBIC = ("model.units=2", "model.cubic=false"), ("model.units=0", "model.cubic=true")


def run_case(kind: str, number: int) -> dict[str, Any] | None:
    """The result of a case; None where it has no fit or an interval that is not finite."""
    torch.set_num_threads(1)
    try:
        return judge(kind, number)
    except ValueError:
        return None


def judge(kind: str, number: int) -> dict[str, Any]:
    """Which intervals hold the truth, the shares that bands hold [%], and what is asked for."""
    seed = np.random.SeedSequence(number, spawn_key=(KINDS.index(kind),))
    rng = np.random.default_rng(seed)
    dofs = 3 if kind == "brace" else int(rng.integers(2, 4))
    structure = draw(rng, dofs, kind)
    clean = records(structure, number)
    shape = noise_filter(kind, rng)
    measured = [noisy(record, rng, shape) for record in clean]
    train = measured[:TRAINING]
    chain = ",".join(f"[{'ground' if i == 0 else f'x{i}'},x{i + 1}]" for i in range(dofs))
    laws = CUBIC if kind == "hardening" else UNITS
    model, _ = fit([*WORDS, *laws, f"model.elements=[{chain}]", f"seed={number}"], train)
    assert isinstance(model, ElementNetwork)
    found = laplace(model, [stack(train)])
    assert found is not None
    findings = criticism_of(model, found, [stack(train)])
    doubted = any(f.significant and f.kind in (ELEMENT, LAW) for f in findings)
    known = truth_of(structure, model)
    told = [i for i in intervals_of(model, found) if i.status == DETERMINED and known.get(i.name)]
    yielding = {i.name.split(".")[0] for i in told if i.name.endswith("yield_displacement")}
    held = [
        abs(i.value - known[i.name]) <= (i.model_error if doubted else i.half)
        for i in told
        if "post_yield" not in i.name or i.name.split(".")[0] in yielding
    ]
    missing = [f for f in findings if f.kind == ELEMENT and f.significant]
    brace = structure.elements.get("brace")
    named = bool(missing) and brace is not None and missing[0].name == "–".join(brace.between)
    bands = shares_held(model, found, measured[TRAINING], clean[TRAINING])
    return {"held": held, "bands": bands, "missing": bool(missing), "named": named}


def draw(rng: np.random.Generator, dofs: int, kind: str) -> Structure:
    """A chain whose elements yield, sometimes all but one; or harden; or have a parallel brace."""
    masses = np.exp(rng.uniform(np.log(0.5), np.log(3.0), dofs))
    omega = 2.0 * np.pi * rng.uniform(1.0, 2.0)
    stiffness = omega**2 * masses.mean() * np.exp(rng.uniform(-0.4, 0.4, dofs)) * dofs
    damping = stiffness * rng.uniform(0.01, 0.04, dofs) * 2.0 / omega
    pairs = [("ground" if i == 0 else f"x{i}", f"x{i + 1}") for i in range(dofs)]
    elements: dict[str, Element] = {
        f"r{i + 1}": Polynomial(between=pairs[i], stiffness=stiffness[i], damping=damping[i])
        for i in range(dofs)
    }
    if kind == "brace":
        ends = [("ground", "x2"), ("x1", "x3"), ("ground", "x3")][int(rng.integers(3))]
        size = float(stiffness.mean() * rng.uniform(0.25, 0.6))
        elements["brace"] = Polynomial(between=ends, stiffness=size, damping=0.02 * size / omega)
    elastic = records(Structure(masses.tolist(), elements), 10**6)
    x = torch.cat([record.x for record in elastic if record.x is not None])
    largest = torch.diff(x, dim=1, prepend=x.new_zeros(len(x), 1)).abs().amax(dim=0).tolist()
    if kind == "hardening":  # by 0.1 to 1 of the linear force at the largest deformation
        for i in range(dofs):
            cubic = float(stiffness[i] * rng.uniform(0.1, 1.0) / largest[i] ** 2)
            spring = {"stiffness": stiffness[i], "damping": damping[i], "cubic_stiffness": cubic}
            elements[f"r{i + 1}"] = Polynomial(between=pairs[i], **spring)
        return Structure(masses.tolist(), elements)
    resting = [int(rng.integers(dofs))] if kind != "brace" and rng.uniform() < 0.5 else []
    for i in range(dofs):
        bend = float(rng.uniform(*(STAYS if i in resting else YIELDS)) * largest[i])
        after = float(stiffness[i] * rng.uniform(0.2, 0.7))
        elements[f"r{i + 1}"] = Bilinear(
            between=pairs[i], yield_displacement=bend, stiffness=stiffness[i],
            post_yield_stiffness=after, damping=damping[i], post_yield_damping=damping[i],
        )  # fmt: skip
    return Structure(masses.tolist(), elements)


def records(structure: Structure, seed: int) -> list[Record]:
    """Training records and one of a test, under random forces on all masses."""
    forces = Excitation(force=BandLimitedGaussian(1.0, (0.1, 4.0)))
    simulation = Simulation(structure, forces, FullState(), DT, DURATION)
    parts = (("train", TRAINING), ("test", 1))
    return [r for split, count in parts for r in simulation.records(split, count, seed, 0)[0]]


def noise_filter(kind: str, rng: np.random.Generator) -> list[float]:
    """Denominator of the filter that shapes white noise: none, slow, about one frequency."""
    if kind == "hardening":
        omega = 2.0 * np.pi * rng.uniform(0.5, 4.0) * DT
        return [1.0, -2.0 * 0.98 * float(np.cos(omega)), 0.98**2]
    return [1.0, -0.95] if kind == "coloured" else [1.0]


def noisy(record: Record, rng: np.random.Generator, shape: list[float]) -> Record:
    """Accelerations alone, with noise of LEVEL."""
    drawn = rng.standard_normal((record.samples + 200, record.dofs))
    impulse = lfilter([1.0], shape, np.eye(1, 2000)[0])
    drawn = lfilter([1.0 / float(np.linalg.norm(impulse))], shape, drawn, axis=0)
    a = record.a + LEVEL * record.a.std(dim=0) * torch.from_numpy(drawn[200:].copy())
    return replace(record, a=a, x=None, v=None, truth=None)


def shares_held(model: Any, found: Any, measured: Record, true: Record) -> list[float]:
    """Shares [%] of samples within 95 % bands: motion, sensors, displacements, forces."""
    of_motion, of_sensors = half_widths(model, found, measured)
    with torch.no_grad():
        run = model.free_run(measured.drive()).a
    assert true.truth is not None
    unseen = unmeasured(model, found, measured)
    shares = (
        ((true.a - run).abs() <= of_motion).double().mean(),
        ((measured.a - run).abs() <= of_sensors).double().mean(),
        unseen[DISPLACEMENT].coverage(true.truth.x),
        unseen[FORCE].coverage(true.truth.r[:, : len(model.elements)]),
    )
    return [100.0 * float(share) for share in shares]


def rows(cases: int, jobs: int) -> Iterator[list[str]]:
    for kind in KINDS:
        work = (delayed(run_case)(kind, number) for number in range(cases))
        results = [result for result in Parallel(n_jobs=jobs)(work) if result is not None]
        if not results:
            continue
        held = [h for r in results for h in r["held"]]
        bands = [mean(r["bands"][i] for r in results) for i in range(4)]
        cells = [100.0 * mean(held) if held else np.nan, *bands]
        if kind == "brace":
            named, missing = (sum(r[key] for r in results) for key in ("named", "missing"))
            print(f"brace left out: named first {named} of {len(results)}, any asked for {missing}")
        else:
            yield [f"{kind}, {len(held)} intervals", *(f"{share:.1f}" for share in cells)]


def main() -> None:
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=200, help="of every kind")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--quick", action="store_true", help="one case of every kind")
    options = parser.parse_args()
    head = ("share held [%]", "intervals", "motion", "measured", "displaced", "force")
    show("", head, rows(1 if options.quick else options.cases, options.jobs))


if __name__ == "__main__":
    with command_errors():
        main()
