"""Errors as a person reads them in the terminal: one line, and an exit status."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Glob, Override
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.utils import to_absolute_path
from omegaconf import ListConfig, OmegaConf
from omegaconf.errors import (
    InterpolationToMissingValueError,
    MissingMandatoryValue,
    OmegaConfBaseException,
)

from data.annotations import shown
from data.arguments import Parser, plain, reason, suggestion
from runner.config.compose import (
    CONF,
    EARLIER,
    EXAMPLES,
    GROUPS,
    can_be_read,
    composed,
    experiments,
    help_text,
    keys_of,
    placed,
)
from runner.config.settings import check_files


def fail(message: str) -> None:
    print(f"error: {plain(' '.join(message.split()))}", file=sys.stderr)


OF_RUNS = re.compile(r"hydra\.(run\.dir|searchpath)")  # keys of Hydra that a person may type
OF_SWEEPS = re.compile(  # the same of a program that sweeps
    r"hydra\.(sweep\.(dir|subdir)|mode|(launcher|sweeper)(\.[^\W_][\w-]*)+)|hydra/launcher"
)
INSTEAD = {  # of a sweep, for the programs that have none
    "evaluate": "runs=[a,b] compares many runs",
    "identify": "a run of its own is python train.py",
    "predict": "a list is several motions, as excitation.scale=[0.5,1]",
}
EXPECTED = (ValueError, OSError, HydraException, OmegaConfBaseException)


class CommandError(ValueError):
    """What a command says in one line of bad input, where it is called from Python."""

    def _render_traceback_(self) -> list[str]:
        """The line alone, in a notebook; a script shows where it was called."""
        return [f"error: {self}"]


def reason_of(error: BaseException) -> str:
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"{error.strerror}; make room and give the same command again"
    if isinstance(error, OSError):
        hint = (
            ""
            if isinstance(error, FileNotFoundError)
            else "; choose another hydra.run.dir, or hydra.sweep.dir"
        )
        return f"{error.strerror or error}: {error.filename or ''}{hint}"
    if isinstance(error, MissingMandatoryValue):
        return f"{error.full_key} must be given: {error.full_key}=…; see --help"
    if isinstance(error, InterpolationToMissingValueError) and "hydra.job." in str(error):
        return (
            "hydra.job.num and hydra.job.id are no names of folders: a sweep that goes on after an "
            "interruption finds runs by their choices; leave hydra.sweep.subdir out, or name what "
            "varies, as in hydra.sweep.subdir='${model.name}-${seed}'"
        )
    if isinstance(error, InterpolationToMissingValueError):
        missing = str(error).splitlines()[0].rpartition(": ")[2]
        needs = f", {error.full_key} needs it" if error.full_key else ""
        return f"{missing} must be given{needs}: {missing}=…; see --help"
    if isinstance(error, OmegaConfBaseException):
        first = (str(error).splitlines() or ["an interpolation cannot be resolved"])[0]
        return f"{error.full_key}: {first}; see --help" if error.full_key else first
    return str(error)


@contextmanager
def one_line_errors(config: str) -> Iterator[None]:
    """Bad input ends with one line and exit status 1; a traceback is for bugs."""
    try:
        with raised_lines(config, sys.argv[1:]):
            yield
    except BrokenPipeError:  # nobody reads on, as after `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except CommandError as error:
        fail(str(error))
    except KeyboardInterrupt:
        training = (
            "; an unfinished run has no metrics.json: the same command goes on from what it saved, "
            "and budget=5min ends with the best so far"
        )
        fail(f"interrupted{training if config == 'train' else ''}")
        sys.exit(130)
    else:
        return
    sys.exit(1)


@contextmanager
def raised_lines(config: str, words: Sequence[str]) -> Iterator[None]:
    """Raise CommandError, the line, for bad input among the words of a program."""
    try:
        yield
    except BrokenPipeError:
        raise
    except HydraException as error:
        line = _explain(error, config, words)
    except RecursionError:
        line = "a word of the command line, or a config, is nested too deeply; give a file instead"
    except EXPECTED as error:
        line = reason_of(error)
    else:
        return
    raise CommandError(plain(" ".join(line.split()))) from None


def read_words() -> None:
    """Ready the command line for Hydra. Raises ValueError for options that it does not have."""
    sys.argv[1:] = placed(sys.argv[1:])
    parser = get_args_parser()
    parser.__class__ = Parser  # raises where argparse prints its usage
    program = Path(sys.argv[0]).stem
    if parser.parse_args().help and program in EXAMPLES:
        print(help_text(program))  # Hydra would list every folder of the configs before
        sys.exit(0)
    if parser.parse_args().experimental_rerun:
        raise ValueError(
            "--experimental-rerun reads a pickle, which can run any code; give the words again"
        )
    if parser.parse_args().multirun and program in INSTEAD:
        raise ValueError(f"--multirun: {program}.py has no sweeps; {INSTEAD[program]}")
    overrides = check_words(parser.parse_args().overrides, program)
    if parser.parse_args().multirun and not parser.parse_args().config_dir:
        words = map(_first, overrides)
        check_files(composed(*filter(None, words)))  # a sweep loads PyTorch before its first run


def check_words(words: Sequence[str], program: str, sweeps: bool = True) -> list[Override]:
    """The words as Hydra reads them. Raises ValueError for settings that the program lacks.

    sweeps: whether this is a command line, which may ask for many runs.
    """
    overrides: list[Override] = OverridesParser.create().parse_overrides(list(words))
    for override in overrides:
        key = override.key_or_group
        if re.match(r"hydra\b", key):
            _check_word_of_hydra(key, program, sweeps and program not in INSTEAD)
        if program == "predict" and key == "excitation":
            raise ValueError(
                f"{override.input_line} is a choice of training; a motion is given by "
                "excitation.path, excitation.events or excitation.kind"
            )
        value = override.value()
        names = value if isinstance(value, list) else [value]
        free = override.is_delete() or override.is_sweep_override()
        choice = override.key_or_group in GROUPS and not free
        if choice and not all(isinstance(name, str) for name in names):
            raise ValueError(f"{override.input_line}: a choice must be a word; see --help")
    return overrides


def _check_word_of_hydra(key: str, program: str, sweeps: bool) -> None:
    """Raise ValueError for a setting of Hydra that the program does not have."""
    if OF_RUNS.fullmatch(key) or (sweeps and OF_SWEEPS.fullmatch(key)):
        return
    if not sweeps:
        own = f"{program}.py" if program in INSTEAD else f"{program}() in Python"
        raise ValueError(
            f"{shown(key)} is not a setting of {own}, which has no sweeps; its settings of "
            "Hydra are hydra.run.dir and hydra.searchpath; "
            + INSTEAD.get(program, "many runs are python train.py -m …, or a loop")
        )
    raise ValueError(
        f"{shown(key)} is not a setting of this program; its settings of Hydra are hydra.run.dir, "
        "hydra.sweep.dir, hydra.sweep.subdir, hydra.mode, hydra.searchpath, "
        "hydra/launcher, hydra.launcher.… and hydra.sweeper.…"
    )


def _first(override: Override) -> str | None:
    """The word that asks for the first value of a sweep's; None where Hydra looks for files.

    Raises ValueError for values that are no list.
    """
    word = str(override.input_line)
    if not override.is_sweep_override():
        return word
    if isinstance(override.value(), Glob):
        return None
    try:
        return f"{word.partition('=')[0]}={next(iter(override.sweep_string_iterator()))}"
    except (StopIteration, ValueError, HydraException):
        raise ValueError(f"{word} names no values; expected such as 1,2,5 or range(0,20)") from None


@contextmanager
def refusals() -> Iterator[None]:
    """Bad input, and a run that fails, end the program before Hydra adds its lines."""
    try:
        yield
    except EXPECTED as error:
        fail(reason_of(error))
        sys.exit(getattr(error, "status", 1))


@contextmanager
def command_errors() -> Iterator[None]:
    """The same for programs that write no run: files by name, Ctrl-C in silence."""
    with one_line_errors("train"):
        try:
            yield
        except HydraException:  # one of them is an OSError too
            raise
        except OSError as error:
            raise ValueError(reason(error)) from None
        except KeyboardInterrupt:
            sys.exit(130)


def _explain(error: Exception, config: str, words: Sequence[str]) -> str:
    """A misspelt choice or key, with the nearest ones that exist."""
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        options = list(error.options)
        if group.startswith("experiment"):
            group, options = "experiment", [path.stem for path in experiments()]
        earlier = {path.stem for path in (EARLIER / group).glob("*.yaml")}
        return (
            f"{group}={choice} does not exist{suggestion(choice, options, 2)} "
            f"(choices: {', '.join(option for option in options if option not in earlier)})"
        )
    if isinstance(error, OverrideParseException):
        return _unreadable(error.override, words)
    if several := re.match(r"Ambiguous value for argument '(.*)'", str(error)):
        return _several(several[1], config)
    cause = getattr(error.__cause__, "full_key", None) or getattr(error.__cause__, "key", None)
    first = " ".join(str(error).splitlines()[:2]).removesuffix(".")
    if first.startswith("Could not override"):
        key = first.split("'")[1].replace("/", ".") if "'" in first else str(cause)
        return _no_setting(key, config, words)
    return first


def _unreadable(override: str | None, words: Sequence[str]) -> str:
    """Why a word cannot be read: the shell split it at a blank, or it is in no quotes."""
    words = [word.removeprefix("++") for word in words]
    own = str(override).removeprefix("++")
    place = words.index(own) if own in words else len(words)
    around = [
        " ".join(words[first : last + 1])
        for first in range(place, -1, -1)
        for last in range(max(place, first + 1), len(words))
    ]
    whole = next(filter(can_be_read, sorted(around, key=len)), None)
    if whole is not None:
        return (
            f"the shell splits {shown(whole)} at its blank; leave blanks out, or put all of it in "
            f"single quotes: '{plain(whole)}'"
        )
    return (
        f"{shown(own)!r} is no key=value that can be read; put it in single quotes, "
        "so that the shell leaves it, and close its brackets"
    )


def _several(word: str, config: str) -> str:
    """What a word that gives several values may mean where a run has one."""
    word = word.removeprefix("++")
    key, _, values = word.partition("=")
    now = OmegaConf.select(composed(config=config), key, throw_on_missing=False)
    lists = f"; a list is {key}=[{values}]" if now is None or isinstance(now, ListConfig) else ""
    if config in INSTEAD:
        return f"{word} gives several values, and {config}.py has no sweeps{lists}"
    return f"{word} gives several values, a run has one; for a run with each: train.py -m …{lists}"


def _no_setting(key: str, config: str, words: Sequence[str]) -> str:
    """The choices that were typed have no such setting; others may have it."""
    choices = [word for word in words if word.partition("=")[0] in GROUPS]
    try:
        known = keys_of(config, *(word for word in choices if "," not in word))
    except (HydraException, OmegaConfBaseException, ValueError):
        known, choices = keys_of(config), []
    elsewhere = f" with {' '.join(choices)}" if key in keys_of(config) else ""
    own = (word for word in words if word.partition("=")[0].replace("/", ".") == key)
    near = "" if key in known else suggestion(key, known, 2)  # of several choices one may lack it
    instead = next((_made_by(word, key, known) for word in own), "") or near
    return f"there is no setting {key!r}{elsewhere}{instead}; see --help"


def _made_by(word: str, key: str, known: Sequence[str]) -> str:
    """Advice to make the first setting, one of those known, that a choice for `key` stands for."""
    path = CONF / f"{word.lstrip('/').replace('.', '/').replace('=', '/')}.yaml"
    made = OmegaConf.load(path) if path.is_file() else OmegaConf.create()
    own = (n for n in known if n.startswith(f"{key.partition('.')[0]}."))
    values = ((name, OmegaConf.select(made, name)) for name in own)
    return next((f"; say {n}={str(v).lower()}" for n, v in values if isinstance(v, bool | int)), "")


def absolute(folder: str | Path) -> Path:
    """A folder as typed, from where the command was typed."""
    return Path(to_absolute_path(str(folder)))
