"""What the study of feedthrough compares: filters that see the sample to be estimated, or not."""

from __future__ import annotations

from studies.feedthrough import feedthrough_errors


def test_a_filter_that_sees_the_sample_seems_better_on_every_system():
    errors = feedthrough_errors(range(20, 21))
    assert set(errors) == {"bilinear", "polynomial", "bouc_wen"}
    for by_name in errors.values():
        for split in ("train", "test"):
            (leaky,), (causal,) = by_name[f"leaky {split}"], by_name[f"causal {split}"]
            assert leaky < 0.75 * causal
