"""The law of docs/adding.md in a copy of the tree, to which its file and one line are added.

The list of the copy has that law and springs alone, so that they compile within seconds.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from shutil import copy, copytree, ignore_patterns

from tests.export.compiling import needs_gcc

ROOT = Path(__file__).parents[2]
LINE = '    "kinematic": ["Kinematic"],\n'
NUMBERS = {"yield_displacement": 0.006, "stiffness": 4e7, "hardening_ratio": 0.04}
SIMULATE = f"""
import numpy as np
from data import Kinematic
from data.simulation.element_test import force, growing_cycles, write

steel = Kinematic(between=["s1", "x1"], **{NUMBERS})
y = growing_cycles(amplitude=0.03, cycles=8, dt=0.001, frequency=0.5)
u, right = 0.0, []
for now in y:
    u = min(max(u, now - 0.006), now + 0.006)
    right.append(4e7 * (0.04 * now + 0.96 * (now - u)))
assert np.abs(force(steel, y, 0.001) - right).max() < 1e-5 * np.abs(right).max()
write("test.csv", steel, y[::10], 0.01)
"""
TRAIN = """
import sys

import train

sys.argv = ["train.py", *WORDS]
train.cli()
"""
REPORT = """
from pathlib import Path

import torch

from data.record import Drive
from data.simulation.element_test import growing_cycles
from export.opensees import script_of
from export.steps import step_of
from models import ElementNetworkNamed
from report.describe.description import describe
from runner.folder.run import restore
from models.stored.run import read_run
from tests.export.compiling import run_in_c
from tests.export.conftest import exported

run = Path("run")
describe(run)
model = restore(read_run(run))
y = torch.from_numpy(growing_cycles(0.02, 5, 0.01, 0.5))
rest = torch.zeros(1, dtype=torch.float64)
drive = Drive(0.01, torch.stack([y, torch.gradient(y, spacing=0.01)[0]], dim=1), rest, rest)
right = model.free_run(drive).a.numpy()
found = run_in_c(step_of(model), drive, Path("c").resolve(), ("-O0",))["r"]
assert np.abs(found - right).max() < 1e-9 * np.abs(right).max()

network = ElementNetworkNamed(1, 1, 0.01, elements=[["ground", "x1"]], masses=[1e3])
network.named.take(0, model.laws[0])
assert "'Steel01'" in script_of(exported(network))
"""


@needs_gcc
def test_a_law_is_added_by_a_file_and_a_line(tmp_path):
    copytree(ROOT / "data", tmp_path / "data", ignore=ignore_patterns("__pycache__"))
    for room in ("models", "conf", "runner", "report", "export", "tests", "hydra_plugins"):
        (tmp_path / room).symlink_to(ROOT / room)
    copy(ROOT / "train.py", tmp_path)
    (text,) = re.findall(
        r"```python\n(# data/simulation/laws/.*?)```",
        (ROOT / "docs" / "adding.md").read_text("utf-8"),
        flags=re.DOTALL,
    )
    (tmp_path / text.split("\n")[0].removeprefix("# ")).write_text(text, "utf-8")
    listed = tmp_path / "data" / "simulation" / "laws" / "__init__.py"
    lines = listed.read_text("utf-8").splitlines(keepends=True)
    kept = [one for one in lines if not one.startswith('    "') or '"polynomial"' in one]
    at = next(i for i, one in enumerate(kept) if one.startswith("CALLED = {"))
    listed.write_text("".join([*kept[: at + 1], LINE, *kept[at + 1 :]]), "utf-8")
    (tmp_path / "c").mkdir()

    words = ["model=element_test", "model.laws=named", "data=measured", "data.path=test.csv"]
    words += ["data.quantity=force", "figures=false", "baselines=none", "hydra.run.dir=run"]
    program = SIMULATE + TRAIN.replace("WORDS", repr(words)) + REPORT  # loaded once
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    trained, _, described = done.stdout.partition("saved in")
    assert "Kinematic" in trained
    assert "r1 Kinematic" in described
