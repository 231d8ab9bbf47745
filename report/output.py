"""Tables and pictures as files: CSV in full precision, Markdown, LaTeX (booktabs), PNG and PDF."""

from __future__ import annotations

import base64
import csv
import io
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from data.arguments import plain
from data.whole_file import whole_file, write_text
from report.style import words_as_they_stand

FORMULAS = tuple("=+-@＝＋－＠")  # first characters of a formula in some spreadsheet
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf)")
WORDS = ("setting", "value", "motion", "varied")  # columns of long texts


@dataclass(frozen=True)
class Section:
    """Lines of texts under a heading each; a title above them and notes below, where there are."""

    head: Sequence[str]
    lines: Sequence[Sequence[str]]
    title: str = ""
    notes: Sequence[str] = field(default_factory=tuple)


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line for each row, full precision; nothing for None."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(spreadsheet, rows[0] if rows else ()))
    for row in rows:
        writer.writerow(["" if value is None else spreadsheet(value) for value in row.values()])
    return text.getvalue()


def spreadsheet(value: Any) -> Any:
    """A cell of CSV: a text that would be a formula gets a quote before it, as spreadsheets do.

    Numbers stay as they are, those that are texts too, such as "-3.5".
    """
    if not isinstance(value, str):
        return value
    text = plain(value)
    formula = text[:1] in FORMULAS and len(text) > 1 and not NUMBER.fullmatch(text)
    return f"'{text}" if formula else text


def markdown(
    head: Sequence[str], lines: Sequence[Sequence[str]], left: Collection[int] | None = (0,)
) -> str:
    """A table; all columns but those at `left` to the right, None: all to the left."""
    rules = ["---" if left is None or i in left else "---:" for i in range(len(head))]
    rows = (head, rules, *lines)
    return "\n".join(f"| {' | '.join(map(_markdown_cell, line))} |" for line in rows)


def _markdown_cell(text: str) -> str:
    """One cell: no line ends, no bars that would begin another cell, no HTML outside of code."""
    parts = re.split(r"(`+[^`]*`+)", re.sub(r"(?<!\\)\|", r"\|", plain(text)))
    return "".join(p if p.startswith("`") else p.replace("<", "&lt;") for p in parts)


def code(text: str) -> str:
    """Text as code, also where it holds a backquote."""
    return f"`` {text} ``" if "`" in text else f"`{text}`"


def sections_markdown(
    sections: Sequence[Section], caption: str = "", label: Callable[[str], str] = code
) -> str:
    """Tables with titles and notes; the first text of each line through `label`."""
    blocks: list[str] = []
    for section in sections:
        lines = [(label(first), *rest) for first, *rest in section.lines]
        blocks += [f"**{section.title}**"] if section.title else []
        blocks += [markdown(section.head, lines), *section.notes]
    return "\n\n".join([*blocks, *([f"{caption}."] if caption else [])]) + "\n"


def latex(sections: Sequence[Section], caption: str, groups: Sequence[tuple[str, int]] = ()) -> str:
    """A tabular for the booktabs package, titles on lines of their own.

    groups: headings above the head, (text, columns that it spans).
    """
    head = sections[0].head
    lines = [
        rf"% needs \usepackage{{booktabs}}; {escaped(caption)}",
        r"\begin{tabular}{l" + "r" * (len(head) - 1) + "}",
        r"\toprule",
        *_group_lines(groups),
        _latex_line(head),
    ]
    for section in sections:
        lines.append(r"\midrule")
        if section.title:
            title = rf"\emph{{{escaped(section.title)}}}"
            lines.append(rf"\multicolumn{{{len(head)}}}{{l}}{{{title}}} \\")
        lines += map(_latex_line, section.lines)
        lines += [f"% {escaped(note)}" for note in section.notes]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _latex_line(texts: Sequence[str]) -> str:
    return " & ".join(map(escaped, texts)) + r" \\"


def _group_lines(groups: Sequence[tuple[str, int]]) -> list[str]:
    if not groups:
        return []
    texts, rules, column = [], "", 1
    for text, count in groups:
        over = rf"\multicolumn{{{count}}}{{c}}{{{escaped(text)}}}"
        texts.append(over if text else " & " * (count - 1))
        rules += rf"\cmidrule(lr){{{column}-{column + count - 1}}}" if text else ""
        column += count
    return [" & ".join(texts) + r" \\", rules]


def escaped(text: str) -> str:
    """Text for LaTeX; a cell that begins with a bracket would be an argument of the \\\\ before."""
    signs = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    signs |= {sign: f"\\{sign}" for sign in "&%$#_{}"} | {"–": "--", "×": r"$\times$"}
    done = "".join(signs.get(sign, sign) for sign in plain(text))
    return f"{{}}{done}" if done.startswith("[") else done


def printed(section: Section, left: Sequence[int] = (0,), fold: bool = False) -> Table:
    """For the terminal. Texts, for brackets in strings are markup.

    left: columns of words, of which those after the first may wrap. fold: all columns may, in the
    middle of a word.
    """
    table = Table(title=Text(section.title, style="table.title"), title_justify="left")
    for i, name in enumerate(section.head):
        if name in WORDS:
            table.add_column(Text(name), overflow="fold", min_width=18)
        else:
            side: Any = "left" if i in left else "right"
            wraps: Any = {"overflow": "fold"} if fold else {"no_wrap": i not in left[1:]}
            table.add_column(Text(name), justify=side, **wraps)
    for line in section.lines:
        table.add_row(*map(Text, line))
    return table


def write_texts(folder: Path, name: str, texts: Mapping[str, str]) -> list[Path]:
    """{kind: text} as name.kind in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, text in texts.items():
        write_text(folder / f"{name}.{kind}", text)
    return [folder / f"{name}.{kind}" for kind in texts]


def _laid_out(figure: Figure) -> None:
    """Find the places of all parts once: savefig would for every file, which takes longest."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


_drawn: ContextVar[list[Figure] | None] = ContextVar("drawn", default=None)


@contextmanager
def figures_kept() -> Iterator[list[Figure]]:
    """A list that gets every figure which is saved meanwhile."""
    figures: list[Figure] = []
    before = _drawn.set(figures)
    try:
        yield figures
    finally:
        _drawn.reset(before)


def save_figure(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure as PNG and PDF."""
    if (kept := _drawn.get()) is not None:
        kept.append(figure)
    folder.mkdir(parents=True, exist_ok=True)
    words_as_they_stand(figure)
    paths = [folder / f"{name}.{kind}" for kind in ("png", "pdf")]
    with _any_glyph():
        _laid_out(figure)
        for path in paths:
            with whole_file(path) as aside:
                figure.savefig(aside, format=path.suffix[1:], dpi=150)
    return paths


@contextmanager
def _any_glyph() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # drawn as a box
        yield


def picture_link(figure: Figure) -> str:
    """A figure as a data: link: SVG, or PNG where lines of many points make that the smaller."""
    words_as_they_stand(figure)
    found = []
    with _any_glyph():
        _laid_out(figure)
        for kind, mime in (("png", "png"), ("svg", "svg+xml")):
            content = io.BytesIO()
            about = {"Date": None} if kind == "svg" else None  # the same figure, the same bytes
            figure.savefig(content, format=kind, dpi=150, metadata=about)
            text = base64.b64encode(content.getvalue()).decode()
            found.append(f"data:image/{mime};base64,{text}")
    return min(found, key=len)
