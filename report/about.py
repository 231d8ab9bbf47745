"""What conf/model says about a model: prior knowledge, whether it contains the truth, its colour.

    about:
      told: what the model knows of the structure before it sees any data
      contains: [bilinear]      structures whose laws are among those that the model can have
      may_contain: [polynomial] structures whose laws it could find, though nothing leads it there
      colour: "#D55E00"
      own_residual_colour: "#CC79A7"   of another way in which the model is scored

All of it is optional. Statements, no results: what a small error shows depends on them. And the
unit of a setting, as its comment in conf/ has it.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from functools import cache
from typing import Any

from omegaconf import OmegaConf

from runner.config.compose import CONF, EARLIER

OTHERS = ("#DDCC77", "#661100", "#6699CC", "#888888")  # of models that name none
COLOUR = "colour"
UNITS = ("s", "Hz", "rad/s", "m", "N", "kg", "samples", "seconds")  # as comments of conf/ say them


def models() -> list[str]:
    """Names of the models of conf/, as results bear them."""
    return sorted(_blocks())


@cache
def _blocks() -> Mapping[str, Mapping[str, Any]]:
    """{name of a model: what its config says about it}."""
    paths = [*(CONF / "model").rglob("*.yaml"), *(EARLIER / "model").glob("*.yaml")]
    read: list[Any] = [OmegaConf.to_container(OmegaConf.load(path)) for path in paths]
    models = [content.get("model", content) for content in read if content]
    return {model["name"]: model.get("about", {}) for model in models if "name" in model}


def about(model: str) -> Mapping[str, Any]:
    """The block of a model; empty where conf/model has none."""
    return _blocks().get(model, {})


def prior_knowledge(model: str) -> str:
    """What the model knows of the structure before it sees any data; "" where nobody says."""
    return str(about(model).get("told", ""))


def contains(model: str, system: str) -> str:
    """Whether the structure's law is among those that the model can have: yes, possible or no."""
    for key, word in (("contains", "yes"), ("may_contain", "possible")):
        if system in about(model).get(key, ()):
            return word
    return "no"


@cache
def colours() -> dict[str, str]:
    """{method: colour} of all models that name one, and of the other ways in which they score."""
    found = {}
    for model in models():
        for key, colour in about(model).items():
            if key.endswith(COLOUR):
                way = key.removesuffix(COLOUR).rstrip("_")
                found["_".join(filter(None, (model, way)))] = str(colour)
    return found


def colour_of(method: str) -> str:
    """The same in every picture."""
    return colours().get(method) or OTHERS[zlib.crc32(method.encode()) % len(OTHERS)]


@cache
def unit_of(key: str) -> str:
    """The unit of a setting such as model.cutoff; "" where conf/ names none, or several."""
    group, *_, name = key.split(".") if "." in key else ("", key)
    found, line = set(), re.compile(rf"^ *{re.escape(name)}:[^#\n]*#(.*)$", re.MULTILINE)
    for path in (CONF / group).rglob("*.yaml") if group else ():
        for comment in line.findall(path.read_text("utf-8")):
            found |= {part.strip() for part in re.split("[,;]", comment)}.intersection(UNITS)
    return found.pop() if len(found) == 1 else ""
