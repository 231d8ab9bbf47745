"""What is a result and what is none: judged on training motions, told in tables and counts."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from data.record import Drive, Record, Response
from data.terminal import terminal
from models.baselines import TwoPoint
from models.estimator import Estimator
from models.fit.blocks import beyond_chance, errors_by_block
from models.fit.metrics import RelativeRMSError
from report.collection.compare import as_table, compare
from report.collection.report import long_table, status_counts
from runner.config.command_line import refusals
from runner.progress import sweep_tables
from runner.scores import verdict as verdict_file
from runner.scores.outcome import require_identified
from runner.scores.result import FINISHED, Result, read_result, spread_of
from runner.scores.spread import ESCAPED, FAILED, Spread, percent
from runner.scores.verdict import NotIdentifiedError, compare_with, judgement, lost_on

DIVERGED = {"relative_rms_percent": None, "diverged": 1, "diverged_after_s": [2.8]}


def scores(percent: float) -> dict:
    return {"relative_rms_percent": percent, "per_dof_percent": [percent]}


@pytest.mark.parametrize(
    ("of_run", "on_base", "said"),
    [
        (DIVERGED, False, "diverges after 2.8 s"),
        (scores(120.0), False, "errs by 120 %, no motion at all by 100 %"),
        (scores(120.0), True, "moving rigidly with the base by 100 %"),
        (scores(40.0), False, ""),
    ],
)
def test_a_free_run_in_training_is_held_against_no_motion(of_run, on_base, said):
    verdict = judgement("free run", of_run, on_base)
    assert verdict["identified"] is (said == "")
    assert said in verdict["reason"]


class Off(Estimator):
    """A model that misses a motion by a share of it, and by chance."""

    reads = ("f",)

    def __init__(self, share: float, chance: float = 0.0) -> None:
        super().__init__(1, 1, 0.01)
        self.share, self.chance = share, chance

    def free_run(self, drive: Drive) -> Response:
        generator = torch.Generator().manual_seed(int(1e6 * self.share))
        noise = torch.randn(drive.u.shape, generator=generator, dtype=torch.float64)
        a = (1.0 - self.share) * drive.u + self.chance * drive.u.std() * noise
        return Response(a, a, a)


class Named(Off):
    """The same, not of the class of its opponents."""


MOTION = torch.randn(2000, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def compared(own: float, other: float, chance: float = 0.0, way: str = "free run") -> dict:
    record = Record(0.01, MOTION, MOTION)
    own_model = Off(own, chance) if way == "free run" else OneStep(own)
    rival = Named(other, chance) if way == "free run" else TwoPoint(1, 1, 0.01)
    return compare_with(own_model, {"linear": rival}, [record], {"test": [record]}, way)


class Growing(Off):
    """Right on the motion that it was trained on, and far off on others of the same spectrum."""

    def free_run(self, drive: Drive) -> Response:
        own = torch.allclose(drive.u, MOTION)
        a = drive.u if own else drive.u * self.share
        return Response(a, a, a)


@pytest.mark.parametrize(
    ("times", "said"), [(100.0, " times the motion of training"), (np.inf, "grows without end")]
)
def test_a_free_run_that_grows_under_like_excitations_is_unstable(times, said):
    record = Record(0.01, MOTION, MOTION)
    verdict = compare_with(Growing(times), {}, [record], {"test": [record]}, "free run")
    assert said in verdict["unstable"]
    assert verdict["unstable"].endswith("under excitations of the same spectrum")
    assert verdict["not_better"] == verdict["unstable"]
    assert compared(0.1, 0.3)["unstable"] == ""


class OneStep(Estimator):
    reads = ("a", "f")

    def __init__(self, share: float) -> None:
        super().__init__(1, 1, 0.01)
        self.share = share

    def forward(self, record: Record) -> torch.Tensor:
        return (1.0 - self.share) * record.f


def test_a_model_that_is_better_than_plain_ones_is_good(monkeypatch):
    monkeypatch.setattr(verdict_file, "PLAIN", (Named,))
    verdict = compared(0.1, 0.3)
    assert (verdict["as_good"], verdict["not_better"]) == ("", "")
    assert verdict["opponents"]["test"]["linear"] == pytest.approx(30.0)


@pytest.mark.parametrize(("own", "other", "said"), [
    (0.4, 0.3, "it errs by 40.00 % on the test motion; better: linear (30.00 %)"),
    (0.303, 0.3, "it errs by 30.30 % on the test motion; better: linear (30.00 %)"),
    (0.3, 0.3, "it errs by 30.00 % on the test motion; as good: linear (30.00 %)"),
    (5e-4, 1e-6, ""),  # as close as anybody asks
])  # fmt: skip
def test_a_plain_model_that_is_as_good_or_better_is_told(monkeypatch, own, other, said):
    """A model that is no better than it is no result."""
    monkeypatch.setattr(verdict_file, "PLAIN", (Named,))
    verdict = compared(own, other)
    assert verdict["as_good"].startswith(said)
    assert bool(verdict["as_good"]) is bool(said)
    assert ("linear by 30.00 %" in verdict["not_better"]) is bool(said)
    assert bool(verdict["worse"]) is (bool(said) and own > other)  # as good is not worse


def test_a_plain_model_is_no_result_less_for_another(monkeypatch):
    monkeypatch.setattr(verdict_file, "PLAIN", (Named, Off))
    verdict = compared(0.4, 0.3)
    assert "linear (30.00 %)" in verdict["as_good"]
    assert (verdict["worse"], verdict["not_better"]) == ("", "")


@pytest.mark.parametrize(("other", "worse"), [(0.523, False), (0.51, True)])
def test_what_differs_by_chance_is_as_good(monkeypatch, other, worse):
    monkeypatch.setattr(verdict_file, "PLAIN", (Named,))
    verdict = compared(0.5, other, chance=0.5)
    assert verdict["as_good"]
    assert bool(verdict["not_better"]) is worse


def test_a_motion_that_fits_by_chance_is_no_result():
    """It is better than no motion in every block, by a hundredth."""
    assert "no motion at all by 99.99" in compared(0.99, 1.0)["not_better"]


@pytest.mark.parametrize("way", ["free run", "one step"])
def test_what_is_as_good_as_no_motion_is_no_result(way):
    assert "errs by 100 %" in compared(1.0, 1.0, way=way)["not_better"]


def test_a_model_that_runs_away_under_excitations_like_those_of_training_is_no_result():
    """On the motions that there are nobody sees it."""

    class Fragile(Off):
        def free_run(self, drive: Drive) -> Response:
            run = super().free_run(drive)
            same = torch.equal(drive.u, MOTION)
            return run if same else Response(run.x, run.v, 12.0 * run.a)

    record = Record(0.01, MOTION, MOTION)
    verdict = compare_with(Fragile(0.1), {}, [record], {"test": [record]}, "free run")
    assert "times the motion of training under excitations" in verdict["not_better"]
    assert compared(0.1, 0.3)["not_better"] == ""


def test_an_estimate_one_step_ahead_is_no_failure_where_an_extrapolation_is_better():
    smooth = torch.sin(torch.arange(2000, dtype=torch.float64) / 40.0)[:, None]
    opponents = {"two_point": TwoPoint(1, 1, 0.01)}
    motions = {"test": [Record(0.01, smooth, smooth)]}
    verdict = compare_with(OneStep(0.1), opponents, motions["test"], motions, "one step")
    assert verdict["as_good"].endswith("better: two_point (0.10 %)")
    assert verdict["not_better"] == ""
    require_identified({"model": "vwnn", "verdict": {"identified": True, **verdict}})


def test_errors_on_blocks_are_those_of_the_whole_motion():
    records = [replace(Record(0.01, k * MOTION, MOTION), warmup=20) for k in (1.0, 3.0)]
    estimates = [0.8 * record.a + 0.1 for record in records]
    error = RelativeRMSError(1)
    for record, estimate in zip(records, estimates, strict=True):
        error.update(estimate[20:], record.a[20:])
    whole = float(error.compute()["total"]) ** 2
    assert errors_by_block(records, estimates).mean() == pytest.approx(whole, rel=1e-9)


def test_a_finished_run_that_is_no_result_ends_with_a_status_of_its_own():
    for verdict in ({"identified": False, "reason": "it errs"},
                    {"identified": True, "not_better": "it errs"}):  # fmt: skip
        with pytest.raises(SystemExit) as end, refusals():
            require_identified({"model": "gru", "verdict": verdict})
        assert end.value.code == 3


def test_what_cannot_run_free_is_not_judged_by_it():
    verdict = judgement("free run", {"no_free_run": "it begins in motion"}, False)
    assert (verdict["identified"], verdict["reason"]) == (None, "it begins in motion")


def test_a_test_motion_on_which_a_free_run_diverges_is_named_and_no_success():
    runs = {"small": scores(10.0), "large": DIVERGED, "other": DIVERGED}
    lost = lost_on(runs, {"small": False, "large": True, "other": False})
    assert lost.endswith(": large at 2.8 s, outside the trained range; other at 2.8 s")
    assert lost_on({"small": scores(10.0)}, {"small": True}) == ""
    verdict = judgement("free run", scores(10.0), False) | {"test_diverges": lost}
    assert verdict["identified"]
    with pytest.raises(NotIdentifiedError, match="gru does not model the test motion: its free"):
        require_identified({"model": "gru", "verdict": verdict})


@pytest.fixture
def runs(tmp_path):
    """Three runs of one case: identified, not identified, and of older code without a verdict."""
    verdicts = (
        {"verdict": judgement("free run", scores(10.0), False)},
        {"verdict": judgement("free run", scores(150.0), False)},
        {},
    )
    for seed, verdict in enumerate(verdicts):
        folder = tmp_path / f"gru-bilinear-full_state-seed{seed}-0"
        folder.mkdir()
        names = {"model": "gru", "system": "bilinear", "scenario": "full_state", "seed": seed}
        errors = {key: scores(10.0 + 5 * seed) for key in ("train", "test", "free_run")}
        (folder / "metrics.json").write_text(json.dumps({**names, **errors, **verdict}))
    return [read_result(folder) for folder in sorted(tmp_path.iterdir())]


def test_tables_count_what_is_no_result_and_keep_its_numbers(runs, capsys):
    assert [run.identified for run in runs] == [True, False, None]
    assert [run.status for run in runs] == ["finished"] * 3
    spread = spread_of(runs, lambda run: run.error("test"))
    assert (spread.values, spread.counts()) == ((10.0, 15.0, 20.0), "3, 1 not identified")
    for width in (80, 160):
        (table,) = sweep_tables([("", run) for run in runs], width)
        terminal(width).print(table)
        assert "1 not identified" in capsys.readouterr().out
    rows = long_table(runs).to_pylist()
    found = {row["run"][-3]: (row["status"], row["reason"]) for row in rows}
    assert found["0"] == found["2"] == ("finished", "")
    assert found["1"][0] == "not identified"
    assert "no motion at all" in found["1"][1]
    assert status_counts(runs) == "3 runs: 2 finished, 1 not identified"
    comparison = compare(runs, ["seed"], "relative_rms_percent", "test")
    assert "not identified" in [str(column.header) for column in as_table(comparison).columns]


def test_a_record_that_is_stronger_than_all_others_is_no_chance():
    """One earthquake of ten times the others: a model that errs by a quarter is good."""
    rng = np.random.default_rng(3)
    records, estimates = [], []
    for strength in (10.0, 1.0, 1.0):
        a = torch.from_numpy(strength * rng.standard_normal((400, 2)))
        records.append(Record(dt=0.01, a=a, f=torch.zeros(400, 1)))
        estimates.append(a + 0.25 * strength * torch.from_numpy(rng.standard_normal((400, 2))))
    own = errors_by_block(records, estimates)
    still = errors_by_block(records, [torch.zeros_like(r.a) for r in records])
    assert still == pytest.approx(1.0, abs=0.05)
    assert own.mean() == pytest.approx(
        sum(float((e - r.a).square().sum()) for e, r in zip(estimates, records, strict=True))
        / sum(float(r.a.square().sum()) for r in records)
    )
    assert beyond_chance(own, still) > 10.0


# How runs count: medians with diverged and failed runs, draws that escaped, ranges


def counted(*values: float | str) -> list[Result]:
    """Finished runs with these test errors, None: diverged; words: runs without numbers."""
    return [
        Result(Path(str(seed)), value, "why", {}, {})
        if isinstance(value, str)
        else Result(Path(str(seed)), FINISHED, "", {}, {"test": {"relative_rms_percent": value}})
        for seed, value in enumerate(values)
    ]


def spread(*values: float | str) -> Spread:
    return spread_of(counted(*values), lambda run: run.error("test"))


def test_diverged_and_failed_runs_are_infinite_and_never_left_out():
    ours = spread(9.0, None, FAILED, 10.0, 11.0)
    assert (ours.median, *ours.range) == (11.0, 9.0, math.inf)
    assert (ours.runs, ours.diverged, ours.failed) == (5, 1, 1)
    assert ours.text() == "11.00 (9.00 – diverged)"
    assert ours.counts() == "5, 1 diverged, 1 failed"


def test_a_draw_whose_structure_escaped_is_counted_and_changes_no_statistic():
    ours, without = spread(9.0, ESCAPED, 11.0), spread(9.0, 11.0)
    assert (ours.median, ours.quartiles, ours.range) == (10.0, (9.5, 10.5), (9.0, 11.0))
    assert (ours.median, ours.quartiles) == (without.median, without.quartiles)
    assert ours.counts() == "3, 1 escaped"
    assert spread(ESCAPED).text() == "–"


def test_what_failed_has_no_number_where_no_run_of_its_case_has_one():
    """A model without a free run, say."""
    ours = spread_of(counted(1.0, FAILED), lambda run: run.free_run)
    assert (ours.values, ours.runs, ours.failed) == ((), 2, 1)
    assert spread(FAILED, FAILED).text() == "failed"


@pytest.mark.parametrize(("value", "inside"), [(9.0, True), (10.5, True), (1e9, False)])
def test_an_infinite_end_lets_no_value_in(value, inside):
    assert spread(9.0, 10.5, None).holds(value) is inside
    assert not spread(None).holds(value)


def test_percents_have_the_digits_that_can_be_read():
    texts = [percent(value) for value in (0.004, 9.996, 99.996, 1234.5, 2e5, math.inf, None)]
    assert texts == ["0.00", "10.00", "100", "1234", "2e+05", "diverged", ""]
