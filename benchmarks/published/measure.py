"""One fit of a published package, or of an estimator of the zoo, and the error of its free run."""

from __future__ import annotations

import math
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.published import narx, sindy, subnet
from data.datamodule import Data
from data.record import Drive, Record
from models.checkpoint import load_estimator
from models.estimator import NoFreeRunError
from models.training.assemble import data_from, estimator_from
from runner.config.compose import composed
from runner.folder.run_files import CHECKPOINT
from runner.job import identify

PACKAGES = {"subnet": subnet, "narx": narx, "sindy": sindy}
INSTALL = "pip install -e '.[published]'"
ESCAPE = 100.0  # times the largest acceleration of the record: a free run beyond has diverged
GRACE = 2.0  # times its seconds of processor: a fit, or a free run, is stopped
QUIET = ("threads=1", "figures=false", "baselines=none", "trainer.enable_progress_bar=false")

Result = dict[str, Any]  # error: a fraction, None with a remark why; fit_seconds; remark


@dataclass(frozen=True)
class Case:
    """Records as `python train.py` simulates them with these choices."""

    system: str
    records: int  # training motions
    seed: int
    duration: float  # s

    def words(self) -> tuple[str, ...]:
        sizes = (f"data.train_records={self.records}", f"data.duration={self.duration}")
        return f"system={self.system}", f"seed={self.seed}", *sizes

    def data(self) -> Data:
        data = data_from(composed(*self.words()))
        data.setup()
        return data


class Overtime(Exception):  # noqa: N818
    """A package does not end in the processor time it has."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise Overtime after so many seconds of processor, where there is such an alarm; no warnings.

    Time of the processor: other programs of the machine take no time of a fit.
    """

    def over(*_: Any) -> None:
        raise Overtime

    alarm = hasattr(signal, "setitimer")
    before = signal.signal(signal.SIGPROF, over) if alarm else None
    if alarm:
        signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the packages
            yield
    finally:
        if alarm:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)


def require(names: list[str]) -> None:
    """Raise ValueError naming the packages that are not installed, and how they are."""
    wanted = [PACKAGES[name].PACKAGE for name in names]
    missing = [package for package in wanted if find_spec(package) is None]
    if missing:
        raise ValueError(
            f"{', '.join(missing)}: not installed; {INSTALL}, or leave out with --packages"
        )


def version(name: str) -> str:
    """The package with its version."""
    package = PACKAGES[name].PACKAGE
    return f"{package} {metadata.version(package)}"


def free_run_error(simulate: Callable[[Drive], np.ndarray], record: Record) -> float:
    """√Σ‖ẍ − ẍ̂‖² / √Σ‖ẍ‖² (Eq. 21) of a free run; infinite where it diverged."""
    a, estimate = record.a.numpy(), simulate(record.drive())
    if not np.isfinite(estimate).all() or np.abs(estimate).max() > ESCAPE * np.abs(a).max():
        return math.inf
    return float(np.linalg.norm(a - estimate) / np.linalg.norm(a))


def _result(error: float, fit_seconds: float) -> Result:
    diverged = math.isinf(error)
    remark = "diverged" if diverged else ""
    return {"error": None if diverged else error, "fit_seconds": fit_seconds, "remark": remark}


def measure_package(name: str, case: Case, seconds: float) -> Result:
    """Fit in `seconds` of processor, free run on the test motion."""
    records, fit_seconds = case.data().records, None
    start = time.process_time()
    try:
        with limited(GRACE * seconds):
            simulate = PACKAGES[name].fit(records["train"], case.seed, seconds)
        fit_seconds = time.process_time() - start
        with limited(GRACE * seconds):
            return _result(free_run_error(simulate, records["test"][0]), fit_seconds)
    except Overtime:
        remark = "over time"
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as why:  # a loss that is NaN
        remark = f"failed: {why}"
    return {"error": None, "fit_seconds": fit_seconds, "remark": remark}


def measure_zoo(model: str, case: Case, folder: Path) -> Result:
    """The same for an estimator that `train.py` trains; its run lies in `folder`.

    Its seconds are of the whole run, with simulation, scores and files.
    """
    cfg = composed(f"model={model}", *case.words(), *QUIET)
    start = time.process_time()
    identify(cfg, folder)
    fit_seconds = time.process_time() - start
    data = case.data()
    estimator = estimator_from(cfg.model, data)
    load_estimator(estimator, folder / CHECKPOINT, cfg.model.name)

    @torch.inference_mode()
    def simulate(drive: Drive) -> np.ndarray:
        return estimator.free_run(drive).a.numpy()

    try:
        return _result(free_run_error(simulate, data.records["test"][0]), fit_seconds)
    except NoFreeRunError:
        return {"error": None, "fit_seconds": fit_seconds, "remark": "no free run"}
