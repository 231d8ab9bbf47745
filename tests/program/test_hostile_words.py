"""Whatever is typed after a program ends in a result or in a line, never in a traceback.

HOSTILE_EXAMPLES=2000 python -m pytest -n 0 tests/program/test_hostile_words.py    the long form
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import chdir
from functools import cache
from pathlib import Path
from types import FrameType

import pytest
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import evaluate
import predict
import train
from data.inspect import __main__ as inspect_command
from export import __main__ as export_command
from live import __main__ as live_command
from report.zoo import command as zoo_command
from runner.config.command_line import _first
from runner.config.compose import CONF, EARLIER, GROUPS, experiments, keys_of
from runner.folder.lock import release_all
from tests.program.test_train import finished_run, run

# Command lines of wrong keys, types, sizes and names
NUMBERS = [
    "0", "-1", "1", "3", "1.5", "-0.0", "1e-300", "1e300", "-1e300", "1e160", "1e400", "nan", "inf",
    "-inf", ".nan", ".inf", "1e9", "1e5", "0x10", "1_000", "00", "99999999999999999999999",
    "9" * 400,
]  # fmt: skip
TEXTS = [
    "null", "true", "abc", "''", "' '", "none", "~", "???", "[]", "{}", "[1,2]", "[a,b]", "[null]",
    "[[1,2],[3]]", "{a:1}", "{_target_:os.system}", "[0,nan]", "[0.0,1e9]", "x" * 300, "../x",
    "'../x'", "'a/b'", "größe", "\u202eabc", "'\x1b[31mred'", "'[bold]x[/]'", "'-1'", "${seed}",
    "'${seed}'", "${nothing}", "'\\${seed}'", "range(3)", "choice(1,2)", "interval(0,1)", "1,2",
    "glob(*)", "sort(2,1)", "tag(log,interval(1,2))", "a=b", "a:b", "int(3)", "'%s'", "{", "]", "'",
    '"', "\\", "$", "${", "os.system", "${oc.env:HOME}", "/dev/null", "/", ".", "zoo:a/b",
]  # fmt: skip
OF_HYDRA = [
    "hydra.launcher._target_", "hydra.sweeper._target_", "hydra.sweeper", "hydra.launcher",
    "hydra.sweep.dir", "hydra.sweep.subdir", "hydra.run.dir", "hydra.job_logging", "hydra.verbose",
    "hydra.callbacks.a._target_", "hydra.job.env_copy", "hydra.job.num", "hydra.mode", "hydra",
    "hydra.sweeper.params", "hydra.sweeper.grids", "hydra.sweeper.params.seed", "hydra/launcher",
    "hydra/sweeper", "hydra/job_logging", "hydra.searchpath", "hydra.launcher.n_jobs",
]  # fmt: skip
OPTIONS = [
    "-m", "--cfg=job", "--cfg=foo", "-x", "--config-name=foo", "--config-dir=/nothing", "--help=3",
    "--package=a.b", "--info=foo", "--experimental-rerun=x", "--resolve", "--to", "--output",
    "--force", "-h", "--picture", "--", "-", "--units", "--channels", "a1=b",
]  # fmt: skip
CHEAP = ["vwnn", "linear", "two_point", "last_value", "vwnn_first_order"]
CONFIGURED = ("train", "evaluate", "predict")
LISTS = {  # first words and keys of the programs that have no config
    "live": (["listen", "replay", "RUN"], ["source", "dt", "channels", "model", "port", "units"]),
    "export": (["RUN"], ["to", "output", "run"]),
    "models.zoo": (["list", "show", "load", "publish", "verify", "card"], ["name", "licence"]),
    "data.inspect": (["RECORD", "."], ["a1", "time", "dt"]),
}
PROGRAMS = (*CONFIGURED, *LISTS)


@cache
def keys(program: str) -> list[str]:
    """Every setting of a program with a config, dotted."""
    return [key for key in keys_of(program) if "." in key or key not in GROUPS]


@cache
def choices(group: str) -> list[str]:
    """What a group of choices has."""
    if group == "experiment":
        return [path.stem for path in experiments()]
    return [path.stem for folder in (CONF, EARLIER) for path in (folder / group).glob("*.yaml")]


values = st.one_of(
    st.sampled_from(NUMBERS), st.sampled_from(TEXTS), st.text(max_size=8).filter("\0".__ne__)
)


@st.composite
def words_of(draw: st.DrawFn, program: str) -> str:
    """A word that a person, or somebody who means ill, might type."""
    value = draw(values)
    known = keys(program) if program in CONFIGURED else LISTS[program][1]
    key = draw(st.sampled_from(known))
    kind = draw(st.integers(0, 9 if program in CONFIGURED else 3))
    if kind == 0:
        return draw(st.sampled_from(OPTIONS))
    if kind == 1:
        return value
    if kind == 2:
        place = draw(st.integers(0, len(key) - 1))
        other = draw(st.sampled_from(["x", ".", "", "@", "="]))
        return f"{key[:place]}{other}{key[place + 1 :]}={value}"
    if kind == 3 and program not in CONFIGURED:
        return draw(st.sampled_from(LISTS[program][0]))
    if kind == 3:
        return f"{draw(st.sampled_from(['+', '~', '++']))}{key}={value}"
    if kind == 4:
        return f"{draw(st.sampled_from(['', '+', '~']))}{draw(st.sampled_from(OF_HYDRA))}={value}"
    if kind == 5:
        group = draw(st.sampled_from(GROUPS))
        return f"{group}={draw(st.one_of(st.just(value), st.sampled_from(choices(group))))}"
    if kind == 6:
        parent = key.rpartition(".")[0] or key
        name = draw(st.sampled_from(["foo", "_partial_", "_args_", "_target_"]))
        return f"+{parent}.{name}={value}"
    return f"{key}={value}"


@st.composite
def command_lines(draw: st.DrawFn) -> tuple[str, list[str]]:
    """A program and one to four words after it."""
    program = draw(st.sampled_from((*PROGRAMS, "train", "predict")))
    words = draw(st.lists(words_of(program), min_size=1, max_size=4))
    if program == "train" and draw(st.booleans()):
        words.insert(0, f"model={draw(st.sampled_from(CHEAP))}")
    return program, [word.replace("\0", "") for word in words]


EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "12"))
SECONDS = 10  # of a line that asks for much work: it is no traceback until then
QUICK = ["data.duration=2", "figures=false", "trainer.enable_progress_bar=false", "max_fail=1"]
CLI: dict[str, Callable[[], object]] = {
    "train": train.cli,
    "evaluate": evaluate.cli,
    "predict": predict.cli,
    "live": live_command.main,
    "export": export_command.cli,
    "models.zoo": lambda: zoo_command.cli(""),
    "data.inspect": inspect_command.main,
}


class _TimeUp(BaseException):
    """Raised where a line asks for more work than a test may do."""


def _time_up(number: int, frame: FrameType | None) -> None:
    raise _TimeUp


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Iterator[Path]:
    """A finished run; the alarm rings for lines that take long."""
    folder = finished_run(tmp_path_factory.mktemp("runs") / "run", *QUICK, "model=linear")
    before = signal.signal(signal.SIGALRM, _time_up)
    yield folder
    signal.signal(signal.SIGALRM, before)


def _give(program: str, words: list[str], finished: Path) -> int:
    """Exit status of a line; what it raises is a traceback."""
    more = {
        "train": ["hydra.run.dir=run", *QUICK, *words],
        "evaluate": [f"run={finished}", *words],
        "predict": [f"run={finished}", "figures=false", "output=out", *words],
        "export": [f"run={finished}", *words],
    }
    GlobalHydra.instance().clear()
    sys.argv = [f"{program}.py", *more.get(program, words)]
    signal.alarm(SECONDS)
    try:
        CLI[program]()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except _TimeUp:
        return 0
    finally:
        signal.alarm(0)
        release_all()
    return 0


@settings(
    max_examples=EXAMPLES, deadline=None, database=None,
    derandomize="HOSTILE_EXAMPLES" not in os.environ, suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(line=command_lines())
def test_no_command_line_ends_in_a_traceback(line, finished, tmp_path_factory):
    program, words = line
    argv, folder = sys.argv, tmp_path_factory.mktemp("place")
    stdin, sys.stdin = sys.stdin, open(os.devnull)  # noqa: SIM115
    try:
        with chdir(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _give(program, words, finished)
    finally:
        sys.stdin.close()
        sys.argv, sys.stdin = argv, stdin


@pytest.mark.parametrize(
    "words",
    [
        ["hydra.launcher._target_=os.system"],
        ["-m", "hydra.sweeper._target_=os.system", "seed=0"],
        ["+hydra.callbacks.a._target_=os.system"],
        ["-m", "hydra.sweeper.grids=x", "seed=0"],
        ["-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs={_target_:builtins.print}"],
        ["-m", "hydra/launcher=slurm", "hydra.launcher.hours=inf", "seed=0"],
    ],
)
def test_words_of_hydra_end_in_one_line_that_names_them(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    place = f"hydra.sweep.dir={tmp_path}"
    assert run(train, monkeypatch, *words, "model=linear", *QUICK, place) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: hydra")
    assert error.count("\n") == 1
    assert not list(tmp_path.rglob("config.yaml"))


@pytest.mark.parametrize("word", ["seed=interval(1,2)", "seed=range(0,3,0)", "seed=range(3,0)"])
def test_a_sweep_over_no_values_is_named(word, monkeypatch, capsys):
    """And one over names of files is no error."""
    assert run(train, monkeypatch, "-m", word, *QUICK) == 1
    assert capsys.readouterr().err.startswith(f"error: {word} names no values; expected such as")
    (names,) = OverridesParser.create().parse_overrides(["model=glob(lin*)"])
    assert _first(names) is None


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (evaluate, ["--", "hydra.sweeper.params.seed=0"]),
        (predict, ["+hydra.sweeper.params.seed=0"]),
        (evaluate, ["hydra.mode=MULTIRUN"]),
        (predict, ["hydra/launcher=joblib"]),
        (evaluate, ["hydra.launcher.n_jobs=2"]),
        (predict, ["hydra.sweep.dir=x"]),
        (evaluate, ["-m", "figures=true,false"]),
    ],
)
def test_programs_without_sweeps_refuse_words_of_sweeps(
    program, words, finished, monkeypatch, capsys
):
    assert run(program, monkeypatch, *words, f"run={finished}") == 1
    error = capsys.readouterr().err
    assert "has no sweeps" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("program", "path"), [(train, "[]"), (evaluate, "0"), (train, "[0]"), (evaluate, "{a:b}")]
)
def test_files_are_text(program, path, finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = ["data=measured"] if program is train else [f"run={finished}"]
    plus = "" if program is train else "+"
    assert run(program, monkeypatch, *words, f"{plus}data.path={path}") == 1
    error = capsys.readouterr().err
    assert error.startswith("error: data.path=")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("key", "value"), [("duration", "inf"), ("std", "nan"), ("scale", "-inf"), ("dt", "nan")]
)
def test_numbers_of_a_prediction_are_finite(key, value, finished, tmp_path, monkeypatch, capsys):
    words = [f"run={finished}", f"output={tmp_path / 'out'}", "excitation.kind=gaussian"]
    assert run(predict, monkeypatch, *words, f"excitation.{key}={value}") == 1
    error = capsys.readouterr().err
    assert error.startswith(f"error: excitation.{key}=")
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_setting_of_numba_that_cannot_be_is_named():
    """By what every command is in, as it loads what compiles a simulation."""
    code = "from runner.config.command_line import command_errors\n"
    code += "with command_errors(): import data.numba_cache"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_NUM_THREADS": "0"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    assert done.returncode
    assert "NUMBA_" in done.stderr
    assert done.stderr.count("\n") == 1
