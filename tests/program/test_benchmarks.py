"""Every benchmark says what it claims and how it is run; what the tables rest on is right."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import coverage, unplanted
from benchmarks.fitting import fit, free_run_error
from benchmarks.table import show
from data.record import stack

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(
    path.stem
    for path in (ROOT / "benchmarks").glob("*.py")
    if "def main(" in path.read_text("utf-8")
)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_opens_with_its_question_and_commands_and_has_help(name, monkeypatch, capsys):
    script = importlib.import_module(f"benchmarks.{name}")
    question, _, rest = script.__doc__.partition("\n\n")
    assert question.endswith("?") or question.partition("\n")[0].endswith(("?", "."))
    assert f"    python -m benchmarks.{name}" in rest
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as left:
        script.main()
    assert left.value.code == 0
    assert "--quick" in capsys.readouterr().out
    assert f"`python -m benchmarks.{name}" in (ROOT / "benchmarks/README.md").read_text("utf-8")


def test_tables_have_80_columns_and_aligned_numbers(capsys):
    show("title", ("model", "error", "seconds"), [["linear", "1.0", 2], ["network", "10.0", 3]])
    *_, head, first, second = capsys.readouterr().out.splitlines()
    assert {len(head), len(first), len(second)} == {80}
    assert first.index("1.0") == second.index("10.0") + 1
    show("", ("model", "error"), [["a name " * 12, "1.0"]])
    *_, name, number = capsys.readouterr().out.splitlines()
    assert name.startswith("a name")
    assert number == "1.0".rjust(80)


def test_the_error_of_a_fit_in_free_run_is_that_of_another_motion():
    """A linear structure is found; a stiffer one is as far off as its motion."""
    case = unplanted.Case([3e4] * 2, [[unplanted.spring(k)] for k in (2.0e7, 1.6e7)])
    train, test = (unplanted.record(case.structure(), 1.0, seed, 800) for seed in (100, 201))
    model, _ = fit(["model=linear", "model.ridge=0"], stack([train]))
    assert free_run_error(model, [test]) < 1.0
    stiffer = unplanted.record(case.structure(1.01), 1.0, 201, 800)
    assert 1.0 < unplanted.apart([stiffer], [test]) < 50.0


def test_noise_is_of_its_size_and_hides_the_state():
    case = unplanted.CASES["steel, 3 storeys"]
    record = unplanted.record(case.structure(), 1.0, 100, 600)
    assert unplanted.noisy(record, 0.0, 0) is record
    noisy = unplanted.noisy(record, 0.02, 0)
    assert noisy.x is noisy.v is None
    assert ((noisy.a - record.a).std(dim=0) / record.a.std(dim=0)).tolist() == pytest.approx(
        [0.02] * 3, rel=0.2
    )


@pytest.mark.parametrize("kind", coverage.KINDS)
def test_a_case_is_its_number_and_its_noise_of_unit_size(kind):
    first, again = (coverage.draw(np.random.default_rng(3), 3, kind) for _ in range(2))
    assert first.elements == again.elements
    assert ("brace" in first.elements) == (kind == "brace")
    record = coverage.records(first, 0)[0]
    rng = np.random.default_rng(0)
    noisy = coverage.noisy(record, rng, coverage.noise_filter(kind, rng))
    share = (noisy.a - record.a).std(dim=0) / (coverage.LEVEL * record.a.std(dim=0))
    assert torch.all((share > 0.6) & (share < 1.4))
