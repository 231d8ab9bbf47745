"""All text that leaves for another language: identifiers, units, comments and strings.

A run may come from a stranger, and its exported files are compiled and run. A name is written as an
identifier or not at all, a unit as a word of the grammar below or not at all. Every other text is
data or a comment: it is quoted by one function for each language and written on one line, with
`[U+…]` in place of characters that cannot be printed.
"""

from __future__ import annotations

import keyword
import math
import re
import string
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

from export.translate.scope import KEYWORDS
from models.estimator import Estimator

GROUND = "s_ddot1"  # the acceleration of the ground
MOTION = (("x", "m"), ("v", "m/s"), ("a", "m/s2"))
WIDTH = 90  # of a line of text in a comment
LONGEST_NAME = 40  # characters
LONGEST_TEXT = 1000
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")  # those with _ at first are the compiler's

DEVICES = ["con", "prn", "aux", "nul"]  # names that Windows gives to no file
DEVICES += [f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)]
RESERVED = {*KEYWORDS.split(), *DEVICES, "asm", "typeof", "main"}
RESERVED |= {word.lower() for word in (*keyword.kwlist, *keyword.softkwlist)}

SI = "m g s A K mol cd rad sr Hz N Pa J W C V F S Wb T H Ω Ohm ohm bar"
OTHERS = """
kg min h hr sec degC degF °C °F deg ° % gal Gal in inch ft feet mil lb lbs lbf kip kips kgf kp
t tf tonf psi ksi G gn
"""
_SYMBOL = rf"(?:(?:da|[YZEPTGMkhdcmµμunpf])?(?:{'|'.join(SI.split())})|{'|'.join(OTHERS.split())})"
_FACTOR = rf"(?:1|{_SYMBOL}(?:\^?-?[1-9]|⁻?[¹²³⁴⁵⁶⁷⁸⁹])?)"
UNIT = re.compile(rf"{_FACTOR}(?:(?: ?[·/] ?| ){_FACTOR}){{0,5}}")
C_ENDS = re.compile(r"\*(?=/)|/(?=\*)|\\|\?(?=\?)")  # of comments, lines and trigraphs
C_LETTERS = frozenset(string.ascii_letters + string.digits + " !#$%&'()*+,-./:;<=>@[]^_`{|}~")
PLAIN_POWERS = str.maketrans("⁻¹²³⁴⁵⁶⁷⁸⁹", "-123456789")


def inputs_of(model: Estimator) -> list[tuple[str, str]]:
    """Name and unit of every excitation (m,): forces, displacements and velocities of supports.

    Where a model does not know which is which, all are called u, of unknown unit.
    """
    forces, supports = getattr(model, "forces", None), getattr(model, "supports", None)
    if isinstance(forces, int) and isinstance(supports, int):
        unit = "m/s2" if getattr(model, "base", False) else "N"
        named = [(f"f{i + 1}", unit) for i in range(forces)]
        named += [(f"s{i + 1}", "m") for i in range(supports)]
        return named + [(f"s_dot{i + 1}", "m/s") for i in range(supports)]
    return [(f"u{i + 1}", "") for i in range(model.inputs)]


def motion_of(model: Estimator) -> list[tuple[str, list[str], str]]:
    """The outputs x, v, a (n,) of a motion, of floors without a sensor, too."""
    numbers = range(1, getattr(model, "floors", model.dofs) + 1)
    return [(name, [f"{name}{i}" for i in numbers], unit) for name, unit in MOTION]


def elements_of(model: Estimator, count: int) -> list[str]:
    """A name for every element: the nodes that it joins, where the model knows them."""
    pairs = model.elements or []
    known = ["_".join(pair) for pair in pairs] if len(pairs) == count else [""] * count
    return identifiers(known, "e")


def loops_of(elements: Sequence[str]) -> list[tuple[str, list[str], str]]:
    """The outputs of named elements: deformations y and forces r."""
    deformations = ("y", [f"deformation_{name}" for name in elements], "m")
    return [deformations, ("r", [f"force_{name}" for name in elements], "N")]


def identifier(text: str) -> str:
    """The word of letters, digits and underscores that is most like a text, in every language.

    It begins with a letter, with `model_` where the text does not, and is no reserved word.
    """
    word = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")[:LONGEST_NAME].rstrip("_")
    word = word if re.match(r"[A-Za-z]", word) else f"model_{word}".rstrip("_")
    return f"{word}_" if word.lower() in RESERVED else word


def is_identifier(name: object) -> bool:
    """Whether a name is one as it is: ASCII, not reserved anywhere, not too long."""
    found = isinstance(name, str) and len(name) <= LONGEST_NAME and IDENTIFIER.fullmatch(name)
    return bool(found) and str(name).lower() not in RESERVED


def identifiers(names: Sequence[str], kind: str, taken: Iterable[str] = ()) -> list[str]:
    """Names of siblings: those that are identifiers as they are, each other one by its number.

    No two are the same, and none is taken: of `a-b`, `a_b`, `a_b` and the kind `input_` come
    input_1, a_b, input_3.
    """
    used, found = set(taken), []
    for name in names:
        found.append(name if is_identifier(name) and name not in used else "")
        used.add(found[-1])
    for i, name in enumerate(found):
        own = name or f"{kind}{i + 1}"
        while not name and own in used:
            own += "_"
        used.add(own)
        found[i] = own
    return found


def unit_of(text: str) -> str:
    """A unit of base units, powers, products and quotients unchanged; none of other texts."""
    return text if UNIT.fullmatch(text) else ""


def plain_unit(unit: str) -> str:
    """The same without raised digits: m/s2."""
    return unit.translate(PLAIN_POWERS)


def channels_of(
    names: Sequence[str], units: Sequence[str]
) -> tuple[list[tuple[str, str]], list[str]]:
    """Name and unit of each channel of excitation, and lines about names and units left behind."""
    found = identifiers(names, "input_", ["time"])  # a column of every table
    known = [unit_of(unit) for unit in units]
    notes = []
    for name, own, text, unit in zip(names, found, units, known, strict=True):
        notes += [] if own == name else [f'{own} is "{short(name)}" in the run']
        notes += [] if unit == text else [f'{own} has no unit, which "{short(text)}" is not']
    return list(zip(found, known, strict=True)), wrap(notes)


def wrap(lines: Iterable[str]) -> list[str]:
    """Printable lines of some 90 characters at most."""
    return [
        part
        for line in lines
        for part in textwrap.wrap(printable(line), WIDTH, subsequent_indent="  ")
    ]


def printable(value: object) -> str:
    """A text on one line, without control characters, signs of direction and half surrogates."""
    text = str(value)
    return text if text.isprintable() else "".join(map(_shown, text))


def short(value: object) -> str:
    """A printable text of no more than LONGEST_TEXT characters."""
    text = str(value)
    return printable(text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 1]}…")


def _shown(letter: str) -> str:
    return letter if letter.isprintable() else _code(letter)


def _code(letter: str) -> str:
    return f"[U+{ord(letter):04X}]"


def plain_values(value: Any) -> Any:
    """Mappings, lists, printable texts and finite numbers, as JSON has them; null for others."""
    if isinstance(value, str):
        return short(value)
    if hasattr(value, "items"):
        return {short(key): plain_values(inner) for key, inner in value.items()}
    if hasattr(value, "__iter__"):
        return [plain_values(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, bool | int | float) else short(value)


def c_comment(lines: Iterable[str]) -> str:
    """A comment of C, which nothing in its lines can end, splice or spell by trigraphs."""
    safe = (C_ENDS.sub(lambda found: _code(found[0]), printable(line)) for line in lines)
    return "/* " + "\n".join(f"   {line}".rstrip() for line in safe)[3:] + " */"


def c_string(text: str) -> str:
    """A string of C with its quotes."""
    return '"' + "".join(map(_in_c_string, text)) + '"'


def _in_c_string(letter: str) -> str:
    if letter == "\n":
        return "\\n"
    if letter in C_LETTERS:
        return letter
    return "".join(f"\\{byte:03o}" for byte in letter.encode("utf-8", "replace"))


def python_comment(lines: Iterable[str]) -> str:
    """Comments of Python, to the end of each line."""
    return "\n".join(f"# {printable(line)}".rstrip() for line in lines)
