"""The variables of a function that is being translated, and what it reads and writes."""

from __future__ import annotations

from collections.abc import Iterable

from export.translate.operations import HELPERS, OF_NUMBERS, ROUNDED, TESTED
from export.translate.values import Value, common_value, tuple_of

KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while
new class this delete template operator try catch throw bool true false
"""  # of C, and of C++ that C leaves free
TAKEN = {*KEYWORDS.split(), *OF_NUMBERS.values(), *ROUNDED, *TESTED, *HELPERS}
TAKEN |= {"abs", "INFINITY", "NAN", "m"}  # m: the model


def c_name(name: str) -> str:
    return f"{name}_" if name in TAKEN else name.strip("_") or "unused"


class Scope:
    """Variables by name. They become known over some passes through the function's body."""

    def __init__(self, arguments: dict[str, Value]) -> None:
        self.arguments = dict(arguments)
        self.kinds: dict[str, Value] = dict(arguments)
        for name, value in list(arguments.items()):
            if value.kind == "tuple" and not value.fixed:
                del self.arguments[name]
                self._open(name, value)
        self.changed = False
        self.read: set[str] = set()  # variables and arrays by their names in Python
        self.written: set[str] = set()  # arrays whose elements are set
        self.arrays: dict[str, Value] = {}  # made here
        self.pointers: dict[str, Value] = {}  # other names of arrays or rows of them
        self.temporaries: list[Value] = []

    def _open(self, name: str, value: Value) -> None:
        """An argument for every item of a tuple."""
        for own, item in zip(value.parts(name), value.items, strict=True):
            self.kinds[own] = item
            if item.kind == "tuple" and not item.fixed:
                self._open(own, item)
            else:
                self.arguments[own] = item

    def begin_pass(self) -> None:
        """Forget what an earlier pass read and wrote, where kinds were not all known yet."""
        self.changed = False
        self.read, self.written = set(), set()
        self.arrays, self.pointers, self.temporaries = {}, {}, []

    def set(self, name: str, value: Value) -> Value:
        """What the variable `name` is, given this value too. Raises ValueError if it is none."""
        before = self.kinds.get(name)
        try:
            now = common_value(before, value)
        except ValueError as error:
            raise ValueError(f"{name} {error}") from None
        if before is None or (now.kind, now.fixed, now.known, now.shape) != (
            *(before.kind, before.fixed, before.known, before.shape),
        ):
            self.changed = self.changed or repr(now) != repr(before)
        self.kinds[name] = now
        return now

    def get(self, name: str) -> Value | None:
        """A variable as an expression."""
        found = self.kinds.get(name)
        if found is not None and found.kind == "tuple" and not found.fixed:
            return tuple_of([self._part(own) for own in found.parts(name)], found.fields)
        if found is None or (found.fixed and found.kind != "array"):
            return found
        if found.is_number:
            return Value(found.kind, c_name(name))
        return found

    def _part(self, name: str) -> Value:
        found = self.get(name)
        if found is None:
            raise ValueError(f"{name} is not known")
        return found

    def temporary(self, kind: str) -> Value:
        found = Value(kind, f"t{len(self.temporaries) + 1}_")
        self.temporaries.append(found)
        return found

    def declarations(self) -> Iterable[str]:
        """Lines that declare what is not an argument."""
        numbers: dict[str, list[str]] = {}
        for name, value in self.kinds.items():
            given = self.arguments.get(name)
            if value.is_number and not value.fixed and name in self.read:
                if given is None:
                    numbers.setdefault(value.kind, []).append(f"{c_name(name)} = 0")
                elif given.fixed:
                    text = f"{c_name(name)} = {given.code}"
                    numbers.setdefault(value.kind, []).append(text)
        for one in self.temporaries:
            numbers.setdefault(one.kind, []).append(f"{one.code} = 0")
        for kind, names in sorted(numbers.items()):
            for first in range(0, len(names), 8):
                yield f"{kind} {', '.join(names[first : first + 8])};"
        for name, one in self.pointers.items():
            constant = "" if one.root in self.written else "const "
            yield f"{constant}{one.dtype} *{name} = 0;"
        for array in self.arrays.values():
            yield f"{array.dtype} {array.code}[{max(array.size, 1)}];"
