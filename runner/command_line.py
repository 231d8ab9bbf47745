"""What a person reads in the terminal besides tables: help, and errors in one line."""

from __future__ import annotations

import difflib
import errno
import hashlib
import logging
import os
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from hydra.utils import to_absolute_path
from lightning.fabric.utilities.exceptions import MisconfigurationException
from omegaconf import DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from data.arguments import plain, reason
from data.simulation.motion import EscapedMotionError
from runner.run_folder import run_name, write_failure

CONF = Path(__file__).parent.parent / "conf"
SHARED = "shared"  # by the experiments of a folder
GROUPS = (
    "system",
    "excitation",
    "damage",
    "scenario",
    "data",
    "model",
    "solver",
    "objective",
    "adaptation",
    "baselines",
    "trainer",
    "experiment",
)
EXAMPLES = {
    "train": """Identify a structure: simulate it, fit a model, score it on unseen motion.

    python train.py model=vwnn system=bilinear
    python train.py model=vwnn system=polynomial scenario=noisy scenario.level=0.2 seed=4
    python train.py -m model=vwnn,linear system=bilinear,polynomial,bouc_wen seed=0,1

Common keys: seed, data.dt [s], data.duration [s], data.train_records, data.test_records,
model.cutoff [rad/s], trainer.accelerator, hydra.run.dir. All of them: python train.py --cfg job""",
    "evaluate": """One finished run scored again; or many runs compared.

    python evaluate.py run=FOLDER                   one run, from its own config and checkpoint
    python evaluate.py run=FOLDER scenario=noisy seeds=[5,6,7]
    python evaluate.py run=FOLDER data.duration=100
    python evaluate.py runs=FOLDER output=FOLDER    all numbers: results.parquet, results.csv
    python evaluate.py runs=[a,b] by=model.cutoff   of several folders, compared by a choice

The paper's tables and the leaderboard of free runs: python -m report.paper --help,
python -m report.free_run --help""",
}


def help_text(program: str) -> str:
    """Examples, then each group with its choices, a line each (the config's first comment)."""
    groups = GROUPS if program == "train" else ("scenario",)
    lines = [EXAMPLES[program], ""]
    for group in groups:
        lines.append(f"{group}=")
        paths = experiments() if group == "experiment" else (CONF / group).glob("*.yaml")
        for path in sorted(paths, key=lambda path: path.stem):
            comments = [s for s in path.read_text(encoding="utf-8").splitlines() if s[:1] == "#"]
            described = [s[1:].strip() for s in comments if "@package" not in s]
            lines.append(f"    {path.stem:<30}{described[0] if described else ''}".rstrip())
    return "\n".join(lines)


def experiments() -> list[Path]:
    """The files of all experiments, which lie in a folder for each room of the report."""
    paths = (CONF / "experiment").glob("*/*.yaml")
    return sorted(path for path in paths if path.stem != SHARED)


def placed(words: Sequence[str]) -> list[str]:
    """The same words with experiments by their folder too: experiment=paper/table3 for table3."""
    places = {path.stem: f"{path.parent.name}/{path.stem}" for path in experiments()}
    named = (word.partition("=") for word in words)
    return [
        f"{key}={','.join(places.get(name, name) for name in names.split(','))}"
        if key == "experiment"
        else f"{key}{equals}{names}"
        for key, equals, names in named
    ]


def prepare_hydra() -> None:
    """Let Hydra raise what it finds instead of printing it, and give it our help."""
    os.environ["HYDRA_FULL_ERROR"] = "1"
    if not OmegaConf.has_resolver("help"):
        OmegaConf.register_new_resolver("help", help_text)
        OmegaConf.register_new_resolver("run_name", lambda _root_: run_name(_root_))
        OmegaConf.register_new_resolver("same_for", _same_for, use_cache=True)


def _same_for(words: ListConfig) -> str:
    """Ten characters for what was typed, in any order; kept for the configs of a sweep's runs."""
    return hashlib.sha256("\n".join(sorted(words)).encode()).hexdigest()[:10]


def composed(*words: str, config: str = "train") -> DictConfig:
    """The config that a command line with these words would have."""
    prepare_hydra()
    GlobalHydra.instance().clear()  # a program that is run by Hydra has one already
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return compose(config, placed(words))


def quiet_lightning() -> None:
    """Silence what Lightning says to everybody; here, because processes of a sweep start afresh."""
    for name in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(name).setLevel(logging.WARNING)
    warnings.filterwarnings("ignore", message=".*does not have many workers.*")
    warnings.filterwarnings("ignore", message=".*LeafSpec.*deprecated.*")
    warnings.filterwarnings("ignore", message="The `srun` command is available.*")
    threading.excepthook = _thread_failed


_others_failed = threading.excepthook


def _thread_failed(failed: threading.ExceptHookArgs) -> None:
    """TensorBoard's writer hands a full disk on to the run, which says so in one line."""
    writer = type(failed.thread).__name__ == "_AsyncWriterThread"
    if not (writer and issubclass(failed.exc_type, OSError)):
        _others_failed(failed)


def fail(message: str) -> None:
    print(f"error: {plain(' '.join(message.split()))}", file=sys.stderr)


EXPECTED = (ValueError, OSError, HydraException, OmegaConfBaseException, MisconfigurationException)


def _reason(error: BaseException) -> str:
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"{error.strerror}; make room and give the same command again"
    if isinstance(error, OSError):
        hint = "" if isinstance(error, FileNotFoundError) else "; choose another hydra.run.dir"
        return f"{error.strerror or error}: {error.filename or ''}{hint}"
    return str(error)


@contextmanager
def one_line_errors(config: str) -> Iterator[None]:
    """Bad input ends with one line and exit status 1; a traceback is for bugs."""
    sys.argv[1:] = placed(sys.argv[1:])
    try:
        yield
    except (MissingConfigException, ConfigCompositionException, OverrideParseException) as error:
        fail(_explain(error, config))
    except EXPECTED as error:
        fail(_reason(error))
    except KeyboardInterrupt:
        fail("interrupted; the unfinished run has no metrics.json, a sweep goes on from here")
        sys.exit(130)
    else:
        return
    sys.exit(1)


def _disk_error(error: Exception) -> Exception:
    """The disk's, where a logger made another of it."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__
    return cause or error


@contextmanager
def command_errors() -> Iterator[None]:
    """The same for programs that write no run: files by name, Ctrl-C in silence."""
    with one_line_errors("train"):
        try:
            yield
        except OSError as error:
            raise ValueError(reason(error)) from None
        except KeyboardInterrupt:
            sys.exit(130)


@contextmanager
def job_errors(sweep_folder: Path | None = None, cfg: DictConfig | None = None) -> Iterator[None]:
    """A failing run ends the program; in a sweep it leaves config and reason in its folder."""
    try:
        yield
    except Exception as raised:
        error = _disk_error(raised)
        expected = isinstance(error, EXPECTED)
        if sweep_folder is None:
            if not expected:
                raise
            fail(_reason(error))
            sys.exit(1)
        trace = "" if expected else traceback.format_exc() + "\n"
        reason = " ".join(
            f"{'' if expected else type(error).__name__ + ': '}{_reason(error)}".split()
        )
        own = expected and not isinstance(error, OSError)  # not that of a disk or a machine
        escaped = isinstance(error, EscapedMotionError)
        write_failure(sweep_folder, cfg, reason, trace, own, escaped)


def _explain(error: Exception, config: str) -> str:
    """A misspelt choice or key, with the nearest ones that exist."""
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        options = list(error.options)
        if group.startswith("experiment"):
            group, options = "experiment", [path.stem for path in experiments()]
        return (
            f"{group}={choice} does not exist{_nearest(choice, options)} "
            f"(choices: {', '.join(options)})"
        )
    cause = getattr(error.__cause__, "full_key", None) or getattr(error.__cause__, "key", None)
    first = " ".join(str(error).splitlines()[:2]).removesuffix(".")
    if first.startswith("Could not override"):
        key = first.split("'")[1] if "'" in first else str(cause)
        return f"there is no setting {key!r}{_nearest(key, _keys(config))}; see --help"
    return first


def _nearest(word: str, choices: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, choices, n=2, cutoff=0.6)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _keys(config: str) -> list[str]:
    """All settings of a program, dotted."""
    return sorted({*GROUPS, *_dotted(composed(config=config))})


def _dotted(node: DictConfig, prefix: str = "") -> Iterator[str]:
    for key in node:
        name = f"{prefix}{key!s}"
        yield name
        if not OmegaConf.is_missing(node, key) and isinstance(node._get_node(key), DictConfig):
            yield from _dotted(node[key], f"{name}.")


def absolute(folder: str) -> Path:
    """A folder as typed, from where the command was typed."""
    return Path(to_absolute_path(folder))
