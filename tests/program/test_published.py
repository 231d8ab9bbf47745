"""Published packages beside the zoo: the error, the runner, and each package on what it can do."""

from __future__ import annotations

import csv
import json
import math
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.published import __main__ as runner
from benchmarks.published import measure, narx, sindy, subnet
from benchmarks.published.page import write_page
from benchmarks.published.table import cells, percent, rows
from data.record import Record


def installed(package: object) -> pytest.MarkDecorator:
    name = package.PACKAGE  # type: ignore[attr-defined]
    return pytest.mark.skipif(
        find_spec(name) is None, reason=f"{name} is not installed; {measure.INSTALL}"
    )


def result(error: float | None, remark: str = "") -> dict:
    return {
        "model": "narx", "version": "1", "system": "bilinear", "records": 8,
        "error": error, "fit_seconds": 1.0, "remark": remark,
    }  # fmt: skip


def test_error_is_eq_21_and_a_huge_or_undefined_run_has_diverged() -> None:
    a = torch.tensor([[3.0], [4.0]], dtype=torch.float64)
    record = Record(dt=0.1, a=a, f=a)
    assert measure.free_run_error(lambda _: 0.8 * a.numpy(), record) == pytest.approx(0.2)
    for bad in (np.nan, np.inf, 401.0):
        assert measure.free_run_error(lambda _, bad=bad: np.full((2, 1), bad), record) == math.inf
    assert math.isfinite(measure.free_run_error(lambda _: np.full((2, 1), 399.0), record))


def test_a_diverged_run_counts_as_infinite() -> None:
    two = [result(0.1), result(0.3), result(None, "diverged")]
    assert cells(two) == ("30 (10–∞)", "1 of 3", "1.0")
    assert cells([result(None, "over time")])[1] == "0 of 1, 1 over time"
    assert cells([result(None, "no free run")])[0] == "no free run"
    assert [row[:4] for row in rows(two)] == [("bilinear", "8", "narx", "1")]


def test_percent_keeps_three_digits_and_what_lies_before_the_point() -> None:
    assert [percent(e) for e in (0.000123, 0.25, 1.04, 13.34, math.inf)] == [
        "0.0123", "25", "104", "1334", "∞"
    ]  # fmt: skip


def test_page_is_filled_from_the_results_and_names_what_is_lost(tmp_path: Path) -> None:
    def run(model: str, seed: int, error: float | None, remark: str = "") -> dict:
        version, seconds = ("zoo", None) if model == "linear" else ("1.5", 5.0)
        case = {"version": version, "seconds": seconds, "duration": 50.0, "seed": seed}
        return result(error, remark) | {"model": model} | case

    ours = [run("linear", 40, 0.2), run("linear", 41, 0.3)]
    theirs = [run("narx", 40, 0.1), run("narx", 41, None, "over time"), run("sindy", 40, 0.26)]
    page = tmp_path / "page.md"
    write_page(page, [*theirs, *ours], range(40, 43))
    text = page.read_text(encoding="utf-8")
    assert "$" not in text
    head, rule, *lines = text.split("Median over the seeds:\n\n")[1].split("\n\n")[0].splitlines()
    assert head == "| model | bilinear, 8 records |"
    assert rule == "| --- | ---: |"
    assert lines == ["| `linear` | 25 |", "| `sindy` | 26 |", "| `narx` | ∞ |"]
    assert "A package has the smallest median of all: nowhere." in text
    assert "An estimator of the zoo has it: `linear` on bilinear, 8 records." in text
    assert "| `narx` | bilinear | 1 of 2 |" in text
    assert "| `sindy` | bilinear | 0 of 1 |" in text
    assert "| `narx` | bilinear | 8 | over time | 41 |" in text
    assert "**Incomplete:** planned are seeds 42 too" in text
    assert "--models linear --seeds 40 41 --page" in text
    assert "deepSI, not run" in text


def test_missing_packages_are_named_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measure, "find_spec", lambda _: None)
    monkeypatch.setattr(sys, "argv", ["published", "--quick"])
    with pytest.raises(SystemExit) as stop:
        runner.main()
    assert stop.value.code == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "deepSI, sysidentpy, pysindy: not installed; pip install -e '.[published]'" in said


def test_a_stored_result_is_not_measured_again(tmp_path: Path) -> None:
    path, settings = tmp_path / "a.json", {"seconds": 5.0}
    assert runner.stored(path, settings, lambda: {"error": 0.5}) == {"seconds": 5.0, "error": 0.5}
    assert runner.stored(path, settings, lambda: pytest.fail("measured again"))["error"] == 0.5
    with pytest.raises(ValueError, match=r"seconds=5.0, now it is 6.0; choose another --output"):
        runner.stored(path, {"seconds": 6.0}, dict)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such alarm")
def test_a_fit_without_end_is_stopped_by_processor_time_not_by_the_clock() -> None:
    with measure.limited(0.2):
        time.sleep(0.4)  # takes no processor

    def endless() -> None:
        while True:
            pass

    with measure.limited(0.05), pytest.raises(measure.Overtime):
        endless()


def test_zoo_alone_needs_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = "--quick --packages --models linear --systems polynomial --output"
    monkeypatch.setattr(sys, "argv", ["published", *words.split(), str(tmp_path)])
    runner.main()
    stored = json.loads((tmp_path / "results/linear-polynomial-1-seed0.json").read_text())
    with open(tmp_path / "results.csv", encoding="utf-8") as file:
        assert float(next(csv.DictReader(file))["error"]) == stored["error"]
    assert 0.0 < stored["error"] < 1.0
    assert "| linear | zoo |" in (tmp_path / "table.md").read_text(encoding="utf-8")


@installed(sindy)
def test_sindy_recovers_a_linear_structure(linear_record: Record) -> None:
    simulate = sindy.fit([linear_record], 0, 60.0)
    assert measure.free_run_error(simulate, linear_record) < 1e-4


@installed(sindy)
def test_products_from_the_table_are_those_of_the_package(bilinear_record: Record) -> None:
    x, u = sindy.state(bilinear_record), bilinear_record.f.numpy()
    model = sindy.model_of(0.5)
    model.fit([x], t=bilinear_record.dt, x_dot=[sindy.derivative(bilinear_record)], u=[u])
    theirs = super(type(model), model).predict(x, u)
    assert np.allclose(model.predict(x, u), theirs, rtol=1e-10, atol=1e-10)


@installed(narx)
def test_narx_recovers_a_planted_model_from_two_records() -> None:
    """Exactly, so no row of the regression reaches across the joint of the records."""
    rng = np.random.default_rng(0)

    def planted(samples: int) -> Record:
        f, a = rng.normal(size=samples + 2), np.zeros(samples + 2)
        f[:2] = 0.0  # at rest
        for k in range(2, samples + 2):
            a[k] = 1.2 * a[k - 1] - 0.5 * a[k - 2] + f[k] + 0.1 * a[k - 1] * f[k - 1]
        signals = (torch.from_numpy(s[2:, None]) for s in (a, f))
        return Record(0.1, *signals)

    simulate = narx.fit([planted(300), planted(200)], 0, 60.0)
    assert measure.free_run_error(simulate, planted(250)) < 1e-6


@installed(subnet)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the package leaves its files open
def test_subnet_simulates_from_rest_and_leaves_the_home_folder_alone(
    linear_record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    simulate = subnet.fit([linear_record], 0, 1.0)
    a = simulate(linear_record.drive())
    assert a.shape == linear_record.a.shape
    assert np.isfinite(a).all()
    assert not list(tmp_path.iterdir())
