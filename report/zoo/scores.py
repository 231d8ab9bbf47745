"""Errors of a published model on its own test motion, and on motions of other seeds."""

from __future__ import annotations

from typing import Any

from omegaconf import DictConfig

from data.record import stack
from data.simulation.datamodule import SimulatedData
from data.simulation.motion import EscapedMotionError
from models.estimator import Estimator
from models.training.assemble import changed, data_from
from models.fit.metrics import FreeRunScore, Scores
from report.run.rescore import scores_of

SEEDS = (0, 1, 2, 3, 4)  # of the test motions that a card tells of
ERROR = "relative_rms_percent"


def is_simulated(cfg: DictConfig) -> bool:
    return cfg.system.structure is not None


def over_seeds(estimator: Estimator, cfg: DictConfig) -> list[dict[str, Any]]:
    """For each seed: errors [%] of the free run and one step ahead, None where it diverges.

    Or why there is none: the structure's own motion escaped, or the model cannot simulate.
    """
    rows: list[dict[str, Any]] = []
    for seed in SEEDS:
        data = data_from(changed(cfg, {"seed": seed}))
        assert isinstance(data, SimulatedData)
        try:
            records, _ = data.simulation.records("test", 1, seed, data.train_records)
        except EscapedMotionError as error:
            rows.append({"seed": seed, "escaped": str(error)})
            continue
        one_step, free_run = Scores(), FreeRunScore()
        one_step.update(estimator, stack(records))
        free_run.update(estimator, stack(records))
        percent = free_run.percent()
        row = {"seed": seed, "one_step_percent": one_step.percent()[ERROR]}
        row |= {"none": percent["none"]} if "none" in percent else {}
        rows.append(row | {"free_run_percent": percent.get(ERROR)})
    return rows


def again(estimator: Estimator, cfg: DictConfig) -> dict[str, Any]:
    """The scores of the test motion under the keys of metrics.json, computed from the records."""
    data = data_from(cfg)
    if isinstance(data, SimulatedData):
        records, _ = data.simulation.records(
            "test", data.test_records, cfg.seed, data.train_records
        )
        data.records = {"test": records}
    else:
        data.setup()
    return scores_of(estimator, data, ("test",))
