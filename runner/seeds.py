"""Runs that differ in their seed alone: name, identity and config file of each from one config.

Resolving and writing a config takes longer than a VWNN takes to fit, so it is done once for all.
"""

from __future__ import annotations

import re
from copy import deepcopy
from functools import cached_property
from typing import Any

from omegaconf import DictConfig, OmegaConf

from runner.config.choices import plain
from runner.config.identity import choices_text, digest, identity_of, name_of
from runner.folder.run_folder import config_text

APART = 8123456789012345678  # a seed that stands nowhere else in a config


class SeedsOf:
    """What follows from a config for any seed, where nothing else in it depends on the seed."""

    def __init__(self, cfg: DictConfig) -> None:
        other = deepcopy(cfg)
        OmegaConf.update(other, "seed", cfg.seed + 1)
        self.content, changed = plain(cfg), plain(other)
        self.alone = {**changed, "seed": cfg.seed} == self.content
        self._text = ""

    @cached_property
    def _around(self) -> tuple[str, str]:
        """What `choices_text` has before and after the seed."""
        before, after = choices_text(self.values(APART)).split(f'"seed": {APART}')
        return f'{before}"seed": ', after

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

    def text(self, seed: int) -> str:
        """The content of config.yaml."""
        self._text = self._text or config_text(self.content)
        return re.sub(r"^seed: .*$", f"seed: {seed}", self._text, count=1, flags=re.MULTILINE)
