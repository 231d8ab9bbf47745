"""This code computes the numbers that it computed before."""

from __future__ import annotations

import pytest

from tests.golden.cases import CASES
from tests.golden.compare import differences, platform, read

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
    pytest.mark.filterwarnings("ignore:.*found in sys.modules.*:RuntimeWarning"),
]


@pytest.fixture(scope="module")
def kept():
    return read()


def test_every_case_is_kept_and_no_other(kept):
    assert sorted(kept["cases"]) == sorted(CASES)


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_that_were_kept(name, kept):
    exact = kept["platform"] == platform()
    lines = differences(name, kept["cases"][name], CASES[name](), exact)
    assert not lines, "\n".join([*lines, "python -m tests.golden --make keeps the new ones"])
