"""What a run's numbers follow from: every choice that can change one, and the code that ran.

The code is what the modules of this run *do*: the syntax trees of their statements without
docstrings, comments, imports of this project and messages of errors. A moved file, a split one and
a mended sentence leave it as it is; an estimator that this run does not use does too.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import data
import models

ROOT = Path(__file__).parent.parent
FRONTS = {"data": data.PUBLIC, "models": models.PUBLIC}
CORE = ("models.training.assemble", "models.training.identification", "runner.outcome")  # of all
INERT = ("figures", "checkpoint_seconds")  # they change no number,
INERT_TRAINER = ("enable_progress_bar", "log_every_n_steps")  # nor do these of the trainer


def digest(text: str) -> str:
    """Ten characters that stand for a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def config_digest(content: dict[str, Any]) -> str:
    """Ten characters that tell runs apart: a hash of every choice that can change a number."""
    content = {k: v for k, v in content.items() if k not in INERT}
    content["trainer"] = {k: v for k, v in content["trainer"].items() if k not in INERT_TRAINER}
    return digest(json.dumps(content, sort_keys=True, ensure_ascii=False))


def code_version(content: dict[str, Any], root: Path = ROOT) -> str:
    """Ten characters that change with the code of a run with these resolved values."""
    return _code_of(frozenset(_targets(content)), root)


def identity_of(content: dict[str, Any]) -> dict[str, str]:
    """What a run's numbers follow from: its resolved values and the code."""
    return {"config": config_digest(content), "code": code_version(content)}


def _targets(node: Any) -> Iterator[str]:
    """Every `_target_` of a config."""
    if isinstance(node, dict):
        if "_target_" in node:
            yield str(node["_target_"])
        node = list(node.values())
    if isinstance(node, list):
        for value in node:
            yield from _targets(value)


@cache
def _code_of(targets: frozenset[str], root: Path) -> str:
    named = (target.partition(".") for target in targets)
    roots = [FRONTS[room][name] for room, _, name in named if name in FRONTS.get(room, {})]
    statements = {s for module in _imported([*roots, *CORE], root) for s in _read(module, root)[0]}
    return digest("\n".join(sorted(statements)))


def _imported(modules: Iterable[str], root: Path) -> set[str]:
    """These modules and all of the project that they import, directly or not."""
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += _read(module, root)[1]
    return found


@cache
def _read(module: str, root: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the statements of a module do, and which modules of data and models it imports."""
    tree = ast.parse((root / Path(*module.split("."))).with_suffix(".py").read_bytes())
    ours = {name for node in ast.walk(tree) for name in _own_imports(node, root)}
    bare = (_Bare().visit(node) for node in tree.body)
    return tuple(ast.unparse(node) for node in bare if node is not None), tuple(sorted(ours))


def _own_imports(node: ast.AST, root: Path) -> Iterator[str]:
    """Modules that an import statement loads, of those that make numbers."""
    if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in FRONTS:
        for name in node.names:  # a module of a package, or what a module defines
            inside = f"{node.module}.{name.name}"
            is_module = (root / Path(*inside.split("."))).with_suffix(".py").is_file()
            place = inside if is_module else str(node.module)
            if place not in FRONTS:
                yield place


class _Bare(ast.NodeTransformer):
    """Statements without what changes no number."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST | None:
        return None if (node.module or "").split(".")[0] in (*FRONTS, "runner") else node

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        if isinstance(node.exc, ast.Call):
            node.exc = node.exc.func
        return node
