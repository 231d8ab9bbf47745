"""A generated page in docs/ says what its template says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = {"report/zoo": "zoo"}


@pytest.mark.parametrize("room", PAGES)
def test_the_prose_of_a_page_is_that_of_its_template(room):
    """A sentence that is changed in one of the two files alone is lost when the page is written."""
    template = (ROOT / room / "page.md").read_text("utf-8")
    page = (ROOT / "docs" / f"{PAGES[room]}.md").read_text("utf-8")
    place = 0
    for prose in re.split(r"\$\{?\w+\}?", template):
        found = page.find(prose, place)
        assert found >= 0, f"docs/{PAGES[room]}.md lacks {prose.strip()[:200]!r}"
        place = found + len(prose)
