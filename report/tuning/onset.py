"""Finished runs of searches scored without the first second of the test motion. No training.

    python -m report.tuning.onset                 of the searches in runs/tune_…
    python -m report.tuning.onset FOLDER FOLDER

At the first sample the force sets in, which no estimate of one step ahead can foresee. Each run on
fresh seeds keeps its scores in its onset.json, and a run with scores of this code is not scored
again. Some seconds a run, side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from omegaconf import DictConfig

from data.arguments import Parser
from models.baselines import TwoPoint
from models.training.assemble import changed, data_from
from models.training.metrics import score
from report.tuning.cases import WAYS, Case, read_cases
from report.usual import SEARCHES
from runner.config.command_line import command_errors
from runner.config.identity import RESULTS
from runner.config.plain_data import read_json
from runner.config.schema import ANYTHING, PERCENT, require
from runner.folder.run import restore
from runner.folder.run_folder import read_run, write_json
from runner.job import quiet_lightning

FILE = "onset.json"
KIND = {"origin": {...: ANYTHING}, "scores": {...: PERCENT}}
ONSET = 100  # samples: the first second, as little counted here as in the search


@dataclass(frozen=True)
class Onset:
    """Relative RMS test errors [%] without the first second; None where the estimate overflowed."""

    model: float | None  # of the run
    line: float | None  # of a straight line through the last two measured accelerations


def onsets(case: Case, way: str) -> dict[int, Onset]:
    """{seed: scores} of the finished runs of a case that this program scored."""
    paths = {seed: case.folders[way][seed] / FILE for seed in case.metrics[way]}
    return {seed: Onset(**kept["scores"]) for seed, path in paths.items() if (kept := _read(path))}


def write_onset(folder: Path) -> None:
    """Score a finished run, unless its scores are there, of this run and this version."""
    cfg, metrics = read_run(folder)
    origin = {"run": metrics.get("identity"), "results": RESULTS}
    path = folder / FILE
    if _read(path).get("origin") != origin:
        write_json(path, {"origin": origin, "scores": asdict(after_onset(cfg, folder))})


def _read(path: Path) -> dict[str, Any]:
    """What `write_onset` wrote; nothing of a damaged file, which is written anew."""
    try:
        content: dict[str, Any] = read_json(path)
        require(content, KIND)
        Onset(**content["scores"])
    except (ValueError, OSError, TypeError, KeyError):
        return {}
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
    parser = Parser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="*", type=Path, default=SEARCHES)
    with command_errors():
        options = parser.parse_args()
        count = score_cases(read_cases(options.folders))
        print(f"{count} runs scored, each in its {FILE}")


if __name__ == "__main__":
    main()
