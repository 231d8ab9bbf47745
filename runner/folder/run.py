"""A run that is being made, and a finished one's estimator."""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from data.parallel import take_threads
from data.sample import Sensors
from data.whole_file import digest_of, write_text
from models.checkpoint import save_estimator
from models.estimator import Estimator
from models.fit.resume import fault_of
from models.stored.run import StoredRun, read_run
from runner.config.identity import identity_of
from runner.folder.lock import RUN, hold, release
from runner.folder.run_folder import (
    CHECKPOINT,
    CONFIG,
    EARLIER,
    EVENTS,
    FAILED,
    METRICS,
    PROGRESS,
    SENSORS,
    config_text,
    run_folder,
    write_json,
)

SHOWN = "report.html", "estimates.csv", "storeys.csv", "storeys.png", "storeys.pdf"  # of a model


@dataclass(frozen=True)
class Run:
    """A run that is being made: folder, resolved values, and what its numbers follow from."""

    folder: Path
    choices: dict[str, Any]
    identity: dict[str, Any]

    @classmethod
    def begin(
        cls,
        folder: Path,
        choices: dict[str, Any],
        sensors: Sensors,
        typed: dict[str, Any] | None = None,
    ) -> Run:
        """Start a run in a folder, which has no results from now on. choices: resolved values.

        typed: these before records and a start settled some; a sweep knows the run by them. Raises
        OSError where the folder cannot be written to, ValueError where another process works in it.
        """
        run = cls(folder, choices, identity_of(typed or choices))
        run.start(config_text(choices), sensors)
        return run

    def start(self, config: str, sensors: Sensors) -> None:
        """Write what is known beforehand, the text of config.yaml last; earlier results go."""
        self.folder.mkdir(parents=True, exist_ok=True)
        hold(self.folder)
        if set(os.listdir(self.folder)) != {RUN}:  # not new
            self._clear()
        write_json(self.folder / SENSORS, asdict(sensors))
        write_text(self.folder / CONFIG, config)

    def _clear(self) -> None:
        """Take earlier results out of the folder, except training that this run goes on with."""
        for name in (METRICS, CHECKPOINT, FAILED, PROGRESS):
            if (self.folder / name).is_dir():
                raise ValueError(
                    f"{self.folder / name} is a folder in place of a file; remove it, or "
                    "choose another hydra.run.dir"
                )
        for name in (METRICS, EARLIER, CHECKPOINT, FAILED, *SHOWN):
            (self.folder / name).unlink(missing_ok=True)
        if fault := fault_of(self.progress, self.identity):
            if os.path.lexists(self.progress):
                print(f"{self.progress} {fault}; training starts again", file=sys.stderr)
            self.progress.unlink(missing_ok=True)
            for events in self.folder.glob(EVENTS):
                events.unlink(missing_ok=True)

    def built_for(self, sensors: Sensors) -> None:
        """Rewrite the model's arguments, which the fit has completed from the records."""
        write_json(self.folder / SENSORS, asdict(sensors))

    def withdraw(self) -> None:
        """Take back a run whose records cannot be made: the folder holds no run."""
        for name in (CONFIG, SENSORS):
            (self.folder / name).unlink(missing_ok=True)

    @property
    def progress(self) -> Path:
        """Where half-done training is saved; once begun, what is there is of this very run."""
        return self.folder / PROGRESS

    def save(self, estimator: Estimator) -> None:
        """Write the identified estimator."""
        save_estimator(estimator, self.folder / CHECKPOINT, self.choices["model"]["name"])

    def finish(self, metrics: dict[str, Any]) -> None:
        """Write the numbers, which makes the run a finished one."""
        checkpoint = digest_of(self.folder / CHECKPOINT)
        write_json(self.folder / METRICS, {**metrics, "checkpoint": checkpoint})
        self.progress.unlink(missing_ok=True)
        release(self.folder)


def restore(run: StoredRun) -> Estimator:
    """The identified estimator of a run, on the threads of its config."""
    take_threads(run.experiment.threads)  # the same threads, the same bits
    return run.restore()


def load_run(folder: str | Path) -> Estimator:
    """The identified model of a finished run, or of zoo:MODEL/SYSTEM, to be used in Python.

        model = load_run("runs/mine")
        rest = torch.zeros(model.dofs)
        motion = model.free_run(Drive(dt, u, rest, rest))   # u (T, m): motion.x, .v, .a (T, n)

    u: forces [N], or the displacements and velocities of supports [m], [m/s]; of a shaken base
    −s̈ [m/s²]; of an element test s, ṡ. Its parameters ask for no gradient, so that runs are
    compiled. Nothing of the folder is executed. Raises ValueError for a folder that holds no
    finished run.
    """
    return restore(read_run(run_folder(str(folder)))).requires_grad_(False)
