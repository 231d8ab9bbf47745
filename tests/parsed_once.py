"""The same text of a config or a command line is parsed once: tests compose a thousand configs.

Parsing takes a third of the time of composing. What it returns depends on the text alone. Words
that a test composes by `composed` are composed once; every caller gets a copy of its own. So are
files of `conf` and of Hydra read once, and a list of them merged once, which takes half of the
rest. A copy is a pickle: reading it takes a quarter of the time of `deepcopy`.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Hashable
from functools import cache
from types import SimpleNamespace
from typing import Any

import omegaconf._utils
import omegaconf.base
import omegaconf.omegaconf
import yaml
from hydra import compose
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import ConfigRepository
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf.grammar_parser import parse

from runner.config import compose as composing

_of_yaml: dict[str, Any] = {}
_of_words: dict[tuple[str, str], Any] = {}
_of_keys: dict[Hashable, bytes] = {}
_parse_rule = OverridesParser.parse_rule
_load_config = ConfigRepository.load_config
_load_single_config = ConfigLoaderImpl._load_single_config
_compose_config = ConfigLoaderImpl._compose_config_from_defaults_list
PLACES = {"hydra.conf", str(composing.CONF), str(composing.EARLIER), ""}  # of files that stay


def _load(stream: Any, **loader: Any) -> Any:
    text = stream if isinstance(stream, str) else stream.read()
    if text not in _of_yaml:
        _of_yaml[text] = yaml.load(text, **loader)  # as OmegaConf names it
    return _of_yaml[text]


def _parse_word(parser: OverridesParser, word: str, rule: str) -> Any:
    if (word, rule) not in _of_words:
        _of_words[word, rule] = _parse_rule(parser, word, rule)
    return copy.copy(_of_words[word, rule])


def _once(key: Hashable, make: Callable[[], Any]) -> Any:
    if key not in _of_keys:
        if (made := make()) is None:
            return None
        _of_keys[key] = pickle.dumps(made)
    return pickle.loads(_of_keys[key])


def _compose(config: str, words: list[str], return_hydra_config: bool) -> Any:
    key = config, return_hydra_config, *words
    return _once(key, lambda: compose(config, words, return_hydra_config))


def _of_files(repo: Any, key: tuple[Hashable, ...], make: Callable[[], Any]) -> Any:
    places = tuple(source.path for source in repo.get_sources())
    return _once((places, *key), make) if PLACES.issuperset(places) else make()


def _of_file(repository: Any, config_path: str) -> Any:
    return _of_files(repository, (config_path,), lambda: _load_config(repository, config_path))


def _in_its_place(loader: Any, default: Any, repo: Any) -> Any:
    key = default.config_path, default.package, default.primary
    return _of_files(repo, key, lambda: _load_single_config(loader, default, repo))


def _in_one(loader: Any, defaults: Any, repo: Any) -> Any:
    key = tuple((d.config_path, d.package, d.primary) for d in defaults)
    return _of_files(repo, key, lambda: _compose_config(loader, defaults, repo))


def remember() -> None:
    """From here on, in this process."""
    interpolation = cache(parse)
    omegaconf.base.parse = omegaconf._utils.parse = interpolation
    omegaconf._utils.get_yaml_loader = cache(omegaconf._utils.get_yaml_loader)
    omegaconf.omegaconf.yaml = SimpleNamespace(**{**vars(yaml), "load": _load})
    OverridesParser.parse_rule = _parse_word
    composing.compose = _compose
    ConfigRepository.load_config = _of_file
    ConfigLoaderImpl._load_single_config = _in_its_place
    ConfigLoaderImpl._compose_config_from_defaults_list = _in_one
