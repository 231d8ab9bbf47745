"""How fast is the simulation of a composed model, and how fast are its derivatives?

    python -m benchmarks.free_run            # one record of 50 s, a thousand of them, one Jacobian
    python -m benchmarks.free_run --quick    # short records, a few of them, for CI

An element network of 3 DOFs and 6 elements, 5,000 samples with 2 substeps. Compiled, against the
same equations in PyTorch (tests/reference_networks.py), with which tests compare it, and the
zoo's integrator of the true structure (data/simulation/motion.py). Derivatives: forward
sensitivities by all parameters at once, against as many runs as finite differences would take. The
best of three where it is short; one thread.
"""

from __future__ import annotations

import torch

from benchmarks.table import seconds_of, show
from data.arguments import Parser
from data.record import Drive, Record
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.laws.bilinear import Bilinear
from data.simulation.motion import simulate as simulate_structure
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models.element_network import ElementNetwork
from runner.config.command_line import command_errors
from tests.reference_networks import simulate

PAIRS = (("s1", "x1"), ("x1", "x2"), ("x1", "x3"), ("x2", "x3"), ("x3", "s3"), ("s2", "x2"))


def frame() -> Simulation:
    """Three masses, six bilinear elements."""
    bilinear = {"yield_displacement": 0.02, "stiffness": 40.0, "post_yield_stiffness": 20.0}
    bilinear |= {"damping": 0.1, "post_yield_damping": 0.1}
    elements = {f"r{i}": Bilinear(between=p, **bilinear) for i, p in enumerate(PAIRS, start=1)}
    excitation = Excitation(force=BandLimitedGaussian(std=1.7, band=(0.0, 3.0)))
    structure = Structure([0.8, 2.0, 1.2], elements)
    return Simulation(structure, excitation, FullState(), dt=0.01, duration=50.0)


def many(drive: Drive, count: int) -> Drive:
    """The same excitation, `count` times."""
    rest = drive.x0.expand(count, -1)
    return Drive(drive.dt, drive.u.expand(count, -1, -1).contiguous(), rest, rest)


def measure(quick: bool) -> None:
    """Print the table."""
    simulation = frame()
    record: Record = simulation.records("train", 1, seed=0)[0][0]
    if quick:
        record = record.window(0, 100)
    network = ElementNetwork(3, 3, record.dt, units=2)
    network.identify([record])
    drive = record.drive()
    count = 10 if quick else 1000
    drives, f = many(drive, count), record.f.numpy()
    parameters = sum(p.numel() for p in network.parameters() if p.requires_grad)
    with torch.no_grad():
        one = min(seconds_of(lambda: network.free_run(drive), 3))
        batch = min(seconds_of(lambda: network.free_run(drives), 1))
        torch_one = min(seconds_of(lambda: simulate(network.composition(), drive, 2), 1))
        torch_batch = min(seconds_of(lambda: simulate(network.composition(), drives, 2), 1))
        truth = min(seconds_of(lambda: simulate_structure(simulation.structure, f, 0.01), 3))
        jacobian = min(seconds_of(lambda: network.trace(drive, derivatives=True), 3))
    times = [
        ("free run of a record, compiled", one, one),
        ("  in PyTorch", torch_one, one),
        ("  the true structure, adaptive integrator", truth, one),
        (f"free runs of {count} records, compiled", batch, batch),
        ("  in PyTorch, one batch", torch_batch, batch),
        ("derivatives by all parameters, compiled", jacobian, jacobian),
        ("  by finite differences, as many runs", parameters * one, jacobian),
    ]
    rows = [(what, f"{took:.4g}", f"{took / least:.3g}") for what, took, least in times]
    title = f"{record.samples} samples, {parameters} parameters"
    show(title, ("what", "seconds", "of the compiled"), rows)


def main() -> None:
    parser = Parser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--quick", action="store_true", help="short records, a few of them")
    torch.set_num_threads(1)
    measure(parser.parse_args().quick)


if __name__ == "__main__":
    with command_errors():
        main()
