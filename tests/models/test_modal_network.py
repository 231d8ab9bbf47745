"""Modal network: exact modes, laws without jumps, input between samples, planted systems."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy import signal
from scipy.integrate import solve_ivp

from data.record import Record
from models import ModalNetwork
from models.modal.excitation import Excited, interpolated
from models.modal.layout import Layout
from models.modal.linear_start import by_spectra
from models.modal.problem import Motion
from models.modal.run import blocks, exact_steps, outputs
from models.modal.run_compiled import features

SMALL = {
    "modes": 1,
    "elements": 1,
    "laws": ["cubic"],
    "directions": 6,
    "draws": 1,
    "iterations": 30,
}


def layout_and_values(modes: int, elements: int, seed: int = 0) -> tuple[Layout, np.ndarray]:
    """Two hinges and two units in every law, two inputs, two outputs."""
    rng = np.random.default_rng(seed)
    layout = Layout(modes, elements, 2, 2, 2, 2)
    parts = {name: 0.4 * rng.standard_normal(shape) for name, shape in layout.shapes.items()}
    w = np.linspace(1.0, 2.5, modes)
    parts |= {"log_k": 2.0 * np.log(w), "log_c": np.log(0.06 * w)}
    parts["laws"] *= 0.15
    for i in range(elements):
        parts["laws"][i, 5:] = [0.2, 0.3, -1.0, 0.2, -0.2, -1.5, 0.3, 0.3, 0.2, 0.2, 1.0, -0.3]
    return layout, layout.join(parts)


def waves(samples: int, dt: float) -> np.ndarray:
    t = dt * np.arange(samples)
    return np.stack([np.sin(0.9 * t) + 0.6 * np.sin(1.7 * t + 1.0), np.cos(1.3 * t)], axis=1)


def excited(samples: int = 300, dt: float = 0.2, substeps: int = 4) -> Excited:
    u = waves(samples, dt)
    return Excited(u, interpolated(u, "linear", substeps), dt)


@pytest.mark.parametrize("damping", [0.1, 9.0])  # the last is over-damped
@pytest.mark.parametrize("force", ["linear", "parabola"])
def test_a_mode_steps_exactly(damping, force):
    k, h, start = 1.7, 0.8, np.array([0.3, -0.5])
    f = np.array([0.2, 1.0, -0.7]) if force == "parabola" else np.array([0.2, -0.25, -0.7])
    c = exact_steps(np.log([k]), np.log([damping]), h)[0, 0]
    ours = c[:4].reshape(2, 2) @ start
    if force == "linear":
        ours = ours + c[4:6] * f[0] + c[6:8] * f[2]
    else:
        ours = ours + c[8:10] * f[0] + c[10:12] * f[1] + c[12:14] * f[2]
    curve = np.polyfit([0.0, 0.5 * h, h], f, 2)
    theirs = solve_ivp(
        lambda t, s: [s[1], np.polyval(curve, t) - k * s[0] - damping * s[1]],
        (0.0, h), start, rtol=1e-12, atol=1e-13,
    ).y[:, -1]  # fmt: skip
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_a_unit_is_that_of_bouc_and_wen_and_has_no_jump():
    """dz/dy = 1 − |z| (b₊ or b₋), whatever the steps; κ = 0 unloads along a line."""
    t = np.linspace(0.0, 12.0, 4001)
    y = 1.5 * np.sin(t) + 0.5 * np.sin(3.1 * t)
    fine = features(y, 0.0 * y, np.empty(0), 0.0, np.array([0.5]))[:, -1] + y
    seldom = y[::40].copy()
    coarse = features(seldom, 0.0 * seldom, np.empty(0), 0.0, np.array([0.5]))[:, -1] + seldom
    b, z = np.exp(0.5), np.zeros_like(y)
    for i in range(1, len(y)):
        d = y[i] - y[i - 1]
        z[i] = z[i - 1] + d * (1.0 - b * max(z[i - 1] * np.sign(d), 0.0))
    assert np.abs(z - fine).max() < 2e-3
    assert np.abs(fine[::40] - coarse).max() < 0.02  # turning points between samples
    assert np.abs(np.diff(fine)).max() <= np.abs(np.diff(y)).max() * (1.0 + 1e-9)
    assert np.abs(fine).max() < 1.0 / b


def test_derivatives_are_those_of_differences():
    layout, values = layout_and_values(3, 2)
    drive, rng = excited(), np.random.default_rng(1)
    begin = 0.2 * rng.standard_normal(layout.states)
    learned = rng.random(layout.size) < 0.8
    runs = list(blocks(layout, values, drive, begin, learned, own=True))
    J = np.concatenate([run[2] for run in runs])
    points = [*np.flatnonzero(learned), *(-1 - np.arange(layout.states))]
    assert J.shape[2] == len(points)
    for column, place in enumerate(points):
        sides = []
        for e in (1e-6, -1e-6):
            one, first = values.copy(), begin.copy()
            if place >= 0:
                one[place] += e
            else:
                first[-1 - place] += e
            sides.append(outputs(layout, one, drive, first)[0])
        difference = (sides[0] - sides[1]) / 2e-6
        assert np.abs(J[..., column] - difference).max() < 1e-4 * np.abs(difference).max() + 1e-7


def test_a_run_converges_with_the_second_order():
    layout, values = layout_and_values(3, 2)
    u, dt = waves(200, 0.4), 0.4
    runs = [
        outputs(
            layout, values, Excited(u, interpolated(u, "linear", s), dt), np.zeros(layout.states)
        )[0]
        for s in (2, 4, 8, 256)
    ]
    errors = [float(np.abs(run - runs[-1]).max()) for run in runs[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.7).all()


def test_band_limited_interpolation_between_samples():
    t = np.arange(400.0)
    wave = lambda t: np.sin(0.5 * t + 0.3) + 0.5 * np.cos(1.1 * t)
    fine = interpolated(wave(t)[:, None], "band_limited", 2)
    assert fine.shape == (399, 5, 1)
    true = wave(t[:-1, None] + np.arange(5) / 4.0)
    assert np.abs(fine[60:-60, :, 0] - true[60:-60]).max() < 1e-6


def test_spectra_find_hidden_modes_of_a_record_that_begins_anywhere():
    """Four modes behind one output."""
    rng, dt = np.random.default_rng(0), 0.3
    layout = Layout(4, 0, 1, 1)
    w = np.array([0.5, 1.0, 1.6, 2.3])
    parts = {name: np.ones(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": 2.0 * np.log(w), "log_c": np.log(0.04 * w), "Cv": np.zeros((1, 4))}
    u = rng.standard_normal((3000, 1))
    drive = Excited(u, interpolated(u, "linear", 1), dt)
    y, _ = outputs(layout, layout.join(parts), drive, rng.standard_normal(8))
    found, state = by_spectra([Motion(drive, y, np.ones(1), True, 3000)], 4)
    k = np.exp(found.split(state.values)["log_k"])
    np.testing.assert_allclose(np.sqrt(k), w, rtol=1e-3)
    run, _ = outputs(found, state.values, drive, state.begins[0])
    assert np.abs(run - y).max() < 0.02 * np.abs(y).max()


def duffing(samples: int, seed: int, noise: float = 1e-3) -> Record:
    """A circuit with offsets, quadratic and cubic spring, cut out of a motion [V]."""
    rng, dt, before = np.random.default_rng(seed), 1e-3, 300
    whole = samples + before
    u = np.cumsum(rng.standard_normal(whole)) * 0.1
    u -= np.convolve(u, np.ones(40) / 40.0, "same")
    k, t = (2.0 * np.pi * 60.0) ** 2, dt * np.arange(whole)

    def slope(at: float, s: np.ndarray) -> list[float]:
        force = np.interp(at, t, u) + 0.05 - s[0] - 0.3 * s[0] ** 2 - 0.4 * s[0] ** 3
        return [s[1], k * force - 2.0 * 0.05 * np.sqrt(k) * s[1]]

    q = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-9, max_step=dt).y[0]
    y = torch.from_numpy(q + 0.1 + noise * rng.standard_normal(whole))[before:, None]
    f = torch.from_numpy(u)[before:, None]
    return Record(dt, y, f, warmup=40, initial_state="unknown", quantity="output")


@pytest.fixture(scope="module")
def circuit() -> list[Record]:
    return [duffing(1500, 0), duffing(700, 1)]


@pytest.fixture(scope="module")
def identified(circuit) -> ModalNetwork:
    model = ModalNetwork(1, 1, 1e-3, **SMALL)
    facts = model.identify(circuit[:1])
    assert (facts["modes"], facts["elements"]) == (1, "cubic")
    return model


def rms(model: ModalNetwork, record: Record) -> float:
    error = (model(record) - record.a)[record.warmup :]
    return float(error.square().mean().sqrt())


def test_a_circuit_with_offsets_and_an_unknown_start_is_recovered(identified, circuit):
    assert rms(identified, circuit[0]) < 1.1e-3
    assert rms(identified, circuit[1]) < 1.5e-3  # the noise is 1e-3


def test_the_first_state_is_told_by_the_warm_up_samples_alone(identified, circuit):
    other = circuit[1].a.clone()
    other[circuit[1].warmup :] += 1.0
    assert torch.equal(identified(circuit[1]), identified(replace(circuit[1], a=other)))
    assert not torch.equal(
        identified(circuit[1]), identified(replace(circuit[1], initial_state="rest"))
    )


@pytest.mark.parametrize(
    "wrong",
    [{"modes": 0}, {"elements": -1}, {"laws": ["square"]}, {"substeps": 0}],
)  # fmt: skip
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}="):
        ModalNetwork(1, 1, 1e-3, **wrong)


def test_modes_of_a_small_motion_follow_one_ten_thousand_times_as_large():
    """As those of ambient vibration do an earthquake: a linear run cannot diverge."""
    u = np.random.default_rng(0).standard_normal((600, 1))
    (a,) = signal.lfilter([1.0, -1.0], [1.0, -1.8, 0.9], u.T)
    f, a = (torch.from_numpy(1e-4 * s.reshape(-1, 1)) for s in (u, a))
    model = ModalNetwork(1, 1, 0.01, modes=1, elements=0, iterations=3)
    model.identify([Record(0.01, a, f)])
    still, small, large = (model(Record(0.01, a, size * f)) for size in (0.0, 1.0, 1e4))
    assert torch.allclose(large - still, 1e4 * (small - still), rtol=1e-6, atol=1e-8)


def test_records_that_nothing_drives_are_told_so():
    a = torch.sin(0.1 * torch.arange(200.0, dtype=torch.float64))[:, None]
    with pytest.raises(ValueError, match="nothing drives them"):
        ModalNetwork(1, 1, 1e-3).identify([Record(1e-3, a, 0.0 * a)])


def test_a_record_that_nothing_drives_takes_no_part_in_the_linear_start():
    rng, layout = np.random.default_rng(0), Layout(1, 0, 1, 1)
    parts = {name: np.ones(shape) for name, shape in layout.shapes.items()}
    parts |= {"log_k": np.zeros(1), "log_c": np.log([0.1]), "Cv": np.zeros((1, 1))}
    motions = []
    for size in (1.0, 0.0):
        u = size * rng.standard_normal((1000, 1))
        drive = Excited(u, interpolated(u, "linear", 1), 0.3)
        y, _ = outputs(layout, layout.join(parts), drive, np.array([1.0, 0.0]))
        motions.append(Motion(drive, y, np.ones(1), True, 1000))
    found, state = by_spectra(motions, 1)
    np.testing.assert_allclose(np.exp(found.split(state.values)["log_k"]), 1.0, rtol=0.01)
    assert by_spectra(motions[1:], 1) is None
