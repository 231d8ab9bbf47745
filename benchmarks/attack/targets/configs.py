"""Configs of somebody else: every node of a composed config replaced by what nobody planned."""

from __future__ import annotations

import random
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from benchmarks.attack.attempt import EXECUTED, SECRET_NAME, Attempt, WronglyAcceptedError
from models.estimator import Estimator
from models.training.assemble import assembled
from runner.config.command_line import refusals
from runner.config.compose import CONF, composed
from runner.config.settings import check_settings

RUN = f'{{_target_:torch.utils.collect_env.run,command:"touch {EXECUTED}"}}'
HOSTILE = [
    f"${{oc.create:{RUN}}}",
    f"\\${{oc.create:{RUN}}}",
    f"\\\\${{oc.create:{RUN}}}",
    f"\\\\\\${{oc.create:{RUN}}}",
    f"${{oc.env:{SECRET_NAME}}}",
    f"\\${{oc.env:{SECRET_NAME}}}",
    "${oc.decode:'${seed}'}",
    "${seed}",
    "${hydra:runtime.cwd}",
    "${",
    "\\${",
    "???",
]  # resolved once, the first and the fifth are what their writer typed: see `attempt`
SHELL = {"_target_": "torch.utils.collect_env.run", "command": f"touch {EXECUTED}"}
NODES = [
    SHELL,
    {"_target_": "os.system", "command": f"touch {EXECUTED}"},
    {"_target_": "models.VWNN", "_partial_": True},
    {"_target_": "models.NoFreeRunError"},
    {"_target_": "data.SampleLines", "file": "/etc/hostname"},
    {"_target_": "data.MeasuredData", "path": "/dev/zero"},
    {"_target_": ["models.VWNN"]},
    {"_target_": None},
    {"_target_": SHELL},
    {"_args_": [1], "_recursive_": False, "_convert_": "all"},
    {}, [], [[]], {"": 1}, {1: 2}, {None: 3}, [SHELL], {"a": {"b": [SHELL]}},
]  # fmt: skip
VALUES = [
    None, True, False, 0, 1, -1, 2, 10**6, 10**9, 10**30, 10**400, 0.5, -0.0, 1e-300, 1e300,
    float("nan"), float("inf"), -float("inf"), "", " ", "abc", "1", "1e5", "../x", "x\x1b[31m",
    "\u202e", "x" * 10**5, [1], [1.0, 2.0], ["a"], [None], [float("nan")] * 3, list(range(1000)),
]  # fmt: skip


@cache
def config(group: str, choice: str) -> Any:
    """Resolved values of a run with one choice, small."""
    return OmegaConf.to_container(composed(f"{group}={choice}", "data.duration=1"), resolve=True)


def places(node: Any, path: tuple = ()) -> list[tuple]:
    """Paths of every node below one."""
    inner = node.items() if isinstance(node, dict) else enumerate(node)
    found = []
    for key, value in inner:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += places(value, (*path, key))
    return found


class Target:
    name = "configs"

    def __init__(self) -> None:
        parts = ("model", "solver", "objective", "system", "excitation", "damage", "scenario")
        self.choices = [
            (group, path.stem)
            for group in parts
            for path in sorted((CONF / group).glob("*.yaml"))
            if path.stem not in ("measured", "earthquake", "given", "none")
        ]

    def prepare(self, folder: Path) -> None:
        """Nothing: every config is composed anew."""

    def attempt(self, draw: random.Random, folder: Path) -> Attempt:
        """A config with one or two nodes replaced, renamed, added or taken away."""
        group, choice = draw.choice(self.choices)
        content, done = deepcopy(config(group, choice)), [f"{group}={choice}"]
        for _ in range(draw.choice([1, 1, 2])):
            path = draw.choice(places(content))
            if draw.random() < 0.5:  # the choice itself, not what stands beside
                path = draw.choice([p for p in places(content) if p[0] == group] or [path])
            done.append(mutate(content, path, draw))
        return Attempt("; ".join(done), lambda: assemble(content))


def mutate(content: Any, path: tuple, draw: random.Random) -> str:
    """Change the node at a path; what was done, in words."""
    parent = content
    for key in path[:-1]:
        parent = parent[key]
    name = ".".join(map(str, path))
    kind = draw.random()
    if kind < 0.1 and isinstance(parent, dict):
        del parent[path[-1]]
        return f"without {name}"
    value: Any = deepcopy(draw.choice(VALUES))
    if kind < 0.35:
        value = deepcopy(draw.choice(NODES))
    elif kind < 0.5:
        value = draw.choice(HOSTILE[1:4] + HOSTILE[5:])
    if kind > 0.9 and isinstance(parent, dict):
        parent[draw.choice(["foo", "_partial_", "_args_", "_mode_", "name", "about"])] = value
        return f"beside {name}: {str(value)[:100]}"
    parent[path[-1]] = value
    return f"{name}: {str(value)[:100]}"


def assemble(content: Any) -> None:
    """Build everything that a run needs, as train.py does before it writes a file."""
    with refusals():
        cfg = OmegaConf.create(content)
        assert isinstance(cfg, DictConfig)
        check_settings(cfg)
        _, module, baselines = assembled(cfg)
    for estimator in (module.estimator, *baselines.values()):
        if not isinstance(estimator, Estimator | ValueError):  # why a baseline is none here
            raise WronglyAcceptedError(f"{type(estimator)} in place of an estimator")
