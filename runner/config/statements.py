"""What the statements of a module do: its syntax trees without words and imports of this project.

Parsing the modules of a run takes as long as fitting a VWNN. What was parsed is kept on disk with
the hash of its text, for this code and this Python alone.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

from data.private_folder import private_folder

HERE = Path(__file__)
ROOT = HERE.parents[2]
ROOMS = ("data", "models", "runner")  # what is imported from them is no statement


class Parsed(NamedTuple):
    """A module: the hash of its text, its statements, its (module, names) to import from."""

    text: str
    statements: list[str]
    imports: list[tuple[str, list[str]]]


def parsed_file(path: Path) -> Parsed:
    """A module as its file is now."""
    source, kept = path.read_bytes(), _kept()
    known = kept.get(str(path))
    text = hashlib.sha256(source).hexdigest()
    if known is None or known.text != text:
        known = kept[str(path)] = _parsed(source, text)
        _new.add(path)
    return known


def _parsed(source: bytes, text: str) -> Parsed:
    tree, bare = ast.parse(source), _Bare()
    kept = [statement for node in tree.body if (statement := bare.visit(node)) is not None]
    imports = [(node.module or "", [name.name for name in node.names]) for node in bare.imports]
    return Parsed(text, list(map(ast.unparse, kept)), imports)


_new: set[Path] = set()  # parsed by this process, and not on disk yet


@cache
def _kept() -> dict[str, Parsed]:
    """Modules by the paths of their files, as earlier runs left them."""
    return _on_disk()


def _on_disk() -> dict[str, Parsed]:
    file = _file()
    try:
        content = {} if file is None else json.loads(file.read_text("utf-8"))
        return {path: Parsed(*one) for path, one in content.items()}
    except (OSError, ValueError, TypeError, AttributeError):  # of a file that is something else
        return {}


def keep_parsed() -> None:
    """Write modules of this clone that were parsed anew."""
    ours = {str(path): _kept()[str(path)] for path in _new if path.is_relative_to(ROOT)}
    _new.clear()
    file = _file() if ours else None
    if file is None:
        return
    aside = file.with_name(f"{file.name}.{os.getpid()}")  # others may be writing too
    try:
        aside.write_text(json.dumps(_on_disk() | ours), "utf-8")
        os.replace(aside, file)
    except OSError:  # a full disk: the next run parses them again
        aside.unlink(missing_ok=True)


def _file() -> Path | None:
    """Where they are kept; None: nowhere."""
    code = hashlib.sha256(sys.version.encode() + HERE.read_bytes()).hexdigest()[:16]
    folder = private_folder(HERE.parent / "__pycache__", "statements")
    return None if folder is None else folder / f"{code}.json"


class _Bare(ast.NodeTransformer):
    """Statements without what changes no number; `imports` are those that it met."""

    def __init__(self) -> None:
        self.imports: list[ast.ImportFrom] = []

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST | None:
        self.imports.append(node)
        return None if (node.module or "").split(".")[0] in ROOMS else node

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        is_text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if is_text else self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        if isinstance(node.exc, ast.Call):
            node.exc = node.exc.func
        return node
