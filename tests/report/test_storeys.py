"""Storeys as they are shown: within 80 columns, in a file, in a drawing that marks the sensors."""

from __future__ import annotations

import csv
import io
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from data.terminal import Terminal
from models.fit.metrics import FREE_RUNS
from models.uncertainty.drifts import STOREY
from report.run.building import draw_storeys, storeys_csv
from report.uncertainty.intervals import (
    beyond_training,
    print_intervals,
    sentences,
    value_and_half,
    which_to_believe,
)
from report.uncertainty.storeys import print_drifts


def row(record: str, e: int, **more: object) -> dict:
    values = dict(zip(STOREY, (0.1234, -0.01234, 12.34, 123456.0, 0.876), strict=True))
    halves = {"peak": 0.0123, "residual": 0.0011, "floor_acceleration": 0.56,
              "dissipated_energy": 5600.0, "stiffness_left": 0.045}  # fmt: skip
    widths = {f"{key}_half": half for key, half in halves.items()}
    return {"record": record, "element": f"r{e} x", "height": 3.2, **values, **widths, **more}


def printed(*rows: dict) -> str:
    file = io.StringIO()
    print_drifts(Terminal(width=80, file=file), {"drifts": list(rows)})
    return file.getvalue()


def test_all_that_a_storey_suffers_is_read_in_80_columns():
    text = printed(row("[red]march", 1), row("[red]march", 12, residual=0.0009))
    for words in ("[red]march", "123 ± 12", "3.86 ± 0.38", "-12.3 ± 1.1", "-0.386 ± 0.034",
                  "12.34 ± 0.56", "[kJ]", "123.5 ± 5.6", "87.6 ± 4.5", "* 0.9 ± 1.1"):  # fmt: skip
        assert words in text
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    assert "the interval contains zero" in text
    assert "zero" not in printed(row("march", 1))


def test_no_digit_of_a_storey_is_lost_where_intervals_are_narrow():
    """Of which the numbers of storeys were empty, and halves ended in an ellipsis."""
    narrow = {"peak": 0.02463, "peak_half": 8.9e-5,
              "residual": -0.0061461, "residual_half": 7.6e-5,
              "floor_acceleration": 2.6484, "floor_acceleration_half": 0.0078,
              "dissipated_energy": 12863.0, "dissipated_energy_half": 954.0,
              "stiffness_left": 0.9999999, "stiffness_left_half": 4e-7}  # fmt: skip
    text = printed(row("ev0", 1, **narrow), row("ev0", 12, **narrow))
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    for words in ("│12│", "0.7697 ± 0.0028", "-0.1921 ± 0.0024", "2.648 ± 0.008", "100.00 ± 0.00"):
        assert words in text


def test_what_is_not_known_is_a_dash_and_what_is_sure_has_no_width():
    unknown = {"dissipated_energy": None, "dissipated_energy_half": None}
    text = printed(row("march", 1, stiffness_left=1.0, stiffness_left_half=1e-12, **unknown))
    assert "–│" in text
    assert "100.0 ± 0.0│" in text


def test_the_file_has_every_storey_in_the_units_of_its_head():
    lines = list(csv.DictReader(io.StringIO(storeys_csv([row("a", 1), row("b", 2)]))))
    assert [(line["record"], line["storey"]) for line in lines] == [("a", "1"), ("b", "2")]
    expected = {"height [m]": 3.2, "peak [mm]": 123.4, "peak_half [mm]": 12.3,
                "residual [%]": -1.234 / 3.2, "floor_acceleration [m/s²]": 12.34,
                "dissipated_energy [J]": 123456.0, "stiffness_left_half [%]": 4.5}  # fmt: skip
    for key, value in expected.items():
        assert float(lines[0][key]) == pytest.approx(value)
    short = {key: value for key, value in row("a", 1).items() if key != "height"}
    assert not [head for head in storeys_csv([short]).splitlines()[0].split(",") if "[m]" in head]


def test_the_building_leans_by_its_drifts_and_shows_its_sensors():
    rows = [row("march", e, peak=0.02 * e) for e in (1, 2, 3)]
    figure = draw_storeys(rows, SimpleNamespace(base=True, supports=0, sensors=[1, 3]))
    axes, _ = figure.axes  # and the colours
    (sensors,) = (line for line in axes.lines if line.get_marker() == ">")
    np.testing.assert_allclose(sensors.get_ydata(), [0.0, 3.2, 9.6])
    moved = np.diff(sensors.get_xdata())
    assert moved[1] == pytest.approx(5.0 * moved[0])  # 2 + 3 of the storeys above, 1 of the first
    assert axes.texts[0].get_text() == "20 ± 12 mm\n0.62 ± 0.38 %"
    shades = [patch.get_facecolor() for patch in axes.patches]
    assert len(set(shades)) == 3


def test_drifts_of_all_records_have_one_scale_of_colours_and_of_lean():
    rows = [row("large", 1, peak=0.04), row("small", 1, peak=0.01), row("small", 2, peak=0.04)]
    large, small, _ = draw_storeys(rows, SimpleNamespace(base=True, supports=0, sensors=[1])).axes
    shades = [patch.get_facecolor() for axes in (large, small) for patch in axes.patches]
    assert shades[0] == shades[2] != shades[1]
    moved = [np.diff(axes.patches[-1].get_xy()[:2, 0]) for axes in (large, small)]
    assert moved[0] == pytest.approx(moved[1])


def test_numbers_of_another_model_are_drawn_without_sensors():
    """As in metrics.json that somebody changed."""
    axes, _ = draw_storeys([row("march", 1)], SimpleNamespace()).axes
    assert axes.texts[0].get_text() == "123 ± 12 mm\n3.86 ± 0.38 %"


# The table of intervals: digits that mean something, words where the record tells nothing


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (39.4321, 0.86, ("39.43", "0.86")),
        (0.80038, 0.00061, ("0.80038", "0.00061")),
        (31.2, 174.0, ("31.2", "174")),
        (1234.5, 210.0, ("1234", "210")),
        (0.0, 0.2, ("0", "0.2")),
        (2.5e8, 3e6, ("2.5e+08", "3e+06")),
        (1.2, None, ("1.2000", "given")),
    ],
)
def test_a_value_has_the_digits_that_its_interval_leaves(value, half, shown):
    assert value_and_half(value, half) == shown


def parameter(name: str, **more) -> dict:
    base = {"value": 40.0, "half": 1.0, "white": 0.5, "model_error": 1.0, "status": "determined"}
    return {"name": name, "unit": "N/m", "about": "ground–x1", "combined_with": [], **base, **more}


def test_a_wrong_model_is_told_by_what_parts_of_the_records_ask_for():
    assert not which_to_believe([parameter("r1.stiffness", model_error=1.2)])
    wrong = [parameter("r1.stiffness", model_error=3.0)]
    assert "3 times as wide" in which_to_believe(wrong)
    console = Console(width=80)
    with console.capture() as capture:
        print_intervals(console, {"parameters": wrong}, both=True)
    assert "± model error" in capture.get()
    assert "use ± model error, 3 times as wide" in capture.get()


@pytest.mark.parametrize(("half", "told"), [(0.0010, True), (0.0062, False)])
def test_a_drift_whose_interval_holds_zero_is_none_that_accelerations_tell(half, told):
    row = {"record": "e2", "element": "r1 ground–x1", "peak": 0.0401, "peak_half": 0.0012,
           "residual": 0.0049, "residual_half": half}  # fmt: skip
    console = Console(width=80)
    with console.capture() as capture:
        print_drifts(console, {"drifts": [row]})
    line = next(line for line in capture.get().splitlines() if "r1 ground–x1" in line)
    assert "40.1 ± 1.2" in line
    assert f"4.90 ± {1e3 * half:.1f}" in line
    assert ("*" not in line) == told
    assert ("not determined by the accelerations" in capture.get()) != told


@pytest.mark.parametrize(
    ("unseen", "coloured", "told"), [(60.0, [1], True), (60.0, [], False), (12.0, [1], False)]
)
def test_intervals_of_one_motion_are_not_those_of_another(unseen, coloured, told):
    """A residual that repeats with the motion is alike in all blocks: they cannot tell it."""
    errors = {"train": 10.0, "test": unseen}
    metrics = {FREE_RUNS[part]: {"relative_rms_percent": e} for part, e in errors.items()}
    line = beyond_training(metrics, {"residual_peaks": coloured})
    assert bool(line) == told
    assert not told or "error is 60" in line


def finding(kind: str, name: str, gain: float) -> dict:
    return {"kind": kind, "name": name, "gain": gain, "p": 1e-9, "significant": True}


def test_sentences_name_a_missing_element_alone_and_otherwise_laws():
    brace = finding("a missing element", "x1–x3", 0.26)
    law = finding("the law of an element", "r2", 0.03)
    told = list(sentences({"criticism": [brace, law]}))
    assert told == [
        "the residual suggests an element between x1 and x3, which would explain 26 % of it"
    ]
    assert "r2 lacks terms" in next(sentences({"criticism": [law]}))
    assert not list(sentences({"criticism": [{**law, "significant": False}]}))
