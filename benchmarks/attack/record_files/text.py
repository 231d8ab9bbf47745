"""Text files and JSON, with odd cells, lines and encodings."""

from __future__ import annotations

import json
import random
import re
from typing import Any

from benchmarks.attack.record_files.case import Case, Columns, holding

CELLS = (
    *("", "nan", "inf", "-inf", "1e400", "-1e400", "1e-400", "NA", "abc", "1,5", "1.234,5", "0x1F"),
    *(
        "2025-03-06",
        "2025-13-45T99:99",
        "2025-03-06T12:00:00",
        "12:00",
        "1+2j",
        '"',
        '""',
        "'",
        "=1",
    ),
    *(
        "9" * 25,
        "9" * 400,
        "9007199254740993",
        "#",
        "# x",
        "\0",
        "\x1b[2J",
        "é",
        " ",
        "-",
        "+",
        ".",
    ),
    *("1e", "1_000", "١", "∞", "９", "true", "9.81 m/s2", "5 " + "[" * 50, "(" * 2000, " " * 2000),
    *("1." + "0" * 3000, "1" + ",111" * 500, "1" + "+" * 3000, "$(touch executed)", "\u202e1"),
)


def csv(draw: random.Random, columns: Columns) -> Case:
    delimiter = draw.choice((",", ",", ",", ";", "\t", " ", "|"))
    rows = [[repr(float(x)) for x in row] for row in zip(*columns.values(), strict=True)]
    head = list(columns)
    spoilt = delimiter in " |" or any(re.search(r"[\s,;\"#%\[(]", n.strip()) or not n for n in head)
    if rows and draw.random() < 0.25:
        spoilt = True
        for _ in range(draw.choice((1, 1, 3, 20))):
            k, j = draw.randrange(len(rows)), draw.randrange(len(head))
            for row in rows if draw.random() < 0.15 else [rows[k]]:
                row[min(j, len(row) - 1)] = draw.choice(CELLS)
        if draw.random() < 0.3:
            k = draw.randrange(len(rows))
            rows[k] = draw.choice((rows[k][:-1], [*rows[k], "1"], [], [""] * len(head))) or [""]
    if draw.random() < 0.1:
        spoilt, head = (
            True,
            [n + draw.choice((" [g]", " [m/s^2]", "[[[", " [s]", "")) for n in head],
        )
    lines = [delimiter.join(f'"{n}"' if draw.random() < 0.1 else n for n in head)]
    spoilt = spoilt or '"' in lines[0]
    lines += [delimiter.join(row) for row in rows]
    if draw.random() < 0.1:
        spoilt = True
        extra = draw.choice(
            ("", "# comment", "sep=;", "preamble", "a" * 2_000_000, "\0", "\x1b[0m")
        )
        lines.insert(draw.choice((0, 1, len(lines))), extra)
    text = draw.choice(("\n", "\n", "\r\n", "\r")).join(lines)
    code = draw.choice(("utf-8",) * 5 + ("utf-8-sig", "utf-16", "cp1252", "latin-1", "utf-32"))
    raw = text.encode(code, "replace")
    suffix = draw.choice((".csv", ".csv", ".txt", ".tsv", ".dat"))
    good = None if spoilt or code not in ("utf-8", "utf-8-sig") else columns
    return Case(
        f"CSV {code} {delimiter!r} {len(rows)} rows {head}", suffix, holding(raw), truth=good
    )


def json_file(draw: random.Random, columns: Columns) -> Case:
    lists: dict[str, Any] = {name: values.tolist() for name, values in columns.items()}
    odd: dict[str, Any] = {
        "huge": [10**400] * 3,
        "text": ["1", "2"],
        "mixed": [1, "2", None, True, [], {}],
        "nested": [[1, 2], [3, 4]],
        "dt": 1e-320,
        "fs": 10**400,
        "ts": "0.01",
        "deep": json.loads("[" * 400 + "]" * 400),
        "bools": [True, False],
        "when": ["2025-01-01T00:00:00", "2025-13-01"],
        "\x1b[31m": "\x1b[31m",
        "null": None,
        "many": {f"m{k}": 1 for k in range(50)},
    }
    more = draw.sample(sorted(odd), draw.choice((0, 0, 0, 1, 2)))
    content: Any = {**lists, **{key: odd[key] for key in more}}
    form = draw.randrange(8)
    good: Columns | None = None
    if form == 0:
        content = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    elif form == 1:
        content = {"data": [list(row) for row in zip(*lists.values(), strict=True)]}
    elif form == 2:
        content = draw.choice((5, None, "x", [], {}, [1, 2], [[]], [{}], {"data": [[]]}, [[1], {}]))
    elif form == 3:
        content = {f"c{k}": [1.0, 2.0] for k in range(draw.choice((100, 15_000)))}
    elif not more and all(n.strip() == n and n and "[" not in n for n in columns):
        good = columns
    text = json.dumps(content)
    if draw.random() < 0.05:
        text = draw.choice(
            ("[" * 100_000, '{"a":' * 5000, '{"a": 1e999}', '{"a": [' + "9" * 5000 + "]}")
        )
        good = None
    return Case(f"JSON {form} {more} {list(columns)}", ".json", holding(text.encode()), truth=good)
