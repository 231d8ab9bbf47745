"""Sliders in series with springs: backlash and friction planted, found, and begun anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Record
from models.layers.stop_operator import stretches
from models.prandtl_ishlinskii import PrandtlIshlinskii

DT = 0.01
SLACK, GRIP = 0.002, 0.005  # m: half of the backlash, and where the slider begins to slip


def motion(seed: int, size: float, samples: int = 3000) -> np.ndarray:
    rng, t = np.random.default_rng(seed), DT * np.arange(samples)
    w, phase = rng.uniform(1.0, 8.0, 6), rng.uniform(0.0, 6.0, 6)
    s = (np.minimum(t / 2.0, 1.0) * np.sin(np.outer(t, w) + phase).T).sum(axis=0)
    return size * s / np.abs(s).max()


def joint(seed: int, size: float = 0.03, begin: float = 0.0) -> Record:
    """A slider behind a spring with backlash, stiffer and stronger when it is pushed, in N."""
    s = motion(seed, size)
    z, stretch = np.empty_like(s), begin
    for k in range(len(s)):
        stretch = float(np.clip(stretch + (s[k] - s[k - 1] if k else 0.0), -GRIP, GRIP))
        z[k] = stretch
    spring = np.where(z > 0.0, 5e6, 3e6) * np.sign(z) * np.maximum(np.abs(z) - SLACK, 0.0)
    rate = np.gradient(s, DT)
    r = 2e4 * s + 3e3 * rate + spring
    s, rate, r = (torch.from_numpy(u)[:, None] for u in (s, rate, r))
    none = torch.zeros(len(r), 0)
    return Record(DT, r, none, s=s, s_dot=rate, quantity="force")


def identified(records: list[Record], **settings: int) -> PrandtlIshlinskii:
    model = PrandtlIshlinskii(1, 2, DT, **settings)
    model.identify(records)
    return model


def error(model: PrandtlIshlinskii, record: Record) -> float:
    counted = slice(record.warmup, None)
    difference = (model.run_of(record).a - record.a)[counted]
    return 100.0 * float(difference.norm() / record.a[counted].norm())


@pytest.fixture(scope="module")
def model() -> PrandtlIshlinskii:
    return identified([joint(0), joint(1, 0.02)])


def test_a_joint_with_backlash_is_found_and_holds_for_smaller_and_larger_motions(model):
    assert int((model.widths > 0.0).sum()) == 1
    assert float(model.widths[0] * model.scale[0]) == pytest.approx(GRIP, rel=0.03)
    for size, most in ((0.004, 10.0), (0.01, 3.0), (0.03, 2.0), (0.06, 2.0)):  # nodes are coarse
        assert error(model, joint(2, size)) < most


def test_the_first_samples_alone_tell_where_the_slider_was(model):
    cut = replace(joint(2, 0.004, begin=0.0045), warmup=600, initial_state="unknown")
    assert error(model, cut) < 8.0
    assert error(model, replace(cut, initial_state="rest")) > 20.0
    later = cut.a.clone()
    later[600:] = 1e9
    assert torch.equal(model.run_of(cut).a, model.run_of(replace(cut, a=later)).a)


def test_training_records_may_begin_anywhere():
    records = [joint(0, begin=0.004), joint(1, 0.02, begin=-0.003)]
    cut = [replace(record, warmup=300, initial_state="unknown") for record in records]
    assert error(identified(cut), joint(2)) < 4.0


def test_parallel_sliders_are_told_apart():
    """Two elastoplastic ones, of half widths 2 and 9 mm."""

    widths, stiffness = torch.tensor([[0.002, 0.009], [8e6, 2e6]], dtype=torch.float64)

    def two(seed: int, size: float) -> Record:
        record, none = joint(seed, size), torch.zeros(2, dtype=torch.float64)
        assert record.s is not None
        z = stretches(record.s[:, 0], widths, none)
        return replace(record, a=(z @ stiffness)[:, None])

    model = identified([two(0, 0.03), two(1, 0.02), two(3, 0.03)], sliders=2)
    found = sorted((model.widths[model.widths > 0.0] * model.scale[0]).tolist())
    assert found == pytest.approx([0.002, 0.009], rel=0.05)
    assert error(model, two(2, 0.025)) < 1.0


def test_the_stop_operator_forgets_and_takes_up_energy():
    s = torch.from_numpy(motion(4, 1.0))
    ends = torch.tensor([-0.2, 0.2], dtype=torch.float64)
    z = stretches(s, ends.abs(), ends)
    assert torch.equal(z[-1, 0], z[-1, 1])  # whatever it was at the beginning
    assert float((z[1:, 0] * torch.diff(s)).sum()) > 0.0
    assert float(z.abs().max()) <= 0.2


@pytest.mark.parametrize("wrong", [{"sliders": 7}, {"nodes": 1}, {"ridge": -1.0}])
def test_what_makes_no_sense_is_refused(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=f"{name}={value} must"):
        PrandtlIshlinskii(1, 2, DT, **wrong)
    with pytest.raises(ValueError, match="zero throughout"):
        identified([replace(joint(0), s=torch.zeros(3000, 1).double())])
