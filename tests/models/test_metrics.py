"""Eq. 21 by hand, over batches, and what it must not count."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.record import Record, Truth
from models.baselines import LastValue
from models.estimator import Estimator
from models.fit.metrics import RelativeRMSError, Scores, score

MEASURED = torch.tensor([[3.0, 0.0], [0.0, 4.0], [5.0, 0.0]], dtype=torch.float64)
ERROR = torch.tensor([[0.3, 0.0], [0.0, 0.8], [0.0, 1.2]], dtype=torch.float64)


class Fixed(Estimator):
    """Estimates what it was told to."""

    reads = ()

    def __init__(self, estimate: torch.Tensor) -> None:
        super().__init__(estimate.shape[-1], 1, 0.01)
        self.estimate = estimate
        self.seen: list[Record] = []

    def forward(self, record: Record) -> torch.Tensor:
        self.seen.append(record)
        return self.estimate


def record_of(a: torch.Tensor, true: torch.Tensor | None = None, warmup: int = 0) -> Record:
    f = a[..., :1]
    truth = None if true is None else Truth(true, true, true, f, f)
    return Record(0.01, a, f, truth=truth, warmup=warmup)


def compute(*batches):
    metric = RelativeRMSError(batches[0][0].shape[-1])
    for estimate, measured in batches:
        metric.update(estimate, measured)
    return {**metric.compute(), "over_time": metric.over_time()}


def test_eq_21_by_hand():
    errors = compute((MEASURED + ERROR, MEASURED))
    assert errors["total"].item() == pytest.approx((2.17 / 50.0) ** 0.5, rel=1e-12)
    assert errors["per_dof"].tolist() == pytest.approx([0.3 / 34**0.5, 2.08**0.5 / 4.0], rel=1e-12)
    by_hand = [0.3 / 3.0, (0.73 / 25.0) ** 0.5, (2.17 / 50.0) ** 0.5]
    assert errors["over_time"].tolist() == pytest.approx(by_hand, rel=1e-12)


def test_batches_accumulate_squares_and_are_not_averaged():
    loud, quiet = 10.0 * MEASURED, MEASURED
    apart = compute((loud, loud), (quiet + ERROR, quiet))
    together = compute((torch.stack([loud, quiet + ERROR]), torch.stack([loud, quiet])))
    for name in ("total", "per_dof", "over_time"):
        assert torch.allclose(apart[name], together[name], rtol=1e-14)
    assert apart["total"].item() == pytest.approx((2.17 / (50.0 * 101.0)) ** 0.5, rel=1e-12)


def test_a_silent_start_has_no_error_over_time():
    measured = torch.cat([torch.zeros(2, 2).double(), MEASURED])
    over_time = compute((measured, measured))["over_time"]
    assert torch.equal(over_time, torch.zeros(5).double())


def test_a_dof_that_never_moves_has_no_relative_error():
    still = MEASURED * torch.tensor([1.0, 0.0])
    with pytest.raises(ValueError, match="acceleration of a DOF is zero"):
        compute((still + ERROR, still))


def test_records_of_unequal_length_count_by_their_samples():
    together, longer = RelativeRMSError(2), torch.cat([MEASURED, 2.0 * MEASURED])
    together.update(1.1 * MEASURED, MEASURED)
    together.update(0.8 * longer, longer)
    errors = together.compute()
    size, long = float((MEASURED**2).sum()), float((longer**2).sum())
    by_hand = ((0.01 * size + 0.04 * long) / (size + long)) ** 0.5
    assert float(errors["total"]) == pytest.approx(by_hand, rel=1e-12)
    squares = 0.01 * (MEASURED**2).sum(dim=0) + 0.04 * (longer**2).sum(dim=0)
    assert errors["rms"].tolist() == pytest.approx((squares / 9.0).sqrt().tolist(), rel=1e-12)
    assert together.over_time().shape == (6,)


def test_scores_are_percent_against_measured_and_true():
    noise = torch.tensor([[0.0, 0.5], [0.5, 0.0], [0.0, 0.0]], dtype=torch.float64)
    estimator = Fixed(MEASURED + ERROR)
    result = score(estimator, [record_of(MEASURED + noise, true=MEASURED)])
    against_true = 100.0 * (2.17 / 50.0) ** 0.5
    residual = ((ERROR - noise) ** 2).sum() / ((MEASURED + noise) ** 2).sum()
    assert result["relative_rms_percent_true"] == pytest.approx(against_true, rel=1e-12)
    assert result["relative_rms_percent"] == pytest.approx(100.0 * float(residual) ** 0.5)
    assert result["per_dof_percent_true"] == pytest.approx([30.0 / 34**0.5, 25.0 * 2.08**0.5])
    assert len(result["per_dof_percent"]) == 2


def test_warm_up_samples_are_not_counted():
    wild = ERROR.clone()
    wild[0] = 1e6
    estimator = Fixed(MEASURED + wild)
    result = Scores()
    result.update(estimator, record_of(MEASURED, true=MEASURED, warmup=1))
    by_hand = 100.0 * ((0.64 + 1.44) / 41.0) ** 0.5
    assert result.percent()["relative_rms_percent"] == pytest.approx(by_hand, rel=1e-12)
    assert result.percent()["relative_rms_percent_true"] == pytest.approx(by_hand, rel=1e-12)
    assert result.over_time().shape == (2,)
    assert result.over_time()[0].item() == pytest.approx(0.8 / 4.0)


def test_windows_with_warm_up_score_as_the_whole_record(bilinear_record):
    estimator = LastValue(3, 3, 0.01)
    whole = score(estimator, [replace(bilinear_record, warmup=100)])
    windows = [bilinear_record.window(start, 280, warmup=100) for start in range(0, 721, 180)]
    assert len(windows) == 5
    cut = score(estimator, windows)
    for name in ("relative_rms_percent", "relative_rms_percent_true"):
        assert cut[name] == pytest.approx(whole[name], rel=1e-12)


def test_the_estimator_is_not_shown_the_truth():
    estimator = Fixed(MEASURED)
    score(estimator, [record_of(MEASURED, true=MEASURED)])
    assert [record.truth for record in estimator.seen] == [None]
    assert torch.equal(estimator.seen[0].a, MEASURED)
