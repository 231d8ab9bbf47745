"""Hydra's config loader, for sweeps over seeds: what differs in its seed alone is composed once.

Composing a config takes Hydra longer than a VWNN takes to fit. Launchers ask the loader for the
config of every run, in whichever process runs it; each process keeps what it has composed.
"""

from __future__ import annotations

from copy import deepcopy

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from omegaconf import DictConfig, OmegaConf, open_dict

KEPT = 50  # configs
_composed: dict[tuple[str, ...], DictConfig] = {}  # of this process


class ComposedOnce(ConfigLoaderImpl):
    def shared(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """The config of a run, changed by the next call."""
        seed = [word for word in sweep_overrides if word.startswith("seed=")]
        if len(seed) != 1:
            return super().load_sweep_config(master_config, sweep_overrides)
        rest = [word for word in sweep_overrides if word not in seed]
        key = (*master_config.hydra.overrides.hydra, str(master_config.hydra.sweep.dir), *rest)
        if key not in _composed:
            if len(_composed) == KEPT:
                _composed.pop(next(iter(_composed)))
            _composed[key] = super().load_sweep_config(master_config, sweep_overrides)
        cfg = _composed[key]
        with open_dict(cfg):
            OmegaConf.update(cfg, "seed", int(seed[0].removeprefix("seed=")))
            cfg.hydra.overrides.task = sweep_overrides
        return cfg

    def load_sweep_config(
        self, master_config: DictConfig, sweep_overrides: list[str]
    ) -> DictConfig:
        """The config of a run, its own."""
        return deepcopy(self.shared(master_config, sweep_overrides))
