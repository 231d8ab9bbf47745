"""One run from its config to its files, and what becomes of its errors."""

from __future__ import annotations

import logging
import math
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.plugins.environments import LightningEnvironment
from omegaconf import DictConfig
from threadpoolctl import threadpool_limits
from torch import nn

from data.datamodule import Data
from data.parallel import take_threads
from data.simulation.motion import EscapedMotionError
from data.terminal import Line
from models.checkpoint import load_estimator
from models.choice import overlay
from models.estimator import Estimator
from models.experiment import Experiment, select_fit
from models.fit.identification import Identification
from models.fit.progress import leaves_out, limited, listening, present_budget
from models.fit.resume import SaveProgress
from models.stored.run import read_run
from models.zoo import index as zoo
from runner.accelerator import accelerator_of, require_accelerator
from runner.config.choices import plain
from runner.config.command_line import EXPECTED, reason_of
from runner.config.settings import check_settings, seconds_of
from runner.folder.lock import HeldError, release_all
from runner.folder.run import Run
from runner.folder.run_folder import CHECKPOINT, run_folder, write_failure
from runner.loading import without_compiler
from runner.loggers import (
    RunLogger,
    log_numbers,
    logger_of,
    require_logger,
    settings_of_logger,
    spare_the_run,
)
from runner.scores.outcome import compare_baselines, metrics_of
from runner.scores.verdict import opponents_of, trained_on_free_run

QUIET = (  # warnings that tell a person nothing
    ".*does not have many workers.*",
    ".*Total length of `list`.*",  # nothing is validated
    ".*LeafSpec.*deprecated.*",
    "The `srun` command is available.*",
)


@contextmanager
def quiet_lightning() -> Iterator[None]:
    """Silence what Lightning says to everybody; here, because processes of a sweep start afresh."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric")]
    levels, hook = [logger.level for logger in loggers], threading.excepthook
    threading.excepthook = _thread_failed
    with warnings.catch_warnings():
        for logger in loggers:
            logger.setLevel(logging.WARNING)
        for message in QUIET:
            warnings.filterwarnings("ignore", message=message)
        try:
            yield
        finally:
            threading.excepthook = hook
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


_others_failed = threading.excepthook


def _thread_failed(failed: threading.ExceptHookArgs) -> None:
    """TensorBoard's writer hands a full disk on to the run, which says so in one line."""
    writer = type(failed.thread).__name__ == "_AsyncWriterThread"
    if not (writer and issubclass(failed.exc_type, OSError)):
        _others_failed(failed)


@dataclass
class Shared:
    """What runs on the very same data have in common: the records, and baselines identified."""

    data: Data | None = None
    baselines: dict[str, Estimator] = field(default_factory=dict)


Draw = Callable[[RunLogger, dict[str, Any], Identification, Data, dict[str, Any]], None]


@quiet_lightning()
def identify(
    cfg: DictConfig,
    folder: Path,
    draw: Draw | None = None,
    progress: bool = True,
    shared: Shared | None = None,
) -> dict[str, Any]:
    """One run: data, fit, test, files; returns what `metrics.json` holds.

    `draw` adds figures to the logs, and responses of storeys to the folder, before the run is
    finished. progress: the fit shows how far it is, unless the config says otherwise. shared:
    records and baselines of runs before this one on the same data; those of this run are added.
    Raises ValueError for choices that do not fit together and for a fit that failed, OSError for a
    folder that cannot be used.
    """
    check_settings(cfg)
    typed = values = plain(cfg)
    require_accelerator(values["trainer"])
    logs = settings_of_logger(values)
    require_logger(logs)
    values = with_start(values)
    experiment, start = Experiment.of(values), values.get("start")
    shared = shared or Shared()
    with without_compiler():
        data, module, baselines = experiment.assemble(shared.data)
    shared.data = data
    values = {**values, "data": {**values["data"], **data.settled}}
    if start:
        load_start(module, start, experiment.model.name)
    run = Run.begin(folder, values, data.sensors, typed)
    try:
        data.setup()
        _require_samples(data)
    except ValueError:
        run.withdraw()
        raise

    take_threads(experiment.threads)
    threadpool_limits(experiment.threads or 1)
    logger = logger_of(logs, folder)
    settings = values["trainer"]
    accelerator = accelerator_of(settings, module.estimator)
    common = {
        "plugins": LightningEnvironment(),  # a run is one process, in a Slurm job too
        "default_root_dir": folder,
        "enable_checkpointing": False,
        "enable_model_summary": False,
        "limit_val_batches": None if data.validation else 0,
        **settings,
        "accelerator": accelerator,
        "devices": settings.get("devices", 1) if accelerator != "cpu" else 1,
        "enable_progress_bar": False,  # ours is another
    }
    saves = SaveProgress(run.progress, run.identity, values["checkpoint_seconds"])
    shown = progress and settings.get("enable_progress_bar", True)
    lines: list[Callback] = [FitProgress()] if shown else []
    trainer = Trainer(logger=logger, callbacks=[saves, *lines], **common)
    try:
        with limited(seconds_of(values.get("budget"))) as budget:
            halfway = run.progress if run.progress.exists() else None
            trainer.fit(module, datamodule=data, ckpt_path=halfway, weights_only=True)
            late = data.topology is not None and leaves_out("the other topology")
            rival = None if late else experiment.make_rival(data, module)
            if rival is not None:
                other = Trainer(logger=False, callbacks=lines, **common)
                other.fit(rival, datamodule=data)
                if select_fit(data, module, rival) is rival:
                    module, trainer = rival, other
                run.built_for(data.sensors)
        module.solution = {**module.solution, **budget.facts()}
        check_weights(module.estimator)
        trainer.test(module, datamodule=data, verbose=False)
    except SystemExit:  # what Lightning makes of Ctrl-C
        raise KeyboardInterrupt from None

    metrics = judge(run, module, data, baselines, shared.baselines)
    run.save(module.estimator)
    with spare_the_run(logger):
        log_numbers(logger, run.choices, module, metrics)
    if draw is not None:
        with spare_the_run(logger):
            draw(logger, run.choices, module, data, metrics)
    with spare_the_run(logger):
        logger.end()
    run.finish(metrics)
    return metrics


def judge(
    run: Run,
    module: Identification,
    data: Data,
    baselines: Mapping[str, Estimator | ValueError],
    known: dict[str, Estimator],
) -> dict[str, Any]:
    """What `metrics.json` holds of a model that is fitted and scored.

    known: baselines of runs before this one on the same data; those of this run are added.
    Raises ValueError for a fit that failed.
    """
    _check_fit(module)
    opponents = {**opponents_of(module, data, baselines)}
    opponents |= {name: one for name, one in known.items() if name in opponents}
    compared = compare_baselines(opponents, data, known)
    return metrics_of(run, module, data, compared, opponents, known)


FEWEST = 50  # samples N: the RMS of so many independent errors is known to 1/√(2 N) = 10 %


def _require_samples(data: Data) -> None:
    """Raise ValueError for measured records too short to tell an error by."""
    for split in ("train", "test") if data.measured else ():
        scored = sum(record.samples - record.warmup for record in data.records[split])
        if scored < FEWEST:
            raise ValueError(
                f"the {split} part of the record has {scored} samples ({scored * data.dt:.3g} s) "
                f"to be scored, and {FEWEST} tell an error to a tenth; give a longer record"
            )


def check_weights(estimator: nn.Module) -> None:
    """Raise ValueError for a fit that left weights which are not finite: it is no result."""
    for name, values in estimator.state_dict().items():
        if values.is_floating_point() and not torch.isfinite(values).all():
            raise ValueError(
                f"the fit failed: {name} is not finite; look for outliers in the record, or "
                "choose smaller steps or more ridge (solver.rate, model.ridge)"
            )


def _check_fit(module: Identification) -> None:
    """Raise ValueError where a solver ended at a model that overflows where it was trained."""
    by_estimates = module.solver is not None and not trained_on_free_run(module)
    if by_estimates and module.results()["train"]["relative_rms_percent"] is None:
        raise ValueError(
            f"the fit failed: after {len(module.losses)} iterations the model's error on the "
            "training motion is not finite; choose smaller steps (solver.rate) or another solver"
        )


def _disk_error(error: Exception) -> Exception:
    """The disk's, where a logger made another of it."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__
    return cause or error


@contextmanager
def job_errors(sweep_folder: Path | None = None, cfg: DictConfig | None = None) -> Iterator[None]:
    """A failing run raises what a person reads; in a sweep its folder gets config and reason."""
    try:
        yield
    except Exception as raised:
        error = _disk_error(raised)
        if isinstance(error, MisconfigurationException):
            error = ValueError(str(error))
        expected = isinstance(error, EXPECTED)
        if sweep_folder is None or isinstance(error, HeldError):  # another's: nothing is written
            if error is raised:
                raise
            raise error from None
        trace = "" if expected else traceback.format_exc() + "\n"
        kind = "" if expected else f"{type(error).__name__}: "
        words = " ".join(f"{kind}{reason_of(error)}".split())
        own = expected and not isinstance(error, OSError)  # not that of a disk or a machine
        escaped = isinstance(error, EscapedMotionError)
        values = None if cfg is None else plain(cfg)
        write_failure(sweep_folder, values, words, trace, own, escaped)
    finally:
        release_all()


# Training that begins at the weights of a finished run: `start=FOLDER`, `start=zoo:MODEL/SYSTEM`.
#
# For a new record of the same structure, or of one that has changed a little: fewer records and
# fewer seconds than from nothing. Nothing is identified in closed form and no start is drawn;
# what the new record leaves open stays what it was.

LATER = 2  # stages of a free run that are left: short parts tell weights that nearly fit little


def with_start(values: dict[str, Any]) -> dict[str, Any]:
    """The choices of training from their `start`: one start, later horizons; a version is pinned.

    The same where no start is asked for. Raises ValueError for a start that is not there, or is of
    another model.
    """
    word = values.get("start")
    if not word:
        return values
    own, model = read_run(run_folder(word)).experiment.model.name, values["model"]["name"]
    if own != model:
        raise ValueError(f"start={word} holds {own}, and model={model} is trained; say model={own}")
    pinned = zoo.PREFIX + zoo.entry_of(word).name if zoo.is_name(word) else word
    changes: dict[str, Any] = {"start": pinned}
    if "horizons" in values["objective"]:
        horizons = values["objective"]["horizons"][-LATER:]
        changes["objective"] = {"starts": 1, "finalists": 1, "select": [], "horizons": horizons}
    return overlay(values, changes)


def load_start(module: Identification, start: str, model: str) -> None:
    """Give the estimator the weights of the run that training starts from.

    Raises ValueError for a model that no solver trains, and for weights that do not fit the data.
    """
    if not module.free_parameters():
        raise ValueError(
            f"start={start}: model={model} is solved in closed form, from nothing as fast as from "
            "weights; leave start= out"
        )
    run = read_run(run_folder(start))
    digest = run.metrics.get("checkpoint")
    load_estimator(module.estimator, run.folder / CHECKPOINT, model, digest)
    module.begun_at = start


# One line on a fit while it lasts: what it is about, error, seconds; nothing is left of it.


class FitProgress(Callback):
    """Shows how far the fit of an `Identification` is, on the stream of messages."""

    def __init__(self) -> None:
        self.begun = time.monotonic()
        self.stage = 0
        self.line = Line()
        self.listening = ExitStack()
        self.lock = threading.Lock()  # laws of several elements are identified side by side

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.begun = time.monotonic()
        self.listening.enter_context(listening(self._identifying))

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.begun = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, *rest: Any, **more: Any
    ) -> None:
        assert isinstance(pl_module, Identification)
        if pl_module.stage != self.stage:
            self.stage, self.begun = pl_module.stage, time.monotonic()
        self._tell(lambda: line_of(pl_module, time.monotonic() - self.begun))

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._clear()

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        self._clear()

    def _identifying(self, what: str) -> None:
        left = present_budget().remaining
        end = f", at most {left:.0f} s left" if math.isfinite(left) else ""
        self._tell(lambda: f"identifying: {what}, {time.monotonic() - self.begun:.0f} s{end}")

    def _tell(self, line: Callable[[], str]) -> None:
        with self.lock:
            self.line.tell(line)

    def _clear(self) -> None:
        self.listening.close()
        self.line.clear()


def line_of(module: Identification, seconds: float) -> str:
    """Stage, iterations, error [%], seconds of a fit and how many all its stages may take yet.

    seconds: since the stage began. An iteration of a later stage is taken to last as long as one
    of this, and every stage to need all its iterations: fits end sooner. A budget ends them.
    """
    stages, solver = module.objective.stages, module.solver
    stage = f"stage {module.stage + 1} of {len(stages)} ({stages[module.stage]}), "
    error = f", error {100.0 * module.losses[-1] ** 0.5:.4g} %" if module.losses else ""
    more = present_budget().remaining
    if solver is not None and solver.done:
        later = solver.iterations * (len(stages) - module.stage - 1)
        more = min(more, seconds / solver.done * (solver.iterations - solver.done + later))
    left = f", at most {more:.0f} s left" if math.isfinite(more) else ""
    where = stage if len(stages) > 1 else ""
    spent = time.perf_counter() - module.start
    return f"{where}iteration {len(module.losses)}{error}, {spent:.0f} s{left}"
