"""This code computes the numbers that it computed before."""

from __future__ import annotations

import pytest

from runner.config.identity import RESULTS
from tests.golden.cases import CASES
from tests.golden.compare import Difference, differences, fault_of, platform, read

pytestmark = pytest.mark.filterwarnings("ignore:.*found in sys.modules.*:RuntimeWarning")


@pytest.fixture(scope="module")
def kept():
    return read()


def test_every_case_is_kept_and_no_other(kept):
    assert sorted(kept["cases"]) == sorted(CASES)


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_of_the_results_version(name, kept):
    exact = kept["platform"] == platform()
    found = differences(name, kept["cases"][name], CASES[name](), exact)
    fault = fault_of(found, kept["results"])
    assert not fault, "\n".join([*map(str, found), fault])


OLD = {"error": 1.0, "per_dof": [1.0, 1e-3, None], "text": "ab", "motion": {"sha256": "c"}}


def changed(**values) -> list[Difference]:
    return differences("case", OLD, OLD | values, exact=True)


def test_a_last_bit_is_a_difference_that_needs_a_new_results_version():
    found = changed(per_dof=[1.0, 1e-3 * (1.0 + 2.3e-16), None])
    assert [difference.label for difference in found] == ["case, per_dof"]
    assert "raise RESULTS" in fault_of(found, RESULTS)
    assert "--make" in fault_of(found, RESULTS - 1)
    assert "raise RESULTS" in fault_of(changed(motion={"sha256": "d"}), RESULTS)


def test_another_source_and_a_new_label_need_none():
    for found in (changed(text="other"), changed(more=2.0)):
        assert len(found) == 1
        assert "no number does" in fault_of(found, RESULTS)
    assert fault_of([], RESULTS) == ""
    assert "kept is results version" in fault_of([], RESULTS - 1)


def test_elsewhere_numbers_agree_to_a_share_of_the_largest_of_their_list():
    close = {"per_dof": [1.0, 1e-3 + 1e-10, None], "motion": {"sha256": "d"}, "text": "other"}
    assert differences("case", OLD, OLD | close, exact=False) == []
    for values in ([1.0, 1e-3 + 1e-8, None], [1.0, 1e-3, 1.0], [1.0, 1e-3]):
        assert differences("case", OLD, OLD | {"per_dof": values}, exact=False)
