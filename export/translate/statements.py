"""Statements of a function's body as lines of C."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any

from export.translate import operations
from export.translate.expressions import Called, Expressions, element
from export.translate.scope import Scope, c_name
from export.translate.values import DOUBLE, INT, Binds, Value, flat, number, tuple_of

INDENT = "    "


class Statements:
    """One pass through a body. `live`: variables that were read in the pass before; None: all."""

    def __init__(
        self, scope: Scope, names: dict[str, Any], call: Called, live: set[str] | None
    ) -> None:
        self.scope, self.live = scope, live
        self.expressions = Expressions(scope, names, call)
        self.lines: list[str] = []
        self.depth = 1
        self.returned: list[Value] = []

    def body(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            method = getattr(self, f"_{type(statement).__name__.lower()}", None)
            if method is None:
                raise ValueError(f"line {statement.lineno}: {type(statement).__name__} is unknown")
            method(statement)

    def emit(self, line: str) -> None:
        self.flush()
        self.lines.append(INDENT * self.depth + line)

    def flush(self) -> None:
        before, self.expressions.before = self.expressions.before, []
        self.lines += [INDENT * self.depth + line for line in before]

    def _pass(self, statement: ast.Pass) -> None:
        """Nothing to do."""

    def _break(self, statement: ast.Break) -> None:
        self.emit("break;")

    def _continue(self, statement: ast.Continue) -> None:
        self.emit("continue;")

    def _expr(self, statement: ast.Expr) -> None:
        if isinstance(statement.value, ast.Constant):
            return  # a docstring
        value = self.expressions.value(statement.value)
        self.flush()
        if value.kind != "tuple":
            self.emit(f"{'' if value.kind == 'none' else '(void)'}{value.code};")

    def _return(self, statement: ast.Return) -> None:
        value = self.expressions.value(statement.value) if statement.value else None
        if value is None or value.kind == "none":
            self.emit("return;")
            return
        self.returned.append(value)
        if value.kind == "tuple":
            for i, item in enumerate(flat(value)):
                self.emit(f"*out{i + 1}_ = {item.code};")
            self.emit("return;")
        else:
            self.emit(f"return {value.code};")

    def _if(self, statement: ast.If) -> None:
        condition = self.expressions.value(statement.test)
        if condition.fixed:
            self.body(statement.body if condition.known else statement.orelse)
            return
        self.emit(f"if ({truth(condition)}) {{")
        self._within(statement.body)
        if statement.orelse:
            at = len(self.lines)
            self._within(statement.orelse)
            if len(self.lines) > at:
                self.lines.insert(at, INDENT * self.depth + "} else {")
        self.emit("}")

    def _within(self, body: Sequence[ast.stmt]) -> None:
        self.depth += 1
        self.body(body)
        self.flush()
        self.depth -= 1

    def _while(self, statement: ast.While) -> None:
        self.expressions.hoisting = False
        condition = self.expressions.value(statement.test)
        self.expressions.hoisting = True
        if condition.fixed and not condition.known:
            return
        self.emit("for (;;) {" if condition.fixed else f"while ({truth(condition)}) {{")
        self._within(statement.body)
        self.emit("}")

    def _for(self, statement: ast.For) -> None:
        over = statement.iter
        if isinstance(over, ast.Call) and ast.unparse(over.func) == "range":
            self._range_loop(statement, [self.expressions.value(a) for a in over.args])
            return
        for item in self.expressions.value(over).items:
            self._take(statement.target, item)
            self.body(statement.body)

    def _range_loop(self, statement: ast.For, bounds: list[Value]) -> None:
        first, stop = bounds[:2] if len(bounds) > 1 else (number(0), bounds[0])
        step = bounds[2].known if len(bounds) > 2 else 1
        if not isinstance(step, int):
            raise ValueError(f"line {statement.lineno}: the step of a range must be known")
        if first.fixed and stop.fixed and not range(first.known, stop.known, step):
            return
        name = statement.target.id if isinstance(statement.target, ast.Name) else ""
        self.scope.set(name, Value(INT))
        if not stop.fixed and _assigned(statement.body) & _names(statement.iter):
            held = self.scope.temporary(INT)
            self.emit(f"{held.code} = {stop.code};")
            stop = held
        own, sign = c_name(name), "<" if step > 0 else ">"
        on = {1: f"++{own}", -1: f"--{own}"}.get(step, f"{own} += {step}")
        self.emit(f"for ({own} = {first.code}; {own} {sign} {stop.within(Binds.PLUS)}; {on}) {{")
        self._within(statement.body)
        self.emit("}")

    def _annassign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._take(statement.target, self.expressions.value(statement.value))

    def _assign(self, statement: ast.Assign) -> None:
        made = self._new_array(statement.value)
        if made is not None:
            for target in statement.targets:
                self._hold(target, *made)
            return
        alone = len(statement.targets) == 1 and isinstance(statement.targets[0], ast.Name)
        name = statement.targets[0].id if alone else ""  # type: ignore[attr-defined]
        calls = self.expressions.calls
        value = self.expressions.value(statement.value)
        pure = self.expressions.calls == calls
        if alone and self.live is not None and name not in self.live and value.is_number and pure:
            self.scope.set(name, value)  # nobody asks for it
            return
        for target in statement.targets:
            self._take(target, value)

    def _take(self, target: ast.expr, value: Value) -> None:
        """target = value."""
        if isinstance(target, ast.Tuple):
            self._unpack(target, value)
        elif isinstance(target, ast.Name):
            self._set(target.id, value)
        elif isinstance(target, ast.Subscript):
            self._store(target, value)
        else:
            raise ValueError(f"line {target.lineno}: {ast.unparse(target)} cannot be set")

    def _unpack(self, target: ast.Tuple, value: Value) -> None:
        items = list(value.items)
        if value.kind == "array":
            items = [element(value, [number(i)]) for i in range(value.shape[0])]
        if len(items) != len(target.elts):
            raise ValueError(f"line {target.lineno}: {len(items)} values for {len(target.elts)}")
        set_here = {c_name(n.id) for n in ast.walk(target) if isinstance(n, ast.Name)}
        if len(items) > 1:
            items = [self._kept(item, set_here) for item in items]
        for one, item in zip(target.elts, items, strict=True):
            self._take(one, item)

    def _kept(self, item: Value, names: set[str]) -> Value:
        """An item aside, where what it is made of is set in the same statement."""
        if item.kind == "tuple":
            return tuple_of([self._kept(i, names) for i in item.items], item.fields)
        words = set("".join(c if c.isalnum() or c == "_" else " " for c in item.code).split())
        if not item.is_number or item.fixed or not words & names:
            return item
        held = self.scope.temporary(item.kind)
        self.emit(f"{held.code} = {item.code};")
        return held

    def _set(self, name: str, value: Value) -> None:
        if value.kind == "array":
            self._point(name, value)
            return
        if value.kind == "tuple":
            self._set_tuple(name, value)
            return
        now = self.scope.set(name, value)
        if now.fixed or not now.is_number or (self.live is not None and name not in self.live):
            self.flush()
            return
        self.emit(f"{c_name(name)} = {_as(now.kind, value).code};")

    def _set_tuple(self, name: str, value: Value) -> None:
        """A variable for every item; items are aside first, as the tuple may be made of them."""
        own = {c_name(part) for part in value.parts(name)}
        items = [self._kept(item, own) for item in value.items]
        kinds = tuple(Value(item.kind) for item in items)
        self.scope.set(name, Value("tuple", items=kinds, fields=value.fields))
        for part, item in zip(value.parts(name), items, strict=True):
            self._set(part, item)

    def _point(self, name: str, value: Value) -> None:
        """Another name for an array or a row of it."""
        own = c_name(name)
        known = Value("array", own, shape=value.shape, dtype=value.dtype, root=value.root)
        self.scope.set(name, known)
        if not value.size or (self.live is not None and name not in self.live):
            return
        self.scope.pointers[own] = known
        self.emit(f"{own} = {value.code};")

    def _store(self, target: ast.Subscript, value: Value) -> None:
        owner, places, span = self.expressions.places(target)
        if owner.kind != "array":
            raise ValueError(f"line {target.lineno}: {ast.unparse(target)} is no array")
        self.scope.written.add(owner.root)
        found = element(owner, places)
        if found.kind != "array":
            self.emit(f"{found.code} = {_as(found.kind, value).code};")
        else:
            self._fill(found, span or ast.Slice(), value, target.lineno)

    def _fill(self, array: Value, span: ast.Slice, value: Value, line: int) -> None:
        """Set elements from span.lower to span.upper to a number, or to those of an array."""
        low, high = self.expressions.ends(span, array)
        stride = number(array.size // array.shape[0] if array.shape[0] else 0)
        count = operations.binary(ast.Mult(), operations.binary(ast.Sub(), high, low), stride)
        if count.fixed and count.known <= 0:
            return
        first = operations.binary(ast.Mult(), low, stride)
        start = array.code
        if not (first.fixed and first.known == 0):
            start = f"{array.within(Binds.PLUS)} + {first.within(Binds.TIMES)}"
        if value.kind == "array":
            if count.fixed and count.known != value.size:
                raise ValueError(f"line {line}: {value.size} values for {count.known} places")
            name = "copy" if array.dtype == DOUBLE else "copy_int"
        else:
            name = "fill" if array.dtype == DOUBLE else "fill_int"
            value = _as(array.dtype, value)
        self.emit(f"{name}({start}, {value.code}, {count.code});")

    def _augassign(self, statement: ast.AugAssign) -> None:
        right = self.expressions.value(statement.value)
        target = statement.target
        if isinstance(target, ast.Name):
            before = self.scope.get(target.id)
            if before is None:
                raise ValueError(f"line {statement.lineno}: {target.id} is not known yet")
            found = operations.binary(statement.op, before, right)
            now = self.scope.set(target.id, found)
            sign = operations.SIGNS.get(type(statement.op))
            alive = self.live is None or target.id in self.live
            if not now.fixed and alive and sign is not None and now.kind == found.kind:
                self.emit(f"{c_name(target.id)} {sign[0]}= {_as(now.kind, right).code};")
            else:
                self._set(target.id, found)
            return
        if not isinstance(target, ast.Subscript):
            raise ValueError(f"line {statement.lineno}: {ast.unparse(target)} cannot be set")
        owner, places, span = self.expressions.places(target)
        found = element(owner, places)
        self.scope.written.add(owner.root)
        sign = operations.SIGNS.get(type(statement.op))
        if span or found.kind == "array" or sign is None or sign[0] not in "+-*/":
            raise ValueError(f"line {statement.lineno}: {ast.unparse(statement)} is not known")
        self.emit(f"{found.code} {sign[0]}= {_as(found.kind, right).code};")

    def _new_array(self, node: ast.expr) -> tuple[tuple[int, ...], str, bool] | None:
        """Shape, kind and whether it is zero, where an expression makes an array."""
        if not (isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.zeros", "np.empty")):
            return None
        shape = self.expressions.value(node.args[0])
        sizes = shape.items if shape.kind == "tuple" else (shape,)
        if not all(size.fixed for size in sizes):
            raise ValueError(f"line {node.lineno}: the shape of {ast.unparse(node)} must be known")
        words = [ast.unparse(a) for a in (*node.args[1:], *(k.value for k in node.keywords))]
        dtype = INT if any("int" in word for word in words) else DOUBLE
        return tuple(size.known for size in sizes), dtype, ast.unparse(node.func) == "np.zeros"

    def _hold(self, target: ast.expr, shape: tuple[int, ...], dtype: str, zero: bool) -> None:
        """A new array under a name."""
        if not isinstance(target, ast.Name):
            raise ValueError(f"line {target.lineno}: a new array is assigned to one name")
        code = c_name(target.id)
        whole = Value("array", code, Binds.ATOM, shape=shape, dtype=dtype, root=target.id)
        self.scope.arrays[target.id] = whole
        self.scope.set(target.id, whole)
        if zero and whole.size:
            helper = "fill" if dtype == DOUBLE else "fill_int"
            self.emit(f"{helper}({code}, {'0.0' if dtype == DOUBLE else '0'}, {whole.size});")


def truth(value: Value) -> str:
    return value.code if value.kind == INT else f"{value.within(Binds.PLUS)} != 0.0"


def _as(kind: str, value: Value) -> Value:
    if not value.is_number:
        raise ValueError(f"a {value.kind} is no number")
    if kind == DOUBLE:
        return value.as_double()
    if value.kind == DOUBLE:
        raise ValueError(f"{value.code} is set as a whole number")
    return value


def _assigned(body: Sequence[ast.stmt]) -> set[str]:
    nodes = (node for statement in body for node in ast.walk(statement))
    return {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def _names(node: ast.expr) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
