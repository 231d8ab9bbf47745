"""pt2 and onnx programs against the free run, at other lengths than they were exported with."""

from __future__ import annotations

import json
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from data.record import Drive, Record
from export import onnx as onnx_target
from export import pt2
from export.graphs.choose import program_of
from export.run import Exported
from models import VWNN, EquivalentLinear, GlobalMLP, NeuralStateSpace, Recurrent
from models.estimator import Estimator
from tests.export.conftest import DT, drive_of, exported, network

SPRINGS = ("cubic", "hinge_stiffness", "tanh_stiffness")
TERMS = (*SPRINGS, "unit_stiffness", "unit_rising", "unit_falling")
needs_onnx = pytest.mark.skipif(
    not all(map(find_spec, ("onnx", "onnxscript", "onnxruntime"))),
    reason="needs onnx, onnxscript and onnxruntime",
)
pytestmark = pytest.mark.filterwarnings("ignore")  # PyTorch's exporters warn themselves


def record() -> Record:
    """A motion of three masses."""
    made = network(3, 4)
    drive = drive_of(made, 300, 2.0)
    with torch.no_grad():
        motion = made.free_run(drive)
    return Record(DT, motion.a, drive.u, motion.x, motion.v)


def identified(kind: str) -> Estimator:
    """Networks with weights as drawn, scaled to a record."""
    torch.manual_seed(0)
    made = {
        "elements": lambda: network(3, 3, TERMS, hinges=1, tanhs=1, units=1),
        "one mass": lambda: network(1, 3, TERMS, hinges=1, units=2, substeps=1),
        "base": lambda: network(
            3, 2, SPRINGS, hinges=0, tanhs=2, inputs=1, forced="base", elements="chain", units=0
        ),
        "gru": lambda: Recurrent(3, 3, DT, hidden=8, layers=2),
        "lstm": lambda: Recurrent(3, 3, DT, cell="lstm", hidden=8),
        "state space": lambda: NeuralStateSpace(3, 3, DT, memory=3, hidden=5),
        "mlp": lambda: GlobalMLP(3, 3, DT),
        "linear": lambda: EquivalentLinear(3, 3, DT),
    }[kind]()
    if kind not in ("elements", "one mass", "base"):
        made.identify([record()])
    return made.eval()


@cache
def model_of(kind: str, hold: str) -> Exported:
    return exported(identified(kind), hold=hold)


@pytest.fixture(autouse=True, scope="module")
def _traced_once():
    """Both targets write the program of a model that is traced for the first of them."""
    programs: dict[int, torch.export.ExportedProgram] = {}

    def program(model: Exported) -> torch.export.ExportedProgram:
        if id(model) not in programs:
            programs[id(model)] = program_of(model)
        return programs[id(model)]

    with pytest.MonkeyPatch.context() as patch:
        for target in (pt2, onnx_target):
            patch.setattr(target, "program_of", program)
        yield
    model_of.cache_clear()


KINDS = ["elements", "one mass", "base", "gru", "lstm", "state space", "mlp", "linear"]


def runs_of(estimator: Estimator, hold: str) -> tuple[Drive, list[torch.Tensor]]:
    """Three runs of another length than exported, two of which begin in motion."""
    u = torch.stack(
        [drive_of(estimator, 150, size, seed=k).u for k, size in enumerate((2, 1, 0.5))]
    )
    draw = torch.Generator().manual_seed(0)
    x0, v0 = (s * torch.rand(3, estimator.dofs, generator=draw).double() for s in (0.02, 0.1))
    x0[0], v0[0] = 0.0, 0.0
    drive = Drive(DT, u, x0, v0, hold)
    with torch.no_grad():
        response = estimator.free_run(drive)
    return drive, [response.x, response.v, response.a]


def require_same(theirs: list[torch.Tensor], ours: list[torch.Tensor]) -> None:
    for one, own in zip(theirs, ours, strict=True):
        assert one.dtype == torch.float64
        assert float((one - own).abs().max()) < 1e-12 * float(own.abs().max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hold", ["linear", "zero_order"])
def test_a_pt2_program_is_the_free_run(kind, hold, tmp_path):
    if hold == "zero_order" and kind not in ("base", "state space", "mlp", "linear"):
        pytest.skip("the same path")
    model = model_of(kind, hold)
    drive, ours = runs_of(model.estimator, hold)
    path, facts = pt2.write(model, tmp_path)[0], {"passport.json": ""}
    program = torch.export.load(path, extra_files=facts).module()
    with torch.no_grad():
        require_same(list(program(drive.u, drive.x0, drive.v0)), ours)
    assert json.loads(facts["passport.json"])["model"] == "model"


@needs_onnx
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("one mass", "base")])
def test_onnx_runtime_runs_the_free_run(kind, tmp_path):
    import onnx
    import onnxruntime

    model = model_of(kind, "linear")
    drive, ours = runs_of(model.estimator, "linear")
    path = onnx_target.write(model, tmp_path)[0]
    session = onnxruntime.InferenceSession(path)
    given = {"u": drive.u, "x0": drive.x0, "v0": drive.v0}
    out = session.run(["x", "v", "a"], {name: signal.numpy() for name, signal in given.items()})
    require_same([torch.from_numpy(np.asarray(signal)) for signal in out], ours)
    told = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    assert json.loads(told["passport"])["licence"]["code"] == "MIT"
    assert told["hold"] == "linear"


@pytest.mark.parametrize("write", [pt2.write, onnx_target.write])
def test_a_model_without_a_graph_is_refused(write, tmp_path: Path):
    if write is onnx_target.write and find_spec("onnx") is None:
        pytest.skip("needs onnx")
    with pytest.raises(ValueError, match=r"VWNN has no graph here.*to=c or to=fmu"):
        write(exported(VWNN(3, 3, DT)), tmp_path)
    assert not list(tmp_path.iterdir())
