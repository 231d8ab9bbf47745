"""The commands from Python: the words of the command line, and objects instead of printed text.

    from runner import train, evaluate, predict, identify

    run = train(model="vwnn", system="bilinear", seed=0)
    run = train("data=measured", "data.path=record.csv", model="element_network")
    evaluate(run, scenario="noisy")
    predict(run, **{"excitation.path": "quake.csv"})
    found = identify("record.csv", budget="60s")

A keyword is a key, with dots by ** as above; a mapping sets the keys below: data={"dt": 0.01}. Text
in place of a keyword is as typed. Bad input raises CommandError, the line that the command prints.
"""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from data.arguments import Shown, plain
from report import commands
from runner.config.command_line import CommandError as CommandError
from runner.config.command_line import check_words, raised_lines
from runner.config.compose import borrowed_hydra, composed, placed, word_of
from runner.folder.run_folder import require_finished, run_folder
from runner.selection.words import read_words

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from data.record import Record
    from models.estimator import Estimator
    from models.stored.run import StoredRun
    from report.prediction.fragility import Curve
    from report.prediction.runs import Prediction
    from runner.selection.identified import Identified


LOCK = threading.RLock()  # commands of several threads wait for each other: Hydra is one


class Figures(list["Figure"]):
    """Figures of matplotlib; a notebook shows them."""

    def _repr_html_(self) -> str:
        from report.output import picture_link

        return "\n".join(
            f'<img src="{picture_link(figure)}" style="max-width: 100%" alt="figure {number}">'
            for number, figure in enumerate(self, start=1)
        )


@dataclass(frozen=True, repr=False)
class FinishedRun(Shown):
    """A run in the folder that `train`, or train.py, made; read when something is asked of it.

    Raises ValueError for a folder that holds no finished run.
    """

    folder: Path  # or zoo:MODEL/SYSTEM

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", run_folder(str(self.folder)).absolute())
        require_finished(self.folder)

    @cached_property
    def stored(self) -> StoredRun:
        """All choices, and what they describe."""
        from models.stored.run import read_run

        return read_run(self.folder)

    @property
    def metrics(self) -> dict[str, Any]:
        """All numbers, as in metrics.json."""
        return self.stored.metrics

    @cached_property
    def model(self) -> Estimator:
        """The identified model, which is a module of PyTorch."""
        from runner.folder.run import load_run

        return load_run(self.folder)

    @cached_property
    def records(self) -> dict[str, list[Record]]:
        """Records by split: train, test, validation. Simulated or read again."""
        return self.stored.experiment.set_up_data().records

    def figures(self) -> Figures:
        """The model on the first test motion, as evaluate.py draws it."""
        from report.run.evaluation import figures_of

        return Figures(figures_of(self.stored, self.model).values())

    def __str__(self) -> str:
        from report.run.summary import print_run

        if "records" not in self.metrics:  # a published model keeps its scores, its card says more
            return repr(self)
        with redirect_stdout(io.StringIO()) as said:
            print_run(self.metrics, self.folder)
        return said.getvalue()

    def __repr__(self) -> str:
        metrics = self.metrics
        names = f"{metrics['model']} on {metrics['system']}, {metrics['scenario']}"
        return plain(f"<{names}, seed {metrics.get('seed')}: {self.folder}>")


@dataclass(frozen=True, repr=False)
class Answer(Shown):
    """What a command says, and the figures that it saved."""

    text: str
    drawn: list[Figure]

    def figures(self) -> Figures:
        return Figures(self.drawn)

    def __str__(self) -> str:
        return self.text

    __repr__ = __str__


@dataclass(frozen=True, repr=False)
class Evaluation(Answer):
    """Scores of a run as in scores.json; of many runs a table: `scores.to_pandas()`."""

    scores: Any


@dataclass(frozen=True, repr=False)
class Predictions(Answer):
    """Responses of a model to motions, and the folder that has them as files."""

    folder: Path
    predictions: list[Prediction]
    run: FinishedRun  # whose model it is
    curves: list[Curve]  # of fragility, for limits=

    @property
    def response(self) -> dict[str, np.ndarray]:
        """The time history of a single motion by column, in SI: "time [s]", "x1 [m]", …, (T,)."""
        from report.prediction.predict import columns_of

        if len(self.predictions) != 1:
            raise ValueError(
                f"{len(self.predictions)} motions have no single response; the files in "
                f"{self.folder} have that of each"
            )
        return columns_of(self.predictions[0])

    @property
    def table(self) -> list[dict[str, Any]]:
        """Rows of fragility.csv: θ and β of each limit and intensity, with 95 % intervals."""
        return [curve.row for curve in self.curves]

    @property
    def peaks(self) -> list[dict[str, Any]]:
        """Rows of a table: of a single motion a row for each column, of many one for each."""
        from report.prediction.peaks import peaks_of

        if len(self.predictions) == 1:
            return peaks_of(self.predictions[0], self.run.model)
        return [dict(prediction.row or {}) for prediction in self.predictions]


def train(*words: Any, **settings: Any) -> FinishedRun:
    """`python train.py`: the finished run, whose numbers, model and figures are read on demand.

    folder: where it lies; else as from the command line. A model that is no result is returned
    too: `metrics["verdict"]`. Raises CommandError.
    """
    with _command("train", words, settings) as (cfg, folder):
        commands.train(cfg, folder)
    return FinishedRun(folder)


def evaluate(*words: Any, **settings: Any) -> Evaluation:
    """`python evaluate.py`. A run, or a folder, in place of a word is run=; folder: as output=.

    Raises CommandError.
    """
    with _command("evaluate", words, settings) as (cfg, _), _heard() as (said, figures):
        scores = commands.evaluate(cfg)
    return Evaluation(said.getvalue(), figures, scores)


def predict(*words: Any, **settings: Any) -> Predictions:
    """`python predict.py`; words and folder as of `evaluate`. Raises CommandError."""
    with _command("predict", words, settings) as (cfg, _), _heard() as (said, figures):
        folder, found, curves = commands.predict(cfg)
        run = FinishedRun(commands.folder_of(cfg.run))
    return Predictions(said.getvalue(), figures, folder, found, run, curves)


def identify(*words: Any, config: str | Path | None = None, **settings: Any) -> Identified:
    """`python identify.py`: the verdict, the models that were tried, and the chosen one.

    words: files, folders and archives, settings as typed; folder: where all of it lies. Where
    something is missing that only a person knows, nothing is fitted, and the result says what.
    Raises CommandError.
    """
    folder = settings.pop("folder", None)
    with LOCK, raised_lines("train", []), borrowed_hydra():
        asked = read_words(_typed(words, settings, ""))
        from runner.selection.progress import Following
        from runner.selection.search import BUDGET, identify_records

        with Following() as watch:
            return identify_records(
                asked.records, folder or asked.folder, asked.budget or BUDGET, asked.settings,
                config=Path(config) if config else None, watch=watch,
            )  # fmt: skip


@contextmanager
def _heard() -> Iterator[tuple[io.StringIO, list[Figure]]]:
    """What is printed, and the figures that are saved."""
    from report.output import figures_kept

    with redirect_stdout(io.StringIO()) as said, figures_kept() as figures:
        yield said, figures


@contextmanager
def _command(
    program: str, words: tuple[Any, ...], settings: dict[str, Any]
) -> Iterator[tuple[DictConfig, Path]]:
    """The config of a command and the folder of its run, as Hydra has them while a command runs."""
    typed: list[str] = []
    with LOCK, raised_lines(program, typed), borrowed_hydra():
        if (chosen := settings.pop("folder", None)) is not None:
            settings["hydra.run.dir" if program == "train" else "output"] = chosen
        typed += _typed(words, settings, "run")
        check_words(placed(typed), program, sweeps=False)
        cfg = composed(*typed, config=program, whole=True)
        HydraConfig.instance().set_config(cfg)
        folder = Path(cfg.hydra.run.dir).absolute()
        if not any(word.startswith("hydra.run.dir=") for word in typed):
            folder = _unused(folder)
        own = deepcopy(cfg)
        with open_dict(own):
            del own["hydra"]
        yield own, folder


def _unused(folder: Path) -> Path:
    """The folder, or one with a number behind its name: two runs of a second are two.

    A process of a pool adds its number: others may begin such a run at the same time.
    """
    if parent_process() is not None:
        folder = folder.with_name(f"{folder.name}-process{os.getpid()}")
    number, place = 1, folder
    while place.exists():
        number += 1
        place = folder.with_name(f"{folder.name}-{number}")
    return place


def _typed(words: tuple[Any, ...], settings: dict[str, Any], subject: str) -> list[str]:
    """Words of a command line. subject: the key of a word that is none, "" for a file's name."""
    flat = [one for word in words for one in (word if isinstance(word, list | tuple) else [word])]
    typed = []
    for word in flat:
        if isinstance(word, str) and ("=" in word or not subject):
            typed.append(word)
        else:
            typed += word_of(subject, word) if subject else [str(word)]
    for key, value in settings.items():
        typed += word_of(key, value)
    return typed
