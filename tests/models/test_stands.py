"""Models that are as good as can be on one motion, and run away on another."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch

from data.record import Record, Response
from models.fit.stands import MORE, stands
from models.starts.judged import _like, farthest
from tests.models.test_starts import motion as shaken
from tests.models.test_starts import planted


def test_a_spring_that_gives_way_beyond_the_trained_motion_is_found_out():
    """Softening: k y + k₃ y³ with k₃ < 0 holds up to y = √(k/|k₃|), and nothing holds beyond."""
    model = planted(True)
    record = shaken(model, 600)
    with torch.no_grad():
        model.laws.cubic.theta.fill_(-1.0)
        model.laws.cubic.unit.mul_(10.0)
        drive = record.drive()
        assert float(model.free_run(drive).a.abs().max()) < float(record.a.abs().max())
        larger = model.free_run(shaken(model, 600).map(lambda u: MORE * u).drive()).a
    assert not larger.isfinite().all()
    assert not stands(model, record)
    assert farthest(model, [record]) > 100.0


@pytest.mark.parametrize("times", [1.0, 1e-6])
def test_a_linear_structure_moves_in_proportion_under_excitations_like_those_of_a_record(times):
    """The spectrum tells how large a stationary motion is; peaks of draws differ by less."""
    model = planted(False)
    record = shaken(model, 2000).map(lambda u: times * u)
    assert 0.5 < farthest(model, [record]) < 2.0


def test_an_excitation_like_another_has_its_spectrum_and_other_phases():
    u = shaken(planted(False), 2000).excitation
    quiet = torch.cat([torch.zeros(200, 3), u, torch.zeros(200, 3)]).double()  # nothing is tapered
    record = Record(0.01, torch.zeros_like(quiet), quiet)
    drawn = torch.Generator().manual_seed(3)
    one, other = (_like(record, drawn).u for _ in range(2))
    sizes = [torch.fft.rfft(signal, dim=0)[1:-1].abs() for signal in (quiet, one, other)]
    for size in sizes[1:]:
        assert torch.allclose(size, sizes[0], atol=1e-9 * float(sizes[0].max()))
    for signal in (one - quiet, one - other):
        assert float(signal.norm()) > float(quiet.norm())


def test_an_element_that_slides_is_found_out_though_accelerations_stay_in_proportion():
    def trace(drive):
        y = drive.u**2 * (1.0 + drive.u.abs().max()) ** 4
        return SimpleNamespace(response=Response(drive.u, drive.u, drive.u), deformations=y)

    u = torch.sin(torch.linspace(0.0, 60.0, 400).double())[:, None]
    assert farthest(SimpleNamespace(trace=trace), [Record(0.01, u, 10.0 * u)]) > 4.0
