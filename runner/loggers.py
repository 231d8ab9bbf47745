"""Where numbers and figures go while a run is made: Lightning's loggers, which all get the same.

In the folder of the run itself, whose name is the run's there; MLflow may have another place.
"""

from __future__ import annotations

import logging
import math
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lightning.pytorch.loggers import CSVLogger, MLFlowLogger, TensorBoardLogger, WandbLogger
from lightning.pytorch.loggers.logger import DummyLogger, Logger
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData
from torch import Tensor
from torch.utils.tensorboard.summary import hparams

from data.annotations import shown
from data.arguments import plain
from models.fit.identification import Identification
from models.fit.metrics import FREE_RUNS
from runner.config.choices import dotted, typed
from runner.scores.numbers import scores_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PACKAGES = {"mlflow": "mlflow", "wandb": "wandb"}  # that are extras, by logger


class RunLogger(Logger):
    """One of Lightning's, which is also given the choices and the figures of a run."""

    draws = True
    folder: Path  # of the run

    def log_choices(
        self, choices: Mapping[str, Any], numbers: Mapping[str, float], first: tuple[str, ...]
    ) -> None:
        """Choices and numbers of the finished run; those of `first` are said to tell runs apart."""
        self.log_hyperparams(dict(choices))
        self.log_metrics(dict(numbers))

    def log_figure(self, name: str, figure: Figure) -> None:
        """A figure by its name."""

    def end(self) -> None:
        """Everything is said, and lies on the disk."""
        self.save()


class TensorBoard(RunLogger, TensorBoardLogger):
    """Without Lightning's file of choices: the run has config.yaml."""

    def __init__(self, folder: Path) -> None:
        # the run waits for the thread that writes only where so many events are left to write
        super().__init__(folder, name="", version="", max_queue=1000)

    def log_choices(
        self, choices: Mapping[str, Any], numbers: Mapping[str, float], first: tuple[str, ...]
    ) -> None:
        """Choices and numbers of HParams, whose columns are those of `first`, then by name.

        TensorBoard sorts columns by name; those that are said to differ between runs are before.
        """
        board, parts = self.experiment._get_file_writer(), hparams(dict(choices), dict(numbers))
        said = parts[0].value[0].metadata.plugin_data
        content = HParamsPluginData.FromString(said.content)
        for info in content.experiment.hparam_infos:
            info.differs = info.name in first
        said.content = content.SerializeToString()
        for part in parts:
            board.add_summary(part)
        self.log_metrics(dict(numbers))

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        """All numbers of a step as one event: the writer opens its file for every one."""
        values = [Summary.Value(tag=name, simple_value=one) for name, one in metrics.items()]
        self.experiment._get_file_writer().add_summary(Summary(value=values), step)

    def log_figure(self, name: str, figure: Figure) -> None:
        self.experiment.add_figure(name, figure, close=False)

    def save(self) -> None:
        self.experiment.flush()

    def end(self) -> None:
        self.save()  # says what fails, which closing does not
        self.experiment.close()  # with its thread


class Csv(RunLogger, CSVLogger):
    """`csv/` with metrics.csv, hparams.yaml, and figures as PNG."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, name="csv", version="")

    def log_figure(self, name: str, figure: Figure) -> None:
        figure.savefig(Path(self.log_dir) / f"{name}.png", dpi=150)


class MLflow(RunLogger, MLFlowLogger):
    """In `mlflow/`, or at a uri. Its report on its use, which it sends to its makers, is off."""

    def __init__(self, folder: Path, experiment: str, uri: str | None) -> None:
        os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
        os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")
        logging.getLogger("lightning.pytorch.loggers.mlflow").setLevel(logging.ERROR)
        super().__init__(experiment, folder.name, uri or (folder / "mlflow").as_uri())

    def log_figure(self, name: str, figure: Figure) -> None:
        self.experiment.log_figure(self.run_id, figure, f"{name}.png")


class Wandb(RunLogger, WandbLogger):
    """In `wandb/`, without the network unless mode=online; nothing on code and machine."""

    def __init__(self, folder: Path, project: str, mode: str) -> None:
        if mode == "offline":
            os.environ.setdefault("WANDB_ERROR_REPORTING", "false")  # which is sent in any mode
        from wandb import Settings

        quiet = {"console": "off", "silent": True, "disable_git": True, "disable_code": True}
        own = Settings(x_disable_stats=True, x_disable_meta=True, **quiet)
        super().__init__(
            folder.name, folder, project=project, mode=mode, settings=own, reinit="create_new"
        )
        del self._wandb_init["anonymous"]  # which it warns of

    def log_figure(self, name: str, figure: Figure) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from numpy import asarray

        canvas = FigureCanvasAgg(figure)  # a figure itself would need pyplot
        canvas.draw()
        self.log_image(name, [asarray(canvas.buffer_rgba())])

    def end(self) -> None:
        self.experiment.finish()


class Silent(RunLogger, DummyLogger):
    """Writes nothing."""

    draws = False

    def __init__(self, folder: Path) -> None:
        super().__init__()


KINDS = {"tensorboard": TensorBoard, "csv": Csv, "mlflow": MLflow, "wandb": Wandb, "none": Silent}


@contextmanager
def spare_the_run(logger: Logger) -> Iterator[None]:
    """A server that is gone costs the log its last numbers, and the run nothing."""
    try:
        yield
    except Exception as error:  # packages have errors of their own
        if not isinstance(logger, MLflow | Wandb):
            raise
        reason = plain(" ".join(str(error).split())[:200])
        print(f"logging failed ({reason}); the run and its folder are complete", file=sys.stderr)


def settings_of_logger(choices: Mapping[str, Any]) -> dict[str, Any]:
    """What a run says of its logger; older configs say nothing."""
    return choices.get("logger") or {"name": "tensorboard"}


def require_logger(settings: Mapping[str, Any]) -> None:
    """Raise ValueError for settings of another logger, or a package that is not installed."""
    name, own = settings["name"], {*signature(KINDS[settings["name"]]).parameters} - {"folder"}
    if odd := sorted((settings.keys() - {"name"}) ^ own):
        raise ValueError(
            f"logger.{odd[0]}: logger={name} has {' and '.join(sorted(own)) or 'no settings'}; "
            f"choose logger={name} in place of logger.name"
        )
    package = PACKAGES.get(settings["name"])
    if package and find_spec(package) is None:
        raise ValueError(
            f"logger={package} needs its package; pip install -c constraints.txt "
            f"-e '.[{package}]', or choose logger=csv"
        )


def logger_of(settings: Mapping[str, Any], folder: Path) -> RunLogger:
    """The logger of a run in its folder. settings: as conf/logger has them.

    Raises ValueError for settings that its package refuses.
    """
    own = {key: value for key, value in settings.items() if key != "name"}
    try:
        logger: RunLogger = KINDS[settings["name"]](folder.absolute(), **own)
        if settings["name"] in PACKAGES:
            _ = logger.experiment  # type: ignore[attr-defined]  # made where it is asked for
    except Exception as error:  # packages have errors of their own
        typed = " ".join(f"logger.{key}={shown(value)}" for key, value in own.items())
        reason = plain(" ".join(str(error).split())[:200])
        raise ValueError(f"logger={settings['name']} {typed} is refused: {reason}") from None
    logger.folder = folder
    return logger


# What is logged of a finished run. Choices and numbers have the names of the long table
# (runner/scores/numbers.py).

IDENTITY = ("model", "system", "scenario", "seed")  # the first columns
GROUPS = ("scenario", "excitation", "data", "model", "solver", "objective")
FIRST = ("free_run/relative_rms_percent", "test/relative_rms_percent")
FILES = ("path", "folder")  # where things lie is no choice that changes a number
POINTS = 200  # of an error over time


def log_numbers(
    logger: RunLogger,
    choices: Mapping[str, Any],
    module: Identification,
    metrics: Mapping[str, Any],
) -> None:
    """Log choices, numbers, and errors over time."""
    logger.log_choices(swept(choices), numbers(metrics), IDENTITY)
    curves = defaultdict[int, dict[str, float]](dict)
    for key, error in errors_over_time(module).items():
        each = max(1, len(error) // POINTS)
        for i, value in enumerate((100.0 * error[::each]).tolist()):
            if math.isfinite(value):
                curves[i * each][f"{key}/relative_rms_percent_over_time"] = value
    for sample, errors in curves.items():
        logger.log_metrics(errors, sample)


def errors_over_time(module: Identification) -> dict[str, Tensor]:
    """Error (Eq. 21) up to each sample, by key of `metrics.json`; of free runs if there are any."""
    one_step = {split: scores.over_time() for split, scores in module.scores.items()}
    free = {FREE_RUNS[split]: scores.over_time() for split, scores in module.free_runs.items()}
    return one_step | {key: error for key, error in free.items() if error is not None}


def swept(content: Mapping[str, Any]) -> dict[str, int | float | bool | str]:
    """The choices that a person sweeps; a system is identified by its name alone."""
    *named, seed = IDENTITY
    found: dict[str, Any] = {name: content[name]["name"] for name in named}
    found |= {name: content[name] for name in (seed, "max_fail")}
    for key, value in dotted({name: content[name] for name in GROUPS}).items():
        text, last = typed(value), key.rpartition(".")[2]
        if last not in ("name", *FILES) and not ("/" in str(text) or "\\" in str(text)):
            found[key] = text
    return found


def numbers(metrics: Mapping[str, Any]) -> dict[str, float]:
    """The numbers by name, the errors of test motion first; what diverged is in `diverged`."""
    found = {s.name: s.value for s in scores_of(metrics) if math.isfinite(s.value)}
    return {name: found[name] for name in FIRST if name in found} | found
