"""Hydra's config loader, for sweeps over seeds: what differs in its seed alone is composed once.

Composing a config takes Hydra longer than a VWNN takes to fit. Launchers ask the loader for the
config of every run, in whichever process runs it; each process keeps what it has composed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from omegaconf import DictConfig, OmegaConf, open_dict

from runner.config.identity import run_name
from runner.seeds import SeedsOf

KEPT = 50  # configs
OWN_NAME = "${run_name:}"  # hydra.sweep.subdir, unless somebody chose another


@dataclass
class Composed:
    cfg: DictConfig

    @cached_property
    def seeds(self) -> SeedsOf:
        return SeedsOf(self.cfg)

    @cached_property
    def usual(self) -> bool:
        """Whether folders are named as usual, and differ in nothing but the seed."""
        return _has_own_name(self.cfg) and self.seeds.alone


def _has_own_name(cfg: DictConfig) -> bool:
    """Whether the folder of a run is named after its choices, as nobody chose another name."""
    raw = OmegaConf.to_container(cfg.hydra.sweep, resolve=False)
    assert isinstance(raw, dict)
    return bool(raw["subdir"] == OWN_NAME)


_composed: dict[tuple[str, ...], Composed] = {}  # of this process


def seed_of(overrides: Sequence[str]) -> tuple[int | None, list[str]]:
    """The seed, if a whole number is given, and the other words."""
    seeds = [word for word in overrides if re.fullmatch(r"seed=(0|[1-9][0-9]{0,17})", word)]
    number = int(seeds[0].removeprefix("seed=")) if len(seeds) == 1 else None
    return number, [word for word in overrides if word not in seeds]


class ComposedOnce(ConfigLoaderImpl):
    def _composed(self, master_config: DictConfig, overrides: list[str]) -> DictConfig:
        str(master_config.hydra.sweep.dir)  # resolved now: what is composed takes it over
        return super().load_sweep_config(master_config, overrides)

    def _kept(self, master_config: DictConfig, overrides: list[str], rest: list[str]) -> Composed:
        key = (*master_config.hydra.overrides.hydra, str(master_config.hydra.sweep.dir), *rest)
        if key not in _composed:
            if len(_composed) == KEPT:
                _composed.pop(next(iter(_composed)))
            _composed[key] = Composed(self._composed(master_config, overrides))
        return _composed[key]

    def _shared(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """The config of a run, changed by the next call."""
        seed, rest = seed_of(sweep_overrides)
        cfg = None if seed is None else self._kept(master_config, sweep_overrides, rest).cfg
        if cfg is None or not _has_own_name(cfg):  # another name may hold any of Hydra's values
            return self._composed(master_config, sweep_overrides)
        with open_dict(cfg):
            OmegaConf.update(cfg, "seed", seed)
            cfg.hydra.overrides.task = sweep_overrides
        return cfg

    def place(self, master_config: DictConfig, sweep_overrides: list[str]) -> tuple[Path, str]:
        """The folder of a run, and the name that follows from the run's choices."""
        seed, rest = seed_of(sweep_overrides)
        if seed is not None:
            kept = self._kept(master_config, sweep_overrides, rest)
            if kept.usual:
                name = kept.seeds.name(seed)
                return Path(kept.cfg.hydra.sweep.dir) / name, name
        cfg = self._shared(master_config, sweep_overrides)
        folder = Path(cfg.hydra.sweep.dir) / cfg.hydra.sweep.subdir
        return folder, folder.name if _has_own_name(cfg) else run_name(cfg)

    def folder(self, master_config: DictConfig, sweep_overrides: list[str]) -> Path:
        """The folder of a run."""
        return self.place(master_config, sweep_overrides)[0]

    def load_sweep_config(
        self, master_config: DictConfig, sweep_overrides: list[str]
    ) -> DictConfig:
        """The config of a run, its own."""
        return deepcopy(self._shared(master_config, sweep_overrides))
