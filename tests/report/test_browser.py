"""Pages in a real browser, from their files: nothing is requested, nothing fails, zoom works."""

from __future__ import annotations

import base64
import json
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from report.page import write_page
from tests.program.planted_runs import forced, plant
from tests.report.test_page import measured as measured
from tests.report.test_page import page as page

webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium: the extra `test`")
CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--no-first-run", "--disable-component-update", "--disable-sync",
)  # fmt: skip
DIVERGED = {"relative_rms_percent": None, "per_dof_percent": [None] * 3, "diverged_after_s": [0.1]}
pytestmark = needs_browser = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="needs a browser: apt-get install chromium chromium-driver"
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.chrome.service.Service(DRIVER)  # its own path: nothing is downloaded
    driver = webdriver.Chrome(options=options, service=service)
    yield driver
    driver.quit()


def show(browser: Any, path: Path, width: int, scheme: str) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme_of = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", scheme_of)
    browser.get(path.as_uri())


def requests_of(browser: Any, path: Path) -> list[str]:
    """What the page has asked for, besides itself; the browser's own first page is not meant."""
    events = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
    own = [s["request"]["url"] for s in sent if s["documentURL"] == path.as_uri()]
    return [url for url in own if url != path.as_uri() and not url.startswith("data:")]


@pytest.mark.parametrize(
    ("width", "scheme"), [(1440, "light"), (390, "light"), (390, "dark")], ids=str
)
def test_a_page_is_shown_whole_and_quietly(browser, measured, page, width, scheme):
    path = measured / "report.html"
    show(browser, path, width, scheme)
    assert browser.get_log("browser") == []
    assert requests_of(browser, path) == []
    wide = browser.execute_script("return document.documentElement.scrollWidth")
    assert wide <= width  # no sideways scrolling but inside of tables
    drawn = browser.execute_script("return document.querySelectorAll('.chart canvas').length")
    assert drawn == 4
    assert browser.execute_script("return document.querySelectorAll('th:not([scope])').length") == 0
    background = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")
    shot = base64.b64decode(browser.get_screenshot_as_base64())
    assert len(shot) > 10_000


def test_zoom_and_pan_change_the_scale_of_all_times(browser, measured, page):
    show(browser, measured / "report.html", 1440, "light")

    def scale(chart: int) -> tuple[float, float]:
        text = "const s = document.getElementById('chart-' + arguments[0]).chart.scales.x;"
        return tuple(browser.execute_script(f"{text} return [s.min, s.max];", chart))

    def press(what: str) -> None:
        browser.find_element("css selector", f"[data-do={what}]").click()

    low, high = scale(0)
    spectrum = scale(3)
    press("in")
    near = scale(0)
    assert near[1] - near[0] == pytest.approx(0.5 * (high - low))
    assert scale(1) == pytest.approx(near)
    assert scale(3) == pytest.approx(spectrum)
    press("right")
    assert scale(2)[0] > near[0]
    press("all")
    assert scale(0) == pytest.approx((low, high))
    browser.find_element("id", "chart-1").send_keys("+")
    assert scale(0)[1] - scale(0)[0] == pytest.approx(0.5 * (high - low))


def test_a_dragged_part_fills_the_chart(browser, measured, page):
    show(browser, measured / "report.html", 1440, "light")
    over = browser.find_element("css selector", "#chart-0 .u-over")
    width = over.size["width"]
    text = (
        "const u = document.getElementById('chart-0').chart; return u.scales.x.max - u.scales.x.min"
    )
    before = browser.execute_script(text)
    move = webdriver.ActionChains(browser).move_to_element_with_offset(over, -width // 4, 0)
    move.click_and_hold().move_by_offset(width // 2, 0).release().perform()
    assert browser.execute_script(text) == pytest.approx(0.5 * before, rel=0.1)


def test_a_hostile_channel_does_nothing(browser, measured, page):
    show(browser, measured / "report.html", 1440, "light")
    names = browser.find_element("id", "pick-channel").get_attribute("textContent")
    assert names == "a1 (<script>alert(1)</script>)"
    with pytest.raises(Exception, match="no such alert"):
        _ = browser.switch_to.alert


def test_what_the_page_holds_can_be_saved(browser, measured, page, tmp_path):
    saved = tmp_path / "saved"
    behaviour = {"behavior": "allow", "downloadPath": str(saved)}
    browser.execute_cdp_cmd("Browser.setDownloadBehavior", behaviour)
    show(browser, measured / "report.html", 1440, "light")
    browser.find_element("link text", "config.yaml").click()
    for _ in range(100):
        if (saved / "config.yaml").is_file():
            break
        time.sleep(0.1)
    assert (saved / "config.yaml").read_bytes() == (measured / "config.yaml").read_bytes()


def test_a_model_that_diverges_is_drawn_as_far_as_it_goes(browser, tmp_path):
    scores = dict.fromkeys(("train", "test", "free_run_train", "free_run"), DIVERGED)
    verdict = {"identified": False, "by": "free run", "reason": "its free run diverges"}
    words = ("model=element_network", "system=bilinear", "data.duration=5")
    run = plant(tmp_path / "run", *forced(3, cubic=-1e9), *words, verdict=verdict, **scores)
    path = write_page(run)
    show(browser, path, 1440, "light")
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.querySelectorAll('.chart canvas').length") == 4
    assert "Not identified" in browser.find_element("tag name", "h1").text
