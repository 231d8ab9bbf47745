"""Factors to SI against values of the standards, and what must not be taken for a unit."""

from __future__ import annotations

import time

import pytest

from data.measured.units import DIMENSIONS, split_brackets, to_si, unit_in_name

POUND_FORCE = 4.4482216152605  # N, exactly 0.45359237 kg × 9.80665 m/s²

KNOWN = [
    ("g", "a", 9.80665), ("g", "s_ddot", 9.80665), ("mg", "a", 9.80665e-3), ("G", "a", 9.80665),
    ("gal", "a", 0.01), ("Gal", "a", 0.01), ("mGal", "a", 1e-5), ("m/s2", "a", 1.0),
    ("m/s^2", "a", 1.0), ("m/s²", "a", 1.0), ("m/s/s", "a", 1.0), ("m s^-2", "a", 1.0),
    ("m s-2", "a", 1.0), ("cm/s^2", "a", 0.01), ("cm/s²", "a", 0.01), ("in/s^2", "a", 0.0254),
    ("ft/s**2", "a", 0.3048), ("mm/s^2", "s_ddot", 1e-3), ("m/(s^2)", "a", 1.0),
    ("N", "f", 1.0), ("kN", "r", 1e3), ("MN", "f", 1e6), ("lb", "f", POUND_FORCE),
    ("lbf", "r", POUND_FORCE), ("lbs", "f", POUND_FORCE), ("kip", "f", 1e3 * POUND_FORCE),
    ("kips", "f", 1e3 * POUND_FORCE), ("kgf", "f", 9.80665), ("kg*m/s^2", "f", 1.0),
    ("m", "x", 1.0), ("mm", "x", 1e-3), ("in", "x", 0.0254), ("ft", "s", 0.3048),
    ("um", "x", 1e-6), ("µm", "x", 1e-6),
    ("in/s", "v", 0.0254), ("mm/s", "s_dot", 1e-3), ("cm/s", "v", 0.01),
    ("s", "time", 1.0), ("ms", "time", 1e-3), ("us", "time", 1e-6), ("µs", "time", 1e-6),
    ("g's", "a", 9.80665), ("%g", "a", 0.0980665), ("CM/SEC/SEC", "a", 0.01),
    ("in./sec^2", "a", 0.0254), ("m·s⁻²", "a", 1.0), ("m.s-2", "a", 1.0), ("mps2", "a", 1.0),
    ("unit: cm/sec^2", "a", 0.01), ("ips", "v", 0.0254), ("KN", "f", 1e3), ("in.", "x", 0.0254),
    ('"', "x", 0.0254), ("MM", "x", 1e-3), ("meters per second squared", "a", 1.0),
    ("0.35 mm", "drift", 3.5e-4), ("-2e-3 in", "x", -5.08e-5),
    ("ns", "time", 1e-9), ("min", "time", 60.0), ("sec", "time", 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "signal", "factor"), KNOWN)
def test_known_factors(unit: str, signal: str, factor: float) -> None:
    assert to_si(unit, signal) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "signal"),
    [("g", "f"), ("kg", "f"), ("lb", "x"), ("m", "a"), ("mm/s", "a"), ("Hz", "time"), ("kn", "f")],
)
def test_another_dimension_names_unit_signal_and_examples(unit: str, signal: str) -> None:
    what, si, examples = DIMENSIONS[signal]
    with pytest.raises(ValueError, match=f"unit='{unit}'") as caught:
        to_si(unit, signal)
    for part in (f"signal {signal} is {what}", si, examples, "another dimension"):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    "unit",
    ["", "-", "furlongz", "m/s^2; import os", "__import__('os')", "m[0]", "9^9^9^9^9", "m^99",
     "m^(9^9^9)", "0 m", "-0 m", "1e999 m", "m" * 40, "((((((9)^9)^9)^9)^9)^9)", "m/", "m\n",
     "lambda", "2^9^9", "m**-9**9"],
)  # fmt: skip
def test_what_is_no_length_is_refused_at_once(unit: str) -> None:
    started = time.perf_counter()
    with pytest.raises(ValueError, match="signal x is a displacement") as caught:
        to_si(unit, "x")
    assert time.perf_counter() - started < 5.0
    assert caught.value.__cause__ is None
    assert "\n" not in str(caught.value)


NAMED = [
    ("disp_cm", "x", "cm"), ("x1_mm", "x", "mm"), ("force_kN", "r", "kN"), ("t_ms", "time", "ms"),
    ("Load kips", "f", "kips"), ("acc_cm_s2", "a", "cm/s^2"), ("acc1_cms2", "s_ddot", "cm/s^2"),
    ("v_mm/s", "v", "mm/s"), ("a1_g", "a", "g"), ("stroke_inch", "s", "inch"),
    ("force_kN2", "f", "kN"), ("disp_mm12", "x", "mm"), ("acc_g", "s_ddot", "g"),
    ("d Acc/g", "a", "g"), ("acc, g", "a", "g"), ("acc in g", "a", "g"), ("acc.g", "a", "g"),
    ("acc - g", "a", "g"), ("ACC_CM_S2", "a", "CM/S^2"), ("acc_m_s_2", "a", "m/s^2"),
    ("acc cm/sec^2", "a", "cm/sec^2"), ("vel_ms", "v", "m/s"), ("Load in lb", "f", "lb"),
    ("disp_in", "x", "in"), ("acc m s^-2", "a", "m s^-2"), ("k acc cm/s²", "a", "cm/s^2"),
]  # fmt: skip
UNNAMED = [
    ("a_g", "a"), ("acc_g1", "a"), ("disp_m2", "x"), ("deck_m", "a"), ("roof_N", "a"),
    ("force_in", "f"), ("deck_mm", "a"), ("acc_kN", "a"), ("mm", "x"), ("_mm", "x"),
    ("programme", "x"),
    ("drums", "time"), ("x2_mm_filtered", "x"), ("acc_3", "a"),
]  # fmt: skip


@pytest.mark.parametrize(("column", "signal", "unit"), NAMED)
def test_a_unit_at_the_end_of_a_name_is_read(column, signal, unit):
    assert unit_in_name(column, signal) == unit_in_name(column) == unit


@pytest.mark.parametrize(("column", "signal"), UNNAMED)
def test_what_may_be_another_word_or_is_no_unit_of_the_signal_is_not(column, signal):
    assert unit_in_name(column, signal) is None


@pytest.mark.parametrize(
    ("header", "name"),
    [("-a1 [g]", "-a1"), ("[g] - acc", "acc"), ("_acc_ (g)", "acc"), ("acc - [g]", "acc")],
)
def test_a_name_without_its_unit_keeps_a_minus_that_is_a_sign(header, name):
    assert split_brackets(header) == (name, "g")
