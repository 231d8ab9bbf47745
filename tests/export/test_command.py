"""python -m export: what it writes, one line for every mistake, and the table of docs/export.md."""

from __future__ import annotations

import json
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from export import __main__ as command
from export.run import read_exported
from export.targets import TARGETS
from tests.experiments import said_by
from tests.export.conftest import exported, network


@pytest.fixture
def copy(vwnn_run, tmp_path):
    """A run to damage."""
    return shutil.copytree(vwnn_run, tmp_path / "copy")


@pytest.fixture
def say(monkeypatch, capsys):
    """python -m export: (words) → (exit status, stdout, stderr)."""

    def of(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["export", *words])
        return said_by(lambda _: command.cli(), words, capsys)

    return of


def test_the_json_has_parameters_channels_and_passport(vwnn_run, tmp_path, say):
    status, out, err = say(f"run={vwnn_run}", "to=json", f"output={tmp_path / 'a' / 'b'}")
    assert (status, err) == (0, "")
    assert "vwnn.json" in out
    content = json.loads((tmp_path / "a" / "b" / "vwnn.json").read_text("utf-8"))
    assert [one["unit"] for one in content["inputs"]] == ["N", "N", "N"]
    assert content["passport"]["trained_on"]["duration_s"] == 2
    assert content["passport"]["trained_range"]["displacement"]["unit"] == "m"
    assert all(one["value"] is not None for one in content["parameters"])


def test_the_passport_says_record_error_range_and_licence_in_words(vwnn_run):
    metrics = json.loads((vwnn_run / "metrics.json").read_text("utf-8"))
    model = read_exported(vwnn_run)
    text = "\n".join(model.passport.lines())
    assert "1 simulated record of 2 s of bilinear" in text
    assert f"{metrics['test']['relative_rms_percent']:.3g} %" in text
    assert "displacement: x1" in text
    assert "licence: of this code MIT" in text
    assert max(map(len, text.splitlines())) <= 96


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["to=json"], "run must be given"),
        (["run=RUN"], "to must be given"),
        (["run=RUN", "to=jsn"], "did you mean json?"),
        (["run=RUN", "to=json", "outptu=x"], "did you mean output?"),
        (["run=RUN", "to=json", "to=c"], "given twice"),
        (["run=RUN", "to="], "lacks a value"),
        (["run=nowhere", "to=json"], "is not a finished run"),
        (["run=RUN", "to=json", "output=RUN/config.yaml"], "is a file"),
    ],
)
def test_a_mistake_is_told_in_one_line(vwnn_run, say, words, expected):
    status, out, err = say(*(word.replace("RUN", str(vwnn_run)) for word in words))
    assert (status, out) == (1, "")
    assert expected in err
    assert err.count("\n") == 1


def test_what_a_target_refuses_leaves_nothing_behind(vwnn_run, tmp_path, say):
    output = tmp_path / "out"
    status, _, err = say(f"run={vwnn_run}", "to=json,opensees", f"output={output}")
    assert status == 1
    assert err.startswith("error: opensees: ")
    assert "to=json would be" in err
    assert not output.exists()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"verdict": {"identified": False, "reason": "it errs"}}, "identified nothing: it errs"),
        ({"free_run": {"diverged_after_s": [1.5, 0.5]}}, "diverges after 0.5 s"),
    ],
)
def test_a_model_that_is_no_result_is_refused(copy, say, change, expected):
    path = copy / "metrics.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | change))
    status, _, err = say(f"run={copy}", "to=json")
    assert status == 1
    assert expected in err
    assert not (copy / "export").exists()


def test_an_unfinished_run_is_refused(copy, say):
    (copy / "metrics.json").unlink()
    assert "is not a finished run: it has no metrics.json" in say(f"run={copy}", "to=json")[2]
    (copy / "failed.json").write_text('{"reason": "the fit failed"}')
    assert "holds a run that failed: the fit failed" in say(f"run={copy}", "to=json")[2]


# --- the table of docs/export.md

PAGE = Path(__file__).parents[2] / "docs" / "export.md"
ROWS = re.findall(r"^\| `(\w+)` \| (.+?) \|", PAGE.read_text("utf-8"), flags=re.MULTILINE)
NEEDED = {"fmu": shutil.which("gcc")}


def test_the_page_has_every_target():
    assert [target for target, _ in ROWS] == list(TARGETS)


@pytest.mark.parametrize(("target", "files"), ROWS)
def test_each_row_writes_its_files_for_a_network_of_elements(target, files, tmp_path):
    if not NEEDED.get(target, True):
        pytest.skip(f"to={target} needs more than is installed")
    model = exported(network(1, 1, ("hinge_stiffness",), hinges=1, units=0), "building")
    paths = import_module(f"export.{target}").write(model, tmp_path)
    written = {path.name for path in paths}
    assert written == {path.name for path in tmp_path.iterdir()}
    assert written == set(re.findall(r"`([\w.-]+)`", files.replace("NAME", "building")))
    text = b"".join(path.read_bytes() for path in paths)
    assert target == "fmu" or b"structural-model-zoo" in text  # the passport
