"""A finished run scored again: rebuilt from its folder, on its own or on other motions."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from typing import Any

import torch
from omegaconf import DictConfig
from rich.console import Console

from data.datamodule import SimulatedData
from data.simulate import EscapedMotionError
from models.checkpoint import load_estimator
from models.estimator import Estimator
from models.training.assemble import changed, data_from, estimator_from
from models.training.metrics import Scores
from report.figures import run_figures, save_figure
from report.runs import CHECKPOINT
from report.tables import error_table, ways_of

SPLITS = ("train", "test")


def restore(run: DictConfig, folder: Path) -> Estimator:
    """The identified estimator of a run, of the size and time step it was identified with."""
    torch.set_num_threads(run.threads)  # the same threads, the same bits
    estimator = estimator_from(run.model, data_from(run))
    load_estimator(estimator, folder / CHECKPOINT, run.model.name)
    return estimator.eval()


def score_split(
    estimator: Estimator, data: SimulatedData, split: str
) -> tuple[Scores, tuple[Any, Any]]:
    """Score of a split, and its first batch with the estimate of it."""
    score, example = Scores(), None
    for record in data.loader(split):
        estimates = score.update(estimator, record)
        example = example or (record, estimates[""])
    assert example is not None
    return score, example


def score_seeds(
    estimator: Estimator, run: DictConfig, seeds: list[int], same_motions: bool
) -> dict[str, Any]:
    """{seed: {split: scores}}: the test motions; for the run's own, the training motions too.

    A seed whose motion escapes is kept, with the reason under `failed`.
    """
    results: dict[str, Any] = {}
    for seed in seeds:
        data = data_from(changed(run, {"seed": seed}))
        try:
            data.setup()
            splits = SPLITS if same_motions and seed == run.seed else ("test",)
            results[str(seed)] = {s: score_split(estimator, data, s)[0].percent() for s in splits}
        except EscapedMotionError as error:
            if len(seeds) == 1:
                raise
            results[str(seed)] = {"failed": str(error)}
    return results


def print_evaluation(results: dict[str, Any], metrics: dict[str, Any], altered: bool) -> None:
    """Table of the scores beside the run's own, or the statement that they are equal."""
    rows: dict[str, Any] = {}
    for seed, scores in results.items():
        rows |= {f"seed {seed}": scores} if len(results) > 1 else ways_of(f"seed {seed}", scores)
    if altered:
        rows["as trained"] = {split: metrics[split] for split in SPLITS}
    dofs = len(metrics["test"]["per_dof_percent"])
    title = f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}"
    console = Console(width=None if Console().is_terminal else 110)
    console.print(error_table(title, rows, dofs))
    if altered:
        scored = [r["test"]["relative_rms_percent"] for r in results.values() if "test" in r]
        failed = len(results) - len(scored)
        if len(results) > 1:
            console.print(f"test: median {median(scored):.2f} % of {len(scored)}, {failed} failed")
        return
    (scores,) = results.values()
    if all(scores[split] == metrics[split] for split in SPLITS):
        console.print("equal to metrics.json to the last digit")
    else:
        raise ValueError(
            "the scores differ from metrics.json; the code or the libraries changed since the run "
            f"(made with {metrics.get('versions')})"
        )


def draw_figures(estimator: Estimator, run: DictConfig, seed: int, folder: Path) -> None:
    """The run's figures for one seed, as PNG and PDF."""
    data = data_from(changed(run, {"seed": seed}))
    data.setup()
    score, example = score_split(estimator, data, "test")
    names = list(data.simulation.structure.elements)
    for name, figure in run_figures(*example, {"test": score.over_time()}, names).items():
        save_figure(figure, folder, name)
