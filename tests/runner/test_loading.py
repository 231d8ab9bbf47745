"""Commands load what they use: PyTorch's compiler, metrics and pictures when they are asked for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = """
import gc, importlib.util, sys
from types import SimpleNamespace
from runner.loading import loading, without_compiler
with loading():
    from report.run.summary import draw_run
    from runner.job import identify
late = {"torchmetrics", "matplotlib", "models.named_laws.fit"}
late |= {f"scipy.{part}" for part in ("signal", "stats", "optimize", "interpolate")}
assert not late & set(sys.modules), "what a VWNN's run does not use was loaded"
from lightning.pytorch.core.module import Metric
assert not isinstance({}, Metric)
sys.modules["torchmetrics"] = SimpleNamespace(Metric=dict)
assert isinstance({}, Metric), "Lightning does not know a true metric"
assert gc.isenabled()
kept = gc.get_freeze_count()
with loading():
    assert gc.isenabled()
assert 0 < gc.get_freeze_count() <= kept, "garbage of a run would be kept by the next"
import torch
assert "sympy" not in sys.modules, "the compiler was loaded"
with without_compiler():
    torch.optim.LBFGS([torch.nn.Parameter(torch.zeros(1))])
assert "torch._dynamo" not in sys.modules, "the stand-in was left"
there = importlib.util.find_spec("torch._dynamo")
assert there.origin.endswith("__init__.py"), "the true one is hidden"
true = sys.modules["torch._dynamo"] = SimpleNamespace()
with without_compiler():
    assert sys.modules["torch._dynamo"] is true, "a compiler that is there was hidden"
"""


def test_what_takes_long_is_loaded_when_it_is_used():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


IDENTIFY = """
import sys
from types import SimpleNamespace
import data.measured.files.apart
from data.measured.files import hdf5, mat, uff
assert not {"torch", "pandas", "numba"} & set(sys.modules), "what reads no file was loaded"
import identify
assert "torch" not in sys.modules
identify.Fits = lambda: SimpleNamespace(close=lambda: None)
try:
    identify.main(["README.md"])
except ValueError:
    assert not {"torch._dynamo", "torchmetrics", "sympy"} & set(sys.modules)
else:
    raise AssertionError("a page of words was identified")
"""


def test_a_file_is_tried_and_a_record_read_before_what_neither_needs_is_loaded():
    done = subprocess.run(
        [sys.executable, "-c", IDENTIFY], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
