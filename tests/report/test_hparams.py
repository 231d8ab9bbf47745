"""TensorBoard's HParams tab: every choice that is swept, the numbers named as in the long table."""

from __future__ import annotations

from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams import metadata

from report.collection.report import long_table
from report.collection.runs import collect
from report.collection.scores import scores_of
from tests.program.test_train import QUICK, finished_run


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
