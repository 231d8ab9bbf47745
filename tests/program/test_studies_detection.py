"""The study of change detectors: pairs of motions, what is counted, the whole of it in small."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import pytest
import torch
from rich.console import Console
from scipy.stats import beta

import studies.detection.__main__
import studies.detection.motions as study
from models.detection.detector import conformal_threshold
from models.detection.residual_level import ResidualLevel
from models.detection.weight_distance import WeightDistance
from studies.detection.__main__ import Score, detect, score
from studies.detection.motions import (
    Motions,
    Outcome,
    Watch,
    delays_of,
    joins,
    motions_of,
    pointed_at,
    watched,
)


@pytest.fixture
def small(monkeypatch):
    """Records of 40 s, damaged at 20 s; two watches; one false alarm in three records."""
    for name, value in {
        "DURATION": 40.0, "TIME": 20.0, "SETTLE": 5.0, "LEARNT": 4, "HELD": 5, "RATE": 1.0 / 3.0,
        "WATCHES": (
            Watch("frozen", "linear", ResidualLevel),
            Watch("adaptive", "online_linear", WeightDistance, memory=5.0, cutoff=1.0),
        ),
    }.items():  # fmt: skip
        monkeypatch.setattr(study, name, value)
        if hasattr(studies.detection.__main__, name):
            monkeypatch.setattr(studies.detection.__main__, name, value)


@pytest.fixture
def motions(small) -> Motions:
    return motions_of("shear_frame", range(100, 103))


def test_both_motions_of_a_seed_are_the_same_until_the_damage(motions):
    assert len(motions.train) == 10
    assert motions.lost == ["r1", "r2", "r3"]
    for sound, damaged, lost in zip(motions.sound, motions.damaged, motions.lost, strict=True):
        assert torch.equal(sound.f, damaged.f)
        assert torch.equal(sound.truth.a[:2000], damaged.truth.a[:2000])
        assert not torch.equal(sound.truth.a[2000:], damaged.truth.a[2000:])
        kept = damaged.truth.kept[-1]
        assert kept[int(lost[1:]) - 1] == pytest.approx(0.8)
        assert float(kept.sum()) == pytest.approx(3.8)
    assert not torch.equal(motions.sound[0].f, motions.train[0].f)


def test_seeds_whose_motion_escapes_are_left_out_and_named(small, monkeypatch):
    escaping = motions_of("polynomial", [20])  # its test motion of 120 s escapes; of 40 s it stays
    assert escaping.escaped == []
    monkeypatch.setattr(study, "DURATION", 120.0)
    escaping = motions_of("polynomial", [20, 21])
    assert escaping.escaped == [20]
    assert (len(escaping.sound), len(escaping.damaged), len(escaping.lost)) == (1, 1, 1)
    assert len(escaping.train) == 10


def test_elements_are_named_by_the_dofs_that_rise_together(motions):
    frame = motions.structure
    assert [joins(frame, name) for name in frame.elements] == [{1}, {1, 2}, {2, 3}, {3, 4}]
    assert pointed_at(frame, torch.tensor([3.0, 0.5, 0.2, 0.1])) == {1}
    assert pointed_at(frame, torch.tensor([2.0, 3.0, 0.2, 0.1])) == {1, 2}
    assert pointed_at(frame, torch.tensor([0.1, 0.2, 3.0, 2.9])) == {3, 4}
    assert pointed_at(frame, torch.tensor([3.0, 0.2, 2.0, 0.1])) == {1}  # nothing joins 1 and 3


def levels(*alarms: tuple[int, int]) -> torch.Tensor:
    """Levels (40, 4) that are 0.1 but for 2.0 from a block on, in a DOF."""
    made = torch.full((40, 4), 0.1)
    for block, dof in alarms:
        made[block:, dof - 1] = 2.0
    return made


def test_alarms_are_counted_as_false_early_found_and_missed(motions):
    sound = torch.stack([levels(), levels((7, 1)), levels()])
    damaged = torch.stack([levels((3, 1)), levels((24, 2), (26, 1)), levels()])
    outcome = Outcome(sound, damaged)  # lost: r1, r2, r3
    assert delays_of(damaged) == [-16.0, 5.0, math.inf]
    counted = score(motions, outcome)
    assert counted == Score(3, 1, 1, [5.0, math.inf], 1, 1)
    assert counted.found == 1
    wrong = Outcome(sound, torch.stack([levels((25, 3)), levels((25, 1)), levels((25, 2))]))
    counted = score(motions, wrong)
    assert (counted.found, counted.right_dof, counted.right_element) == (3, 2, 0)


def test_quartiles_count_what_was_missed_as_infinite():
    missed = [math.inf]
    assert Score(1, 0, 0, [4.0, 2.0, 8.0, *missed], 0, 0).quartiles() == [4.0, 8.0, math.inf]
    assert Score(1, 0, 0, 5 * missed, 0, 0).quartiles() == 3 * missed
    assert all(map(math.isnan, Score(1, 0, 1, [], 0, 0).quartiles()))


def test_the_interval_of_false_alarms_is_that_of_clopper_and_pearson():
    low, high = Score(50, 3, 0, [], 0, 0).false_alarms()
    assert low == pytest.approx(beta.ppf(0.025, 3, 48))
    assert high == pytest.approx(beta.ppf(0.975, 4, 47))


def test_no_test_motion_has_a_part_in_the_thresholds(motions):
    """Other sound motions, and the levels of the damaged ones stay as they are, to the bit."""
    others = replace(motions, sound=motions.damaged[::-1])
    for watch in study.WATCHES:
        one, other = (watched(watch, "shear_frame", m) for m in (motions, others))
        assert torch.equal(one.damaged, other.damaged)
        assert torch.equal(one.damaged, other.sound.flip(0))
        shuffled = replace(motions, train=[motions.train[0], *motions.train[:0:-1]])
        assert not torch.equal(watched(watch, "shear_frame", shuffled).damaged, one.damaged)


def test_the_whole_study_in_small(small, tmp_path):
    """The adaptive watch finds all losses of the frame, and names them."""
    page = io.StringIO()
    detect(["shear_frame"], 3, tmp_path, Console(file=page, width=132))
    (row,) = [line for line in page.getvalue().splitlines() if "adaptive" in line]
    cells = [cell.strip() for cell in row.split("│")[1:-1]]
    assert cells[4] == "3 of 3"
    assert cells[-2:] == ["3 of 3", "3 of 3"]
    assert float(cells[6]) < 10.0
    for name in ("detection_delays", "detection_levels"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_single_threshold_keeps_its_rate_as_far_as_its_records_tell(monkeypatch):
    """Of many calibrations on uniform peaks, whose exceedance is known exactly."""
    monkeypatch.setattr(studies.detection.__main__, "HELD", 59)
    monkeypatch.setattr(studies.detection.__main__, "RATE", 1.0 / 30.0)
    low, high = studies.detection.__main__.rate_of_thresholds()
    peaks = torch.rand(20000, 59, generator=torch.Generator().manual_seed(0))
    shares = torch.tensor([1.0 - conformal_threshold(p, 1.0 / 30.0) for p in peaks])
    assert float((shares < low).double().mean()) == pytest.approx(0.025, abs=0.005)
    assert float((shares > high).double().mean()) == pytest.approx(0.025, abs=0.005)
    assert float(shares.mean()) == pytest.approx(1.0 / 30.0, rel=0.02)
