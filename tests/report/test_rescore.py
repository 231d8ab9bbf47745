"""A run scored again on other seeds: what is printed of all of them together."""

from __future__ import annotations

from report.run.rescore import agree, print_evaluation


def test_medians_over_seeds_count_what_diverged_and_what_escaped(capsys):
    def scores(test: float, free_run: float | None) -> dict:
        one_step = {"relative_rms_percent": test, "per_dof_percent": [test]}
        return {"test": one_step, "free_run": {"relative_rms_percent": free_run}}

    results = {"5": scores(9.0, 20.0), "6": scores(11.0, None), "7": {"failed": "it escaped"}}
    metrics = {"model": "linear", "system": "bilinear", "scenario": "noisy", **scores(9.0, 20.0)}
    print_evaluation(results, metrics, altered=True)
    *_, one_step, free_run = capsys.readouterr().out.splitlines()
    assert one_step == "test: median 10.00 (9.00 – 11.00) %, seeds: 3, 1 escaped"
    assert free_run.endswith("diverged (20.00 – diverged) %, seeds: 3, 1 diverged, 1 escaped")


def test_rounding_is_no_difference_and_more_is():
    some = {"test": {"relative_rms_percent": 10.0, "per_dof_percent": [1.0, None]}}
    near = {"test": {"relative_rms_percent": 10.0 + 1e-9, "per_dof_percent": [1.0, None]}}
    far = {"test": {"relative_rms_percent": 10.0 + 1e-7, "per_dof_percent": [1.0, None]}}
    assert agree(some, near)
    assert not agree(some, far)
    assert not agree(some, {"test": {}})
