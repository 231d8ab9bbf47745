"""Text of fixed forms with other numbers, words, cells and lines in its headers."""

from __future__ import annotations

import random
import re

from benchmarks.attack.record_files.case import Case, holding

NUMBERS = (
    *("0", "1", "7", "-5", "1000000", "1000000000000", "9" * 25, "9" * 5000, "٣", "1e3", "", "nan"),
    *("1e-300", "1e300", "1e400", "inf", "0.0", "-0.02", "1.2.3", "...", ".", "5e-324", "0x10"),
)
TEXTS = (
    *("\x1b[31mred", "\x1b]0;title\x07", "\x9b2J", "\x85", "\u202eabc", "[red]x[/red]", "=1+1"),
    *("${oc.env:ATTACK_SECRET}", "$(touch executed)", "\0", "x" * 100_000, " " * 50_000, "\\", "{"),
    *("units=" * 20_000, "chan1" * 20_000, "location:" * 20_000, "/&" + " " * 50_000),
    "end of data",
    *("units of uncor accel are " * 5_000, "1" * 50_000 + " points of accel data", "]\n# x", "'\""),
    *("counts", "units=counts (50),Format=(8I10)", "(8I10)", "(0F0.0)", "(99999F1.0)"),
    "(1F999999)",
    *("MICRON", "CM/SEC2", "in/s/s", "g", "0.1*g", "9**9**9", "((((((", "100 points of veloc data"),
)  # fmt: skip


def worsened(draw: random.Random, made: tuple[Case, str], ends: int = 0) -> Case:
    """The file with some of its header changed; `ends` is where the header does, 0 for all."""
    case, text = made
    if draw.random() < 0.3:
        return case
    done = []
    for _ in range(draw.choice((1, 1, 2, 4))):
        way = draw.choice(WORSE)
        text = way(draw, text, ends)
        done.append(way.__name__.strip("_"))
    raw = text.encode("latin-1" if draw.random() < 0.5 else "utf-8", "replace")
    return Case(f"{case.what} with {', '.join(done)}", case.suffix, holding(raw), case.mapped)


def _number(draw: random.Random, text: str, ends: int) -> str:
    """Another number in a line that has words, or anywhere in the header."""
    head = text[:ends] if ends else text
    places = list(re.finditer(r"(?<=[ =])\d*\.?\d+(?:E[+-]\d+)?", head))
    telling = [m for m in places if re.search("[A-Za-z]{2}", _line(text, m.start()))]
    if not places:
        return text
    found = draw.choice(telling if telling and draw.random() < 0.8 else places)
    number = draw.choice(NUMBERS)
    if draw.random() < 0.3:
        number = number.rjust(found.end() - found.start())
    return text[: found.start()] + number + text[found.end() :]


def _line(text: str, at: int) -> str:
    first = text.rfind("\n", 0, at) + 1
    return text[first : (text.find("\n", at) + 1 or len(text) + 1) - 1]


def _word(draw: random.Random, text: str, ends: int) -> str:
    """Another word in place of one, or beside it."""
    places = list(re.finditer(r"[A-Za-z/^]{2,}\S*", text[:ends] if ends else text))
    if not places:
        return text
    found = draw.choice(places)
    upto = found.end() if draw.random() < 0.5 else found.start()
    return text[: found.start()] + draw.choice(TEXTS) + text[upto:]


def _value(draw: random.Random, text: str, ends: int) -> str:
    """Another cell among the numbers."""
    cells = (
        "**********",
        "       nan",
        "       inf",
        "     1e999",
        "    1.0D02",
        "\x1b[2J",
        "1-300",
    )
    at = draw.randrange(ends, len(text)) if len(text) > ends else 0
    return text[:at] + draw.choice(cells) + text[at + 10 :]


def _lines(draw: random.Random, text: str, ends: int) -> str:
    """Lines lost, doubled or swapped."""
    lines = text.splitlines()
    k, j = draw.randrange(len(lines)), draw.randrange(len(lines))
    way = draw.randrange(4)
    if way == 0:
        del lines[k : k + draw.choice((1, 1, 10, len(lines)))]
    elif way == 1:
        lines[k:k] = lines[k : k + draw.choice((1, 40))] * draw.choice((1, 300))
    elif way == 2:
        lines[k], lines[j] = lines[j], lines[k]
    else:
        lines = [line for line in lines if "nd" not in line.lower()[:20]]  # no ends of channels
    return "\n".join(lines)


def _again(draw: random.Random, text: str, ends: int) -> str:
    """The whole once more, or so often that channels cannot be told apart quickly."""
    return text * min(draw.choice((2, 2, 30)), max(2, 2_000_000 // max(len(text), 1)))


def _announced(draw: random.Random, text: str, ends: int) -> str:
    """Many announcements of short series, without an end of a channel."""
    line = "1 points of accel data equally spaced at .02 sec, in cm/sec2. (8f10.3)\n     1.000\n"
    line = line if draw.random() < 0.5 else line.replace("1 points", "0 points")
    return text[: text.find("\n") + 1] + line * draw.choice((3, 300, 20_000))


WORSE = (_number, _number, _number, _word, _word, _value, _lines, _again, _announced)
