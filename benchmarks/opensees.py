"""How well are structures found that OpenSees simulates, other people's code and materials?

    python -m benchmarks.opensees                       # full state, ten minutes
    python -m benchmarks.opensees --noise 0.02          # accelerations alone, 15 minutes
    python -m benchmarks.opensees --unnamed --noise 0.02  # none of the zoo's laws, half an hour
    python -m benchmarks.opensees --cases "gaps, 2 storeys" --model element_network_branch
    python -m benchmarks.opensees --quick               # one case, half a minute

Shear chains of OpenSees' own materials with Rayleigh damping on a shaking base, Newmark's method
with 32 steps a sample. A model is given the masses, the chain and six records of 30 s; it simulates
four unseen motions from rest, and the same with 1.5 times the ground motion. Prints relative RMS
errors of the absolute accelerations [%] and how far OpenSees is from itself with steps twice as
long (– where that does not converge), seconds of the processor, the laws that were chosen and, as a
yardstick, how far the same structure with 1 % larger forces is from itself, unseen and 1.5 times.
`--unnamed`: steel with another hardening (Steel4), frames whose columns have fibres. Needs
openseespy.   N, m, s
"""

from __future__ import annotations

import ctypes
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.fitting import fit
from benchmarks.table import show
from benchmarks.unplanted import DT, FARTHER, SAMPLES, TRAINED, UNSEEN
from data.arguments import Parser
from data.record import Record
from models.estimator import Estimator
from runner.config.command_line import command_errors

SUBSTEPS = 32  # of a sample; SelfCentering is of first order, 10 % away with 4
DAMPING = 0.03  # ratio of the first and last mode
Material = Sequence[object]  # the words of OpenSees' command, without its number


def opensees() -> Any | None:
    """The module, or None; its wheel needs its own BLAS loaded first where the system has none."""
    found = find_spec("openseespylinux")
    if found is not None and found.origin is not None:
        for name in ("libquadmath.so.0", "libgfortran.so.4", "libblas.so.3", "liblapack.so.3"):
            library = Path(found.origin).parent / "lib" / name
            if library.is_file():
                ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    try:
        return import_module("openseespy.opensees")
    except (ImportError, RuntimeError):  # it raises the latter where a library is missing
        return None


@dataclass(frozen=True)
class Chain:
    """Masses [kg], materials in parallel of every storey, largest ground acceleration [m/s²]."""

    masses: Sequence[float]
    storeys: Sequence[Sequence[Material]]
    peak: float

    def build(self, ops: Any) -> None:
        """The chain, node i of mass i, with damping."""
        ops.wipe()
        ops.model("basic", "-ndm", 1, "-ndf", 1)
        ops.node(0, 0.0)
        ops.fix(0, 1)
        for i, (mass, materials) in enumerate(zip(self.masses, self.storeys, strict=True), start=1):
            ops.node(i, 0.0)
            ops.mass(i, mass)
            numbers = [100 * i + j for j in range(len(materials))]
            for number, (kind, *words) in zip(numbers, materials, strict=True):
                ops.uniaxialMaterial(kind, number, *words)
            along = ["-dir", *[1] * len(numbers), "-doRayleigh", 1]
            ops.element("zeroLength", i, i - 1, i, "-mat", *numbers, *along)
        self.damp(ops)

    def damp(self, ops: Any) -> None:
        """Rayleigh's damping."""
        rates = np.sqrt(ops.eigen("-fullGenLapack", len(self.masses)))
        both = 2.0 * DAMPING / (rates[0] + rates[-1])
        ops.rayleigh(both * rates[0] * rates[-1], 0.0, both, 0.0)

    def motion(self, ground: np.ndarray, substeps: int = SUBSTEPS) -> np.ndarray:
        """Displacements, velocities, accelerations (3, T, n) against the base."""
        ops = opensees()
        assert ops is not None
        self.build(ops)
        # the last instant may lie beyond the last value, by rounding; without useLast that is none
        ops.timeSeries("Path", 1, "-dt", DT, "-values", *ground.tolist(), "-useLast")
        ops.pattern("UniformExcitation", 1, 1, "-accel", 1)
        prepare_steps(ops, 1e-10)
        motion = np.zeros((3, len(ground), len(self.masses)))
        for sample in range(1, len(ground)):
            if ops.analyze(substeps, DT / substeps):
                raise ValueError("OpenSees does not converge; lower the ground motion")
            for i in range(len(self.masses)):
                for row, read in enumerate((ops.nodeDisp, ops.nodeVel, ops.nodeAccel)):
                    motion[row, sample, i] = read(i + 1, 1)
        return motion


def prepare_steps(ops: Any, near: float) -> None:
    """Newmark's method, each step in equilibrium up to displacements of less than `near`."""
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", near, 50)
    ops.algorithm("Newton")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def steel(k: float) -> list[Material]:
    return [["Steel02", 0.009 * k, k, 0.03, 18.0, 0.925, 0.15, 0.03, 1.0, 0.03, 1.0]]


def slack(k: float) -> list[Material]:
    sides = [("ElasticPPGap", k, s * k * 0.007, s * 0.0015, 0.05, "damage") for s in (1.0, -1.0)]
    return [*sides, ["Elastic", 1.3 * k]]


def pinching(s: float) -> list[Material]:
    backbone = [9e4 * s, 0.005, 1.6e5 * s, 0.014, 1.9e5 * s, 0.035, 1.4e5 * s, 0.09]
    shape = [0.5, 0.25, 0.05, 0.3, 0.2, 0.3, 0.2, 0.6]
    lost = [0.2, 0.2, 0.2, 0.2, 0.3, 0.1, 0.1, 0.1, 0.1, 0.2, 10.0, "energy"]
    return [["Pinching4", *backbone, *shape, *lost]]


def degrading(s: float) -> list[Material]:
    side = [1.1e5 * s, 0.006, 1.5e5 * s, 0.02, 1.6e5 * s, 0.08]
    return [["Hysteretic", *side, *(-number for number in side), 0.6, 0.4, 0.0, 0.0, 0.2]]


def flag(s: float) -> list[Material]:
    return [["SelfCentering", 2e7 * s, 1e6 * s, 1.4e5 * s, 0.6]]


def nailed(s: float) -> list[Material]:
    force, yielded = 1e5 * s, 0.006
    wall = [force, 0.14 * force, 9.0 * yielded, 1.5 * force / yielded]
    return [["SAWS", *wall, 0.05, -0.05, 1.2, 0.04, 0.72, 1.12]]


def hardened(s: float) -> list[Material]:
    own = ["-kin", 0.03, 20.0, 0.9, 0.15, "-iso", 0.012, 1.25, 0.0025, 50.0, 1.0]
    return [["Steel4", 1.2e5 * s, 1.2e5 * s / 0.007, *own]]


def hinge(s: float) -> list[Material]:
    """A concrete hinge that wears out, and softens beyond seven times its yield."""
    force, yielded = 1.1e5 * s, 0.006
    side = [5.0 * yielded, 16.0 * yielded, 50.0 * yielded, force, 1.18, 0.25]
    wear = [*4 * [80.0 * yielded], *6 * [1.0]]
    return [["IMKPeakOriented", force / yielded, *side, *side, *wear]]


def damped(s: float) -> list[Material]:
    """Steel beside a fluid damper on its brace."""
    return [*steel(1.6e7 * s), ["ViscousDamper", 4e7 * s, 1.5e5 * s, 0.4]]


def pounding(s: float) -> list[Material]:
    """An elastic storey that hits a neighbour on one side, and farther away a softer one."""
    sides = [
        ("ElasticPPGap", 6e7 * s, 1e9, 0.005, 0.0),
        ("ElasticPPGap", 3e7 * s, -1e9, -0.012, 0.0),
    ]
    return [*sides, ["Elastic", 1.4e7 * s]]


def composite(s: float) -> list[Material]:
    """Concrete that crushes on one side, beside steel."""
    k, crushed = 1.6e7 * s, 0.012
    force = 0.5 * k * crushed
    concrete = [-force, -crushed, -0.4 * force, -0.05, 0.15, 0.1 * force, 0.05 * k]
    return [["Concrete02", *concrete], *steel(0.5 * k)]


@dataclass(frozen=True)
class Frame(Chain):
    """Storeys of two columns 3 m high between stiff floors, their sections of fibres.

    storeys: materials of a section, then its patches and layers, in the words of OpenSees.
    """

    def build(self, ops: Any) -> None:
        ops.wipe()
        ops.model("basic", "-ndm", 2, "-ndf", 3)
        ops.node(0, 0.0, 0.0)
        ops.fix(0, 1, 1, 1)
        ops.geomTransf("Linear", 1)
        for i, (mass, words) in enumerate(zip(self.masses, self.storeys, strict=True), start=1):
            ops.node(i, 0.0, 3.0 * i)
            ops.fix(i, 0, 1, 1)
            ops.mass(i, mass, 1e-9, 1e-9)
            fibres = [one for one in words if one[0] in ("patch", "layer")]
            for number, one in enumerate((one for one in words if one not in fibres), start=1):
                ops.uniaxialMaterial(one[0], 10 * i + number, *one[1:])
            ops.section("Fiber", i)
            for make, shape, material, *more in fibres:
                getattr(ops, str(make))(shape, 10 * i + int(str(material)), *more)
            ops.beamIntegration("Lobatto", i, i, 5)
            for column in (1, 2):
                ops.element("forceBeamColumn", 10 * i + column, i - 1, i, 1, i)
        self.damp(ops)


def concrete_column(s: float) -> list[Material]:
    """0.4 m deep, with eight bars."""
    crushing = ["Concrete02", -30e6, -0.002, -10e6, -0.008, 0.1, 2.5e6, 1.5e9]
    bars = ["Steel02", 420e6, 200e9, 0.01, 18.0, 0.925, 0.15]
    b, ends = 0.175 * s**0.5, (0.15, -0.15)
    layers = [["layer", "straight", 2, 3, 4e-4 * s, z, 0.05 - b, z, b - 0.05] for z in ends]
    return [crushing, bars, ["patch", "rect", 1, 16, 1, -0.2, -b, 0.2, b], *layers]


def steel_column(s: float) -> list[Material]:
    """A wide flange 0.26 m deep."""
    b, web = 0.1 * s, [-0.118, -0.004, 0.118, 0.004]
    plates = [[2, 1, -0.13, -b, -0.118, b], [2, 1, 0.118, -b, 0.13, b], [12, 1, *web]]
    steel = ["Steel02", 345e6, 200e9, 0.01, 18.0, 0.925, 0.15]
    return [steel, *(["patch", "rect", 1, *plate] for plate in plates)]


SHARES = (1.0, 0.85, 0.7)
CASES = {
    "Steel02, 3 storeys": Chain([2.4e4, 2.2e4, 2.0e4], [steel(1.6e7 * s) for s in SHARES], 2.6),
    "SelfCentering, 3 storeys": Chain([2.4e4] * 3, [flag(s) for s in SHARES], 2.6),
    "gaps, 2 storeys": Chain([2.4e4] * 2, [slack(1.2e7 * s) for s in (1.0, 0.8)], 2.6),
    "Pinching4, 2 storeys": Chain([2.0e4, 1.5e4], [pinching(s) for s in (1.0, 0.8)], 2.6),
    "Hysteretic, 3 storeys": Chain([2.4e4] * 3, [degrading(s) for s in SHARES], 2.2),
    "SAWS, 2 storeys": Chain([2.4e4, 2.2e4], [nailed(s) for s in (1.0, 0.8)], 2.4),
    "IMKPeakOriented, 2 storeys": Chain([2.4e4, 2.2e4], [hinge(s) for s in (1.0, 0.8)], 2.4),
    "fluid dampers, 2 storeys": Chain([2.4e4, 2.2e4], [damped(s) for s in (1.0, 0.8)], 3.5),
    "pounding, 2 storeys": Chain([2.4e4, 2.2e4], [pounding(s) for s in (1.0, 0.8)], 2.4),
    "Concrete02, 2 storeys": Chain([2.4e4, 2.2e4], [composite(s) for s in (1.0, 0.8)], 2.4),
}
UNNAMED = {
    "Steel4, 2 storeys": Chain([2.4e4, 2.2e4], [hardened(s) for s in (1.0, 0.8)], 2.6),
    "steel columns, 2 storeys": Frame([2.4e4, 2.2e4], [steel_column(s) for s in (1.0, 0.85)], 7.0),
    "concrete columns, 2 storeys": Frame(
        [2.4e4, 2.2e4], [concrete_column(s) for s in (1.0, 0.85)], 4.0
    ),
}


def ground_motion(seed: int, size: float) -> np.ndarray:
    """Ground acceleration (T,) [m/s²] from rest: even seeds random, odd ones like earthquakes."""
    rng = np.random.default_rng(seed)
    frequencies, t = np.fft.rfftfreq(2 * SAMPLES, DT), DT * np.arange(SAMPLES)
    ratio, rise = frequencies / rng.uniform(1.5, 3.0), np.minimum(t / 3.0, 1.0) ** 2
    if seed % 2:
        shape = np.sqrt((1.0 + 1.44 * ratio**2) / ((1.0 - ratio**2) ** 2 + 1.44 * ratio**2))
        shape = shape * ((frequencies > 0.1) & (frequencies < 12.0))
        rise = rise * np.exp(-0.1 * np.maximum(t - 10.0, 0.0))
    else:
        shape = 1.0 * ((frequencies > 0.2) & (frequencies < rng.uniform(3.0, 6.0)))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    wave = rise * np.fft.irfft(shape * np.exp(1j * phases))[:SAMPLES]
    return size * wave / np.abs(wave).max()


def record(case: Chain, seed: int, size: float, noise: float = 0.0) -> Record:
    """Accelerations alone where there is noise, x and v too where there is none."""
    ground = ground_motion(seed, size * case.peak)
    x, v, a = (torch.from_numpy(u.copy()) for u in case.motion(ground))
    force = torch.from_numpy(-ground)[:, None]
    if noise == 0.0:
        return Record(DT, a, force, x, v)
    drawn = torch.randn(a.shape, generator=torch.Generator().manual_seed(seed)).double()
    return Record(DT, a + noise * (a - force).std(dim=0) * drawn, force)


def relative(records: Sequence[Record], others: Sequence[torch.Tensor]) -> float:
    """How far other accelerations are from the records', of the absolute accelerations [%]."""
    squares = sum(float(((a - r.a) ** 2).sum()) for r, a in zip(records, others, strict=True))
    return 100.0 * (squares / sum(float(((r.a - r.f) ** 2).sum()) for r in records)) ** 0.5


@torch.no_grad()
def errors(case: Chain, model: Estimator, times: float) -> tuple[str, str, str]:
    """In unseen motions: of the model, of OpenSees with longer steps, of larger forces [%]."""
    unseen = [record(case, 400 + i, times * share) for i, share in enumerate(UNSEEN)]
    own = f"{relative(unseen, [model.free_run(r.drive()).a for r in unseen]):.2f}"
    coarse = _difference(case, SUBSTEPS // 2, unseen)
    return own, coarse, _difference(stronger(case), SUBSTEPS, unseen)


def stronger(case: Chain) -> Chain:
    """The structure with 1 % larger forces: with masses smaller by as much."""
    return replace(case, masses=[mass / 1.01 for mass in case.masses])


def _difference(other: Chain, substeps: int, unseen: Sequence[Record]) -> str:
    """How far a structure's motions are from the records; – where OpenSees does not converge."""
    try:
        a = [torch.from_numpy(other.motion(-r.f[:, 0].numpy(), substeps)[2]) for r in unseen]
    except ValueError:
        return "–"
    return f"{relative(unseen, a):.2f}"


def rows(names: Sequence[str], model: str, noise: float, seed: int) -> Iterator[list[str]]:
    """Rows of the table; prints laws and yardstick below each."""
    for name in names:
        case = (CASES | UNNAMED)[name]
        train = [record(case, 300 + i, share, noise) for i, share in enumerate(TRAINED)]
        masses = f"model.masses={list(map(float, case.masses))}"
        chain = ["model.forced=base", "model.elements=chain", masses]
        words = [f"model={model}", f"seed={seed}", *(chain if "element" in model else ())]
        begin = time.process_time()
        estimator, facts = fit(words, train)
        seconds = time.process_time() - begin
        near, farther = (errors(case, estimator, times) for times in (1.0, FARTHER))
        yield [name, *near[:2], *farther[:2], f"{seconds:.0f}"]
        print(f"  {facts.get('laws', model)}")
        print(f"  the structure itself with 1 % more strength differs by {near[2]}; {farther[2]}")


def main() -> None:
    parser = Parser(description=(__doc__ or "").partition("\n\n")[0])
    add = parser.add_argument
    both = CASES | UNNAMED
    add("--cases", nargs="+", metavar="CASE", default=list(CASES), choices=both, help="structures")
    add("--unnamed", action="store_true", help="structures of none of the zoo's laws")
    add("--model", default="element_network_named")
    add("--noise", type=float, default=0.0, help="of the standard deviation of accelerations")
    add("--seed", type=int, default=0)
    add("--quick", action="store_true", help="the smallest case, a linear model")
    options = parser.parse_args()
    if opensees() is None:
        raise ValueError("openseespy is not installed: pip install openseespy")
    torch.set_num_threads(1)
    if options.unnamed:
        options.cases = list(UNNAMED)
    if options.quick:
        options.cases, options.model = ["gaps, 2 storeys"], "linear"
    head = ("structure", "unseen", "itself", "1.5 times", "itself", "seconds")
    show("", head, rows(options.cases, options.model, options.noise, options.seed))


if __name__ == "__main__":
    with command_errors():
        main()
