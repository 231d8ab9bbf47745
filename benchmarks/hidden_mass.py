"""How well does a model, fitted to the other masses of a simulated structure, know a hidden one?

    python train.py model=element_network system=bilinear "data.sensors=[1,3]" \\
        "model.masses=[0.8,2.0,1.2]" hydra.run.dir=runs/hidden
    python -m benchmarks.hidden_mass runs/hidden

Simulates new motions of the structure of each run, measures all of its masses, and prints the
median and the largest relative RMS error [%] of the masses with a sensor and of those without.
B motions, T samples, n masses, E elements.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from benchmarks.table import show
from data.arguments import Parser
from data.record import stack
from data.simulation.datamodule import SimulatedData
from models.experiment import Experiment
from models.stored.run import read_run
from runner.config.command_line import command_errors


def relative(found: Tensor, true: Tensor) -> Tensor:
    """Relative RMS errors (B,) [%] of signals (B, T, ·)."""
    return 100.0 * (found - true).norm(dim=(1, 2)) / true.norm(dim=(1, 2))


def rows(folder: Path, motions: int) -> Iterator[list[str]]:
    """Errors of the accelerations and displacements of a run's model, of masses seen and hidden."""
    run = read_run(folder)
    model: Any = run.restore()
    if not getattr(model, "hidden", []):
        raise ValueError(f"{folder}: expected a run of element_network with data.sensors=[…]")
    more = {"sensors": None, "test_records": motions, "escape": "redraw"}
    clean = {"name": "full_state", "_target_": "data.FullState"}
    changed = {"scenario": clean, "data": {**run.values["data"], **more}}
    data = Experiment.of({**run.values, **changed}).make_data()
    assert isinstance(data, SimulatedData)
    data = data.of_seed(data.seed + 1)  # of which the run saw no motion
    data.setup()
    record = stack(data.records["test"])
    assert record.x is not None
    rest = record.a.new_zeros(motions, model.dofs)
    trace = model.trace(replace(record.drive(), x0=rest, v0=rest))
    x = trace.deformations @ torch.linalg.pinv(model.B).T
    a = (record.f - trace.forces @ model.B) / model.mass()
    for name, part in (("measured", model.sensors), ("hidden", model.hidden)):
        own = [number - 1 for number in part]
        errors = [relative(u[..., own], v[..., own]) for u, v in ((a, record.a), (x, record.x))]
        cells = [f"{float(e.median()):.2f}; {float(e.max()):.2f}" for e in errors]
        yield [f"{name}: {', '.join(f'x{number}' for number in part)}", *cells]


def main() -> None:
    parser = Parser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    parser.add_argument("--motions", type=int, default=20, help="of each structure")
    parser.add_argument("--quick", action="store_true", help="two motions")
    options = parser.parse_args()
    head = ("median; largest error [%]", "acceleration", "displacement")
    with torch.no_grad():
        for folder in options.runs:
            show(str(folder), head, rows(folder, 2 if options.quick else options.motions))


if __name__ == "__main__":
    with command_errors():
        main()
