"""The page of a run: one file that asks for nothing, in which no text from files acts."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from data.record import Record
from report.commands import page_of
from report.page import write_page
from report.page.page import write_runs_page
from report.page.signals import CODES, Motion, charts_of, coded, csv_of, fit_percent, table_of
from runner.scores.grade import NOTHING, SIMULATES
from runner.selection.identified import Identified
from tests.program.planted_runs import DT, forced, plant

SCRIPT = "<script>alert(1)</script>"
ODD = f"{SCRIPT}\u2028\u202e'\"&"
SCORES = {"relative_rms_percent": 12.5, "per_dof_percent": [12.5], "per_dof_rms": [0.25]}


class Structure(HTMLParser):
    """Tags with their attributes, text by tag, and what is wrong with the headings of tables."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.tags:
            self.texts.setdefault(self.tags[-1][0], []).append(data)

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> Path:
    """A planted run on a file whose columns have hostile names."""
    folder = tmp_path_factory.mktemp("measured")
    t = DT * np.arange(600)
    lines = [f"time,force,{SCRIPT}"]
    lines += [f"{s:.2f},{np.sin(9 * s * s):.6f},{np.sin(9 * s * s - 0.4):.6f}" for s in t]
    (folder / "record.csv").write_text("\n".join(lines))
    channels = f"data.channels={{time: time, f1: force, a1: '{SCRIPT}'}}"
    words = ("model=element_network", "data=measured", channels, "data.units={f: N, a: 'm/s^2'}")
    metrics = {
        **dict.fromkeys(("train", "test", "free_run_train", "free_run"), SCORES),
        "records": {f"test: {ODD}": [ODD]},
        "identification": {"sensors_do_not_determine": f"storeys {ODD}"},
        "verdict": {"grade": {"grade": SIMULATES, "by": "free run", "error_percent": 12.5,
                              "interval_percent": [11.0, 14.0], "reason": ODD, "advice": [ODD]}},
    }  # fmt: skip
    path = f"data.path={folder / 'record.csv'}"
    return plant(folder / "run", *forced(1), *words, path, **metrics)


@pytest.fixture(scope="module")
def page(measured) -> str:
    return write_page(measured).read_text("utf-8")


def test_no_text_from_files_is_markup(page):
    assert SCRIPT not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "\u2028" not in page
    assert "\u202e" not in page
    structure = Structure(page)
    assert len(structure.of("script")) == 2  # the numbers, then the code
    records = json.loads(structure.texts["script"][0])
    assert records[0]["channels"][0]["name"] == f"a1 ({SCRIPT})"


def test_what_the_sensors_leave_open_is_said(page):
    warnings = re.findall(r'<p class="warning">(.*?)</p>', page, re.DOTALL)
    assert any(text.startswith("the sensors do not determine: storeys ") for text in warnings)


def test_scores_of_other_dofs_are_refused(measured, tmp_path):
    for name in ("config.yaml", "model.safetensors", "sensors.json"):
        (tmp_path / name).write_bytes((measured / name).read_bytes())
    metrics = json.loads((measured / "metrics.json").read_text("utf-8"))
    for wrong in ({}, {**SCORES, "per_dof_percent": [1.0, 2.0]}):
        (tmp_path / "metrics.json").write_text(json.dumps(metrics | {"test": wrong}))
        with pytest.raises(
            ValueError, match=r"metrics\.json has no test\.per_dof_percent of 1 DOFs"
        ):
            write_page(tmp_path)


def test_the_policy_allows_this_style_and_this_script_alone(page):
    structure = Structure(page)
    (policy,) = (m["content"] for m in structure.of("meta") if "http-equiv" in m)
    assert policy.startswith("default-src 'none';")
    assert "unsafe" not in policy
    code = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    style = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    for kind, (text,) in (("script", code), ("style", style)):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert not any("style" in attributes for _, attributes in structure.tags)
    assert not any(name.startswith("on") for _, own in structure.tags for name in own)


def test_nothing_is_requested(page):
    links = [v for _, own in Structure(page).tags for k, v in own.items() if k in ("src", "href")]
    assert links
    assert all(link.startswith("data:") for link in links)
    assert "url(" not in page
    assert "@import" not in page


def test_a_page_is_readable_without_eyes(page):
    structure = Structure(page)
    assert structure.of("html") == [{"lang": "en"}]
    assert "simulates the structure" in structure.texts["title"][0]
    assert all(own.get("scope") in ("col", "row") for own in structure.of("th"))
    assert all(own.get("alt") for own in structure.of("img"))
    ids = [own["id"] for _, own in structure.tags if "id" in own]
    assert len(set(ids)) == len(ids)
    assert {own["aria-labelledby"] for own in structure.of("section")} <= set(ids)
    assert len(structure.of("h1")) == 1


def luminance(colour: str) -> float:
    """Of WCAG 2: relative, of #rrggbb."""
    shares = np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)])
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return float(linear @ (0.2126, 0.7152, 0.0722))


def test_texts_and_lines_stand_out_by_day_and_by_night(page):
    for scheme in re.findall(r":root \{(.*?)\}", page, re.DOTALL)[:2]:
        colours = dict(re.findall(r"--(\w+): (#\w{6})", scheme))
        for name, least in {"fg": 4.5, "soft": 4.5, "plain": 4.5, "good": 4.5, "half": 4.5,
                            "bad": 4.5, "own": 3.0, "measured": 3.0}.items():  # fmt: skip
            for ground in ("bg", "panel"):
                pair = sorted(luminance(colours[key]) + 0.05 for key in (name, ground))
                assert pair[1] / pair[0] >= least, (name, ground)


def test_a_stranger_reads_the_verdict_first(page):
    body = page.partition("<main>")[2]
    words = (
        *("Simulates the structure", "Can I simulate with it?", "12.50 %", "11.00 to 14.00 %"),
        *("What is it not for?", "The record as understood", "against measured", "Errors"),
    )
    places = [body.index(word) for word in words]
    assert places == sorted(places)


def test_downloads_hold_what_they_say(page, measured):
    found = {own["download"]: own["href"] for own in Structure(page).of("a") if "download" in own}
    assert {"estimates.csv", "config.yaml"} <= set(found)
    assert any(name.endswith(".c") for name in found)
    texts = {name: base64.b64decode(link.partition(",")[2]) for name, link in found.items()}
    assert texts["config.yaml"] == (measured / "config.yaml").read_bytes()
    head, *rows = csv.reader(io.StringIO(texts["estimates.csv"].decode()))
    assert head[:2] == ["record", "time_s"]
    assert len(rows) > 50


def test_where_the_record_is_gone_the_stored_scores_are_shown(measured, tmp_path):
    config = (measured / "config.yaml").read_text().replace("record.csv", "gone.csv")
    for name in ("metrics.json", "model.safetensors", "sensors.json"):
        (tmp_path / name).write_bytes((measured / name).read_bytes())
    (tmp_path / "config.yaml").write_text(config)
    page = write_page(tmp_path).read_text("utf-8")
    assert "the record gone.csv is missing" in page
    assert "12.50" in page


def test_where_nothing_was_fitted_the_questions_are_asked(tmp_path):
    search = {
        "record": {"files": [{"name": ODD, "channels": [{"column": ODD}], "samples": 10,
                              "findings": [{"text": "ten samples are too few", "blocks": True}]}]},
        "questions": [{"text": f"which column drives {ODD}?", "option": "data.channels.f1=COLUMN"}],
        "chosen": None, "candidates": [{"name": ODD, "status": "not tried"}],
        "verdict": {"grade": NOTHING, "reason": "nothing was fitted"},
    }  # fmt: skip
    (tmp_path / "identify.json").write_text(json.dumps(search))
    page = write_page(tmp_path).read_text("utf-8")
    assert SCRIPT not in page
    for text in ("Not identified", "data.channels.f1=COLUMN", "ten samples are too few"):
        assert text in page


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"chosen": 1}, "has chosen=1 of 1 candidates"),
        ({"chosen": "a"}, "chosen is 'a', expected a whole number or nothing"),
        ({"candidates": 3}, "candidates is 3, expected a list"),
        ({"candidates": [{"seconds": "a"}]}, "seconds is 'a', expected a number or nothing"),
        ({"record": {"files": [3]}}, "files is 3, expected a mapping"),
        ({"record": {"files": [{"channels": [3]}]}}, "channels is 3, expected a mapping"),
        ({"questions": [{}]}, "questions lacks text, option"),
        ({"verdict": {}}, "verdict lacks grade"),
    ],
)
def test_a_search_of_a_stranger_is_refused_in_one_line(changed, said, tmp_path):
    search = {"candidates": [{"name": "a"}], "chosen": None, "verdict": {"grade": NOTHING}}
    (tmp_path / "identify.json").write_text(json.dumps(search))
    write_page(tmp_path)
    (tmp_path / "identify.json").write_text(json.dumps(search | changed))
    for read in (write_page, Identified.read):
        with pytest.raises(ValueError, match=r"^identify\.json: ") as error:
            read(tmp_path)
        assert said in str(error.value)


def test_the_page_of_a_search_shows_the_chosen_run(measured, tmp_path):
    run = tmp_path / "models" / "first"
    run.mkdir(parents=True)
    for file in measured.iterdir():
        if file.suffix in (".yaml", ".json", ".safetensors"):
            (run / file.name).write_bytes(file.read_bytes())
    candidates = [{"name": "the chosen one", "folder": "models/first", "held_back_percent": 5.1},
                  {"name": "the other", "status": "given up", "reason": "too slow"}]  # fmt: skip
    search = {"candidates": candidates, "chosen": 0, "command": "python train.py model=one",
              "verdict": {"grade": SIMULATES}}  # fmt: skip
    (tmp_path / "identify.json").write_text(json.dumps(search))
    path = write_page(tmp_path)
    assert path == tmp_path / "report.html"
    page = path.read_text("utf-8")
    for text in ("Simulates the structure", "5.10 %", "given up", "too slow", "model=one"):
        assert text in page


def test_charts_begin_where_scores_do():
    y = np.sin(0.1 * np.arange(400))[:, None]
    record = Record(dt=0.5, a=_tensor(y)[None], f=_tensor(y)[None], warmup=100)
    (shown,) = charts_of([Motion("rest", record, y, None)], ["a1"], {"own": "model"})
    charts = shown["channels"][0]["charts"]
    assert [chart["start"] for chart in charts if chart["time"]] == [50.0] * 3
    assert len(decoded(charts[0]["lines"][0])) == 300


def test_a_large_record_is_small_enough_to_mail(tmp_path):
    rng = np.random.default_rng(0)
    a = rng.standard_normal((1, 100_000, 10))
    record = Record(dt=0.01, a=_tensor(a), f=_tensor(a[..., :1]))
    motions = [Motion("long", record, a[0] * 0.9, a[0] * 0.5)]
    names = [f"a{i + 1}" for i in range(10)]
    charts = json.dumps(charts_of(motions, names, {"own": "model", "plain": "linear"}))
    text, about = csv_of(table_of(motions, names), tmp_path)
    assert len(charts) + len(text) * 4 / 3 < 1.2e6  # of 1.5 MB; pictures, tables, code: the rest
    assert "of 100,000 samples" in about
    whole = (tmp_path / "estimates.csv").read_text().splitlines()
    assert len(whole) == 100_001
    assert whole[: text.count("\n")] == text.splitlines()


def _tensor(values):
    import torch

    return torch.from_numpy(np.ascontiguousarray(values))


def decoded(line) -> np.ndarray:
    codes = np.frombuffer(base64.b64decode(line["codes"]), "<u2").astype(float)
    values = line["low"] + codes * (line["high"] - line["low"]) / CODES
    return np.where(codes > CODES, np.nan, values)


def test_a_thinned_line_keeps_its_extremes_and_gaps():
    signal = np.sin(np.arange(10_000) / 700.0)
    signal[4321], signal[7000:7200] = 7.0, np.nan
    line = coded(signal, 500)
    drawn = decoded(line)
    assert len(drawn) <= 502
    assert np.nanmax(drawn) == pytest.approx(7.0)
    place = int(np.nanargmax(drawn)) * line["each"]
    assert place == pytest.approx(4321, abs=40)
    assert np.isnan(drawn).any()
    assert decoded(coded(signal, 10_000)) == pytest.approx(signal, abs=1e-3, nan_ok=True)


def test_fit_is_that_of_matlab():
    y = np.array([[9.0], [1.0], [3.0], [5.0]])
    record = Record(dt=1.0, a=_tensor(y)[None], f=_tensor(y)[None], warmup=1)
    motions = [Motion("one", record, y, None)]
    assert fit_percent(motions, [y]) == [100.0]
    assert fit_percent(motions, [np.full((4, 1), 3.0)]) == pytest.approx([0.0])
    assert fit_percent(motions, [3.0 + 0.5 * (y - 3.0)]) == pytest.approx([50.0])


def test_many_runs_on_a_page(measured, tmp_path):
    write_page(measured)
    page = write_runs_page([measured.parent], tmp_path).read_text("utf-8")
    assert "simulates the structure" in page
    assert "12.50" in page
    (link,) = (own["href"] for own in Structure(page).of("a"))
    assert (tmp_path / link).is_file()


def test_a_page_beside_other_scores_is_refused(measured):
    nothing = {"run": str(measured), "runs": None, "output": None, "data": {}}
    with pytest.raises(ValueError, match="leave seeds= out"):
        page_of({**nothing, "seeds": [5]})
    with pytest.raises(ValueError, match="say run=FOLDER"):
        page_of({**nothing, "run": None})
    with pytest.raises(ValueError, match="is not a finished run"):
        write_page(measured.parent / "nowhere")
