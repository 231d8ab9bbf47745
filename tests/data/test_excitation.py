"""Random and given excitation: its spectrum, its chance and its rate of change."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from data.simulation.excitation import BandLimitedGaussian, Excitation, Given, Multisine, SineSweep

DT, T = 0.01, 5000
RANDOM = {
    "gaussian": BandLimitedGaussian(1.7, (0.5, 3.0)),
    "multisine": Multisine(1.7, (0.5, 3.0)),
    "sweep": SineSweep(1.7, (0.5, 3.0)),
}


def draw(waveform, samples=T, dt=DT, channels=1, seed=0, record=0):
    return waveform.draw(samples, dt, channels, record, np.random.default_rng(seed))


def spectrum(values, dt=DT):
    """Frequencies [Hz] and amplitudes of the harmonics of the record."""
    return np.fft.rfftfreq(len(values), dt), 2.0 * np.abs(np.fft.rfft(values, axis=0)) / len(values)


@pytest.fixture(params=RANDOM.values(), ids=RANDOM)
def waveform(request):
    return request.param


def test_the_gaussian_process_has_its_standard_deviation_and_zero_mean():
    values, _ = draw(RANDOM["gaussian"], channels=100)
    assert_allclose(np.sqrt((values**2).mean()), 1.7, rtol=0.02)
    assert np.abs(values.mean(axis=0)).max() < 1e-12


def test_the_gaussian_process_is_gaussian_and_stationary():
    values, _ = draw(RANDOM["gaussian"], samples=1000, channels=4000)
    moments = values[::50]  # (instants, ensemble)
    assert_allclose(moments.std(axis=1), 1.7, rtol=0.06)
    assert np.abs(moments.mean(axis=1)).max() < 0.06 * 1.7
    assert_allclose((moments**4).mean() / (moments**2).mean() ** 2, 3.0, rtol=0.03)


def test_nothing_lies_outside_the_band_and_the_band_is_flat():
    values, _ = draw(RANDOM["gaussian"], channels=400)
    frequency, amplitude = spectrum(values)
    inside = (frequency > 0.49) & (frequency < 3.01)
    assert amplitude[~inside].max() < 1e-12
    power = (amplitude[inside] ** 2).mean(axis=1)
    assert_allclose(power, 2.0 * 1.7**2 / inside.sum(), rtol=0.3)


def test_the_rate_is_the_derivative(waveform):
    values, rate = draw(waveform, samples=10000, dt=0.001, channels=2)
    central = (values[2:] - values[:-2]) / 0.002
    assert_allclose(central, rate[1:-1], atol=1e-4 * np.abs(rate).max())


def test_the_same_seed_at_half_the_time_step_gives_the_same_process(waveform):
    coarse, fine = draw(waveform, 1000, 0.01, 2), draw(waveform, 2000, 0.005, 2)
    for one, other in zip(coarse, fine, strict=True):
        assert_allclose(other[::2], one, atol=1e-11)


def test_a_multisine_has_a_flat_spectrum_and_exactly_its_rms():
    values, _ = draw(RANDOM["multisine"], channels=2)
    frequency, amplitude = spectrum(values)
    inside = (frequency > 0.49) & (frequency < 3.01)
    assert_allclose(amplitude[inside], 1.7 * np.sqrt(2.0 / inside.sum()), rtol=1e-9)
    assert amplitude[~inside].max() < 1e-12
    assert_allclose(np.sqrt((values**2).mean(axis=0)), 1.7, rtol=1e-12)


def test_a_sweep_rises_linearly_through_its_band():
    values, rate = draw(RANDOM["sweep"])
    t = DT * np.arange(T)[:, None]
    omega = 2 * np.pi * (0.5 + (3.0 - 0.5) * t / (T * DT))
    assert_allclose((values * omega) ** 2 + rate**2, (1.7 * omega) ** 2, rtol=1e-9)
    upward = np.flatnonzero((values[:-1, 0] < 0) & (values[1:, 0] >= 0)) * DT
    middle = 0.5 * (upward[1:] + upward[:-1])
    assert_allclose(1 / np.diff(upward), 0.5 + 2.5 * middle / (T * DT), rtol=0.05)


def test_given_records_are_cut_in_order_and_never_reused():
    history = np.sin(np.arange(300.0))
    rows = [draw(Given(history), samples=100, record=i)[0][:, 0] for i in range(3)]
    assert_array_equal(np.concatenate(rows), history)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either values or path"),
        ({"values": np.zeros((9, 1)), "path": "f.csv"}, "either values or path"),
        ({"path": "nowhere/f.csv"}, "no file nowhere/f.csv"),
        ({"values": np.array([[0.0], [np.nan]])}, "not a finite"),
        ({"values": np.zeros((2, 2, 2))}, r"\(2, 2, 2\)"),
    ],
)
def test_a_history_that_cannot_be_used_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Given(**given)


@pytest.mark.parametrize("law", [BandLimitedGaussian, Multisine, SineSweep])
@pytest.mark.parametrize(
    ("size", "band", "message"),
    [
        (1.0, (0.0, 51.0), "Nyquist frequency 50 Hz"),
        (1.0, (3.0, 3.0), "expected 0 ≤ lower < upper"),
        (1.0, (-1.0, 3.0), "expected 0 ≤ lower < upper"),
        (1.0, (0.001, 0.002), "holds no harmonic"),
        (-1.0, (0.0, 3.0), "=-1.0 of the excitation must be positive"),
        (np.nan, (0.0, 3.0), "must be positive"),
    ],
)
def test_a_process_that_cannot_be_is_refused(law, size, band, message):
    with pytest.raises(ValueError, match=message):
        draw(law(size, band))


def test_forces_act_on_the_chosen_masses_only(linear_structure):
    excitation = Excitation(force=RANDOM["gaussian"], dofs=[1, 3])
    force, s, s_dot = excitation.draw(linear_structure, T, DT, 0, np.random.default_rng(0))
    assert_array_equal(force[:, 1], np.zeros(T))
    assert_array_equal(force[:, [0, 2]], draw(RANDOM["gaussian"], channels=2)[0])
    assert not s.any()
    assert not s_dot.any()
    assert excitation.driven(linear_structure) == [0, 2]


def test_supports_move_alone_or_with_the_forces(linear_structure):
    shaken = Excitation(support=RANDOM["gaussian"])
    force, s, s_dot = shaken.draw(linear_structure, T, DT, 0, np.random.default_rng(0))
    assert not force.any()
    assert s.shape == s_dot.shape == (T, 3)
    both = Excitation(RANDOM["gaussian"], RANDOM["gaussian"])
    force, s, _ = both.draw(linear_structure, T, DT, 0, np.random.default_rng(0))
    assert np.abs(np.corrcoef(force.T, s.T)[:3, 3:]).max() < 0.3


def test_a_ramp_starts_at_rest_and_ends_in_the_full_process(linear_structure):
    dt, generator = 0.001, np.random.default_rng
    free = Excitation(RANDOM["gaussian"], RANDOM["gaussian"])
    ramped = Excitation(RANDOM["gaussian"], RANDOM["gaussian"], ramp=2.0)
    full = free.draw(linear_structure, 5000, dt, 0, generator(0))
    grown = ramped.draw(linear_structure, 5000, dt, 0, generator(0))
    assert_allclose(grown[0][1000], 0.5 * full[0][1000])
    for process, ramp in zip(full, grown, strict=True):
        assert_array_equal(ramp[0], np.zeros(3))
        assert_allclose(ramp[2000:], process[2000:], atol=1e-12)
    _, s, s_dot = grown
    assert_allclose((s[2:] - s[:-2]) / (2 * dt), s_dot[1:-1], atol=1e-4 * np.abs(s_dot).max())


@pytest.mark.parametrize(
    ("excitation", "message"),
    [
        (Excitation(), "neither force nor support"),
        (Excitation(RANDOM["gaussian"], dofs=[0]), "excitation.dofs holds 0; the DOFs are 1 … 3"),
        (Excitation(RANDOM["gaussian"], dofs=[4]), "excitation.dofs holds 4"),
    ],
)
def test_an_excitation_that_drives_nothing_is_refused(linear_structure, excitation, message):
    with pytest.raises(ValueError, match=message):
        excitation.draw(linear_structure, 100, DT, 0, np.random.default_rng(0))
