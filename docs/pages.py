"""What the project adds to Sphinx: pages for files and public names, and the navigation.

`api` has a page for each public name, `files` one for each file of the repository that a page links
to. Both folders are written at the start of a build and ignored by git. Links in Markdown stay
those that GitHub follows.
"""

from __future__ import annotations

import os
import re
from importlib import import_module
from inspect import getdoc, getsourcefile, isclass
from pathlib import Path
from shutil import copy, rmtree
from typing import Any

from sphinx.application import Sphinx

import data
import models
import runner

DOCS = Path(__file__).parent
ROOT = DOCS.parent
FRONT = (
    *(f"runner.{name}" for name in runner.FRONT),
    "data.read_record",
    "models.zoo.list_pretrained",
    "models.zoo.load_pretrained",
    "models.fit.metrics.score",
    "data.simulation.accelerograms.read_event",
    "runner.folder.run.load_run",
)
CLASSES = [f"{front.__name__}.{name}" for front in (data, models) for name in front.PUBLIC]
TEXTS = (".py", ".yaml", ".cff")
LINK = re.compile(r"(?<=\]\()([^)#:\s]+)(?=[#)])|(?<=<img src=\")([^\":]+)(?=\")")
UNPRINTED = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)  # what a card says to machines
TITLES = {"/files/README": "Set-up, a first run, which model"}  # its own is that of the front page
HEAD = "| name | what it is |\n|---|---|\n"


def write(page: str, text: str) -> None:
    """Write a page that Sphinx reads."""
    (DOCS / page).parent.mkdir(parents=True, exist_ok=True)
    (DOCS / page).write_text(text, "utf-8")


def heading(words: str) -> str:
    """A page's title; no page written here is listed in the navigation."""
    return f":orphan:\n\n{words}\n{'=' * len(words)}\n\n"


# --- a page for each file that pages link to


def linked(file: Path) -> list[Path]:
    """The files that a page in Markdown links to. Raises ValueError for one that is not there."""
    links = ["".join(found) for found in LINK.findall(file.read_text("utf-8"))]
    paths = [Path(os.path.normpath(file.parent / link)) for link in links]
    for path in paths:
        if not path.exists():
            raise ValueError(f"{file.relative_to(ROOT)} links to {path}, which is not there")
    return paths


def write_files(shown: dict[Path, str], others: list[Path]) -> None:
    """Add {file: its page} for `others`, what pages link to, and what those link to."""
    waiting = [*others, *(path for page in shown if page.suffix == ".md" for path in linked(page))]
    while waiting:
        file = waiting.pop()
        name = file.relative_to(ROOT).as_posix()
        if file in shown or file.suffix not in (".md", *TEXTS):
            continue
        shown[file] = f"files/{name}" + (".rst" if file.suffix in TEXTS else "")
        if file.suffix == ".md":
            text = UNPRINTED.sub("", file.read_text("utf-8"))
            write(shown[file], f"---\norphan: true\n---\n{text}")
            waiting += linked(file)
        else:
            path = os.path.relpath(file, (DOCS / shown[file]).parent)
            write(shown[file], f":nosearch:\n{heading(name)}.. literalinclude:: {path}\n")


def turn_links(shown: dict[Path, str], docname: str, text: str) -> str:
    """The text of a page in Markdown, whose links to files lead to their pages."""
    pages = {page: file for file, page in shown.items()}
    folder = pages[f"{docname}.md"].parent

    def turned(found: re.Match[str]) -> str:
        target = Path(os.path.normpath(folder / found[0]))
        if target in shown:
            return f"/{shown[target]}"
        return os.path.relpath(target, (DOCS / docname).parent)

    return LINK.sub(turned, text)


# --- a page for each public name


def write_names() -> tuple[str, list[Path]]:
    """Tables of all names, those of a folder together, and the files that define them."""
    tables: dict[str, str] = {}
    files = []
    for name in (*FRONT, *CLASSES):
        place, _, short = name.rpartition(".")
        found = getattr(import_module(place), short)
        kind = "class" if isclass(found) else "function"
        group = f"Classes of {found.__module__.rpartition('.')[0]}"
        if name in FRONT:
            group = "Commands, what they return, and other functions"
        files.append(Path(str(getsourcefile(found))))
        source = files[-1].relative_to(ROOT).as_posix()
        text = f".. auto{kind}:: {name}\n\nSource: :doc:`/files/{source}`. "
        text += ":doc:`All public names </python>`.\n"
        write(f"api/{name}.rst", heading(short) + text)
        first = (
            re.split(r"\n\n|\.\s", getdoc(found) or "")[0].replace("\n", " ").replace("|", "\\|")
        )
        row = f"| [{short}](/api/{name}.rst) | {first.rstrip('.')} |\n"
        tables[group] = tables.get(group, f"\n## {group}\n\n{HEAD}") + row
    return "".join(tables.values()), files


def escape_docstring(
    app: Sphinx, what: str, name: str, found: object, options: object, lines: list[str]
) -> None:
    """Docstrings are plain text: `names` are marked, and what is indented is kept as it is."""
    blocks = re.split(r"\n\s*\n", "\n".join(lines).strip("\n"))
    lines[:] = "\n\n".join(map(escaped, blocks)).splitlines()


def escaped(block: str) -> str:
    """A paragraph of plain text, or lines that are kept, as reStructuredText."""
    if re.search(r"^  ", block, re.MULTILINE):
        return "::\n\n" + re.sub("^", "    ", block, flags=re.MULTILINE)
    words = re.split(r"`+([^`\n]+)`+", block)
    words[::2] = [re.sub(r"([\\*_|`])", r"\\\1", word) for word in words[::2]]
    words[1::2] = [f"``{word}``" for word in words[1::2]]
    return "".join(words)


# --- navigation: the sections of the front page, each with the pages that it is the first to name


def contents(text: str) -> str:
    """Tables of contents of a front page, one for each section, hidden but in the navigation."""
    listed = {"README.md"}
    tables = ""
    for section in text.split("\n## ")[1:]:
        caption, _, rest = section.partition("\n")
        pages = dict.fromkeys(re.findall(r"\]\(/?([\w/]+\.\w+)", rest))
        new = [page for page in pages if page not in listed]
        listed |= set(new)
        entries = [f"/{page.rpartition('.')[0]}" for page in new]
        lines = "".join(
            f"{TITLES[one]} <{one}>\n" if one in TITLES else f"{one}\n" for one in entries
        )
        tables += f"\n```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{lines}```\n" if new else ""
    return tables


def name_index(app: Sphinx, error: Exception | None) -> None:
    """The front page under the name that servers look for."""
    if error is None and app.builder.format == "html":
        copy(Path(app.outdir) / f"{app.config.root_doc}.html", Path(app.outdir) / "index.html")


def setup(app: Sphinx) -> dict[str, Any]:
    for folder in ("api", "files"):
        rmtree(DOCS / folder, ignore_errors=True)
    shown = {page: page.name for page in DOCS.glob("*.md")}
    shown |= {file: f"gallery/{file.stem}.rst" for file in (ROOT / "gallery").glob("*.py")}
    shown |= {ROOT / "gallery" / "README.rst": "gallery/index.rst"}
    names, files = write_names()
    write_files(shown, files)

    def add(app: Sphinx, docname: str, source: list[str]) -> None:
        if f"{docname}.md" in shown.values():
            source[0] = turn_links(shown, docname, source[0])
        if docname == "python":
            source[0] += names
        if docname == app.config.root_doc:
            source[0] += contents(source[0])

    app.connect("source-read", add)
    app.connect("autodoc-process-docstring", escape_docstring)
    app.connect("build-finished", name_index)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
