"""The plan of the house: how large a room is, which way imports run, what the fronts list."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from omegaconf import OmegaConf

import data
import models

ROOT = Path(__file__).parents[1]
BUDGETS = {  # lines of Python that a room may have, and those that it should have
    "data": (18_945, 10_500),
    "models": (28_375, 17_000),
    "runner": (6_655, 3_600),
    "export": (4_485, 4_200),
    "report": (9_290, 6_000),
    "live": (1_085, 800),
    "benchmarks": (4_670, 2_500),
    "hydra_plugins": (100, 100),
    "tests": (37_475, 18_000),
}
FLOORS = ("data", "models", "runner", "export", "report", "live")  # from the ground up
PROGRAMS = ("train", "evaluate", "predict", "identify", "benchmarks")  # on the roof
ABOVE = {"hydra_plugins": ("runner",)}  # a porch: imports these alone


def modules() -> dict[str, Path]:
    rooms = (*FLOORS, *PROGRAMS, *ABOVE)
    paths = [p for room in rooms for p in (ROOT / room).rglob("*.py")]
    paths += [ROOT / f"{name}.py" for name in PROGRAMS if (ROOT / f"{name}.py").is_file()]
    names = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths}
    return {name.removesuffix(".__init__"): path for path, name in names.items()}


MODULES = modules()


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def imported(path: Path) -> Iterator[str]:
    """Modules of the project that a file imports, also inside functions."""
    for node in ast.walk(parsed(path)):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.ImportFrom):
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        yield from (name for name in names if name in MODULES)


@cache
def imports() -> dict[str, set[str]]:
    return {name: set(imported(path)) - {name} for name, path in MODULES.items()}


def allowed(room: str) -> set[str]:
    """Rooms that a room may import."""
    if room in FLOORS:
        return set(FLOORS[: FLOORS.index(room) + 1])
    return {*FLOORS, *PROGRAMS} if room in PROGRAMS else {*ABOVE[room], room}


def room_of(module: str) -> str:
    return module.partition(".")[0]


@pytest.mark.parametrize("room", BUDGETS)
def test_a_room_is_within_its_budget(room):
    lines = sum(path.read_text("utf-8").count("\n") for path in (ROOT / room).rglob("*.py"))
    most, goal = BUDGETS[room]
    assert lines <= most, f"{room} has {lines:,} lines, {most:,} at most; its goal is {goal:,}"


def test_no_import_runs_up():
    ups = {
        f"{name} imports {other}"
        for name, others in imports().items()
        for other in others
        if room_of(other) not in allowed(room_of(name))
    }
    assert not ups


def test_no_import_runs_in_a_circle():
    left = {name: set(others) for name, others in imports().items()}
    while free := [name for name, others in left.items() if not others & left.keys()]:
        for name in free:
            del left[name]
    assert not left


@pytest.mark.parametrize("front", [data, models], ids=["data", "models"])
def test_a_front_lists_public_classes_where_they_are_defined(front):
    for name, module in front.PUBLIC.items():
        found = getattr(front, name)
        assert inspect.isclass(found)
        assert found.__module__ == module
        assert found.__doc__
    assert set(front.PUBLIC) <= set(dir(front))
    with pytest.raises(AttributeError, match="has no 'Nobody'"):
        _ = front.Nobody


def test_configs_name_classes_of_the_fronts():
    listed = {f"{front.__name__}.{name}" for front in (data, models) for name in front.PUBLIC}
    named = set()
    for path in (ROOT / "conf").rglob("*.yaml"):
        waiting = [OmegaConf.to_container(OmegaConf.load(path))]
        while waiting:
            node = waiting.pop()
            if isinstance(node, dict):
                named.add(str(node.get("_target_", "")))
            waiting += list(node.values()) if isinstance(node, dict) else []
            waiting += node if isinstance(node, list) else []
    assert {n for n in named if n and not n.startswith("hydra_plugins.")} <= listed


def test_what_a_newcomer_asks_is_answered_in_three_files():
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    table = text.partition("| where a newcomer finds |")[2].partition("\n\n")[0]
    rows = table.splitlines()[2:]
    assert len(rows) == 6
    for row in rows:
        files = re.findall(r"`([\w/]+\.py)`(?: `(\w+)`)?", row)
        assert 1 <= len(files) <= 3, row
        for name, word in files:
            assert (ROOT / name).is_file(), name
            assert word in (ROOT / name).read_text("utf-8"), f"{name} has no {word}"


def test_a_command_is_called_by_the_last_lines_of_its_file():
    """What is defined below the call is not there yet."""
    for path in MODULES.values():
        for node in parsed(path).body[:-1]:
            call = isinstance(node, ast.If) and ast.unparse(node.test).startswith("__name__ ==")
            assert not call, path
