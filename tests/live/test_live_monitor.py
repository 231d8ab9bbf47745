"""python -m live: what is printed and written as it runs, and its alarm."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from data.record import Record
from data.sample import Sample
from live.monitor import LEARNING, LiveMonitor, ResidualAlarm
from live.view import status_line, summary
from models.online.adaptive import Online
from models.online.scores import running_error
from tests.program.test_train import PLAIN, finished_run

DT = 0.01

# What is shown and left behind


def test_estimates_and_scalars_are_written_as_it_runs(run, lines):
    words = ("-", "--rate", "100", "--output", "made.csv", "--log", "logs", "--every", "1")
    status, out, _ = run(*words, text=lines)
    assert status == 0
    assert [line[:9] for line in out.splitlines()[:3]] == [f"t = {k}.0 s" for k in (1, 2, 3)]
    tags = EventAccumulator("logs").Reload()
    wanted = {"a1/measured", "a3/estimated", "error/running_percent", "weights/norm"}
    assert wanted <= set(tags.Tags()["scalars"])
    assert 60 < len(tags.Scalars("a1/measured")) <= 81  # of 400 samples, 20 a second
    measured = np.genfromtxt("made.csv", delimiter=",", names=True)["a1"]
    event = tags.Scalars("a1/measured")[10]
    assert event.value == pytest.approx(measured[event.step], rel=1e-6)
    assert run("-", "--rate", "100", "--output", "made.csv", text=lines)[0] == 1
    assert run("-", "--rate", "100", "--output", "made.csv", "--force", text=lines)[0] == 0


def followed(record: Record, offset: float = 0.0, **trained: dict) -> LiveMonitor:
    """A monitor of estimates that are all off by the same share."""
    stream = Online(record.dofs, record.excitation.shape[-1], record.dt).stream(from_nothing=True)
    monitor = LiveMonitor(stream, record.dt, trained)
    for k in range(record.samples):
        sample = Sample(record.f[k], record.a[k], time=k * record.dt)
        stream.step(sample)
        monitor.add_sample(sample, ((1.0 + offset) * record.a[k]).numpy())
        monitor.add_time(1e-5, 0.0)
    return monitor


def test_one_overrun_is_one(bilinear_record):
    monitor = followed(bilinear_record.measured().window(0, 50), 0.1)
    for count, words in ((0, " 0 overruns"), (1, " 1 overrun "), (2, " 2 overruns")):
        monitor.overruns = count
        assert words in " ".join(summary(monitor, None)).replace("overrun of", "overrun  of")
        assert words.rstrip() in status_line(monitor, None)


def test_the_running_error_is_that_of_the_reports(bilinear_record):
    record = bilinear_record.measured()
    monitor = followed(record, 0.1)
    assert monitor.running_error()[0] == pytest.approx(10.0)
    assert monitor.running_error()[1] == pytest.approx([10.0] * 3)
    assert monitor.error()[0] == pytest.approx(10.0)
    monitor.estimated[:] = 0.0
    assert monitor.running_error()[0] == pytest.approx(100.0)
    assert float(running_error(0.0 * record.a, record)[-1]) == pytest.approx(100.0)
    measured, _ = monitor.window()
    np.testing.assert_array_equal(measured, record.a[-200:].numpy())


def test_a_motion_beyond_that_of_training_is_said_whenever_it_came(bilinear_record):
    loud = bilinear_record.measured()
    a, f = (torch.cat([u, 0.1 * u, 0.1 * u]) for u in (loud.a, loud.f))
    record, largest = Record(loud.dt, a, f), a.abs().amax(dim=0)
    half = {"unit": "m/s²", "names": ["x1", "x2", "x3"], "largest": (0.5 * largest).tolist()}
    monitor = followed(record, acceleration=half)
    (found,) = monitor.outside()
    assert found["times"] == pytest.approx(2.0)
    assert monitor.samples > loud.samples + len(monitor.measured)  # which holds none of these
    assert (
        "outside the trained range: 2 × the largest acceleration of x" in summary(monitor, None)[2]
    )
    assert not followed(record, acceleration=half | {"largest": largest.tolist()}).outside()


def test_a_refused_sample_is_no_motion(bilinear_record):
    record = bilinear_record.measured().window(0, 300)
    largest = record.a.abs().amax(dim=0).tolist()
    known = {"unit": "m/s²", "names": ["x1", "x2", "x3"], "largest": largest}
    record = record.map(torch.clone)
    record.a[250] *= 1e3
    assert not followed(record, acceleration=known).outside()


def test_the_noise_of_sensors_is_all_that_is_left_of_a_motion(bilinear_record):
    monitor = followed(bilinear_record.measured(), 0.1)
    assert monitor.noise_percent() is None
    assert "noise" not in status_line(monitor, None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(monitor.stream), "noise", np.full(3, 0.2))
        monitor.measured[:] = 0.1
        assert monitor.noise_percent() == pytest.approx(200.0)
        assert ", by noise alone 200.0 %, " in status_line(monitor, None)


# The alarm


def noise(seconds: int, seed: int) -> torch.Tensor:
    """Residuals (seconds · 100, 3) of unit variance."""
    rng = torch.Generator().manual_seed(seed)
    return torch.randn(100 * seconds, 3, generator=rng, dtype=torch.float64)


def test_a_louder_residual_raises_an_alarm_at_its_dof():
    residuals = noise(400, 0)
    residuals[30_000:, 1] *= 1.3
    alarm = ResidualAlarm(3, DT, sound=160.0)
    raised = [(k, found) for k, u in enumerate(residuals) if (found := alarm.update(u)) is not None]
    (first, found), *more = raised
    assert 300.0 < first * DT < 310.0
    assert found.dof == 2
    assert not more  # one alarm, not one a second


def test_while_nothing_changes_there_is_no_alarm():
    alarm = ResidualAlarm(3, DT, sound=LEARNING + 100.0)
    assert not [k for k, u in enumerate(noise(300, 1)) if alarm.update(u) is not None]
    assert alarm.level() is not None
    assert 0.0 < float(alarm.level().max()) < 1.0


def test_a_loss_of_stiffness_is_announced_with_its_time(run, tmp_path):
    words = ["baselines=none", "model=vwnn", "system=shear_frame", "data.duration=30"]
    folder = finished_run(tmp_path / "run", *PLAIN[1:], *words)
    hurt = ["damage=sudden", "damage.time=60", "damage.fraction=0.6", "data.duration=80"]
    status, out, _ = run(
        "simulation", "--run", str(folder), *hurt, "--speed", "inf", "--sound", "50"
    )
    assert status == 0
    line = out.splitlines()[-1]
    assert line.startswith("ALARM at ")
    assert 60.0 < float(line.split()[2]) < 80.0
