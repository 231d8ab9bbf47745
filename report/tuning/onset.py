"""Finished runs of searches scored without the first second of the test motion. No training.

    python -m report.tuning.onset                 of the searches in runs/tune_…
    python -m report.tuning.onset FOLDER FOLDER

At the first sample the force sets in, which no estimate of one step ahead can foresee. Each run on
fresh seeds keeps its scores in its onset.json, and a run with scores of this code is not scored
again. Some seconds a run, side by side.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from omegaconf import DictConfig

from models.baselines import TwoPoint
from models.training.assemble import changed, data_from
from models.training.metrics import score
from report.tuning.cases import USUAL, WAYS, Case, read_cases
from runner.command_line import one_line_errors, quiet_lightning
from runner.identity import written_code_version
from runner.run_folder import CONFIG, read_run, restore, write_json

FILE = "onset.json"
ONSET = 100  # samples: the first second, as little counted here as in the search


@dataclass(frozen=True)
class Onset:
    """Relative RMS test errors [%] without the first second; None where the estimate overflowed."""

    model: float | None  # of the run
    line: float | None  # of a straight line through the last two measured accelerations


def onsets(case: Case, way: str) -> dict[int, Onset]:
    """{seed: scores} of the finished runs of a case that this program scored."""
    paths = {seed: case.folders[way][seed] / FILE for seed in case.metrics[way]}
    return {seed: Onset(**_read(path)["scores"]) for seed, path in paths.items() if path.is_file()}


def write_onset(folder: Path) -> None:
    """Score a finished run, unless its scores are there and of this run and this code."""
    cfg, metrics = read_run(folder)
    origin = {"run": metrics.get("identity"), "code": written_code_version(folder / CONFIG)}
    path = folder / FILE
    if not path.is_file() or _read(path)["origin"] != origin:
        write_json(path, {"origin": origin, "scores": asdict(after_onset(cfg, folder))})


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return content


def after_onset(cfg: DictConfig, folder: Path) -> Onset:
    """The scores of a finished run with this config."""
    quiet_lightning()
    model = restore(cfg, folder)
    data = data_from(changed(cfg, {"data": {"warmup": ONSET}}))
    data.setup()
    line = TwoPoint(data.dofs, data.inputs, data.dt)
    own, of_line = (score(e, data.loader("test")) for e in (model, line))
    return Onset(own["relative_rms_percent"], of_line["relative_rms_percent"])


def score_cases(cases: Sequence[Case]) -> int:
    """Score the finished runs of these cases; how many there are."""
    runs = {case.folders[way][seed] for case in cases for way in WAYS for seed in case.metrics[way]}
    Parallel(n_jobs=-1)(delayed(write_onset)(folder) for folder in sorted(runs))
    return len(runs)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, default=USUAL)
    options = parser.parse_args()
    with one_line_errors("train"):
        count = score_cases(read_cases(options.folders))
        print(f"{count} runs scored, each in its {FILE}")


if __name__ == "__main__":
    main()
