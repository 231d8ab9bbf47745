"""What intervals, criticism and bands add to a fit: processor time of both, of runs by train.py.

    python -m benchmarks.coverage.cost --damper FOLDER       # of the friction damper's records

Without the damper's records: the simulated cases alone. The first call of a new version compiles
its run, which counts with the fit: repeat it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import runner.scores.outcome as outcome
from data.arguments import Parser
from models.training.identification import Identification
from runner.config.command_line import command_errors
from runner.config.compose import composed
from runner.job import identify

QUIET = ("baselines=none", "figures=false", "trainer.enable_progress_bar=false")
NOISY = ("scenario=noisy", "scenario.level=0.05")
CASES = {
    "chain that yields, one unit": (
        *("model=element_network", "model/reads=accelerations", "system=bilinear", *NOISY),
        *("model.hinges=0", "model.units=1", "model.cubic=false", "data.train_records=2"),
    ),
}
DAMPER = {
    f"damper, {hinges} hinges, {units} units": (
        *("experiment=friction_damper", "model=hysteretic_element", "data.mend.resample=128"),
        *(f"model.hinges={hinges}", f"model.units={units}", "model.cubic=false"),
        *words,
    )
    for hinges, units, words in ((1, 1, ("model.rounded=false",)), (2, 5, ()))
}


def cost(words: Sequence[str]) -> tuple[int, float, float]:
    """Parameters, and processor seconds of the fit and of what follows from its Jacobian."""
    cfg = composed(*words, *QUIET)
    spent: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder, _timed(spent):
        metrics = identify(cfg, Path(folder))
    return metrics["parameters"], spent["ended"] - spent["begun"], spent["intervals"]


@contextmanager
def _timed(spent: dict[str, float]) -> Iterator[None]:
    """Note processor times: of the fit's beginning and end, and what `_intervals` takes."""
    begin, end, intervals = (
        Identification.on_fit_start,
        Identification.on_fit_end,
        outcome._intervals,
    )

    def begun(module: Identification) -> None:
        spent["begun"] = time.process_time()
        begin(module)

    def ended(module: Identification) -> None:
        end(module)
        spent["ended"] = time.process_time()

    def timed(*given: Any) -> Any:
        first = time.process_time()
        found = intervals(*given)
        spent["intervals"] = time.process_time() - first
        return found

    with (
        patch.object(Identification, "on_fit_start", begun),
        patch.object(Identification, "on_fit_end", ended),
        patch.object(outcome, "_intervals", timed),
    ):
        yield


def main(given: list[str] | None = None) -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("--damper", help="FOLDER of the friction damper's records")
    parser.add_argument("--case", default="", help="those whose name has these letters")
    options = parser.parse_args(given)
    cases = dict(CASES)
    if options.damper is not None:
        where = f"records={Path(options.damper).absolute()}"
        cases |= {name: (*words, where) for name, words in DAMPER.items()}
    with command_errors():
        print(f"{'':32}{'parameters':>12}{'fit [s]':>10}{'after [s]':>11}{'added %':>9}")
        for name, words in cases.items():
            if options.case not in name:
                continue
            parameters, fit, after = cost(words)
            share = 100.0 * after / fit
            print(f"{name:32}{parameters:12d}{fit:10.2f}{after:11.2f}{share:9.1f}", flush=True)


if __name__ == "__main__":
    main()
