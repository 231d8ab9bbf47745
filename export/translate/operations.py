"""Arithmetic of known and unknown numbers: folded where all is known, else C text."""

from __future__ import annotations

import ast
import operator
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from export.translate.values import DOUBLE, INT, Binds, Value, number, tuple_of

FOLDED: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.BitAnd: operator.and_,
    ast.BitOr: operator.or_,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
BITS = {ast.BitAnd: "&", ast.BitOr: "|", ast.LShift: "<<", ast.RShift: ">>"}
SIGNS: dict[type[ast.AST], tuple[str, int]] = {
    ast.Add: ("+", Binds.PLUS),
    ast.Sub: ("-", Binds.PLUS),
    ast.Mult: ("*", Binds.TIMES),
    ast.Div: ("/", Binds.TIMES),
    ast.Lt: ("<", Binds.COMPARED),
    ast.LtE: ("<=", Binds.COMPARED),
    ast.Gt: (">", Binds.COMPARED),
    ast.GtE: (">=", Binds.COMPARED),
    ast.Eq: ("==", Binds.COMPARED),
    ast.NotEq: ("!=", Binds.COMPARED),
}
OF_NUMBERS = {  # of math and numpy, with the name that C has
    **{n: n for n in ("exp", "expm1", "log", "log1p", "log2", "log10", "sqrt", "hypot", "pow")},
    **{n: n for n in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "asin", "acos", "atan")},
    **{n: n for n in ("atan2", "fabs", "copysign", "fmod")},
    **{"abs": "fabs", "power": "pow", "arctan": "atan", "arctan2": "atan2"},
}
ROUNDED = ("floor", "ceil")  # whole numbers of math, doubles of numpy
WITHOUT_SIGN = ("uint64", "uintp")  # indices that are not negative are plain ones in C
TESTED = ("isfinite", "isnan", "isinf")
HELPERS = {  # functions of C that a program brings along, if its text calls them
    text.partition("(")[0].split()[-1]: text
    for text in Path(__file__).with_name("helpers.c").read_text("utf-8").strip().split("\n\n")
}


def binary(sign: ast.operator, a: Value, b: Value) -> Value:
    """a `sign` b. Raises ValueError for other kinds than numbers."""
    if not (a.is_number and b.is_number):
        raise ValueError(f"arithmetic of {a.kind} and {b.kind}; write it element by element")
    if a.fixed and b.fixed:
        return number(FOLDED[type(sign)](a.known, b.known))
    kind = DOUBLE if DOUBLE in (a.kind, b.kind) else INT
    if isinstance(sign, ast.Pow):
        return _power(a, b)
    if isinstance(sign, ast.FloorDiv | ast.Mod):
        if kind == DOUBLE:
            raise ValueError("// and % take whole numbers here")
        name = "floor_quotient" if isinstance(sign, ast.FloorDiv) else "floor_remainder"
        return Value(INT, f"{name}({a.code}, {b.code})")
    if type(sign) in BITS:
        return Value(INT, f"({a.within(Binds.ATOM)} {BITS[type(sign)]} {b.within(Binds.ATOM)})")
    if type(sign) not in SIGNS:
        raise ValueError(f"{type(sign).__name__} is no arithmetic that is known here")
    text, binds = SIGNS[type(sign)]
    if isinstance(sign, ast.Div) or kind == DOUBLE:
        a, b, kind = a.as_double(), b.as_double(), DOUBLE
    return Value(kind, f"{a.within(binds)} {text} {b.within(binds + 1)}", binds)


def _power(a: Value, b: Value) -> Value:
    """A whole exponent is repeated multiplication, as compiled Python has it."""
    names = {2: "squared", 3: "cubed"}
    if b.fixed and b.kind == INT and b.known in names and a.kind == DOUBLE:
        return Value(DOUBLE, f"{names[b.known]}({a.code})")
    if a.kind == INT and b.kind == INT:
        raise ValueError("powers of whole numbers must be known")
    return Value(DOUBLE, f"pow({a.as_double().code}, {b.as_double().code})")


def compared(sign: ast.cmpop, a: Value, b: Value) -> Value:
    """One comparison. Raises ValueError for operands that are not numbers, except None."""
    if isinstance(sign, ast.Is | ast.IsNot):
        same = a.kind == b.kind == "none"
        return number(same == isinstance(sign, ast.Is))
    if a.fixed and b.fixed:
        return number(bool(FOLDED[type(sign)](a.known, b.known)))
    if not (a.is_number and b.is_number):
        raise ValueError(f"a {a.kind} is compared with a {b.kind}")
    if DOUBLE in (a.kind, b.kind):
        a, b = a.as_double(), b.as_double()
    text, binds = SIGNS[type(sign)]
    return Value(INT, f"{a.within(binds + 1)} {text} {b.within(binds + 1)}", binds)


def all_or_any(parts: Sequence[Value], every: bool) -> Value:
    """`and` or `or` of conditions; those that are known decide or drop out."""
    kept = []
    for part in parts:
        if not part.fixed:
            kept.append(part)
        elif bool(part.known) != every:
            if not kept:
                return number(not every)
            kept.append(number(bool(part.known)))
            break
    if not kept:
        return number(every)
    if len(kept) == 1:
        return kept[0]
    text, binds = (" && ", Binds.AND) if every else (" || ", Binds.OR)
    return Value(INT, text.join(part.within(Binds.COMPARED) for part in kept), binds)


def negated(value: Value) -> Value:
    if value.fixed:
        return number(not value.known)
    return Value(INT, f"!{value.within(Binds.ATOM)}", Binds.UNARY)


def minus(value: Value) -> Value:
    if value.fixed:
        return number(-value.known)
    return Value(value.kind, f"-{value.within(Binds.ATOM)}", Binds.UNARY)


def either(condition: Value, yes: Value, no: Value) -> Value:
    """yes if condition else no, of numbers."""
    if condition.fixed:
        return yes if condition.known else no
    if yes.kind == no.kind == "tuple":
        pairs = zip(yes.items, no.items, strict=True)
        return tuple_of([either(condition, one, other) for one, other in pairs])
    if yes.kind == no.kind == "array" and yes.shape == no.shape and not yes.size:
        return yes  # nothing is chosen between
    if not (yes.is_number and no.is_number):
        raise ValueError(f"a choice between {yes.kind} and {no.kind}")
    kind = yes.kind
    if yes.kind != no.kind:
        yes, no, kind = yes.as_double(), no.as_double(), DOUBLE
    parts = (condition.within(Binds.OR), yes.within(Binds.OR), no.within(Binds.CHOSEN))
    return Value(kind, f"{parts[0]} ? {parts[1]} : {parts[2]}", Binds.CHOSEN)


def extreme(largest: bool, a: Value, b: Value) -> Value:
    """max or min of two numbers, the first where they are equal or not comparable."""
    if a.fixed and b.fixed:
        return number((max if largest else min)(a.known, b.known))
    name = "larger" if largest else "smaller"
    if a.kind == b.kind == INT:
        return Value(INT, f"{name}_int({a.code}, {b.code})")
    return Value(DOUBLE, f"{name}({a.as_double().code}, {b.as_double().code})")


def of_numbers(name: str, arguments: Sequence[Value], module: Any) -> Value:
    """math.name or np.name of numbers. Raises ValueError for one that C has not."""
    if name in WITHOUT_SIGN and [a.kind for a in arguments] == [INT]:
        return arguments[0]
    if all(a.fixed for a in arguments):
        return number(getattr(module, name)(*(a.known for a in arguments)))
    text = ", ".join(a.as_double().code for a in arguments)
    if name in TESTED:
        return Value(INT, f"({name}({text}) != 0)")
    if name in ROUNDED:
        if module.__name__ == "math":
            return Value(INT, f"(int){name}({text})", Binds.UNARY)
        return Value(DOUBLE, f"{name}({text})")
    if name not in OF_NUMBERS:
        raise ValueError(f"{module.__name__}.{name} is not among the functions known here")
    return Value(DOUBLE, f"{OF_NUMBERS[name]}({text})")
