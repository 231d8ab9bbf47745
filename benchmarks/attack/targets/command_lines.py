"""Words after `python train.py`: choices, settings and options of wrong types, sizes and names."""

from __future__ import annotations

import json
import math
import random
import sys
from pathlib import Path

import report.run.summary  # noqa: F401  loaded here, so that the forks need not
import train
from benchmarks.attack.attempt import Attempt, WronglyAcceptedError
from runner.config.compose import CONF, GROUPS, experiments, keys_of
from runner.folder.run_files import EVENTS

QUICK = ["data.duration=2", "figures=false", "trainer.enable_progress_bar=false", "max_fail=1"]
NUMBERS = [
    "0", "-1", "1", "2", "3", "7", "1.5", "-0.0", "1e-300", "1e300", "-1e300", "1e400", "nan",
    ".nan", ".inf", "-.inf", "1000000", "1000000000", "1e9", "1e-12", "99999999999999999999999",
    "0x10", "1_000", "9" * 400,
]  # fmt: skip
WORDS = [
    "null", "true", "false", "perhaps", "abc", "''", "' '", "none", "~", "???", "[]", "{}", "[1,2]",
    "[a,b]", "[null]", "[[1,2],[3]]", "{a:1}", "{_target_:os.system}", "[0,nan]", "[0.0,1e9]",
    "x" * 300, "../../x", "'../x'", "'a/b'", "'a b'", "größe", "\u202eabc", "'\x1b[31mred'",
    "'[bold]x[/]'", "'=1+1'", "'-1'", "'${seed}'", "${seed}", "${nothing}", "'\\${seed}'",
    "[1..3]", "range(3)", "a=b", "a:b", "int(3)", "str(5)", "'%s'", "{", "]", "'", '"', "\\", "$",
    "${", "${oc.create:{_target_:os.system}}", "'\\${oc.create:{_target_:os.system}}'",
]  # fmt: skip
OPTIONS = [
    "--cfg=foo", "-x", "--config-name=foo", "--config-dir=/nothing", "--package=a.b", "--info=foo",
    "--experimental-rerun=x", "--cfg", "--help=3", "-cp=/x", "--resolve", "--hydra-help",
]  # fmt: skip
TARGETS = [
    "os.system", "builtins.eval", "subprocess.Popen", "torch.load", "models.NoFreeRunError",
    "data.Record", "data.SampleLines", "models.VWNN", "models.Online", "data.Structure", "models.",
    "data.__init__", "models.PUBLIC", "torch.utils.collect_env.run",
]  # fmt: skip
CHEAP = ["vwnn", "linear", "two_point", "last_value", "vwnn_first_order", "online_linear"]


class Target:
    name = "command_lines"

    def __init__(self) -> None:
        self.keys = [key for key in keys_of("train") if "." in key or key not in GROUPS]
        self.choices = {
            group: [path.stem for path in (CONF / group).glob("*.yaml")] for group in GROUPS
        }
        self.choices["experiment"] = [path.stem for path in experiments()]

    def prepare(self, folder: Path) -> None:
        """Nothing: every command begins anew."""

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        """A small run with one to three hostile words."""
        words = [f"model={draw.choice(CHEAP)}"] if draw.random() < 0.5 else []
        words += [self._word(draw) for _ in range(draw.choice([1, 1, 1, 2, 3]))]
        draw.shuffle(words)
        return Attempt(" ".join(words), lambda: run([*QUICK, *words]))

    def _word(self, draw: random.Random) -> str:
        kind = draw.random()
        value = draw.choice(NUMBERS + WORDS)
        if kind < 0.55:
            return f"{draw.choice(self.keys)}={value}"
        if kind < 0.62:
            return f"{draw.choice(['+', '~', '++'])}{draw.choice(self.keys)}={value}"
        if kind < 0.70:
            group = draw.choice(GROUPS)
            return f"{group}={draw.choice([value, *self.choices[group]])}"
        if kind < 0.76:
            parent = draw.choice(
                ["model", "data", "solver", "excitation.force", "system.structure"]
            )
            return f"{parent}._target_={draw.choice(TARGETS)}"
        if kind < 0.84:
            parent = draw.choice([key.rpartition(".")[0] for key in self.keys if "." in key])
            return f"+{parent}.{draw.choice(['foo', '_partial_', '_args_', 'plugins'])}={value}"
        if kind < 0.90:
            key = draw.choice(self.keys)
            place = draw.randrange(len(key))
            return f"{key[:place]}{draw.choice(['x', '.', '', '@', '='])}{key[place + 1 :]}={value}"
        return draw.choice(OPTIONS) if kind < 0.95 else value


def run(words: list[str]) -> None:
    """Run the program, as the shell would, and look at what it left."""
    sys.argv = ["train.py", *words]
    folder = Path("run")
    if not any(word.startswith("hydra.run") for word in words):
        sys.argv.append(f"hydra.run.dir={folder.absolute()}")
    try:
        train.cli()
    except SystemExit as error:
        if error.code and (folder / "metrics.json").exists():
            raise WronglyAcceptedError("a refused run has a metrics.json") from None
        if error.code and (folder / "config.yaml").exists() and not _began(folder):
            raise WronglyAcceptedError("a refused run has a config.yaml") from None
        raise
    check(folder)


def _began(folder: Path) -> bool:
    """Whether training began: a fit that fails leaves an unfinished run."""
    return any(folder.glob(EVENTS))


def check(folder: Path) -> None:
    """What a finished run must hold: numbers, or that it diverged."""
    if not (folder / "metrics.json").exists():
        return  # --cfg, --help and the like
    metrics = json.loads((folder / "metrics.json").read_text())
    for split in ("train", "test"):
        error = metrics[split]["relative_rms_percent"]
        if error is not None and not (math.isfinite(error) and error >= 0.0):
            raise WronglyAcceptedError(f"an error of {error} %")
    if metrics["train"]["relative_rms_percent"] is None:
        raise WronglyAcceptedError("a finished run whose fit has no error")
