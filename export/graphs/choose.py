"""Which graph a model's free run is, its export by torch.export, and its names."""

from __future__ import annotations

import warnings
from typing import Any

import torch
from torch.export import Dim, ExportedProgram

from export.composite import plain_composite
from export.graphs.composite import CompositeGraph
from export.graphs.graph import Graph
from export.graphs.networks import LinearGraph, MLPGraph, RecurrentGraph, StateSpaceGraph
from export.run import Exported
from models.composition.composite import Composite
from models.estimator import Estimator
from models.linear import EquivalentLinear
from models.mlp import GlobalMLP
from models.neural_state_space import NeuralStateSpace
from models.recurrent import Recurrent

GRAPHS: dict[type[Estimator], Any] = {
    Recurrent: RecurrentGraph,
    NeuralStateSpace: StateSpaceGraph,
    GlobalMLP: MLPGraph,
    EquivalentLinear: LinearGraph,
}
RUNS, SAMPLES = 2, 5  # of the example that is followed; others do as well
MOST_RUNS, MOST_SAMPLES = 1 << 20, 1 << 30


def graph_of(model: Exported) -> Graph:
    """The free run of a model. Raises ValueError for a model that has no graph here.

    Between samples the excitation is held where it was in training, else linear.
    """
    estimator = model.estimator
    held = model.hold == "zero_order"
    if isinstance(estimator, Composite):
        return CompositeGraph(plain_composite(estimator), held).eval()
    if type(estimator) not in GRAPHS:
        raise ValueError(
            f"{type(estimator).__name__} has no graph here, which networks of elements, recurrent "
            "networks, neural state spaces, global MLPs and linear systems have; choose to=c or "
            "to=fmu"
        )
    made: Graph = GRAPHS[type(estimator)](estimator, held)
    return made.eval()


@torch.no_grad()
def program_of(model: Exported) -> ExportedProgram:
    """The graph as torch.export has it: any number of runs and samples, three at least."""
    graph, n, m = graph_of(model), model.estimator.dofs, model.estimator.inputs
    double = torch.float64
    u = torch.zeros(RUNS, SAMPLES, m, dtype=double)
    x0, v0 = torch.zeros(RUNS, n, dtype=double), torch.zeros(RUNS, n, dtype=double)
    runs, samples = Dim("runs", min=1, max=MOST_RUNS), Dim("samples", min=3, max=MOST_SAMPLES)
    shapes = {"u": {0: runs, 1: samples}, "x0": {0: runs}, "v0": {0: runs}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of PyTorch to itself
        return torch.export.export(graph, (u, x0, v0), dynamic_shapes=shapes)
