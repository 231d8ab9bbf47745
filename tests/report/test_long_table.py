"""Any collection of runs → one long table: nothing left out, nothing twice, the same read back."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from omegaconf import OmegaConf
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams import metadata

import evaluate
from report.collection.report import long_table, write_long
from report.collection.runs import collect, folders_of
from runner.config.choices import dotted, plain, read_choices
from runner.config.compose import composed
from runner.scores.numbers import scores_of
from tests.program.test_docs import ROOT, blocks
from tests.program.test_train import QUICK, finished_run, run
from tests.report.free_run_runs import LOST, add_run

IDENTITY = ["model", "system", "scenario", "seed"]


def table_of(*folders: Path) -> pd.DataFrame:
    return long_table(collect(list(folders))).to_pandas()


def add_unfinished(folder: Path, seed: int = 7) -> Path:
    path = add_run(folder, 1.0, seed=seed)
    (path / "metrics.json").unlink()
    return path


def add_damaged(folder: Path, seed: int = 8) -> Path:
    path = add_run(folder, 1.0, seed=seed)
    (path / "metrics.json").write_text('{"model": "lin')
    return path


def test_a_row_is_a_run_a_split_and_a_metric(tmp_path):
    path = add_run(tmp_path, 12.5, seed=3)
    metrics = json.loads((path / "metrics.json").read_text())
    metrics["test"] |= {"own_residual": {"relative_rms_percent": 30.0}}
    metrics["test"]["per_dof_percent"] = [3.0, 4.0]
    (path / "metrics.json").write_text(json.dumps(metrics))
    table = table_of(tmp_path)
    keys = ["split", "estimate", "metric", "dof"]
    assert not table.duplicated(keys).any()
    page = (ROOT / "docs/compare.md").read_text("utf-8")
    assert [name for name in table if f"`{name}`" not in page] == []
    values = {tuple(key): value for *key, value in table[[*keys, "value"]].fillna(0).to_numpy()}
    assert values["free_run", "", "relative_rms_percent", 0] == 12.5
    assert values["free_run", "", "displacement_percent", 0] == 25.0
    assert values["test", "", "per_dof_percent", 2] == 4.0
    assert values["test", "own_residual", "relative_rms_percent", 0] == 30.0
    assert values["", "", "fit_seconds", 0] == 0.5
    assert table[IDENTITY].drop_duplicates().to_numpy().tolist() == [
        ["linear", "bilinear", "full_state", 3]
    ]


def test_runs_without_numbers_are_listed_with_their_reasons(tmp_path):
    add_run(tmp_path, 1.0, seed=0)
    add_run(tmp_path, LOST, failed=True, seed=1)
    add_unfinished(tmp_path, seed=2)
    add_damaged(tmp_path, seed=3)
    table = table_of(tmp_path)
    bad = table[table.status != "finished"].sort_values("run")
    assert bad.status.tolist() == ["failed", "unfinished", "damaged"]
    assert bad.reason.iloc[0] == "the solver failed"
    assert "metrics.json" in bad.reason.iloc[1]
    assert "repeat the run" in bad.reason.iloc[2]
    assert bad.metric.tolist() == ["", "", ""]
    assert bad.value.isna().all()
    assert bad.seed.tolist()[:2] == [1, 2]


def test_the_files_hold_what_the_table_holds(tmp_path):
    add_run(tmp_path, 1.0 / 3.0, seed=0, cutoff=0.1)
    add_run(tmp_path, LOST, seed=1, cutoff=0.2)
    add_run(tmp_path, LOST, failed=True, seed=2)
    table = table_of(tmp_path)
    parquet, text = write_long(long_table(collect([tmp_path])), tmp_path / "out")
    pd.testing.assert_frame_equal(pd.read_parquet(parquet), table)
    again = pd.read_csv(text, keep_default_na=False, na_values={"dof": [""], "value": ["nan"]})
    assert again.value.tolist() == pytest.approx(table.value.tolist(), nan_ok=True, rel=1e-15)
    assert again.metric.tolist() == table.metric.tolist()
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "results.parquet",
        "results.csv",
    }


@pytest.mark.parametrize("model", ["vwnn", "element_network", "online_vwnn"])
def test_choices_are_read_as_hydra_wrote_them(model, tmp_path):
    """The fast reader cuts a config into blocks; OmegaConf reads the whole."""
    cfg = composed(f"model={model}", "scenario=noisy", "data.tolerance=1e-7", "+note='a: b\n c'")
    path = tmp_path / "config.yaml"
    path.write_text(OmegaConf.to_yaml(cfg, resolve=True))
    assert read_choices(path) == dotted(plain(cfg))


def test_a_list_a_pattern_and_a_folder_name_the_same_runs_once(tmp_path):
    for sweep in ("a", "b", "deep/c"):
        (tmp_path / sweep).mkdir(parents=True)
        add_run(tmp_path / sweep, 1.0)
    (tmp_path / "a" / "note.txt").write_text("no folder")
    found = {
        "all": folders_of(str(tmp_path)),
        "pattern": folders_of(f"{tmp_path}/*/"),
        "nested": folders_of(f"{tmp_path}/**"),
        "list": folders_of([f"{tmp_path}/a", f"{tmp_path}/*", f"{tmp_path}/deep"]),
    }
    assert {name: len(collect(folders)) for name, folders in found.items()} == {
        "all": 3,
        "pattern": 3,
        "nested": 3,
        "list": 3,
    }
    assert len(collect(folders_of([f"{tmp_path}/a", f"{tmp_path}/b"]))) == 2
    with pytest.raises(ValueError, match="there is no folder"):
        folders_of([f"{tmp_path}/a", f"{tmp_path}/z"])
    with pytest.raises(ValueError, match="no folder matches"):
        folders_of(f"{tmp_path}/z*")
    with pytest.raises(ValueError, match="no runs in"):
        collect([tmp_path / "deep" / "c" / "nothing"])


def test_evaluate_writes_it_and_counts_what_is_missing(tmp_path, monkeypatch, capsys):
    for sweep in ("a", "b"):
        (tmp_path / sweep).mkdir()
    add_run(tmp_path / "a", 10.0, seed=0)
    add_run(tmp_path / "b", LOST, failed=True, seed=1)
    add_unfinished(tmp_path / "b", seed=2)
    words = [f"runs=[{tmp_path}/a,{tmp_path}/b]", f"output={tmp_path / 'out'}"]
    assert run(evaluate, monkeypatch, *words) == 0
    out = capsys.readouterr().out
    assert "3 runs: 1 finished, 1 failed, 1 unfinished" in out
    assert "the solver failed" in out
    table = pd.read_parquet(tmp_path / "out" / "results.parquet")
    assert table.groupby("run").status.first().value_counts().to_dict() == {
        "finished": 1,
        "failed": 1,
        "unfinished": 1,
    }


def test_the_example_of_the_docs_reads_the_table(tmp_path, monkeypatch, capsys):
    (example,) = blocks(ROOT / "docs" / "compare.md", "python")
    for seed, cutoff in enumerate((20.0, 50.0)):
        add_run(tmp_path / "runs" / "cutoffs", 5.0, seed=seed, cutoff=cutoff)
    monkeypatch.chdir(tmp_path)
    write_long(long_table(collect([Path("runs/cutoffs")])), Path("runs/cutoffs/results"))
    exec(compile(example, "compare.md", "exec"), {})
    printed = capsys.readouterr().out
    assert "bilinear 20.0              1     3.0  3.0" in printed
    assert "finished    2" in printed


# --- TensorBoard's HParams tab: every choice that is swept, the numbers named as in the table


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    words = [*QUICK, "model=residual_mlp", "solver.iterations=3", "baselines=none", "figures=false"]
    return finished_run(tmp_path_factory.mktemp("runs") / "network", *words)


def events_of(folder: Path) -> list[EventAccumulator]:
    places = {path.parent for path in folder.rglob("events.*")}
    return [EventAccumulator(str(place)).Reload() for place in places]


def test_the_plugin_has_the_choices_by_their_dotted_names(finished):
    found = {}
    for events in events_of(finished):
        for tag, content in events.summary_metadata.items():
            if tag == metadata.SESSION_START_INFO_TAG:
                started = metadata.parse_session_start_info_plugin_data(content.plugin_data.content)
                found = dict(started.hparams)
    assert found["model"].string_value == "residual_mlp"
    assert found["model.hidden"].string_value == "[15]"
    assert found["solver.iterations"].number_value == 3
    assert found["data.duration"].number_value == 10
    assert found["model.ridge"].number_value == 0.0
    assert found["seed"].number_value == 0
    assert found["system"].string_value == "bilinear"
    assert not [name for name in found if name.startswith("system.")]


def test_the_columns_begin_with_model_scenario_seed_and_system(finished):
    """TensorBoard sorts by name those that differ, then the others."""
    (content,) = (
        events.summary_metadata[metadata.EXPERIMENT_TAG].plugin_data.content
        for events in events_of(finished)
        if metadata.EXPERIMENT_TAG in events.summary_metadata
    )
    columns = metadata.parse_experiment_plugin_data(content).hparam_infos
    assert [one.name for one in columns][:4] == ["model", "system", "scenario", "seed"]
    assert {one.name for one in columns if one.differs} == {"model", "system", "scenario", "seed"}


def test_the_numbers_have_the_names_and_values_of_the_long_table(finished):
    (of_run,) = collect([finished])
    logged: dict[str, float] = {}
    for events in events_of(finished):
        logged |= {tag: events.Scalars(tag)[-1].value for tag in events.Tags()["scalars"]}
    expected = {score.name: score.value for score in scores_of(of_run.metrics)}
    assert len(expected) == long_table([of_run]).num_rows
    assert {"test/own_residual/relative_rms_percent", "free_run/per_dof_percent/x3"} <= set(
        expected
    )
    assert {name: logged[name] for name in expected} == pytest.approx(expected, rel=1e-6)
