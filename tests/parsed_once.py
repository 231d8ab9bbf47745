"""The same text of a config or a command line is parsed once: tests compose a thousand configs.

Parsing takes a third of the time of composing. What it returns depends on the text alone. Words
that a test composes by `composed` are composed once; every caller gets a copy of its own.
"""

from __future__ import annotations

import copy
from functools import cache
from types import SimpleNamespace
from typing import Any

import omegaconf._utils
import omegaconf.base
import omegaconf.omegaconf
import yaml
from hydra import compose
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf.grammar_parser import parse

from runner.config import compose as composing

_of_yaml: dict[str, Any] = {}
_of_words: dict[tuple[str, str], Any] = {}
_of_choices: dict[tuple[str, ...], Any] = {}
_parse_rule = OverridesParser.parse_rule


def _load(stream: Any, **loader: Any) -> Any:
    text = stream if isinstance(stream, str) else stream.read()
    if text not in _of_yaml:
        _of_yaml[text] = yaml.load(text, **loader)  # as OmegaConf names it
    return _of_yaml[text]


def _parse_word(parser: OverridesParser, word: str, rule: str) -> Any:
    if (word, rule) not in _of_words:
        _of_words[word, rule] = _parse_rule(parser, word, rule)
    return copy.copy(_of_words[word, rule])


def _compose(config: str, words: list[str], return_hydra_config: bool) -> Any:
    if (key := (str(return_hydra_config), config, *words)) not in _of_choices:
        _of_choices[key] = compose(config, words, return_hydra_config)
    return copy.deepcopy(_of_choices[key])


def remember() -> None:
    """From here on, in this process."""
    interpolation = cache(parse)
    omegaconf.base.parse = omegaconf._utils.parse = interpolation
    omegaconf._utils.get_yaml_loader = cache(omegaconf._utils.get_yaml_loader)
    omegaconf.omegaconf.yaml = SimpleNamespace(**{**vars(yaml), "load": _load})
    OverridesParser.parse_rule = _parse_word
    composing.compose = _compose
