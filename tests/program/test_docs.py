"""What the README and the docs show is run, as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from data.measured.files import table
from data.measured.reading import read_record
from data.record import stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from models.training.assemble import build
from models.training.metrics import free_run_score, score

ROOT = Path(__file__).parents[2]
README, ADDING = ROOT / "README.md", ROOT / "docs" / "adding.md"


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)


def test_the_example_in_python_prints_an_error(capsys):
    (example,) = blocks(README, "python")
    exec(compile(example, "README.md", "exec"), {})
    assert 0.0 < float(capsys.readouterr().out) < 100.0


def test_the_structure_and_the_estimator_of_the_docs_work_together():
    system, model = (OmegaConf.create(text) for text in blocks(ADDING, "yaml"))
    assert model.name == "quadratic_damping"
    structure = build(system.structure)
    force = BandLimitedGaussian(system.excitation.std, system.excitation.band)
    simulation = Simulation(structure, Excitation(force), FullState(), dt=0.005, duration=20.0)
    records, _ = simulation.records("train", 1, seed=0)
    scope: dict = {}
    (code,) = (block for block in blocks(ADDING, "python") if "(Estimator)" in block)
    exec(compile(code, "adding.md", "exec"), scope)
    estimator = scope["QuadraticDamping"](structure.dofs, 2, 0.005)
    assert estimator.identify([stack(records)])["rank"] == 8
    assert score(estimator, [stack(records)])["relative_rms_percent"] < 60.0
    assert free_run_score(estimator, [stack(records)])["diverged"] == 0


def test_the_file_format_of_the_docs_is_read(tmp_path, monkeypatch):
    scope: dict = {}
    (code,) = (block for block in blocks(ADDING, "python") if "Format(" in block)
    exec(compile(code, "adding.md", "exec"), scope)
    monkeypatch.setattr(table, "FORMATS", (*table.FORMATS, scope["LOGGER"]))
    rows = np.array([(1.0, 0.5), (2.0, 0.25), (3.0, 0.0)], dtype=scope["ROW"])
    raw = b"LOGGER01" + np.array([0.01]).tobytes() + rows.tobytes()
    (tmp_path / "run.log").write_bytes(raw)
    read = read_record(tmp_path / "run.log")
    assert (read.dt, read.channels["f1"].tolist()) == (0.01, [1.0, 2.0, 3.0])
    (tmp_path / "run.csv").write_bytes(raw)
    with pytest.raises(ValueError, match=r"content is a file of the logger; rename it to \.log"):
        read_record(tmp_path / "run.csv")
    (tmp_path / "cut.log").write_bytes(raw[:-1])
    with pytest.raises(ValueError, match=r"cut\.log is damaged"):
        read_record(tmp_path / "cut.log")


def test_the_example_of_detection_raises_its_alarm(capsys):
    (example,) = blocks(ROOT / "docs" / "detection.md", "python")
    exec(compile(example, "detection.md", "exec"), {})
    time, dof = re.fullmatch(r"alarm at (\d+) s, x(\d)\n", capsys.readouterr().out).groups()
    assert 25 < int(time) < 40
    assert dof in "12"


@pytest.mark.parametrize("page", sorted([README, *(ROOT / "docs").glob("*.md")]))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", sorted([README, *(ROOT / "docs").glob("*.md")]))
def test_anchors_are_headings(page):
    for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", page.read_text("utf-8")):
        text = (page.parent / target).read_text("utf-8") if target else page.read_text("utf-8")
        headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
        slugs = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
        assert anchor in slugs, f"{page.name} links to {target}#{anchor}"


def test_set_up_commands_are_one_line_each():
    lines = [s for s in README.read_text("utf-8").splitlines() if s.startswith("python3 -m venv")]
    assert len(lines) == 2
    assert lines[0].endswith("python train.py model=vwnn system=bilinear")
    assert lines[1].endswith("python -m pytest")
