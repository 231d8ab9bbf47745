"""A search: judged on held-back motion alone, over seeds; resumed after a kill."""

from __future__ import annotations

import json
import math
from pathlib import Path
from statistics import median

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.plugins import Plugins
from omegaconf import open_dict
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

import train
from data.whole_file import write_text
from models.fit.metrics import score
from models.stored.run import read_run
from runner.config.choices import plain
from runner.config.compose import CONF, placed, prepare_hydra
from runner.config.identity import identity_of
from runner.folder.run_folder import config_text, write_failure
from runner.scores.outcome import validation_error
from runner.search import distribution
from tests.program.test_train import run
from tests.runner import test_sweep

QUICK = [*test_sweep.QUICK, "data.duration=10"]  # a fifth of which is held back
HELD = ["data.validation=0.2", "data.warmup=50"]
LAUNCHER = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
BEST = 80.0  # rad/s, of the planted error
SEARCH = ["-m", "experiment=tune_vwnn", "hydra/launcher=basic", "system=bilinear"]


def test_a_run_scores_what_it_held_back_and_its_fit_has_not_seen_it(tmp_path, monkeypatch):
    words = [*QUICK, *HELD, "model=linear", f"hydra.run.dir={tmp_path}"]
    assert run(train, monkeypatch, *words) == 0
    stored = read_run(tmp_path)
    metrics, data = stored.metrics, stored.experiment.make_data()
    data.setup()
    (held_back,) = data.records["validation"]
    fitted = stored.experiment.model.estimator(data)
    fitted.identify([data.loader("train").collate_fn([record]) for record in data.windows("train")])
    assert data.records["train"][0].samples == held_back.warmup < held_back.samples == 1000
    powers = held_back.a.square().sum(dim=-1)
    assert float(powers[held_back.warmup :].sum() / powers.sum()) == pytest.approx(0.2, rel=0.02)
    assert metrics["validation"] == score(fitted, data.loader("validation"))
    assert validation_error(metrics) == metrics["validation"]["relative_rms_percent"]


def test_a_run_without_validation_cannot_be_judged():
    with pytest.raises(ValueError, match=r"data\.validation=0\.2"):
        validation_error({"test": {"relative_rms_percent": 1.0}})
    assert validation_error({"validation": {"relative_rms_percent": None}}) == math.inf


def test_hydras_words_are_optunas_distributions():
    parser = OverridesParser.create()
    for text, expected in {
        "a=interval(5,314)": FloatDistribution(5.0, 314.0),
        "a=tag(log,interval(1e-3,10))": FloatDistribution(1e-3, 10.0, log=True),
        "a=range(1,4)": IntDistribution(1, 3),
        "a=choice([15],[10,10])": CategoricalDistribution(["[15]", "[10,10]"]),
    }.items():
        assert distribution(parser.parse_override(text)) == expected
    with pytest.raises(ValueError, match="a=5: what is tuned is an interval"):
        distribution(parser.parse_override("a=5"))


class Planted:
    """Instead of runs: an error with one minimum, at BEST; one seed of three escapes."""

    def __init__(self, monkeypatch, killed_after: float = math.inf, lost: int = 0) -> None:
        """Killed after some runs; or one of them lost: the first is 1."""
        self.launched: list[Path] = []
        self.killed_after, self.lost = killed_after, lost
        launcher = Plugins.instance().class_name_to_class[LAUNCHER]

        def launch(own, jobs, initial_job_idx):
            self(own, jobs)
            return []

        monkeypatch.setattr(launcher, "launch", launch)

    def __call__(self, launcher, jobs) -> None:
        loader = launcher.hydra_context.config_loader
        for job in jobs:
            cfg = loader.load_sweep_config(launcher.config, list(job))
            folder = Path(cfg.hydra.sweep.dir) / cfg.hydra.sweep.subdir
            with open_dict(cfg):
                del cfg["hydra"]  # a run does not see it
            if len(self.launched) >= self.killed_after:
                raise KeyboardInterrupt
            self.launched.append(folder)
            folder.mkdir(parents=True, exist_ok=True)
            if len(self.launched) == self.lost:
                write_failure(folder, None, "No space left on device", "", False)
                continue
            if cfg.seed == 82:
                write_failure(folder, None, "the motion escaped", "", True)
                continue
            error = 3.0 + math.log(cfg.model.cutoff / BEST) ** 2 + 0.1 * (cfg.seed - 80)
            scores = {"relative_rms_percent": error}
            names = {"model": "vwnn", "system": "bilinear", "scenario": "full_state"}
            content = {**names, "train": scores, "test": scores}
            content["identity"] = identity_of(plain(cfg))
            write_text(folder / "config.yaml", config_text(plain(cfg)))
            held = {"validation": scores} if cfg.data.validation else {}
            (folder / "metrics.json").write_text(json.dumps({**content, **held}))


def search(folder: Path, monkeypatch, *words: str) -> int:
    return run(train, monkeypatch, *SEARCH, f"hydra.sweep.dir={folder}", *words)


def found(folder: Path) -> dict:
    (told,) = json.loads((folder / "search.json").read_text()).values()
    return told


def test_a_search_finds_the_planted_optimum_over_seeds_one_of_which_fails(
    tmp_path, monkeypatch, capsys
):
    planted = Planted(monkeypatch)
    words = ("hydra.sweeper.trials=11", "hydra.sweeper.final.seed='60,61'")
    fixed = ("model.stages=2", "model.order=2", "model.ridge=0.0", "model.sigmoid_weight=0.05")
    assert search(tmp_path, monkeypatch, *words, *fixed) == 0
    told = found(tmp_path)
    assert len(told["trials"]) == 11
    assert told["trials"][0]["settings"]["model.cutoff"] == 50.0  # the config's own
    first = math.log(50.0 / BEST) ** 2
    assert told["first_percent"] == pytest.approx(median([3.0 + first, 3.1 + first, math.inf]))
    assert abs(math.log(told["best"]["model.cutoff"] / BEST)) < 0.2
    assert told["best_percent"] == min(t["percent"] for t in told["trials"])
    final = [path for path in planted.launched if int(path.name.split("-")[3][4:]) < 80]
    assert {path.name for path in final} == {*told["final"]["configured"], *told["final"]["tuned"]}
    assert len(final) == 4
    assert "4 done, 0 failed" in capsys.readouterr().out


def test_a_killed_search_ends_like_an_undisturbed_one(tmp_path, monkeypatch):
    undisturbed = Planted(monkeypatch)
    words = ("hydra.sweeper.trials=2", "hydra.sweeper.final.seed=60")
    assert search(tmp_path / "undisturbed", monkeypatch, *words) == 0
    total = len(undisturbed.launched)
    Planted(monkeypatch, killed_after=4)
    assert search(tmp_path / "disturbed", monkeypatch, *words) == 130
    rest = Planted(monkeypatch)
    assert search(tmp_path / "disturbed", monkeypatch, *words) == 0
    assert len(rest.launched) == total - 4  # nothing twice
    assert found(tmp_path / "disturbed") == found(tmp_path / "undisturbed")
    again = Planted(monkeypatch)
    assert search(tmp_path / "disturbed", monkeypatch, *words) == 0
    assert again.launched == []


def test_a_setting_is_not_judged_by_a_run_that_was_lost(tmp_path, monkeypatch, capsys):
    Planted(monkeypatch, lost=2)
    words = ("hydra.sweeper.trials=2", "hydra.sweeper.final.seed=60")
    assert search(tmp_path, monkeypatch, *words) == 1
    assert "1 runs of the search were lost; repeat the command" in capsys.readouterr().err
    again = Planted(monkeypatch)
    assert search(tmp_path, monkeypatch, *words) == 0
    assert [path.name.split("-")[3] for path in again.launched[:2]] == ["seed81", "seed80"]
    assert len(found(tmp_path)["trials"]) == 2


def test_a_search_and_the_tables_share_no_seed():
    prepare_hydra()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", placed(["experiment=tune_vwnn"]), return_hydra_config=True)
    sweeper = cfg.hydra.sweeper
    parser = OverridesParser.create()

    def seeds(text: str) -> set[int]:
        return {int(s) for s in parser.parse_override(f"seed={text}").sweep_string_iterator()}

    searched, final = seeds(sweeper.params.seed), seeds(sweeper.final.seed)
    tables = {*range(20, 48)}  # of the study and the leaderboard
    assert not searched & final
    assert not (searched | final) & tables
    assert cfg.data.validation > 0.0
    assert cfg.data.warmup > 0
    assert float(sweeper.final["data.validation"]) == 0.0
