"""Free runs by the kernel of a GPU beside those of a core, of all that a network can hold.

`python -m tests.models.runs_on_gpu` prints differences under numba's simulator, in which Python
runs the kernel (NUMBA_ENABLE_CUDASIM=1); tests/program/test_gpu.py takes them from a GPU.
"""

from __future__ import annotations

import json

import numpy as np
import torch

from data.record import Drive
from models.composition.composite import Composite
from models.composition.many_runs import ManyRuns
from models.uncertainty.parameters import free_vector
from tests.export.networks import DT, base_network, latent, network


def bounded(size: float) -> Composite:
    """Whose runs have diverged where an acceleration [m/s²] passes a bound."""
    model = network(2)
    model.bound.fill_(size)
    return model


CASES = {  # a model, the size of its excitation, how many numbers its first state has
    "hinges and units": (network(2), 1e4, 0),
    "one substep, a linear law": (network(2, hinges=0, units=0, substeps=1), 1e4, 0),
    "supports that move": (base_network(2), 0.01, 0),
    "a core": (latent(2), 10.0, 0),
    "masses without sensors": (network(3, sensors=[1, 3]), 1e4, 0),
    "a first state": (network(2), 1e4, 2 * 2 + 2 * 3),
    "a run that diverges": (bounded(15.0), 1e4, 0),
}


@torch.no_grad()
def compared(samples: int, runs: int, device: str) -> dict[str, tuple[float, int]]:
    """The largest difference, over the largest measure, and how many numbers are NaN in both.

    Infinite where a number is NaN in one of them only.
    """
    found, draw = {}, torch.Generator().manual_seed(0)
    for name, (model, size, states) in CASES.items():
        u = size * torch.randn(samples, model.inputs, generator=draw, dtype=torch.float64)
        rest = torch.zeros(model.dofs, dtype=torch.float64)
        begin = 0.01 * torch.randn(states, generator=draw, dtype=torch.float64) if states else None
        many = ManyRuns(model, Drive(DT, u, rest, rest), begin)
        theta = free_vector(model)
        moved = theta + 0.1 * torch.randn(runs, len(theta), generator=draw, dtype=torch.float64)
        steps = many.steps(moved)
        own, other = many.on_a_core(steps).numpy(), many.on_gpu(steps.to(device)).cpu().numpy()
        lost = np.isnan(own)
        apart = np.abs(own - other)[~lost].max() / np.abs(own[~lost]).max()
        same = np.array_equal(lost, np.isnan(other))
        found[name] = (float(apart) if same else np.inf, int(lost.sum()))
    return found


if __name__ == "__main__":
    print(json.dumps(compared(samples=8, runs=2, device="cpu")))
