"""Every benchmark says what it claims and how it is run; what the tables rest on is right."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path

import pytest

from benchmarks import unplanted
from benchmarks.fitting import fit, free_run_error
from benchmarks.same_numbers import compared, results

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


def test_the_error_of_a_fit_in_free_run_is_that_of_another_motion():
    """A linear structure is found; a stiffer one is as far off as its motion."""
    case = unplanted.Case([3e4] * 2, [[unplanted.spring(k)] for k in (2.0e7, 1.6e7)])
    train, test = (unplanted.record(case.structure(), 1.0, seed, 800) for seed in (100, 201))
    model, _ = fit(["model=linear", "model.ridge=0"], [train])
    assert free_run_error(model, [test]) < 1.0
    stiffer = unplanted.record(case.structure(1.01), 1.0, 201, 800)
    assert 1.0 < unplanted.apart([stiffer], [test]) < 50.0


# --- what counts as a difference between two runs, and how they pair

RUN = {
    "test": {"relative_rms_percent": "1.0", "per_dof_percent": ["1.0", "2.0"]},
    "fit_seconds": "3.1",
    "identity": {"results": 1},
    "versions": {"torch": "2"},
    "baselines": {"linear": {"fit_seconds": "0.2"}},
}


def test_times_identity_and_versions_are_no_difference():
    other = {
        **RUN,
        "fit_seconds": "9",
        "identity": {},
        "versions": None,
        "baselines": {"linear": {}},
    }
    assert compared(RUN, other) == (True, "identical")


def test_a_last_digit_is_a_difference_and_is_named_with_both_values():
    other = json.loads(json.dumps(RUN))
    other["test"]["per_dof_percent"][1] = "2.0000000000000004"
    same, line = compared(RUN, other)
    assert not same
    assert line == "differs in test.per_dof_percent[1]: 2.0 before, 2.0000000000000004 now"
    assert not compared(RUN, {**RUN, "test": {**RUN["test"], "per_dof_percent": ["1.0"]}})[0]


def test_runs_of_a_sweep_pair_without_their_hashes(tmp_path):
    for name, number in (("linear-bilinear-seed0-aaaa", "0.10"), ("linear-bilinear-seed1-bb", "1")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metrics.json").write_text(f'{{"test": {number}}}')
    assert results(tmp_path) == {
        "linear-bilinear-seed0": {"test": "0.10"},
        "linear-bilinear-seed1": {"test": "1"},
    }
    (tmp_path / "linear-bilinear-seed1-cc").mkdir()
    (tmp_path / "linear-bilinear-seed1-cc" / "metrics.json").write_text("{}")
    with pytest.raises(ValueError, match="several runs linear-bilinear-seed1"):
        results(tmp_path)
