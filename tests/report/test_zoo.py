"""`python -m models.zoo`: a finished run is published, verified and never written again."""

from __future__ import annotations

import json
import math
import shutil
import sys
from pathlib import Path

import pytest

from models.experiment import Experiment
from models.stored.run import read_run
from models.zoo.index import entries, entry_of
from models.zoo.pretrained import load_pretrained
from report.zoo import command, publish, verify
from report.zoo.card import Licence
from report.zoo.publish import ABSOLUTE, entry_config
from runner.config.choices import plain
from runner.config.compose import composed
from runner.job import identify

WORDS = ("data.duration=10", "baselines=none", "figures=false", "trainer.enable_progress_bar=false")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A finished run of a linear system on 10 s of the yielding structure."""
    folder = tmp_path_factory.mktemp("runs") / "linear"
    identify(composed("model=linear", "system=bilinear", *WORDS), folder)
    return folder


@pytest.fixture(scope="module")
def zoo(run, tmp_path_factory) -> Path:
    """A zoo of that run alone."""
    root = tmp_path_factory.mktemp("zoo")
    assert publish.publish(run, None, Licence(), root=root) == "linear/bilinear.v1"
    return root


def test_a_published_run_loads_and_is_verified(run, zoo, capsys, monkeypatch):
    pretrained = load_pretrained("linear/bilinear", zoo)
    assert pretrained.metrics["free_run"] == read_run(run).metrics["free_run"]
    assert [row["seed"] for row in pretrained.metrics["over_seeds"]] == [0, 1, 2, 3, 4]
    own = pretrained.metrics["over_seeds"][0]
    assert own["free_run_percent"] == pretrained.metrics["free_run"]["relative_rms_percent"]
    verify.verify([], root=zoo)
    assert "files as published, golden 0.0e+00, numbers 0.0e+00" in capsys.readouterr().out
    monkeypatch.setattr(verify, "ROUNDING", -1.0)  # as if the digits depended on the processor
    verify.verify([], root=zoo)


def test_texts_of_a_run_stay_texts_in_its_card(run, tmp_path):
    own = shutil.copytree(run, tmp_path / "run")
    metrics = json.loads((own / "metrics.json").read_text())
    metrics["versions"] = {"<img src=x>": "[a](javascript:b)"}
    metrics["outside_trained_range"] = [
        {"kind": "<b>", "name": "`x`", "unit": "", "largest": 2.0, "trained": 1.0, "times": 2.0,
         "channels": 1}
    ]  # fmt: skip
    (own / "metrics.json").write_text(json.dumps(metrics))
    card = load_pretrained(publish.publish(own, None, Licence(), root=tmp_path), tmp_path).card
    assert "\\<img src=x> \\[a](javascript:b)" in card
    assert "the largest \\<b> of \\`x\\`" in card


def test_numbers_that_are_others_now_are_remarks_of(run, tmp_path, capsys):
    publish.publish(run, "linear/other", Licence(), root=tmp_path)
    entry = entry_of("linear/other", tmp_path)
    path = entry.folder / "metrics.json"
    content = json.loads(path.read_text())
    content["free_run"]["relative_rms_percent"] *= 1.0 + 1e-8
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="1 published models are not what they were"):
        verify.verify([], root=tmp_path)
    assert "metrics.json is not the published file" in capsys.readouterr().out
    publish.write_index(tmp_path, {entry.name: publish.facts_of(entry.folder, Licence())})
    with pytest.raises(ValueError, match="1 published models are not what they were"):
        verify.verify([], root=tmp_path)
    assert "relative_rms_percent of free_run is" in capsys.readouterr().out


@pytest.mark.parametrize("now", [None, math.inf])
def test_a_run_that_diverges_now_is_not_what_it_was(run, zoo, monkeypatch, now):
    own = verify._scored
    calls = []

    def scored(model, experiment, seeds):
        numbers = own(model, experiment, seeds)
        calls.append(numbers)
        return dict.fromkeys(numbers, now) if len(calls) == 1 else numbers

    monkeypatch.setattr(verify, "_scored", scored)
    with pytest.raises(ValueError, match="1 published models are not what they were"):
        verify.verify([], root=zoo)


def test_a_version_is_never_written_again(run, zoo, tmp_path):
    before = {p: p.read_bytes() for p in zoo.rglob("*") if p.is_file()}
    with pytest.raises(ValueError, match=r"linear/bilinear\.v1 is published, and never changes"):
        publish.publish(run, "linear/bilinear.v1", Licence(), root=zoo)
    with pytest.raises(ValueError, match=r"linear/bilinear\.v1 has these weights"):
        publish.publish(run, None, Licence(), root=zoo)
    assert before == {p: p.read_bytes() for p in zoo.rglob("*") if p.is_file()}
    identify(composed("model=linear", "system=bilinear", "seed=1", *WORDS), tmp_path / "new")
    assert publish.publish(tmp_path / "new", None, Licence(), root=zoo) == "linear/bilinear.v2"
    assert all(p.read_bytes() == was for p, was in before.items() if p.name != "index.json")
    assert load_pretrained("linear/bilinear", zoo).config["seed"] == 1
    assert load_pretrained("linear/bilinear.v1", zoo).config["seed"] == 0


def test_a_measured_record_asks_for_its_licence_and_loses_its_folders(run, tmp_path, monkeypatch):
    monkeypatch.setattr(Experiment, "simulated", False)
    with pytest.raises(ValueError, match="say data_licence"):
        publish.publish(run, None, Licence(), root=tmp_path / "zoo")
    cfg = composed(
        "experiment=friction_damper", f"records={tmp_path}/damper", "model=prandtl_ishlinskii"
    )
    values = entry_config(plain(cfg))
    assert values["data"]["path"][0] == "RECORDS/damper/0.5Hz36lbtension1amplitude.json"
    assert values["records"] == "RECORDS/damper"
    cfg.data.path = [str(tmp_path / "elsewhere.json")]
    with pytest.raises(ValueError, match="names a folder of this machine; say records=FOLDER"):
        entry_config(plain(cfg))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/home/me/record.csv", True),
        ("[/mnt/x/a.csv]", True),
        ("../shared/a.csv", True),
        ("~/data/a.csv", True),
        ("m/s²", False),
        ("stiffness of x1 / x2", False),
        ("RECORDS/frame/a.csv", False),
        ("C:\\data\\a.csv", True),
    ],
)
def test_what_is_a_folder_of_a_machine(text, told):
    assert bool(ABSOLUTE.search(text)) is told


def test_what_identified_nothing_or_is_no_run_is_not_published(run, tmp_path):
    with pytest.raises(ValueError, match="is not a finished run"):
        publish.publish(tmp_path, None, Licence(), root=tmp_path / "zoo")
    with pytest.raises(ValueError, match="expected MODEL/SYSTEM"):
        publish.publish(run, "linear", Licence(), root=tmp_path / "zoo")
    with pytest.raises(ValueError, match="expected MODEL/SYSTEM"):
        publish.publish(run, "../x/y", Licence(), root=tmp_path / "zoo")
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    metrics = json.loads((folder / "metrics.json").read_text())
    metrics["verdict"] = {"identified": False, "reason": "noise"}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    with pytest.raises(ValueError, match="identified nothing: noise"):
        publish.publish(folder, None, Licence(), root=tmp_path / "zoo")
    assert not entries(tmp_path / "zoo")


def test_the_page_is_that_of_the_index():
    assert publish.PAGE.read_text("utf-8") == publish.page_of(), "python -m models.zoo page"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("lst", "did you mean list?"),
        ("list size=3", "expected system=… model=…"),
        ("show", "give MODEL/SYSTEM"),
        ("show linear/bilinaer", "did you mean linear/bilinear"),
        ("verify linear/bilinear records=nowhere", "records=nowhere is no folder"),
        ("publish nowhere", "nowhere is not a finished run"),
        ("publish a b c", "c is one name too many"),
    ],
)
def test_a_mistyped_word_ends_in_one_line(words, told, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["zoo", *words.split()])
    with pytest.raises(SystemExit) as end:
        command.cli("help")
    assert end.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line
