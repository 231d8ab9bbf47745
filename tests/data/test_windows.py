"""Records, their windows and batches: every counted sample once, and nothing out of place."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.record import Record, Truth, stack
from data.windows import WindowDataset


def counted_record(samples: int = 100, dofs: int = 2, offset: float = 0.0) -> Record:
    """A record whose signals hold their own sample numbers."""
    k = offset + torch.arange(float(samples), dtype=torch.float64)[:, None]
    a = k.expand(-1, dofs)
    return Record(
        0.01, a, 2 * k, 3 * a, 4 * a, 5 * k, 6 * k, Truth(7 * a, 8 * a, 9 * a, 10 * k, 11 * k)
    )


def counted_samples(windows: WindowDataset) -> list[float]:
    return [float(k) for w in windows for k in w.a[w.warmup :, 0]]


@pytest.mark.parametrize(
    ("length", "warmup", "last"), [(20, 0, 100), (20, 5, 95), (30, 10, 90), (100, 40, 100)]
)
def test_windows_count_every_sample_after_the_first_warmup_once(length, warmup, last):
    windows = WindowDataset([counted_record()], length, warmup=warmup)
    assert counted_samples(windows) == list(range(warmup, last))
    assert all(w.samples == length and w.warmup == warmup for w in windows)


def test_windows_never_run_from_one_record_into_the_next():
    records = [counted_record(50), counted_record(75, offset=1000.0)]
    windows = WindowDataset(records, 20)
    assert [w.a[0, 0].item() for w in windows] == [0, 20, 1000, 1020, 1040]
    assert all((w.a.diff(dim=0) == 1).all() for w in windows)


def test_all_signals_of_a_window_cover_the_same_samples():
    window = WindowDataset([counted_record()], 25)[2]
    k = torch.arange(50.0, 75.0, dtype=torch.float64)
    for factor, name in enumerate(("a", "f", "x", "v", "s", "s_dot"), start=1):
        assert torch.equal(getattr(window, name)[:, 0], factor * k), name
    for factor, name in enumerate("xvayr", start=7):
        assert torch.equal(getattr(window.truth, name)[:, 0], factor * k), name


@pytest.mark.parametrize(
    ("cut", "message"),
    [
        ({"length": 101}, r"data\.window=101 samples must lie between 2 and .* 100 samples"),
        ({"length": 1}, r"data\.window=1 "),
        ({"length": 20, "warmup": 20}, r"data\.warmup=20 must be shorter than the window of 20"),
        ({"warmup": 100}, r"data\.warmup=100"),
        ({"warmup": -1}, r"data\.warmup=-1"),
        ({"length": 20, "stride": 0}, r"data\.stride=0"),
    ],
)
def test_windows_that_fit_no_record_are_refused(cut, message):
    with pytest.raises(ValueError, match=message):
        WindowDataset([counted_record()], **cut)


@pytest.mark.parametrize("name", ["a", "f", "x", "v", "s", "s_dot"])
def test_a_record_with_a_gap_is_refused_with_the_place_of_the_gap(name):
    record = counted_record()
    signal = getattr(record, name).clone()
    signal[42, -1] = torch.nan
    with pytest.raises(ValueError, match=rf"{name} is not finite at sample 42 \(t = 0.42 s"):
        WindowDataset([record, replace(record, **{name: signal})])


def test_stacked_windows_are_a_batch_in_order():
    windows = WindowDataset([counted_record()], 20, warmup=5)
    batch = stack([windows[i] for i in range(3)])
    assert batch.a.shape == (3, 20, 2)
    assert batch.f.shape == batch.s.shape == (3, 20, 1)
    assert batch.truth.r.shape == (3, 20, 1)
    assert (batch.samples, batch.dofs, batch.warmup, batch.dt) == (20, 2, 5, 0.01)
    for i in range(3):
        assert torch.equal(batch.x[i], windows[i].x)
        assert torch.equal(batch.truth.r[i], windows[i].truth.r)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_windows_from_the_start_and_from_the_middle_all_begin_as_measured(order):
    record = counted_record()
    windows = [record.window(0, 20), record.window(40, 20)]
    batch = stack([windows[i] for i in order])
    assert batch.initial_state == "given"
    assert torch.equal(batch.drive().x0[order.index(1)], record.x[40])


@pytest.mark.parametrize(
    "other",
    [
        counted_record(99),
        counted_record(dofs=3),
        replace(counted_record(), dt=0.02),
        replace(counted_record(), warmup=1),
        replace(counted_record(), hold="zero_order"),
    ],
    ids=["length", "dofs", "dt", "warmup", "hold"],
)
def test_unlike_records_make_no_batch(other):
    with pytest.raises(ValueError, match="records differ in"):
        stack([counted_record(), other])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.0}, r"dt=0\.0 s must be positive"),
        ({"dt": float("nan")}, "must be positive"),
        ({"a": torch.zeros(1, 2)}, r"\(1, 2\) has too few samples"),
        ({"a": torch.zeros(100)}, "too few samples"),
        ({"f": torch.zeros(99, 1)}, r"f has shape \(99, 1\), which does not fit a .*\(100, 2\)"),
        ({"x": torch.zeros(100, 3)}, r"x has shape \(100, 3\)"),
        ({"v": torch.zeros(99, 2)}, r"v has shape \(99, 2\)"),
        ({"s": torch.zeros(4, 100, 1)}, r"s has shape \(4, 100, 1\)"),
        ({"warmup": 100}, "warmup=100 samples must be shorter"),
        ({"warmup": -1}, "warmup=-1"),
    ],
)
def test_signals_that_do_not_fit_make_no_record(change, message):
    with pytest.raises(ValueError, match=message):
        replace(counted_record(), **change)
