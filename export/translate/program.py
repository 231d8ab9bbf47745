"""Functions specialised on the shapes and numbers that they are called with, as text of C99."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, reduce
from typing import Any

import numpy as np

from export.translate.expressions import Expressions
from export.translate.operations import HELPERS
from export.translate.scope import Scope, c_name
from export.translate.statements import Statements
from export.translate.values import (
    DOUBLE,
    INT,
    Tables,
    Value,
    common_value,
    flat,
    known_value,
    tuple_of,
)

WIDTH = 100
BROKEN_BEFORE = (" + ", " - ", " * ", " && ", " || ", " ? ", " : ")
SET = re.compile(r"^\s*\w+ [-+*/]?= ")


@dataclass
class Function:
    """One function as C."""

    name: str
    parameters: list[str]  # those that C has, by their names in Python
    text: str
    returned: Value  # its kind, or those of a tuple's items
    written: set[str]  # arrays among the parameters whose elements it sets
    called: list[Function] = field(default_factory=list)


@cache
def _body(python: Callable[..., Any]) -> list[ast.stmt]:
    """The statements of a function, found once: it is translated for each way it is called."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(python)))
    return tree.body[0].body  # type: ignore[attr-defined]


class Program:
    """All functions of a program, each once for every way it is called."""

    def __init__(self) -> None:
        self.functions: dict[Any, Function] = {}
        self.tables = Tables()
        self.names: set[str] = set()
        self.stack: list[Any] = []
        self.callers: list[list[Function]] = []

    def function(self, source: Callable[..., Any], arguments: Mapping[str, Value]) -> Function:
        """The function for such arguments. Raises ValueError for what cannot be translated."""
        python = getattr(source, "py_func", source)
        if not inspect.isfunction(python):
            raise ValueError(f"{source!r} is no function that can be translated")
        taken = {name: _argument(name, value) for name, value in arguments.items()}
        key = (python, tuple(sorted((name, repr(value)) for name, value in taken.items())))
        if key not in self.functions:
            if key in self.stack:
                raise ValueError(f"{python.__name__} calls itself")
            self.stack.append(key)
            self.callers.append([])
            self.functions[key] = self._translated(python, taken)
            self.functions[key].called = self.callers.pop()
            self.stack.pop()
        found = self.functions[key]
        if self.callers and found not in self.callers[-1]:
            self.callers[-1].append(found)
        return found

    def _translated(self, python: Callable[..., Any], taken: dict[str, Value]) -> Function:
        body = _body(python)
        names = self.tables.opened(
            {**python.__globals__, **inspect.getclosurevars(python).nonlocals}
        )
        scope = Scope(taken)
        live: set[str] | None = None
        try:
            for _ in range(50):  # until its variables are known
                scope.begin_pass()
                self.callers[-1].clear()
                one = Statements(scope, names, self._call, live)
                one.body(body)
                used = words_of(one.lines)
                scope.read = {n for n in (*scope.kinds, *scope.arrays) if c_name(n) in used}
                if not scope.changed and live == scope.read:
                    return self._function(python.__name__, scope, one)
                live = None if scope.changed else set(scope.read)
        except ValueError as error:
            where = f"{python.__module__}.{python.__name__}"
            known = str(error).startswith(f"{python.__module__.split('.')[0]}.")
            raise ValueError(str(error) if known else f"{where}: {error}") from None
        raise ValueError(f"{python.__name__}: its variables cannot be determined")

    def _function(self, name: str, scope: Scope, one: Statements) -> Function:
        if constant := scope.written & set(self.tables.values):
            raise ValueError(f"{min(constant)} is an array of its module, which cannot be set")
        parameters = [n for n, v in scope.arguments.items() if not _folded(v) and n in scope.read]
        values = one.returned  # of all returns: what they have in common
        returned = _kind_of(reduce(common_value, values)) if values else Value("none")
        words = [_declared(n, scope) for n in parameters]
        if returned.kind == "tuple":
            words += [f"{item.kind} *out{i + 1}_" for i, item in enumerate(flat(returned))]
        own = f"do_{name.strip('_')}"  # not the name of any variable
        unique, count = own, 2
        while unique in self.names:
            unique, count = f"{own}_{count}", count + 1
        self.names.add(unique)
        kind = returned.kind if returned.is_number else "void"
        head = f"static {kind} {unique}({', '.join(words)})"
        head = head.replace("()", "(void)")
        body = [*(f"    {line}" for line in scope.declarations()), *one.lines]
        lines = [*wrapped(head), "{", *(part for line in body for part in wrapped(line)), "}"]
        written = {n for n in parameters if n in scope.written}
        return Function(unique, parameters, "\n".join(lines), returned, written)

    def _call(
        self, source: Callable[..., Any], arguments: list[Value], inside: Expressions
    ) -> Value:
        """A call as an expression, or as a statement before it where it returns several numbers."""
        python = getattr(source, "py_func", source)
        names = list(inspect.signature(python).parameters.values())
        given = dict(zip([p.name for p in names], arguments, strict=False))
        for parameter in names[len(arguments) :]:
            value = known_value(parameter.default)
            if parameter.default is inspect.Parameter.empty or value is None:
                raise ValueError(f"{python.__name__} is called without {parameter.name}")
            given[parameter.name] = value
        found = self.function(source, given)
        for name, value in list(given.items()):
            given.update(_opened(name, value))
        passed = {name: given[name] for name in found.parameters}
        written = [v for name, v in passed.items() if name in found.written and v.kind == "array"]
        inside.scope.written |= {value.root for value in written}
        return _result(found, [value.code for value in passed.values()], inside)

    def text(self, roots: list[Function]) -> str:
        """The functions that the roots call, each after those that it calls."""
        ordered: list[Function] = []

        def visit(function: Function) -> None:  # none calls itself
            if function not in ordered:
                for one in function.called:
                    visit(one)
                ordered.append(function)

        for root in roots:
            visit(root)
        texts = [f.text for f in ordered]
        used = words_of(texts)
        helpers = [HELPERS[name] for name in sorted(used & HELPERS.keys())]
        return "\n\n".join([*self.tables.text(used), *helpers, *texts])


def words_of(lines: Iterable[str]) -> set[str]:
    """Names that are used, not merely set."""
    return set(re.findall(r"[A-Za-z_]\w*", "\n".join(SET.sub("", line) for line in lines)))


def wrapped(line: str) -> Iterable[str]:
    """A line of C as lines of 100 characters at most, broken after a comma or before a sign."""
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    while len(line) > WIDTH:
        at = max(line.rfind(", ", 0, WIDTH) + 1, *(line.rfind(s, 0, WIDTH) for s in BROKEN_BEFORE))
        if at <= len(indent):
            break
        yield line[:at].rstrip()
        line = indent + line[at:].lstrip()
    yield line


def _opened(name: str, value: Value) -> dict[str, Value]:
    """Items of a tuple by the names of their arguments."""
    if value.kind != "tuple":
        return {name: value}
    named = zip(value.parts(name), value.items, strict=True)
    parts = [_opened(part, item) for part, item in named]
    return {key: item for part in parts for key, item in part.items()}


def _result(found: Function, words: list[str], inside: Expressions) -> Value:
    if found.returned.kind != "tuple":
        return Value(found.returned.kind, f"{found.name}({', '.join(words)})")
    if not inside.hoisting:
        raise ValueError(f"{found.name} returns several numbers where it may not be reached")
    held = _temporaries(found.returned, inside)
    words = [*words, *(f"&{one.code}" for one in flat(held))]
    inside.before.append(f"{found.name}({', '.join(words)});")
    return held


def _temporaries(returned: Value, inside: Expressions) -> Value:
    """Variables for what a function returns."""
    if returned.kind != "tuple":
        return inside.scope.temporary(returned.kind)
    return tuple_of([_temporaries(item, inside) for item in returned.items], returned.fields)


def _argument(name: str, value: Value) -> Value:
    """What a function knows of an argument: arrays by its own name for them."""
    if value.kind == "array":
        return Value("array", c_name(name), shape=value.shape, dtype=value.dtype, root=name)
    if value.kind == DOUBLE:
        return Value(DOUBLE)
    if value.kind == INT and not value.fixed:
        return Value(INT)
    if value.kind == "tuple" and not value.fixed:
        named = zip(value.parts(name), value.items, strict=True)
        items = tuple(_argument(part, item) for part, item in named)
        return Value("tuple", items=items, fields=value.fields)
    if not value.fixed:
        raise ValueError(f"{name} is a {value.kind} that is not known")
    return value


def _folded(value: Value) -> bool:
    return value.fixed and value.kind != "array"


def _declared(name: str, scope: Scope) -> str:
    value = scope.arguments[name]
    if value.kind != "array":
        return f"{value.kind} {c_name(name)}"
    constant = "" if name in scope.written else "const "
    return f"{constant}{value.dtype} *{c_name(name)}"


def _kind_of(value: Value) -> Value:
    if value.kind == "tuple":
        items = tuple(_kind_of(item) for item in value.items)
        return Value("tuple", items=items, fields=value.fields)
    return Value(value.kind)


def array_of(name: str, value: np.ndarray) -> Value:
    """An array as an argument."""
    dtype = INT if value.dtype.kind == "i" else DOUBLE
    return Value("array", name, shape=value.shape, dtype=dtype, root=name)
