"""Errors as a person reads them in the terminal: one line, and an exit status."""

from __future__ import annotations

import difflib
import errno
import logging
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hydra.errors import (
    ConfigCompositionException,
    HydraException,
    MissingConfigException,
    OverrideParseException,
)
from hydra.utils import to_absolute_path
from lightning.fabric.utilities.exceptions import MisconfigurationException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from data.arguments import plain, reason
from data.simulation.motion import EscapedMotionError
from runner.compose import experiments, keys_of, placed
from runner.run_folder import write_failure


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
        return f"there is no setting {key!r}{_nearest(key, keys_of(config))}; see --help"
    return first


def _nearest(word: str, choices: Sequence[str]) -> str:
    near = difflib.get_close_matches(word, choices, n=2, cutoff=0.6)
    return f"; did you mean {' or '.join(near)}?" if near else ""


def absolute(folder: str) -> Path:
    """A folder as typed, from where the command was typed."""
    return Path(to_absolute_path(folder))
