"""The site, once it is built: `python -m pytest -n 0 tests/site.py`.

Every link leads somewhere, every page is three clicks from the front page, and a browser shows
pages without overflow, errors or faint text, on a phone and a desktop, dark and light.
"""

from __future__ import annotations

import re
from functools import partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from os.path import normpath
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urldefrag

import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.support.expected_conditions import presence_of_element_located
from selenium.webdriver.support.wait import WebDriverWait

from tests.report.test_browser import browser as browser
from tests.report.test_browser import needs_browser, requests_of, show

ROOT = Path(__file__).parents[1]
SITE = ROOT / "build" / "site"
FRONT = SITE / "index.html"
SHOWN = [
    *("index", "files/README", "measured", "results", "theory", "python", "search"),
    *("api/models.VWNN", "api/runner.train", "files/models/vwnn.py", "gallery/index"),
    "gallery/02_one_step_error_misleads",
]
# Text whose contrast with what lies behind it is below 4.5, or 3 if it is large (WCAG 2.1, AA).
FAINT = """
const parsed = (text) => { const n = text.match(/[\\d.]+/g).map(Number);
  return [...n.slice(0, 3), n[3] ?? 1]; };
const over = (a, b) => [0, 1, 2].map((k) => a[k] * a[3] + b[k] * (1 - a[3])).concat(1);
const luminance = (c) => { const l = c.slice(0, 3).map((v) => v / 255).map(
  (v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2]; };
const behind = (node) => { const layers = [];
  for (; node; node = node.parentElement)
    layers.push(parsed(getComputedStyle(node).backgroundColor));
  return layers.reduceRight((below, layer) => over(layer, below), [255, 255, 255, 1]); };
const faint = new Map();
for (const node of document.querySelectorAll("body *")) {
  const own = [...node.childNodes].some((one) => one.nodeType === 3 && one.textContent.trim());
  if (!own || !node.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
  const style = getComputedStyle(node), back = behind(node);
  const text = over(parsed(style.color), back), size = parseFloat(style.fontSize);
  const [low, high] = [luminance(text), luminance(back)].sort((a, b) => a - b);
  const ratio = (high + 0.05) / (low + 0.05);
  const large = size >= 24 || (size >= 18.66 && +style.fontWeight >= 700);
  if (ratio < (large ? 3 : 4.5))
    faint.set(`${node.tagName}.${node.className}: ${ratio.toFixed(2)}`, node.textContent);
}
return Object.fromEntries(faint);
"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture(scope="module")
def site() -> dict[Path, str]:
    """The text of every page."""
    if not FRONT.exists():
        pytest.fail(f"{FRONT} is not there; python -m sphinx -W docs build/site builds it")
    return {page: page.read_text("utf-8") for page in SITE.rglob("*.html")}


def links(page: Path, text: str) -> set[tuple[Path, str]]:
    """{(file, anchor)} of the links of a page that stay in the site."""
    found = set()
    for link in set(re.findall(r'<a [^>]*?href="([^"]+)"', text)):
        address, anchor = urldefrag(unescape(link))
        if "://" not in address and not address.startswith("mailto:"):
            target = normpath(page.parent / unquote(address)) if address else page
            found.add((Path(target), unquote(anchor)))
    return found


def test_every_link_leads_somewhere(site):
    ids = {page: {*map(unescape, re.findall(r'\bid="([^"]+)"', site[page])), ""} for page in site}
    for page, text in site.items():
        for target, anchor in links(page, text):
            assert target in ids or target.is_file(), f"{page} links to {target}"
            assert anchor in ids.get(target, {anchor}), f"{page}: {target}#{anchor}"


def test_every_picture_says_what_it_shows(site):
    """A thumbnail of the gallery stands beside the title of its page."""
    for page, text in site.items():
        for image in re.findall(r"<img [^>]*>", text):
            assert re.search(r'alt="[^"]+"|_thumb\.png"', image), f"{page}: {image}"


def test_every_page_is_three_clicks_from_the_front_page(site):
    clicks, edge = {FRONT: 0}, [FRONT]
    for page in edge:
        for target in {target for target, _ in links(page, site[page])} & site.keys():
            if target not in clicks:
                clicks[target] = clicks[page] + 1
                edge.append(target)
    made = {SITE / f"{name}.html" for name in ("search", "genindex", "py-modindex", "README")}
    assert {page for page in site if clicks.get(page, 9) > 3} <= made


def test_questions_of_every_day_are_answered_by_one_click(site):
    listed = re.findall(
        r"<li><p><a[^>]*>(?:<[^>]*>)*([^<]*)",
        site[FRONT].partition("<ol ")[2].partition("</ol>")[0],
    )
    assert len(listed) == 12
    assert all(one.endswith("?") for one in listed)


@needs_browser
@pytest.mark.parametrize(("words", "page"), [("Takeda", "data.Takeda"), ("multisine", "examples")])
def test_the_search_finds_words_of_pages_and_of_docstrings(browser, words, page):
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=SITE)) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        browser.get(f"http://127.0.0.1:{server.server_port}/search.html?q={words}")
        found = (By.CSS_SELECTOR, f"#search-results a[href*='{page}.html']")
        WebDriverWait(browser, 30).until(presence_of_element_located(found))
        assert browser.get_log("browser") == []
        browser.get("about:blank")  # it still fetches the texts of what was found
        server.shutdown()
        browser.get_log("browser")


@needs_browser
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1440, "light")])
def test_pages_are_shown_whole_quietly_and_legibly(browser, width, scheme):
    """Whether a page fits depends on the width, whether it is legible on the scheme."""
    for name in SHOWN:
        path = SITE / f"{name}.html"
        show(browser, path, width, scheme)
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        assert wide <= width, name
        assert browser.get_log("browser") == [], name
        sent = requests_of(browser, path)
        assert all(url.startswith(SITE.as_uri()) for url in sent), name
        assert browser.execute_script(FAINT) == {}, name
