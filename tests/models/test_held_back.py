"""What is held back of a training motion: fits do not see it, and it alone judges between them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data.record import Record
from models.element_network import ElementNetwork
from models.fit.free_run_objective import FreeRun
from models.fit.held_back import held_back_from
from tests.models.test_starts import motion as shaken
from tests.models.test_starts import planted


@pytest.fixture(scope="module")
def model() -> ElementNetwork:
    return planted(True, 0.3)


@pytest.fixture(scope="module")
def record() -> Record:
    """Of a structure that is a little different, so that the model errs everywhere."""
    return shaken(planted(True, 0.7), 1000, 0.02)


@pytest.fixture(scope="module")
def growing(record: Record) -> Record:
    """The part of the motion in which it swells."""
    return record.window(0, 500)


def prepared(model: ElementNetwork, record: Record) -> FreeRun:
    objective = FreeRun([50, None], select=[1e-6])
    objective.prepare(model, [record], measured=True)
    return objective


def turned(record: Record, part: slice) -> Record:
    """Another motion of the same power: a part of it with the other sign."""
    a = record.a.clone()
    a[part] *= -1.0
    return replace(record, a=a)


@torch.no_grad()
def test_no_fit_before_the_last_sees_what_is_held_back(model, record):
    k = held_back_from(record, 0.2)
    other = turned(record, slice(k, None))
    objective = prepared(model, record)
    *first, last = (
        [float(objective.problem(model, r, stage).loss()) for r in (record, other)]
        for stage in range(len(objective.stages))
    )
    assert len(first) > 3
    assert all(one == two for one, two in first)
    assert last[1] > 1.5 * last[0]


@torch.no_grad()
def test_what_is_held_back_alone_judges(model, record):
    k = held_back_from(record, 0.2)
    objective = prepared(model, record)
    objective.present = 0
    loss = objective.final_loss(model, [record])
    assert objective.final_loss(model, [turned(record, slice(0, k))]) == pytest.approx(loss)
    assert objective.final_loss(model, [turned(record, slice(k, None))]) > 2.0 * loss


@torch.no_grad()
def test_the_first_part_is_held_back_where_the_strongest_motion_comes_last(model, record, growing):
    assert not prepared(model, record).judged_first
    objective, k = prepared(model, growing), held_back_from(growing, 0.8)
    assert objective.judged_first
    assert "the first part is held back" in objective.remarks[-1]
    other, later = turned(growing, slice(0, k)), turned(growing, slice(k, None))
    objective.present = 0
    loss = objective.final_loss(model, [growing])
    assert objective.final_loss(model, [later]) == pytest.approx(loss)
    assert objective.final_loss(model, [other]) > 2.0 * loss
    last = len(objective.horizons) - 1  # begins at rest, others at states that take in all before
    whole = [float(objective.problem(model, r, last).loss()) for r in (growing, other, later)]
    assert whole[0] == pytest.approx(whole[1])
    assert whole[2] > 1.5 * whole[0]
