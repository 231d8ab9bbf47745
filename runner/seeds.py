"""Runs that differ in their seed alone: name, identity and config file of each from one config.

Resolving and writing a config takes longer than a VWNN takes to fit, so it is done once for all.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from omegaconf import DictConfig, OmegaConf, open_dict

from runner.config.choices import plain
from runner.config.identity import choices_text, digest, identity_of, name_of, run_name
from runner.folder.run_folder import config_text

APART = "<seed>"  # in place of a seed: it stands nowhere else in a config


class SeedsOf:
    """What follows from a config for any seed, where nothing else in it depends on the seed."""

    def __init__(self, cfg: DictConfig) -> None:
        self.cfg = cfg

    @cached_property
    def content(self) -> dict[str, Any]:
        """The resolved values."""
        return plain(self.cfg)

    @cached_property
    def alone(self) -> bool:
        """Whether nothing but the seed depends on the seed."""
        other = deepcopy(self.cfg)
        OmegaConf.update(other, "seed", self.cfg.seed + 1)
        return {**plain(other), "seed": self.cfg.seed} == self.content

    @cached_property
    def usual(self) -> bool:
        """Whether folders are named as usual, and differ in nothing but the seed."""
        return _has_own_name(self.cfg) and self.alone

    @cached_property
    def _around(self) -> tuple[str, str]:
        """What `choices_text` has before and after the seed."""
        before, after = choices_text({**self.content, "seed": APART}).split(f'"{APART}"')
        return before, after

    def values(self, seed: int) -> dict[str, Any]:
        """The resolved values for a seed."""
        return {**self.content, "seed": seed}

    def name(self, seed: int) -> str:
        return name_of(self.values(seed), self._digest(seed))

    def identity(self, seed: int) -> dict[str, Any]:
        """As `identity_of` of the values."""
        return identity_of(self.content, self._digest(seed))

    def _digest(self, seed: int) -> str:
        return digest(str(seed).join(self._around))

    @cached_property
    def _text(self) -> str:
        return config_text(self.content)

    def text(self, seed: int) -> str:
        """The content of config.yaml."""
        return re.sub(r"^seed: .*$", f"seed: {seed}", self._text, count=1, flags=re.MULTILINE)


# Hydra's config loader, for sweeps over seeds: what differs in its seed alone is composed once.
#
# Composing a config takes Hydra longer than a VWNN takes to fit. Launchers ask the loader for the
# config of every run, in whichever process runs it; each process keeps what it has composed.

KEPT = 500  # configs
OWN_NAME = "${run_name:}"  # hydra.sweep.subdir, unless somebody chose another


def _has_own_name(cfg: DictConfig) -> bool:
    """Whether the folder of a run is named after its choices, as nobody chose another name."""
    raw = OmegaConf.to_container(cfg.hydra.sweep, resolve=False)
    assert isinstance(raw, dict)
    return bool(raw["subdir"] == OWN_NAME)


_composed: dict[tuple[str, ...], SeedsOf] = {}  # of this process


def seed_of(overrides: Sequence[str]) -> tuple[int | None, list[str]]:
    """The seed, if a whole number is given, and the other words."""
    seeds = [word for word in overrides if re.fullmatch(r"seed=(0|[1-9][0-9]{0,17})", word)]
    number = int(seeds[0].removeprefix("seed=")) if len(seeds) == 1 else None
    return number, [word for word in overrides if word not in seeds]


_bases: dict[tuple[str, ...], DictConfig] = {}  # of this process: choices without values
T = TypeVar("T")


def _kept(known: dict[tuple[str, ...], T], key: tuple[str, ...], make: Callable[[], T]) -> T:
    """What is known under a key, made where it is not; the oldest of too many goes."""
    if key not in known:
        if len(known) == KEPT:
            known.pop(next(iter(known)))
        known[key] = make()
    return known[key]


class ComposedOnce(ConfigLoaderImpl):
    def _composed(self, master_config: DictConfig, overrides: list[str]) -> DictConfig:
        """Files are read for what is chosen of them; the values of settings are set in a copy."""
        str(master_config.hydra.sweep.dir)  # resolved now: what is composed takes it over
        parsed = OverridesParser.create().parse_overrides(overrides)
        values = [word for word in parsed if self._is_value(word)]
        chosen = [str(word.input_line) for word in parsed if word not in values]
        key = (*master_config.hydra.overrides.hydra, str(master_config.hydra.sweep.dir), *chosen)
        load = super().load_sweep_config
        base = _kept(_bases, key, lambda: load(master_config, chosen))
        if not _has_own_name(base):  # another name may hold any of Hydra's values
            return load(master_config, overrides)
        cfg = deepcopy(base)
        self._apply_overrides_to_config(values, cfg)
        cfg.hydra.overrides.task = overrides
        return cfg

    def _is_value(self, word: Override) -> bool:
        """Whether a word changes, adds or deletes a setting that is no group of files."""
        own = word.package is None and not word.is_hydra_override()
        return own and not self.repository.group_exists(word.key_or_group)

    def kept(self, master_config: DictConfig, overrides: list[str], rest: list[str]) -> SeedsOf:
        """What runs that differ in their seed have in common; rest: the words without it."""
        key = (*master_config.hydra.overrides.hydra, str(master_config.hydra.sweep.dir), *rest)
        return _kept(_composed, key, lambda: SeedsOf(self._composed(master_config, overrides)))

    def _shared(self, master_config: DictConfig, sweep_overrides: list[str]) -> DictConfig:
        """The config of a run, changed by the next call."""
        seed, rest = seed_of(sweep_overrides)
        cfg = None if seed is None else self.kept(master_config, sweep_overrides, rest).cfg
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
            kept = self.kept(master_config, sweep_overrides, rest)
            if kept.usual:
                name = kept.name(seed)
                return Path(kept.cfg.hydra.sweep.dir) / name, name
        cfg = self._shared(master_config, sweep_overrides)
        folder = Path(cfg.hydra.sweep.dir) / cfg.hydra.sweep.subdir
        return folder, folder.name if _has_own_name(cfg) else run_name(cfg)

    def load_sweep_config(
        self, master_config: DictConfig, sweep_overrides: list[str]
    ) -> DictConfig:
        """The config of a run, its own."""
        return deepcopy(self._shared(master_config, sweep_overrides))
