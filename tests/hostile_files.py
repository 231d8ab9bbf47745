"""Generated changes of files that a stranger hands over: a run's folder, an entry of the zoo.

A change is of one file: its values at any depth, its bytes, its syntax, or what it is at all. What
a payload would do shows outside: it makes the file EXECUTED, or tells the value of SECRET_NAME.
"""

from __future__ import annotations

import json
import os
import pickle
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

SECRET, SECRET_NAME = "the-value-of-a-secret", "HOSTILE_SECRET"
EXECUTED = "executed"  # in the folder where the program works
RUN = f"touch {EXECUTED}"
PYTHON = f"__import__('os').system('{RUN}')"
CREATE = f'${{oc.create:{{_target_:torch.utils.collect_env.run,command:"{RUN}"}}}}'
TEXTS = (
    *("", "x", "???", "null", "1e9", "../../x", "a.b", "a b", "\x1b[31mred", "\u202ex", "é" * 200),
    *(f"${{oc.env:{SECRET_NAME}}}", f"\\${{oc.env:{SECRET_NAME}}}", CREATE, f"\\{CREATE}"),
    *("${seed}", "${", "${a:${b}}", "${hydra:runtime.cwd}", "=cmd|'/c calc'!A1", "[red]x[/red]"),
    *("data.MeasuredData", "models.VWNN", "data.Bilinear", "models.MLP", "/dev/zero", "/", PYTHON),
    *("base", "force", "velocity", "conformal", "\ud800", "\x00", "\n", "u1", "y1", "x1.mass"),
    *("torch.os.system", "torch.ops.aten.from_file.default", "_operator.call"),
)
NUMBERS = (
    *(0, -1, 1, 2, 3, 7, 10**5, 10**9, 10**30, -(2**63), 0.5, -0.0, 1e-300, 1e308, -1e308),
    *(float("nan"), float("inf"), True, False),
)
NODES: tuple[Any, ...] = (
    *(None, [], {}, [1], [None], [[[]]], {"a": {}}, {"": None}, [1.5, "x", {}], [1, 1], [3, 2, 1]),
    *([1.0] * 300, {"identified": False}, {"_target_": "models.VWNN"}),
    {"_target_": "os.system", "command": RUN},
    {"_target_": "torch.utils.collect_env.run", "command": RUN},
    {"_target_": "data.MeasuredData", "path": "/dev/zero"},
    {"_partial_": True, "_target_": "models.MLP"},
)
BOMBS = (
    "a: &a [x,x,x,x,x,x,x,x,x]\n"
    + "".join(
        f"{c}: &{c} [{','.join(f'*{p}' for _ in range(9))}]\n" for p, c in pairwise("abcdefghi")
    ),
    "a: &a {k: v}\n"
    + "".join(
        f"{c}: &{c} {{<<: [{','.join(f'*{p}' for _ in range(9))}]}}\n"
        for p, c in pairwise("abcdefghi")
    ),
    *("a: &a [*a]\n", "a: " + "[" * 50_000, "".join(f"{' ' * n}a:\n" for n in range(900))),
    *("a: " + ":".join(["59"] * 200_000), "a: 0x" + "f" * 500_000, "a: " + "9" * 50_000),
    f"a: !!python/object/apply:os.system ['{RUN}']\n",
    *("a: !!timestamp x\n", "a: !!binary x\n", "? [a]\n: b\n", "--- a\n--- b\n", "a: *nobody\n"),
    *("[" * 60, "[" * 100_000, '{"a":' * 5000, "[]", "1", '"x"', "null", "NaN", "{}{}", "1e999"),
    *('{"a": "\\ud800"}', "9" * 5000, '{"a": 1, "a": 2}', ""),
)
KINDS = ("missing", "pipe", "folder", "loop", "nothing", "endless", "huge", "link", "pickle")


class Payload:
    """Unpickled, it runs a command."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (RUN,)


class Bomb:
    """Unpickled, it ends the program."""

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, ("raise SystemExit('code of a file was run')",)


@dataclass(frozen=True)
class Change:
    """A change of one file, in words and as what is done to the file."""

    words: str
    apply: Callable[[Path], None]

    def __repr__(self) -> str:
        return self.words


def odd_values() -> st.SearchStrategy[Any]:
    """Values of every type, among them those that a resolver or a constructor would act on."""
    one = st.sampled_from(NUMBERS) | st.sampled_from(TEXTS) | st.sampled_from(NODES)
    drawn = st.integers() | st.floats() | st.text(max_size=8) | st.lists(st.floats(), max_size=4)
    return one | one | one | drawn


def places_of(node: Any) -> list[tuple[Any, Any]]:
    """(holder, key) of every value below a node."""
    if not isinstance(node, dict | list):
        return []
    keys: Any = node if isinstance(node, dict) else range(len(node))
    inner = [(node, key) for key in keys]
    nested = (node[key] for key in keys if isinstance(node[key], dict | list))
    return inner + [place for one in nested for place in places_of(one)]


@st.composite
def changes_of_values(draw: st.DrawFn) -> Change:
    """Values that are another's, of another type, gone, new, repeated or nested."""
    kinds = ("set", "set", "set", "drop", "add", "rename", "swap", "scale", "nest", "shorten")
    one = st.tuples(st.sampled_from(kinds), st.floats(0, 0.999), st.floats(0, 0.999), odd_values())
    drawn = draw(st.lists(one, min_size=1, max_size=3))

    def apply(path: Path) -> None:
        try:
            text = path.read_text("utf-8")
            content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        except (ValueError, yaml.YAMLError, RecursionError):
            return  # an earlier change left no values
        for kind, where, other, value in drawn:
            places = []
            with suppress(RecursionError):  # of an earlier change that nests too deeply
                places = places_of(content)
            if places:
                holder, key = places[int(where * len(places))]
                theirs, name = places[int(other * len(places))]
                _change(holder, key, kind, json.loads(json.dumps(value)), theirs[name])
        with path.open("w", encoding="utf-8", errors="surrogatepass") as file:
            if path.suffix == ".json":
                json.dump(content, file)
            else:
                with suppress(RecursionError):  # too deep to be written: half of it is
                    yaml.safe_dump(content, file, sort_keys=False, allow_unicode=True)

    return Change(f"values {drawn!r:.300}", apply)


def _change(holder: Any, key: Any, kind: str, value: Any, other: Any) -> None:
    old = holder[key]
    if kind == "drop":
        del holder[key]
    elif kind == "add" and isinstance(holder, dict):
        holder[str(value)[:20]] = value
    elif kind == "rename" and isinstance(holder, dict):
        holder[f"{key}_"] = holder.pop(key)
    elif kind == "swap":
        holder[key] = json.loads(json.dumps(other))
    elif kind == "scale" and isinstance(old, int | float):
        holder[key] = old * 1000
    elif kind == "nest":
        holder[key] = [old]
    elif kind == "shorten" and isinstance(old, list):
        holder[key] = old[: len(old) // 2]
    else:
        holder[key] = value


@st.composite
def changes_of_bytes(draw: st.DrawFn) -> Change:
    """Bits that are flipped, bytes that are gone, repeated, nil or any."""
    kind = draw(st.sampled_from(("flip", "cut", "insert", "repeat", "zero", "all")))
    where, bit, more = (
        draw(st.floats(0, 0.999)),
        draw(st.integers(0, 7)),
        draw(st.binary(max_size=50)),
    )

    def apply(path: Path) -> None:
        content = bytearray(path.read_bytes())
        place = int(where * len(content))
        if kind == "flip" and content:
            content[place] ^= 1 << bit
        elif kind == "cut":
            del content[place:]
        elif kind == "zero":
            content[place : place + 9] = bytes(9)
        else:
            copied = content[place : place + 50] * 9
            content[place:place] = copied if kind == "repeat" else more
        path.write_bytes(more if kind == "all" else content)

    return Change(f"{kind} at {where:.3f}", apply)


@st.composite
def changes_of_kind(draw: st.DrawFn) -> Change:
    """What is no regular file, is no file at all, or claims a size that nobody reads."""
    kind = draw(st.sampled_from(KINDS))

    def apply(path: Path) -> None:
        content = path.read_bytes()
        path.unlink()
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind in ("loop", "nothing", "endless"):
            target = {"loop": path.name, "nothing": "nowhere", "endless": "/dev/zero"}[kind]
            path.symlink_to(target)
        elif kind == "huge":
            with path.open("wb") as file:
                file.truncate(2**40)
        elif kind == "link":
            elsewhere = path.parent.parent / f"kept_{path.name}"
            elsewhere.write_bytes(content)
            path.symlink_to(elsewhere)
        elif kind == "pickle":
            path.write_bytes(pickle.dumps(Payload()))

    return Change(kind, apply)


@st.composite
def changes_of_syntax(draw: st.DrawFn) -> Change:
    """Text that unfolds, nests or is of another kind, in place of the file or after it."""
    text, after = draw(st.sampled_from(BOMBS)), draw(st.booleans())

    def apply(path: Path) -> None:
        path.write_bytes((path.read_bytes() if after else b"") + text.encode())

    return Change(f"syntax {text[:40]!r}", apply)


def changes(name: str) -> st.SearchStrategy[Change]:
    """Changes of a file of this name."""
    of_files = changes_of_bytes() | changes_of_kind()
    if name.endswith((".json", ".yaml")):
        values = changes_of_values()
        return values | values | values | values | changes_of_syntax() | of_files
    return of_files


@contextmanager
def watched(folder: Path, told: Callable[[], str]) -> Iterator[None]:
    """Raise AssertionError where code ran, a connection was opened or the environment was told.

    folder: where the program works. told: all that it printed.
    """
    before, here = socket.socket.connect, Path.cwd()
    reached: list[Any] = []

    def connect(self: socket.socket, address: Any) -> None:
        reached.append(address)
        raise OSError("no network here")

    os.environ[SECRET_NAME] = SECRET
    socket.socket.connect = connect  # type: ignore[method-assign]
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(here)
        socket.socket.connect = before  # type: ignore[method-assign]
        del os.environ[SECRET_NAME]
        assert not reached, f"a connection to {reached}"
        assert not list(folder.rglob(EXECUTED)), "a command ran"
        assert SECRET not in told(), "the environment was printed"
        for path in folder.rglob("*"):
            if path.is_file() and not path.is_symlink() and path.stat().st_size < 2**20:
                assert SECRET.encode() not in path.read_bytes(), f"{path} has a secret"


def require_lines(status: int, error: str, printed: str) -> None:
    """Raise AssertionError for an error that is not one line, and for signs that move a cursor."""
    lines = [line for line in error.splitlines() if line.strip()]
    if status:
        assert len(lines) == 1, error
        assert lines[0].startswith("error: "), error
    odd = [c for c in printed + error if not c.isprintable() and c not in "\n\r\t"]
    assert not odd, f"printed the control character {odd[0]!r}"
