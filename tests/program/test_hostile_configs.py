"""Nothing runs from a config, and what cannot be used is refused by key, value and expectation."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from data import Excitation
from data.annotations import Count, Fraction, Positive, Share, expectation, fits
from models import Estimator
from runner import job
from runner.config.command_line import read_words, refusals
from runner.config.compose import composed
from runner.config.settings import check_settings
from runner.folder.lock import release_all
from tests.experiments import build, experiment_of
from tests.hostile_files import places_of

ROOT = Path(__file__).parents[2]
SIZES = {"dofs": 3, "inputs": 3, "dt": 0.01}


@pytest.mark.parametrize("backslashes", range(6))
def test_a_config_is_resolved_once_and_only_to_plain_values(backslashes, tmp_path):
    """Finding 1: what is escaped stays text, whatever it says."""
    command = f"touch {tmp_path / 'executed'}"
    run = f'{{_target_:torch.utils.collect_env.run,command:"{command}"}}'
    for key in ("ridge", "cutoff", "bias"):
        cfg = composed("model=vwnn")
        cfg.model[key] = "\\" * backslashes + f"${{oc.create:{run}}}"
        with pytest.raises(ValueError, match=r"_target_|must be"):
            build(cfg.model, Estimator, **SIZES)
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize(
    ("words", "key", "asked"),
    [
        (["threads=0.5"], "threads=0.5", "a whole number"),
        (["threads=1000000"], "threads=1000000", "1 to 1024, or null"),
        (["figures=perhaps"], "figures=perhaps", "true or false"),
        (["+foo=1"], "foo", "no setting"),
        (["model.name=null"], "model.name=null", "text"),
        (["model.name='../x'"], "model.name=../x", "a name"),
        (["+trainer.plugins=x"], "trainer.plugins", "no setting"),
        (["trainer.devices=-1"], "trainer.devices=-1", "a list of one device"),
        (["trainer.devices=2"], "trainer.devices=2", "hydra/launcher=joblib"),
        (["seed=1.5"], "seed=1.5", "a whole number"),
        (["checkpoint_seconds=nan"], "checkpoint_seconds=nan", "a number"),
    ],
)
def test_a_setting_of_a_wrong_type_is_named(words, key, asked):
    """Finding 10."""
    with pytest.raises(ValueError, match=r".") as error:
        check_settings(composed(*words))
    assert key in str(error.value)
    assert asked in str(error.value)


@pytest.mark.parametrize(
    ("node", "key", "asked"),
    [
        ({"band": "abc"}, "excitation.force.band=abc", "a list of numbers"),
        ({"band": [0.0, float("nan")]}, "excitation.force.band=", "a list of numbers"),
        ({"std": True}, "excitation.force.std=true", "a number"),
        ({"std": None}, "excitation.force.std=null", "a number"),
        ({"std": 10**400}, "excitation.force.std=", "a number"),
        ({"std": {"a": 1}}, "excitation.force.std=", "a number"),
    ],
)
def test_an_argument_of_a_wrong_type_is_named(node, key, asked):
    """Findings 10 and 13: the key as it is typed, the value and what is expected."""
    cfg = OmegaConf.merge(composed(), {"excitation": {"force": node}})
    with pytest.raises(ValueError, match=r".") as error:
        build(cfg.excitation, Excitation)
    assert key in str(error.value)
    assert asked in str(error.value)


@pytest.mark.parametrize("target", ["data.Record", "models.Adam"])
def test_a_class_of_another_kind_is_no_estimator(target):
    cfg = composed()
    cfg.model._target_ = target
    with pytest.raises(ValueError, match="is no Estimator"):
        build(cfg.model, Estimator, **SIZES)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(
    VALUES, st.sampled_from([float, int, bool, str, Share | None, list[Count], tuple[str, float]])
)
@settings(deadline=None, max_examples=40, derandomize=True)
def test_any_value_fits_an_annotation_or_not(value, annotation):
    assert fits(value, annotation) in (True, False)
    assert expectation(annotation)
    if fits(value, float):
        assert value == value
        assert not isinstance(value, bool)


def test_a_range_holds_its_ends_or_not():
    assert [fits(u, Count) for u in (0, 1, 1.5, True, 10**9)] == [False, True, False, False, True]
    assert [fits(u, Share) for u in (-0.1, 0, 1, 1.1)] == [False, True, True, False]
    assert [fits(u, Fraction) for u in (0.0, 1.0)] == [True, False]
    assert [fits(u, Positive) for u in (0.0, 1e-300, float("inf"))] == [False, True, False]
    assert expectation(list[Count] | None) == "a list of whole numbers of at least 1 or null"


ODD = VALUES | st.sampled_from((
    {"_target_": "os.system", "command": "touch executed"}, {"_target_": "data.Record"},
    {"_target_": "models.VWNN", "_partial_": True}, {"_target_": None}, {"_args_": [1]},
    "\\${oc.env:HOME}", "\\${", "???", "\x1b[31m", "../x", "x" * 10**5, 10**400,
))  # fmt: skip


@cache
def config(model: str) -> str:
    """The resolved config of a small run, as JSON: each use changes a copy of its own."""
    cfg = composed(f"model={model}", "data.duration=1")
    return json.dumps(OmegaConf.to_container(cfg, resolve=True))


@given(st.data())
@settings(deadline=None, max_examples=24, derandomize=True)
def test_a_changed_config_is_refused_in_a_line_or_built(source):
    model = source.draw(st.sampled_from(("vwnn", "linear", "element_network")))
    content = json.loads(config(model))
    holder, key = source.draw(st.sampled_from(places_of(content)))
    if isinstance(holder, dict):
        key = source.draw(st.sampled_from((key, key, "extra")))
    holder[key] = source.draw(ODD)
    try:
        with refusals():
            cfg = OmegaConf.create(content)
            check_settings(cfg)
            _, module, _ = experiment_of(cfg).assemble()
    except SystemExit as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
    except ValueError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
    else:
        assert isinstance(module.estimator, Estimator)
    assert not Path("executed").exists()


def test_an_option_that_unpickles_is_refused(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["train.py", "--experimental-rerun=config.pickle"])
    with pytest.raises(ValueError, match="pickle"):
        read_words()


MISTYPED = [
    ["train.py", "data.durations=3"],
    ["train.py", "data=measured", "data.path=nothing.csv"],
    ["train.py", "-m", "model=vwn,linear"],
    ["train.py", "-x"],
    ["evaluate.py", "run=nothing"],
    ["-m", "live", "simulation", "--run", "nothing"],
    ["-m", "live.samples", "--replay", "nothing.csv"],
    ["-m", "report.paper", "nothing"],
]
ONE_BY_ONE = """
import json, os, runpy, sys, tempfile, traceback
import hydra  # once for all of them; each goes on in a process of its own

def run(words):
    sys.argv = words[words[0] == "-m":]
    try:
        if words[0] == "-m":
            runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        else:
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as end:
        return end.code
    except BaseException:
        traceback.print_exc()
    return None

answers = []
for words in json.loads(sys.argv[1]):
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as end:
        child = os.fork()
        if child == 0:
            os.dup2(said.fileno(), 2)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            json.dump([run(words), "torch" in sys.modules], end)
            end.flush()
            sys.stderr.flush()
            os._exit(0)
        os.waitpid(child, 0)
        said.seek(0)
        end.seek(0)
        answers.append([*json.load(end), said.read()])
print(json.dumps(answers))
"""


@pytest.fixture(scope="module")
def mistyped() -> list[tuple[int | None, bool, str]]:
    """Of each of MISTYPED the exit status, whether PyTorch was loaded, and what it says."""
    command = [sys.executable, "-c", ONE_BY_ONE, json.dumps(MISTYPED)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


@pytest.mark.parametrize("number", range(len(MISTYPED)), ids=map(" ".join, MISTYPED))
def test_a_mistyped_word_is_told_before_pytorch_is_loaded(number, mistyped):
    """Seconds of imports come after; counted by what was imported, not by the clock."""
    status, torch_is_loaded, said = mistyped[number]
    (line,) = said.splitlines()
    assert (status, torch_is_loaded) == (1, False)
    assert line.startswith("error: ")


def test_a_fit_that_failed_is_no_result(tmp_path, monkeypatch):
    """Whatever a solver does to the weights: an error, and nothing that looks finished."""

    def spoil(self, module, **_: object) -> None:
        for values in module.estimator.state_dict().values():
            values.fill_(float("nan"))

    monkeypatch.setattr(job.Trainer, "fit", spoil)
    words = ["data.duration=5", "figures=false", "baselines=none", "model=linear"]
    with pytest.raises(ValueError, match="the fit failed"):
        job.identify(composed(*words, "trainer.enable_progress_bar=false"), tmp_path)
    assert not (tmp_path / "metrics.json").exists()
    release_all()
