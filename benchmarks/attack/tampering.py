"""Changes of one file of a run: its bytes, its kind, its syntax, its values."""

from __future__ import annotations

import contextlib
import json
import os
import random
import socket
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from benchmarks.attack.attempt import EXECUTED, SECRET_NAME

RUN = f"touch {EXECUTED}"
CREATE = f'${{oc.create:{{_target_:torch.utils.collect_env.run,command:"{RUN}"}}}}'
TEXTS = (
    *("", "x", "???", "null", "1e9", "../../x", "a.b", "a b", "\x1b[31mred", "\u202ex", "é" * 200),
    *(f"${{oc.env:{SECRET_NAME}}}", f"\\${{oc.env:{SECRET_NAME}}}", CREATE, f"\\{CREATE}"),
    *("${seed}", "${", "${a:${b}}", "\\\\${seed}", "${oc.decode:'[1,2]'}", "${hydra:runtime.cwd}"),
    *("${run_name:}", "${help:train}", "=cmd|'/c calc'!A1", "[red]x[/red]", "\ud800", "\x00", "\n"),
    *("data.MeasuredData", "models.VWNN", "data.Bilinear", "models.Frozen", "/dev/zero", "/"),
)
ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 7, 0.5, -0.0, 1e-300, 1e308, float("nan"), float("inf")),
    *(10**9, 10**30, -(2**63), [], {}, [1], [None], [[[]]], {"a": {}}, {"": None}, [1.5, "x", {}]),
    *TEXTS,
    {"_target_": "os.system", "command": RUN},
    {"_target_": "torch.utils.collect_env.run", "command": RUN},
    {"_target_": "data.MeasuredData", "path": "/dev/zero"},
    {"_target_": "models.VWNN"},
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
    "a: &a [*a]\n",
    "a: " + "[" * 50_000,
    "".join(f"{' ' * n}a:\n" for n in range(900)),
    "a: " + ":".join(["59"] * 200_000),
    "a: 0x" + "f" * 500_000,
    "a: " + "9" * 50_000,
    f"a: !!python/object/apply:os.system ['{RUN}']\n",
    "a: !!timestamp x\n",
    "a: !!binary x\n",
    "a: !!set {a, b}\n",
    "? [a]\n: b\n",
    "a: 1\na: 2\n",
    "a: 2020-01-01\n",
    "--- a\n--- b\n",
    "%YAML 9.9\n---\na: 1\n",
    "\tx: 1\n",
    "a: *nobody\n",
)


def mutation(draw: random.Random, file: str) -> tuple[str, Callable[[Path], None]]:
    """A change of one file, in words and as a function of the file."""
    kinds = [_of_bytes, _of_kind]
    if not file.endswith("safetensors"):
        kinds += [_of_values] * 6 + [_of_syntax]
    return draw.choice(kinds)(draw)


def _of_bytes(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    where, bit, count = draw.random(), draw.randrange(8), draw.choice((1, 1, 1, 5, 200))
    kind = draw.choice(("flip", "cut", "insert", "repeat", "zero", "random"))

    def mutate(path: Path) -> None:
        content = bytearray(path.read_bytes())
        place = int(where * len(content))
        other = random.Random(place)
        if kind == "flip":
            for _ in range(count):
                content[place] ^= 1 << bit
                place = other.randrange(len(content))
        elif kind == "cut":
            del content[place:]
        elif kind == "insert":
            content[place:place] = bytes(other.randrange(256) for _ in range(count))
        elif kind == "repeat":
            content[place:place] = content[place : place + 50] * count
        elif kind == "zero":
            content[place : place + count] = bytes(count)
        else:
            content = bytearray(other.randbytes(len(content)))
        path.write_bytes(content)

    return f"{kind} {count} from {where:.3f}", mutate


def _of_kind(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    kinds = ("missing", "empty", "pipe", "folder", "loop", "device", "endless", "huge", "socket")
    kind = draw.choice((*kinds, "link", "nowhere"))

    def mutate(path: Path) -> None:
        kept = path.with_name("kept")
        path.rename(kept)
        if kind == "empty":
            path.touch()
        elif kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind == "loop":
            path.symlink_to(path)
        elif kind in ("device", "endless", "nowhere"):
            targets = {"device": "/dev/null", "endless": "/dev/zero", "nowhere": "/nowhere"}
            path.symlink_to(targets[kind])
        elif kind == "huge":
            with path.open("wb") as file:
                file.truncate(2**40)
        elif kind == "socket":
            os.chdir(path.parent)
            socket.socket(socket.AF_UNIX).bind(path.name)
            os.chdir("../..")
        elif kind == "link":
            path.symlink_to(kept)

    return kind, mutate


def _of_syntax(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    text, at_end = draw.choice(BOMBS), draw.random() < 0.5
    deep = "[" * draw.choice((60, 999, 100_000))
    jsons = (deep, '{"a":' * 5000, "[]", "1", '"x"', "null", "NaN", '{"test": Infinity}', "{}{}")
    json_text = draw.choice((*jsons, "1e999", '{"a": "\\ud800"}', "9" * 5000, '{"a": 1e400}'))

    def mutate(path: Path) -> None:
        if path.suffix == ".json":
            path.write_text(json_text, "utf-8")
        else:
            kept = path.read_text("utf-8") if at_end else ""
            path.write_text(kept + text, "utf-8")

    return f"{text[:60]!r} or {json_text[:30]!r}", mutate


def _of_values(draw: random.Random) -> tuple[str, Callable[[Path], None]]:
    """A value, or several, of another type; a key that is gone, new, or another's."""
    changes = [
        (
            draw.random(),
            draw.choice(("set", "set", "set", "drop", "add", "rename", "swap", "scale")),
            draw.choice(ODD),
        )
        for _ in range(draw.choice((1, 1, 1, 2, 5)))
    ]

    def mutate(path: Path) -> None:
        text = path.read_text("utf-8")
        content = json.loads(text) if path.suffix == ".json" else yaml.safe_load(text)
        for where, kind, value in changes:
            places = list(_places(content))
            if not places:
                break
            holder, key = places[int(where * len(places))]
            _change(holder, key, kind, value, places[int(where * 7919) % len(places)])
        with path.open("w", encoding="utf-8", errors="surrogatepass") as file:
            if path.suffix == ".json":
                json.dump(content, file)
            else:
                file.write(yaml.dump(content, sort_keys=False, allow_unicode=True))

    return "; ".join(
        f"{kind} at {where:.3f} {value!r:.80}" for where, kind, value in changes
    ), mutate


def _places(node: Any) -> list[tuple[Any, Any]]:
    keys = (
        list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    )
    found = []
    for key in keys:
        found += [(node, key), *_places(node[key])]
    return found


def _change(holder: Any, key: Any, kind: str, value: Any, other: tuple[Any, Any]) -> None:
    with contextlib.suppress(KeyError, IndexError, TypeError):
        if kind == "set":
            holder[key] = value
        elif kind == "drop":
            del holder[key]
        elif kind == "add" and isinstance(holder, dict):
            holder[str(value)[:20]] = value
        elif kind == "rename" and isinstance(holder, dict):
            holder[f"{key}_"] = holder.pop(key)
        elif kind == "swap":
            holder[key] = json.loads(json.dumps(other[0][other[1]]))
        elif kind == "scale":
            holder[key] = holder[key] * 1000
