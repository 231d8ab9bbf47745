"""Texts that mean something to one of the languages that text of a run ends up in, for hypothesis.

`texts` mixes them: ends of comments and strings, spliced, wrapped or spelled as trigraphs,
templates, formats, markup, control characters, directions, surrogates, keywords, near-identifiers,
near-units. `changes` says where in a document of plain values they go, `tampered` puts them there.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

from hypothesis import strategies as st

SIGNS = (
    "*/\\\"'`?%{}$()[]<>&;:,.=!#@~^|+-_ \n\r\t\0\b\x0b\x0c\x1a\x1b\x7f\x85\x9b\u200b\u200d\u2028"
    "\u2029\u202e\u2066\ufeff\ufffe\ud800\U000e0041\U0001f600²·µ°Å\u0301０Ⅷaxn1"
)
ENDS = (
    '*/ __asm__(".incbin \\"/etc/passwd\\""); __attribute__((constructor)) void f(void) {} /*',
    "*\\\n/ int planted; /*", "*??/\n/ int planted; /*", "*/\n#include \"/etc/passwd\"\n/*", "*",
    "/", "/*", "//", "\\", "\\\n", "??/", "??/\n", "\n#define double int\n", "%:include",
    '"); system("x"); printf("', "%n%s%99999d", "%", "\\x22", "\\u002a\\u002f", "\\N{ASTERISK}",
    '"""\nimport os; os.system("x")\n"""', "'''", '"""', "\n# coding: utf-7\n", "coding: utf-7",
    "\nimport os", "\r\nimport os", "\x0cimport os", "\u2028import os", "$name", "${name}", "$$",
    "$", "{name}", "{{}}", "%(name)s", "</p><script>x</script>", "<!--", "-->", "]]>",
    "<![CDATA[", "<!DOCTYPE a [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>", "&e;", "&#0;", "&#10;",
    '" start="1', "'/>", "<?x?>", "';system('x');'", "''", "\n%{\n", "%}", "%{", "...\nx=1", "...",
    "\n!x\n", "#{", "@-1", "../../x", "C:\\x", "x\0.c", " ", "word " * 30,
    "*" * 95 + "/", "x" * 300,
)  # fmt: skip
WORDS = (
    "f1", "f2", "s1", "s_dot1", "u1", "x1", "a1", "time", "input_1", "input_2", "a-b", "a_b", "_a",
    "__a", "_A", "1a", "int", "main", "struct", "typedef", "for", "end", "lambda", "None", "nan",
    "function", "con", "NUL", "m", "model", "math", "variables", "fmi2", "instance", "print",
    "defined", "NDEBUG", "EXPORTED", "INPUTS", "linear", "zero_order", "N", "m/s²", "m/s2", "N s/m",
    "kN", "m*/", "m//s", "m/*s", "/m", "m/", "N;", "1/s", "s^-1", "m^99999999999", "deformation",
)  # fmt: skip

words = st.sampled_from(WORDS)
pieces = st.sampled_from(ENDS) | words | st.text(st.sampled_from(SIGNS), max_size=6)
texts = words | pieces | st.lists(pieces, max_size=5).map("".join) | st.text(max_size=12)
readable = texts.map(lambda text: text.encode("utf-8", "replace").decode())  # as files have it

Place = tuple[Any, ...]  # keys and numbers on the way into a document; None last: the key itself


def places(document: Any, way: Place = ()) -> Iterator[Place]:
    """Where a document has text: values, and the keys of mappings."""
    if isinstance(document, dict):
        for key, value in document.items():
            yield (*way, key, None)
            yield from places(value, (*way, key))
    elif isinstance(document, list):
        for i, value in enumerate(document):
            yield from places(value, (*way, i))
    elif isinstance(document, str):
        yield way


def put(document: Any, place: Place, text: str) -> None:
    """Set the text of a value or of a key in place, where it still is."""
    *way, last = place[:-1] if place[-1] is None else place
    for step in way:
        if isinstance(document, dict) and step not in document:
            return  # an earlier change renamed it
        document = document[step]
    if place[-1] is None and last in document:
        items = [(text if key == last else key, value) for key, value in document.items()]
        document.clear()
        document.update(items)
    elif place[-1] is not None and (isinstance(document, list) or last in document):
        document[last] = text


def changes(among: list[Place], most: int = 6) -> st.SearchStrategy[list[tuple[Place, str]]]:
    """Places in a document, one or several, and the hostile text of each."""
    pairs = st.tuples(st.sampled_from(among), readable)
    return st.lists(pairs, min_size=1, max_size=most, unique_by=lambda pair: pair[0])


def tampered(document: Any, changes: list[tuple[Place, str]]) -> Any:
    """A copy of a document with those texts in those places."""
    copy = deepcopy(document)
    for place, text in changes:
        put(copy, place, text)
    return copy
