"""Odd files: what `python -m data.inspect` says of each, and whether its config trains."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir

from data.inspect import __main__ as command_line
from runner.config.compose import CONF, prepare_hydra
from tests.data.odd_files import ODD, Odd
from tests.experiments import data_from, estimator_from


def inspected(odd: Odd, folder: Path, capsys) -> str:
    """What is printed of a file, whose config lies in mine/data/record.yaml then."""
    path = odd.write(folder)
    words = [str(path), *odd.words, "--config", str(folder / "mine" / "data" / "record.yaml")]
    with contextlib.suppress(SystemExit):
        command_line.main(words)
    said = capsys.readouterr()
    return said.out + said.err


def accepted(path: Path, odd: Odd) -> str:
    """The config with all its guesses taken, and what a person adds; the model it proposes."""
    text = path.read_text()
    model = re.search(r"model=(\w+)", text)
    assert model is not None
    lines = [re.sub(r"^    # (\w+:)", r"    \1", line) for line in text.splitlines()]
    config = yaml.safe_load("\n".join(lines))
    for key, value in odd.config.items():
        if key == "leave":
            kept = {c: w for c, w in config["data"]["channels"].items() if w != value}
            config["data"]["channels"] = kept
        elif key.startswith("mend."):
            config["data"].setdefault("mend", {})[key.removeprefix("mend.")] = value
        else:
            config["data"][key] = value
    path.write_text("# @package _global_\n" + yaml.safe_dump(config, sort_keys=False))
    return model[1]


def fitted(folder: Path, model: str, scenario: str) -> float:
    """Largest estimate of a model of the proposed config, identified in closed form."""
    prepare_hydra()
    words = [f"hydra.searchpath=[file://{folder / 'mine'}]", "data=record", f"model={model}"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", [*words, *([scenario] if scenario else [])])
    data = data_from(cfg)
    estimator = estimator_from(cfg.model, data)
    estimator.identify(data.train_dataloader())
    record = data.records["test"][0]
    with torch.no_grad():
        return float(estimator(record).abs().max())


@pytest.mark.parametrize("name", ODD)
def test_an_odd_file_is_understood_and_its_config_trains(name, tmp_path, capsys):
    odd = ODD[name]
    said = inspected(odd, tmp_path, capsys)
    for words in odd.says:
        assert words in said
    if odd.refused == "unread":
        return
    scenario = ""
    model = accepted(tmp_path / "mine" / "data" / "record.yaml", odd)
    if odd.refused:
        with pytest.raises(ValueError, match=odd.refused):
            fitted(tmp_path, model, scenario)
        return
    quick = model == "element_network"
    if quick and not {"x1", "v1"} <= set(re.findall(r"\w+(?==)", said)):
        scenario = "scenario=integrated"
    largest = fitted(tmp_path, "linear" if quick else model, scenario)
    assert 0.0 < largest < 1e6
