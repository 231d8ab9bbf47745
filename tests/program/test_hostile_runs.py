"""Run folders and entries of the zoo that a stranger wrote, given to all commands that read them.

In small here; HOSTILE_EXAMPLES=5000 pytest tests/program/test_hostile_runs.py tries that many.
"""

from __future__ import annotations

import copy
import hashlib
import io
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hubconf
from data.sample import Sensors
from data.terminal import Terminal
from export.__main__ import main as export
from models import ElementNetwork
from models.checkpoint import load_estimator, save_estimator
from models.experiment import Model
from models.stored.schema import METRICS_KIND, SENSORS_KIND, require
from models.zoo.index import ROOT
from models.zoo.pretrained import load_pretrained
from models.zoo.table import list_pretrained
from report.collection.report import long_table
from report.collection.runs import collect
from report.describe import description
from report.describe.__main__ import main as describe
from report.page import write_page
from report.prediction.predict import predict
from report.run.building import draw_storeys, storeys_csv
from report.run.evaluation import evaluate
from report.uncertainty.storeys import has_storeys, print_drifts
from report.zoo import command, verify
from runner.config.choices import plain, take_settings
from runner.config.command_line import command_errors, one_line_errors
from runner.config.compose import composed
from runner.config.settings import Conditions, Wanted, Written
from runner.folder.run import load_run
from runner.job import job_errors
from runner.scores.result import STATUSES
from tests.experiments import estimator_from
from tests.hostile_files import (
    NODES,
    NUMBERS,
    TEXTS,
    Change,
    changes,
    places_of,
    require_lines,
    watched,
)
from tests.program.planted_runs import DT, forced, plant

EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "0"))
HOSTILE = settings(
    deadline=None, derandomize=not EXAMPLES, database=None, suppress_health_check=list(HealthCheck)
)
FILES = ("config.yaml", "metrics.json", "sensors.json", "model.safetensors")
SCORES = {"relative_rms_percent": 1.0, "per_dof_percent": [1.0] * 3, "per_dof_rms": [0.1] * 3}
BAND = {
    "method": "conformal", "records": 5, "factor": [2.0] * 3, "floor": [0.1] * 3, "memory_s": 1.0,
    "coverage_of_others": [0.9] * 5, "covered_percent": 95.0, "mean_half_width": 0.1,
    "mean_half_widths": [0.1] * 3,
}  # fmt: skip
INTERVAL = {
    "value": 400.0, "half": 1.0, "white": 1.0, "model_error": 3.0, "believed": 1.0, "unit": "N/m",
    "about": "x1–x2", "combined_with": ["r1.damping"],
}  # fmt: skip
STOREY = {
    "height": 3.2, "peak": 0.02, "residual": 0.001, "floor_acceleration": 3.0,
    "dissipated_energy": 900.0, "stiffness_left": 0.9,
}  # fmt: skip
HALVES = {f"{key}_half": 0.1 * value for key, value in STOREY.items() if key != "height"}
METRICS: dict[str, Any] = {  # beside those of a planted run
    "seed": 0,
    "quantity": "acceleration",
    **dict.fromkeys(("train", "test", "free_run_train", "free_run"), SCORES),
    "per_record": {"a": {"test": SCORES, "free_run": SCORES}},
    "baselines": {"linear": {"test": SCORES, "free_run": SCORES}},
    "verdict": {"identified": True, "reason": "", "by": "one step", "error_percent": 1.0},
    "identity": {"config": "a", "code": "b"},
    "parameters": 9,
    "simulation_error": 1e-7,
    "training": {"solver": "LBFGS", "iterations": 3, "prior": 0.1},
    "uncertainty": {
        "bands": BAND,
        "one_step_bands": BAND,
        "parameters": [
            {"name": "r1.stiffness", "status": "determined", **INTERVAL},
            {"name": "r2.yield_displacement", "status": "only in a combination", **INTERVAL},
            {"name": "x1.mass", "status": "given", **INTERVAL, "half": None, "truth": 1.0},
        ],
        "priors": [{"stated": "r1", "contradicted": True, "records_alone": 2.0, "fit": 1.0}],
        "criticism": [{"significant": True, "kind": "law", "name": "r1", "gain": 0.1}],
        "drifts": [{"record": "a", "element": f"r{e} x{e}", **STOREY, **HALVES} for e in (1, 2, 3)],
        "residual_peaks": [{"channel": 1, "times": 9.0, "frequency_hz": 2.0}],
        "noise": [0.1] * 3,
        "channel_weights": [1.0] * 3,
    },
}


def network(folder: Path) -> Path:
    words = ("model=element_network", "system=bilinear", "data.duration=2")
    return plant(folder, *forced(3), *words, **METRICS)


def black_box(folder: Path) -> Path:
    sensors, words = Sensors(DT, 3, 3, [1, 2, 3]), ("model=vwnn", "model.order=1")
    model = estimator_from(composed(*words).model, sensors)
    model.weights.data.fill_(0.0)  # type: ignore[union-attr, operator]
    return plant(folder, model, sensors, *words, "system=bilinear", "data.duration=2", **METRICS)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    return {"network": network(folder / "network"), "black_box": black_box(folder / "black_box")}


def _describe(run: Path) -> None:
    describe([f"run={run}"])


def _predict(run: Path) -> None:
    with one_line_errors("predict"), job_errors():
        predict(run, WANTED, WRITTEN, Path("predicted"))


def _evaluate(run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        evaluate(run, "again", EVALUATE)


def _score(run: Path) -> None:
    with one_line_errors("evaluate"), job_errors():
        evaluate(run, "again", SCORE)


def _export(run: Path) -> None:
    with command_errors():
        export([f"run={run}", "to=json", "output=exported"])


def _page(run: Path) -> None:
    with command_errors():
        write_page(run)


def _load(run: Path) -> None:
    with command_errors():
        load_run(run)


def _collect(run: Path) -> None:
    with command_errors():
        (result,) = collect([run.parent]) or (None,)
        if result is not None:
            assert result.status in STATUSES
            long_table([result])


WORDS = ("run=here", "figures=false", "threads=1")
PREDICT = plain(composed(*WORDS, "excitation.seed=5", "excitation.duration=1", config="predict"))
WANTED, WRITTEN = take_settings(Wanted, PREDICT["excitation"]), take_settings(Written, PREDICT)
SCORE = Conditions(scenario=None, seeds=None, data={}, figures=False)
EVALUATE = replace(SCORE, seeds=[5])
COMMANDS: dict[str, Callable[[Path], None]] = {
    "describe": _describe, "predict": _predict, "evaluate": _evaluate, "score": _score,
    "export": _export, "load": _load, "collect": _collect, "page": _page,
}  # fmt: skip


def try_command(act: Callable[[Path], None], work: Path, place: Path) -> None:
    """Raise AssertionError or the error itself where a command does not end as promised."""
    printed, error, status = io.StringIO(), io.StringIO(), 0
    with (
        watched(work, lambda: printed.getvalue() + error.getvalue()),
        redirect_stdout(printed),
        redirect_stderr(error),
    ):
        try:
            act(place)
        except SystemExit as end:
            status = int(end.code or 0)
    require_lines(status, error.getvalue(), printed.getvalue())


def try_run(run: Path, name: str, changed: list[tuple[str, Change]], sealed: bool) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        place = shutil.copytree(run, Path(temporary) / "run")
        for file, change in changed:
            if _small(place / file):
                change.apply(place / file)
        if sealed:
            seal_run(place)
        work = Path(temporary) / "work"
        work.mkdir()
        try_command(COMMANDS[name], work, place)


def _small(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and path.stat().st_size < 2**22


def seal_run(place: Path) -> None:
    """Let metrics.json name the digest of the weights that are there, where it can."""
    metrics, weights = place / "metrics.json", place / "model.safetensors"
    if _small(metrics) and _small(weights):
        try:
            content = json.loads(metrics.read_text("utf-8"))
            content["checkpoint"] = hashlib.sha256(weights.read_bytes()).hexdigest()
            metrics.write_text(json.dumps(content), "utf-8")
        except (ValueError, TypeError, RecursionError):
            pass


CHANGED = st.lists(
    st.sampled_from(FILES[:3] * 3 + FILES[3:]).flatmap(
        lambda name: st.tuples(st.just(name), changes(name))
    ),
    min_size=1,
    max_size=2,
)


@pytest.mark.filterwarnings("ignore")
@settings(HOSTILE, max_examples=EXAMPLES or 12)
@given(
    st.sampled_from(("network", "black_box")),
    st.sampled_from(tuple(COMMANDS)),
    CHANGED,
    st.booleans(),
)
def test_a_run_of_a_stranger_is_read_or_refused_in_one_line(runs, kind, name, changed, sealed):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(description, "save_figure", lambda *a: [])
        try_run(runs[kind], name, changed, sealed)


GONE = object()


@pytest.mark.parametrize(
    "value", [*NUMBERS, *TEXTS[:4], *NODES[:11], GONE], ids=lambda v: repr(v)[:20]
)
def test_drifts_of_a_stranger_are_shown_or_refused(value):
    """Wherever among the numbers of the storeys an odd value is, or one that is there is not."""
    drifts = METRICS["uncertainty"]["drifts"][:2]
    for place in range(len(places_of(drifts))):
        rows = copy.deepcopy(drifts)
        holder, key = places_of(rows)[place]
        if value is GONE:
            del holder[key]
        else:
            holder[key] = value
        content = {"model": "a", "system": "b", "scenario": "c", "uncertainty": {"drifts": rows}}
        try:
            require(content, METRICS_KIND)
        except ValueError:
            continue
        print_drifts(Terminal(width=80, file=io.StringIO()), {"drifts": rows})
        if has_storeys(rows):
            storeys_csv(rows)
            if holder is rows[0] and key in ("record", "height", "peak"):  # it takes a while
                draw_storeys(rows, SimpleNamespace(base=True, supports=0, sensors=[1, 3]))


@pytest.mark.parametrize("number", [torch.nan, torch.inf])
def test_weights_that_are_no_numbers_are_not_taken(number, tmp_path):
    """Whatever file they are in; a buffer that waits for a fit may hold what it begins with."""
    settings: Any = {"elements": "chain", "masses": [1.0, 1.0], "laws": ["Bilinear"]}
    fresh, model = (ElementNetwork(2, 1, DT, forced="base", **settings) for _ in range(2))
    path = tmp_path / "model.safetensors"
    save_estimator(model, path, "a")
    load_estimator(fresh, path, "a")
    model.noise_of_ground.fill_(number)  # type: ignore[union-attr, operator]
    save_estimator(model, path, "a")
    with pytest.raises(ValueError, match="noise_of_ground is not finite; repeat the run"):
        load_estimator(fresh, path, "a")


ENTRY = "linear/bilinear"
OF_ENTRY = (*FILES, "card.md", "golden.npz", "index.json")
LINKED = ("", "entry", "model")  # which folder is a link


def _list(root: Path) -> None:
    with command_errors():
        print(list_pretrained(root=root))


def _show(root: Path) -> None:
    with command_errors():
        command.show_card([ENTRY], root)


def _verify(root: Path) -> None:
    with command_errors():
        verify.verify([], root=root)


def _pretrained(root: Path) -> None:
    with command_errors():
        load_pretrained(ENTRY, root)


def _hub(root: Path) -> None:
    with pytest.MonkeyPatch.context() as patch, command_errors():
        patch.setattr(hubconf, "_CLONE", root.parent)
        hubconf._kinds()


OF_ZOO = {"list": _list, "show": _show, "verify": _verify, "load": _pretrained, "hub": _hub}


def facts_of(entry: Path) -> dict[str, Any]:
    """Digests and sizes of the files that are there."""
    files = [path for path in entry.iterdir() if _small(path)]
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    return {p.name: {"sha256": digests[p.name], "bytes": p.stat().st_size} for p in files}


def small_zoo(root: Path) -> dict[str, Any]:
    """A zoo of one entry; what its index says."""
    index: dict[str, Any] = json.loads((ROOT / "index.json").read_text("utf-8"))
    name = f"{ENTRY}.v1"
    shutil.copytree(ROOT / name, root / name)
    index["entries"] = {name: index["entries"][name]}
    (root / "index.json").write_text(json.dumps(index), "utf-8")
    return index


def try_zoo(name: str, file: str, change: Change, sealed: bool, linked: str) -> None:
    with tempfile.TemporaryDirectory() as temporary:
        root, work = Path(temporary) / "zoo", Path(temporary) / "work"
        work.mkdir()
        index = small_zoo(root)
        entry = root / f"{ENTRY}.v1"
        change.apply((root if file == "index.json" else entry) / file)
        if sealed and file != "index.json":
            index["entries"][f"{ENTRY}.v1"]["files"] = facts_of(entry)
            (root / "index.json").write_text(json.dumps(index), "utf-8")
        if linked:
            place = entry if linked == "entry" else entry.parent
            place.rename(Path(temporary) / "elsewhere")
            place.symlink_to(Path(temporary) / "elsewhere")
        try_command(OF_ZOO[name], work, root)


@pytest.mark.filterwarnings("ignore")
@settings(HOSTILE, max_examples=EXAMPLES or 12)
@given(
    st.sampled_from(tuple(OF_ZOO)),
    st.sampled_from((*OF_ENTRY, "index.json", "index.json")).flatmap(
        lambda name: st.tuples(st.just(name), changes(name))
    ),
    st.booleans(),
    st.sampled_from(LINKED + ("",) * 7),
)
def test_an_entry_of_a_stranger_is_read_or_refused_in_one_line(name, changed, sealed, linked):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verify, "_numbers", lambda *a: 0.0)
        try_zoo(name, *changed, sealed, linked)


def test_an_index_of_any_size_is_refused_unread(tmp_path):
    index = tmp_path / "index.json"
    with index.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(ValueError, match="is larger than"):
        list_pretrained(root=tmp_path)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"bytes": -1}, "bytes is -1"),
        ({"bytes": True}, "bytes is True"),
        ({"bytes": 1.5}, "bytes is 1.5"),
        ({"bytes": 2**40}, "expected 0 to"),
        ({"sha256": "x"}, "is no SHA-256"),
        ({"sha256": None}, "sha256 is None"),
    ],
)
def test_an_index_of_other_types_is_named(changed, said, tmp_path):
    index = small_zoo(tmp_path)
    index["entries"][f"{ENTRY}.v1"]["files"]["card.md"] |= changed
    (tmp_path / "index.json").write_text(json.dumps(index), "utf-8")
    with pytest.raises(ValueError, match="is damaged") as error:
        load_pretrained(ENTRY, tmp_path)
    assert said in str(error.value)


@pytest.mark.parametrize("name", ["..", "a/b", "sub", "../../x", "card.md/", "x.py"])
def test_an_entry_has_files_of_an_entry_alone(name, tmp_path):
    index = small_zoo(tmp_path)
    files = index["entries"][f"{ENTRY}.v1"]["files"]
    files[name] = files["card.md"]
    (tmp_path / "index.json").write_text(json.dumps(index), "utf-8")
    with pytest.raises(ValueError, match="is damaged"):
        load_pretrained(ENTRY, tmp_path)


def test_a_file_of_another_size_is_not_read(tmp_path):
    small_zoo(tmp_path)
    with (tmp_path / f"{ENTRY}.v1" / "golden.npz").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(ValueError, match=r"golden\.npz is not the published file: 1099511627776"):
        load_pretrained(ENTRY, tmp_path)


@pytest.mark.parametrize("place", ["linear", f"{ENTRY}.v1", f"{ENTRY}.v1/card.md", "index.json"])
def test_a_link_in_the_zoo_is_refused(place, tmp_path):
    root = tmp_path / "zoo"
    small_zoo(root)
    shutil.move(root / place, tmp_path / "elsewhere")
    (root / place).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ValueError, match=r"zoo"):
        load_pretrained(ENTRY, root)


def test_an_entry_s_config_stays_text(tmp_path, monkeypatch):
    monkeypatch.setenv("HOSTILE_SECRET", "told")
    index = small_zoo(tmp_path)
    config = tmp_path / f"{ENTRY}.v1" / "config.yaml"
    text = config.read_text("utf-8")
    assert "grid: null" in text
    config.write_text(text.replace("grid: null", "grid: ${oc.env:HOSTILE_SECRET}"), "utf-8")
    index["entries"][f"{ENTRY}.v1"]["files"] = facts_of(config.parent)
    (tmp_path / "index.json").write_text(json.dumps(index), "utf-8")
    assert load_pretrained(ENTRY, tmp_path).config["grid"] == "${oc.env:HOSTILE_SECRET}"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"quantity": "jerk"}, "quantity is 'jerk', expected acceleration"),
        ({"seed": -1}, "seed is -1, expected 0 to"),
        ({"trained_range": {"rate": {"unit": "", "names": ["a"], "largest": []}}},
         "trained_range.rate has 0 largest, 1 names: expected as many of each"),
        ({"trained_range": {"rate": {"unit": ""}}}, "trained_range.rate lacks names, largest"),
        ({"verdict": {"identified": False}}, "verdict lacks reason"),
        ({"uncertainty": {"parameters": [{"name": "a"}]}}, "lacks value, half, status"),
        ({"uncertainty": {"bands": {"method": "conformal"}}}, "lacks factor, floor, memory_s"),
        ({"per_record": {"a": {}}}, "per_record.a lacks test"),
        ({"records": {"a": 3}}, "records.a is 3, expected a list"),
        ({"benchmark": {"unit": "N"}}, "benchmark lacks noise_rms, published_rms"),
        ({"baselines": {"linear": {"test": 3}}}, "baselines.linear.test"),
    ],
)  # fmt: skip
def test_numbers_that_do_not_fit_together_are_named(changed, said):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        require({"model": "a", "system": "b", "scenario": "c", **changed}, METRICS_KIND)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"dt": 0}, "dt is 0, expected 1e-09 to"),
        ({"dt": 1e308}, "dt is 1e+308"),
        ({"dofs": 10**9}, "dofs is 1000000000, expected 1 to"),
        ({"inputs": -1}, "inputs is -1"),
        ({"forced": [4]}, "has forced=4, and its DOFs are 1 to 3"),
        ({"forced": "roof"}, "expected base"),
        ({"forced": [1, 1]}, "expected each once"),
        ({"channels": [""]}, "is empty"),
    ],
)
def test_sensors_that_do_not_fit_together_are_named(changed, said):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        require({"dt": 0.01, "dofs": 3, "inputs": 3, **changed}, SENSORS_KIND)
    assert said in str(error.value)


def test_a_force_may_act_where_there_is_no_sensor():
    require(
        {"dt": 0.01, "dofs": 2, "inputs": 3, "forced": [1, 2, 3], "channels": ["a1", "a3"]},
        SENSORS_KIND,
    )


def test_a_model_of_another_size_than_its_weights_is_not_built(runs, tmp_path, monkeypatch):
    """10 000 masses with elements between all pairs fill the memory."""
    folder = shutil.copytree(runs["network"], tmp_path / "run")
    sensors = json.loads((folder / "sensors.json").read_text("utf-8"))
    (folder / "sensors.json").write_text(json.dumps(sensors | {"dofs": 10_000, "forced": None}))
    monkeypatch.setattr(Model, "estimator", None)  # calling it would be another error
    with pytest.raises(ValueError, match="was stored with dofs=3; this model has dofs=10000"):
        load_run(folder)
