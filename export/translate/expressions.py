"""Expressions of Python as values with C text."""

from __future__ import annotations

import ast
import builtins
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce
from typing import Any

import numpy as np

from export.translate import operations
from export.translate.scope import Scope
from export.translate.values import DOUBLE, INT, Binds, Value, known_value, number, tuple_of

Called = Callable[[Callable[..., Any], list[Value], "Expressions"], Value]


class Expressions:
    """Expressions in the scope of one function. `names`: those of its module."""

    def __init__(self, scope: Scope, names: dict[str, Any], call: Called) -> None:
        self.scope, self.names, self.call_of = scope, names, call
        self.before: list[str] = []  # statements that an expression needs before it
        self.hoisting = True  # whether there may be any
        self.calls = 0  # of functions of ours, which may write into arrays

    def value(self, node: ast.expr) -> Value:
        """Raises ValueError for what the translator does not know."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise ValueError(f"{ast.unparse(node)}: this kind of expression is not known")
        return method(node)

    def _constant(self, node: ast.Constant) -> Value:
        found = known_value(node.value)
        if found is None:
            raise ValueError(f"{ast.unparse(node)} is no number")
        return found

    def _name(self, node: ast.Name) -> Value:
        found = self.scope.get(node.id)
        if found is None and node.id in self.names:
            found = known_value(self.names[node.id])
        if found is None and hasattr(builtins, node.id):
            found = known_value(getattr(builtins, node.id))
        if found is None:
            raise ValueError(f"{node.id} is not known; set it before, or make it a number")
        return found

    def _tuple(self, node: ast.Tuple) -> Value:
        return tuple_of([self.value(item) for item in node.elts])

    def _binop(self, node: ast.BinOp) -> Value:
        return operations.binary(node.op, self.value(node.left), self.value(node.right))

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return operations.negated(value)
        return operations.minus(value) if isinstance(node.op, ast.USub) else value

    def _compare(self, node: ast.Compare) -> Value:
        sides = [self.value(side) for side in (node.left, *node.comparators)]
        parts = map(operations.compared, node.ops, sides[:-1], sides[1:])
        return operations.all_or_any(list(parts), True)

    def _boolop(self, node: ast.BoolOp) -> Value:
        every, parts = isinstance(node.op, ast.And), []
        for i, item in enumerate(node.values):
            part = self.value(item) if i == 0 else self._aside(item)
            parts.append(part)
            if part.fixed and bool(part.known) != every:
                break
        return operations.all_or_any(parts, every)

    def _ifexp(self, node: ast.IfExp) -> Value:
        condition = self.value(node.test)
        if condition.fixed:
            return self.value(node.body if condition.known else node.orelse)
        return operations.either(condition, self._aside(node.body), self._aside(node.orelse))

    def _aside(self, node: ast.expr) -> Value:
        """An expression that may not be reached: nothing may be done for it beforehand."""
        before, self.hoisting = self.hoisting, False
        found = self.value(node)
        self.hoisting = before
        return found

    def _attribute(self, node: ast.Attribute) -> Value:
        owner = self.value(node.value)
        if owner.kind == "array" and node.attr == "shape":
            return tuple_of([number(n) for n in owner.shape])
        if owner.kind == "tuple" and node.attr in owner.fields:
            return owner.items[owner.fields.index(node.attr)]
        if owner.kind == "array" and node.attr == "size":
            return number(owner.size)
        if owner.kind == "module":
            found = known_value(getattr(owner.known, node.attr, None))
            if found is not None:
                return found
        raise ValueError(f"{ast.unparse(node)} is not known")

    def _subscript(self, node: ast.Subscript) -> Value:
        owner, places, span = self.places(node)
        if span is not None:
            return self._span(node, element(owner, places), span)
        if owner.kind == "tuple":
            return self._item(owner, places[0])
        if owner.kind != "array":
            raise ValueError(f"{ast.unparse(node)}: a {owner.kind} has no elements")
        return element(owner, places)

    def places(self, node: ast.Subscript) -> tuple[Value, list[Value], ast.Slice | None]:
        """What a subscript is of, its places, and the slice behind these, if there is one."""
        owner = self.value(node.value)
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        span = parts[-1] if isinstance(parts[-1], ast.Slice) else None
        places = parts if span is None else parts[:-1]
        if any(isinstance(place, ast.Slice) for place in places) or (span and span.step):
            raise ValueError(f"{ast.unparse(node)}: one slice, at the end")
        return owner, list(map(self.value, places)), span

    def ends(self, span: ast.Slice, part: Value) -> tuple[Value, Value]:
        """The first place of a slice of an array, and that behind its last."""
        if part.kind != "array":
            raise ValueError(f"a {part.kind} has no elements")
        low = self.value(span.lower) if span.lower else number(0)
        return low, self.value(span.upper) if span.upper else number(part.shape[0])

    def _span(self, node: ast.Subscript, part: Value, span: ast.Slice) -> Value:
        """A part of an array whose length is known."""
        low, high = self.ends(span, part)
        if not (low.fixed and high.fixed):
            raise ValueError(f"{ast.unparse(node)}: its length must be known")
        first = element(part, [low])
        start = first.code if first.kind == "array" else f"{part.within(Binds.PLUS)} + {low.code}"
        shape = (max(high.known - low.known, 0), *part.shape[1:])
        binds = first.binds if first.kind == "array" else Binds.PLUS
        return Value("array", start, binds, shape=shape, dtype=part.dtype, root=part.root)

    def _item(self, owner: Value, place: Value) -> Value:
        if place.fixed:
            return owner.items[place.known]
        found = owner.items[-1]
        for i in range(len(owner.items) - 2, -1, -1):
            chosen = operations.compared(ast.Eq(), place, number(i))
            found = operations.either(chosen, owner.items[i], found)
        return found

    def _call(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if node.keywords and not _is_numpy(function):
            raise ValueError(f"{ast.unparse(node)}: arguments go by place")
        arguments = [self.value(argument) for argument in node.args]
        if function.kind == "type":
            return _converted(function.known, arguments[0])
        if function.kind != "function":
            raise ValueError(f"{ast.unparse(node)} calls something that is not a function")
        return self._called(function.known, arguments)

    def _called(self, function: Any, arguments: list[Value]) -> Value:
        name = getattr(function, "__name__", "")
        if function in (abs, max, min, len):
            return self._builtin(name, arguments)
        if _is_numpy(Value("function", known=function)) and name in ("zeros", "empty"):
            raise ValueError(f"np.{name} is for an assignment to a name")
        module = _module_of(function)
        if module is not None:
            return operations.of_numbers(name, arguments, module)
        self.calls += 1
        return self.call_of(function, arguments, self)

    def _builtin(self, name: str, arguments: list[Value]) -> Value:
        first = arguments[0]
        if name == "len":
            return number(first.shape[0] if first.kind == "array" else len(first.items))
        if name == "abs":
            if first.fixed:
                return number(abs(first.known))
            if first.kind == INT:
                parts = first.within(Binds.PLUS), first.within(Binds.ATOM)
                return Value(INT, f"({parts[0]} < 0 ? -{parts[1]} : {first.code})")
            return Value(DOUBLE, f"fabs({first.code})")
        return reduce(partial(operations.extreme, name == "max"), arguments)


def element(array: Value, places: Sequence[Value]) -> Value:
    """An element of an array, or a part of it: its first places are given."""
    if len(places) > len(array.shape):
        raise ValueError(f"{array.root} has {len(array.shape)} dimensions")
    offset: Value = number(0)
    for i, place in enumerate(places):
        if place.kind != INT:
            raise ValueError(f"an index of {array.root} is no whole number")
        stride = math.prod(array.shape[i + 1 :])
        if place.fixed and place.known < 0:
            place = number(place.known + array.shape[i])
        step = operations.binary(ast.Mult(), place, number(stride)) if stride != 1 else place
        zero = offset.fixed and offset.known == 0
        offset = step if zero else operations.binary(ast.Add(), offset, step)
    if len(places) == len(array.shape):
        own = array.code if array.binds == Binds.ATOM else f"({array.code})"
        return Value(array.dtype, f"{own}[{offset.code}]")
    if offset.fixed and offset.known == 0:
        return replace(array, shape=array.shape[len(places) :])
    text = f"{array.within(Binds.PLUS)} + {offset.within(Binds.TIMES)}"
    return replace(array, code=text, binds=Binds.PLUS, shape=array.shape[len(places) :])


def _converted(kind: type, value: Value) -> Value:
    if value.fixed:
        return number(kind(value.known))
    if kind is float:
        return value.as_double()
    if value.kind == INT:
        return value
    return Value(INT, f"(int){value.within(Binds.UNARY)}", Binds.UNARY)


def _is_numpy(function: Value) -> bool:
    return getattr(function.known, "__module__", None) == "numpy"


def _module_of(function: Any) -> Any:
    """math or numpy, where the function is theirs."""
    name = getattr(function, "__name__", "")
    return next((one for one in (math, np) if getattr(one, name, None) is function), None)
