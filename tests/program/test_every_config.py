"""Every choice a person can type composes, instantiates, fits, and stands in the help."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import torch
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from data import Excitation
from models import Estimator
from models.fit.metrics import score
from runner.config.compose import CONF, EARLIER, GROUPS, composed, experiments, help_text
from runner.config.settings import check_settings
from tests.experiments import build, changed, data_from, estimator_from

ROOT = Path(__file__).parents[2]


NEED_MORE = {"given", "earthquake", "none"}  # a file, an extra, measured records
NEED_RECORDS = {
    "benchmarks",
    "bouc_wen_benchmark",
    "bouc_wen_stretches",
    "shake_table",
    "friction_damper",
    "earthquakes",
}  # experiments on them
PAPER = {"bilinear", "polynomial", "bouc_wen", "shear_frame", "single_oscillator"}
EARLIER_MODELS = {path.stem for path in (EARLIER / "model").glob("*.yaml")}


def choices(group: str) -> list[str]:
    paths = experiments() if group == "experiment" else (CONF / group).glob("*.yaml")
    return sorted(path.stem for path in paths)


def fits(*overrides: str) -> dict:
    """Errors of a model in closed form on short motions with these choices."""
    cfg = composed("data.duration=20", *overrides)
    for group, choice in (word.split("=") for word in overrides):
        assert group not in ("system", "scenario", "model") or cfg[group].name == choice
    data = data_from(cfg)
    data.setup()
    torch.manual_seed(0)
    estimator = estimator_from(cfg.model, data)
    estimator.identify(data.loader("train"))
    return score(estimator, data.loader("test"))


@pytest.mark.parametrize("system", sorted(set(choices("system")) - PAPER - {"measured"}))
def test_a_model_on_named_laws(system):
    """How well it does there is an open question; that it runs is not."""
    cfg = composed(f"system={system}")
    assert cfg.excitation.support.std == cfg.system.excitation.support_std
    errors = fits("model=vwnn", f"system={system}")
    assert errors["relative_rms_percent"] > 0.0


def test_named_laws_take_earthquakes():
    words = ("model=linear", "system=steel_frame", "data.duration=40")
    errors = fits(*words, "excitation=earthquake")
    assert 0.0 < errors["relative_rms_percent"] < 200.0


@pytest.mark.parametrize("scenario", choices("scenario"))
def test_every_scenario(scenario):
    errors = fits("model=vwnn_first_order", f"scenario={scenario}")
    assert 0.0 < errors["relative_rms_percent"] < 200.0


@pytest.mark.parametrize("excitation", sorted(set(choices("excitation")) - NEED_MORE))
def test_every_excitation(excitation):
    errors = fits("model=two_point", f"excitation={excitation}")
    assert 0.0 < errors["relative_rms_percent"] < 10.0


@pytest.mark.parametrize("law", choices("adaptation"))
def test_every_adaptation_law(law):
    errors = fits("model=online_linear", f"adaptation={law}")
    assert 0.0 < errors["relative_rms_percent"] < 200.0
    assert (errors["relative_rms_percent"] < 50.0) == (
        law in ("recursive_least_squares", "random_walk")
    )


def test_given_forces_drive_the_structure(tmp_path):
    rng = torch.Generator().manual_seed(0)
    force = torch.cumsum(torch.randn(8000, 3, generator=rng), 0) / 10.0
    path = tmp_path / "forces.csv"
    path.write_text("\n".join(",".join(f"{u:.6f}" for u in row) for row in force.tolist()))
    choices = ["excitation=given", f"excitation.force.path={path}", "model=two_point"]
    assert 0.0 < fits(*choices)["relative_rms_percent"] < 50.0


@pytest.mark.parametrize("experiment", choices("experiment"))
def test_every_experiment_is_of_settings_that_are_known_and_has_data(experiment):
    """Those on records name their folder, which need not be there."""
    of_records = experiment in ("shake_table", "friction_damper")
    cfg = composed(f"experiment={experiment}", *(["records=somewhere"] * of_records))
    check_settings(cfg)
    if experiment not in NEED_RECORDS:
        data_from(cfg)


@pytest.mark.parametrize("baselines", choices("baselines"))
def test_every_set_of_baselines_builds(baselines):
    cfg = composed(f"baselines={baselines}")
    data = data_from(cfg)
    for node in cfg.baselines.values():
        estimator_from(node, data)


@pytest.mark.parametrize("columns", [80, 120])
def test_help_describes_every_choice_and_is_as_wide_as_the_terminal(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    for program in ("evaluate", "predict"):
        assert max(map(len, help_text(program).splitlines())) <= columns
    lines = help_text("train").splitlines()
    assert max(map(len, lines)) <= columns
    assert "    vwnn                    (default)" in "\n".join(lines)
    for group in GROUPS:
        assert f"{group}=" in lines
        for choice in choices(group):
            described = [s for s in lines if re.fullmatch(rf" +{choice} +\S.*", s)]
            assert described, f"{group}={choice} has no line in the help"


def test_readme_and_docs_commands_compose():
    """Each line of a program with its overrides is one that Hydra accepts.

    All are parsed; composed are those with a key that no line before them had. A choice has a file.
    """
    seen, parser = set(), OverridesParser.create()
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for program, rest in re.findall(
            r"python (train|evaluate|predict)\.py([^\n`]*)",
            re.sub(r"\\\n\s*", "", page.read_text("utf-8")),  # lines that go on
        ):
            if "my_" in rest or "--config-dir" in rest:  # about files that the reader makes
                continue
            words = [w for w in shlex.split(rest, comments=True) if "=" in w]
            words = [w for w in words if not w.startswith(("hydra.", "hydra/"))]
            # a sweep's lists are tried by their first value
            words = [re.sub(r"=range\(.*", "=1", w) for w in words]
            words = [re.sub(r",(?![^\[{]*[\]}]).*", "", w) for w in words]
            parser.parse_overrides(words)
            pairs = [word.split("=", 1) for word in words]
            for group, choice in (pair for pair in pairs if pair[0] in GROUPS):
                assert choice in choices(group) or choice in EARLIER_MODELS, f"{group}={choice}"
            new = {(program, key) for key, _ in pairs} - seen
            if new:
                composed(*words, config=program)
            seen |= new
    assert len(seen) >= 5


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "data.simulation.excitation.np.load",
        "models.vwnn.__builtins__",
        "builtins.eval",
    ],
)
def test_a_config_can_only_build_classes_of_this_project(target):
    with pytest.raises(ValueError, match="_target_"):
        build(OmegaConf.create({"_target_": target}), Estimator)
    with pytest.raises(ValueError, match="_target_"):
        build(
            changed(composed(), {"excitation": {"force": {"_target_": target}}}).excitation,
            Excitation,
        )


def test_a_misspelt_argument_names_the_nearest():
    node = changed(composed(), {"model": {"name": "vwnn"}}).model.copy()
    OmegaConf.set_struct(node, False)
    node.cutof = 3.0
    with pytest.raises(ValueError, match="did you mean 'cutoff'"):
        build(node, Estimator, dofs=3, inputs=3, dt=0.01)
