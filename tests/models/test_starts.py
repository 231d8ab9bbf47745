"""Where training begins: a structure from every motion of one, whatever its units; signs named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from data.record import Drive, Record
from models.element_network import ElementNetwork
from models.latent_hysteresis_network import LatentHysteresisNetwork
from models.starts.ladder import nearest_structure, not_negative, triangle
from models.starts.spectra import Layout, LinearStructure, Spectra, respond, typical
from tests.models.planted import DT, planted

MASSES = [1.2, 1.0, 0.7]
STIFFNESS = [900.0, 700.0, 500.0]


def coloured(channels: int, samples: int, seed: int) -> Tensor:
    """Noise up to 8 Hz that swells and fades, of about 1."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.standard_normal((samples, channels)), axis=0)
    spectrum[np.fft.rfftfreq(samples, DT) > 8.0] = 0.0
    noise = np.fft.irfft(spectrum, samples, axis=0)
    return torch.from_numpy(3.0 * noise * np.sin(np.linspace(0.0, np.pi, samples))[:, None])


def chain(base: bool, yielding: float = 0.0) -> ElementNetwork:
    """A chain of three; `yielding`: share of the stiffness that is lost beyond the limits."""
    driven = {"forced": "base", "inputs": 1} if base else {}
    return planted(MASSES, STIFFNESS, "chain", yielding=yielding, damper=0.002, **driven)


@torch.no_grad()
def motion(
    model: ElementNetwork, samples: int = 3000, noise: float = 0.0, rest: int = 0, seed: int = 0
) -> Record:
    """Accelerations alone, after a start at `rest`, with noise on every channel."""
    u = torch.cat([torch.zeros(rest, model.inputs), coloured(model.inputs, samples, seed)]).double()
    zero = torch.zeros(3, dtype=torch.float64)
    a = model.free_run(Drive(DT, u, zero, zero)).a
    errors = torch.randn(2, len(u), 3, generator=torch.Generator().manual_seed(seed)).double()
    f = u + noise * u.std() * errors[0, :, : model.inputs]
    return Record(DT, a + noise * a.std() * errors[1], f)


def layout_of(model: ElementNetwork) -> Layout:
    return Layout(model.B.numpy(), model.B_s.numpy(), model.forced, model.base)


@torch.no_grad()
def error(model, record: Record) -> float:
    return float((model.free_run(record.drive()).a - record.a).norm() / record.a.norm())


# Spectra


def test_a_planted_chain_is_found_from_its_spectra_and_a_far_start():
    model = chain(base=True)
    record, layout = motion(model), layout_of(model)
    spectra = Spectra.of([record])
    found = nearest_structure(spectra, layout)
    wanted = LinearStructure(np.array(MASSES), np.array(STIFFNESS), np.zeros(3))
    frequencies = [np.sqrt(s.frequencies(layout.B)) for s in (found, wanted)]
    assert frequencies[0] == pytest.approx(frequencies[1], rel=0.02)
    assert spectra.error(found, layout) < 0.15  # the motion is cut while it rings down


@pytest.mark.parametrize("base", [True, False])
def test_derivatives_of_a_response_are_those_of_differences(base):
    model = chain(base)
    spectra, layout = Spectra.of([motion(model, 500)]), layout_of(model)
    structure = typical(spectra, layout, 50.0, np.array([1.0, 0.8, 0.6]))
    slopes = respond(structure, layout, spectra, structure)[1]
    theta = np.concatenate(list(vars(structure).values()))
    for i in range(len(theta)):
        ends = []
        for step in (1e-6, -1e-6):
            moved = theta.copy()
            moved[i] *= np.exp(step)
            ends.append(respond(LinearStructure(*np.split(moved, 3)), layout, spectra)[0])
        difference = (ends[0] - ends[1]) / 2e-6
        assert np.abs(slopes[..., i] - difference).max() < 1e-5 * np.abs(slopes).max()


# Springs of either sign

BENT = [900.0, -100.0, -40.0, 700.0, -80.0, 500.0]  # N/m; all but a chain's are below zero


class Positive(ElementNetwork):
    takes_either_sign = False


def bent_frame() -> ElementNetwork:
    """All pairs of three masses on a shaken base, whose columns bend over several storeys."""
    settings = {"forced": "base", "from_accelerations": True}
    return planted(MASSES, BENT, "all", inputs=1, damper=0.002, **settings)


def test_a_frame_whose_columns_bend_over_storeys_is_found_by_negative_springs():
    model = bent_frame()
    spectra, layout = Spectra.of([motion(model, 1500, noise=0.02)]), layout_of(model)
    either = replace(layout, either=np.array(model.laws.either))
    found = nearest_structure(spectra, either)
    errors = [spectra.error(one, layout) for one in (found, nearest_structure(spectra, layout))]
    assert errors[0] < 0.75 * errors[1]  # both have what is cut off while it rings down
    assert [k > 0.0 for k in found.stiffness] == [k > 0.0 for k in BENT]


# Least squares with bounds


def test_bounds_hold_and_the_solution_is_exact_where_they_are_idle():
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((200, 4)) * np.array([1.0, 1e6, 1e-6, 1.0])
    planted_at = np.array([1.0, 2e-6, 3e6, 0.5])
    factor = triangle(torch.from_numpy(rows), torch.from_numpy(rows @ planted_at))
    assert not_negative(factor) == pytest.approx(planted_at, rel=1e-9)
    factor = triangle(torch.from_numpy(rows), torch.from_numpy(rows @ (planted_at * [1, 1, 1, -1])))
    assert (not_negative(factor) >= 0.0).all()


# The ladder


def test_a_yielding_noisy_chain_on_a_shaken_base_gets_a_start():
    record = motion(chain(True, 0.8), noise=0.05)
    model = ElementNetwork(3, 1, DT, forced="base")
    facts = model.identify([record])
    assert facts["topology"] == "chain"
    assert (model.mass() > 0.0).all()
    assert (model.laws.stiffness() > 0.0).all()
    assert error(model, record) < 0.5


@pytest.mark.parametrize("channel", ["a2", "f1", "all forces"])
def test_the_channel_whose_sign_is_wrong_is_named(channel):
    record = motion(chain(False))
    a, f = record.a.clone(), record.f.clone()
    if channel == "a2":
        a[:, 1] *= -1.0
    elif channel == "f1":
        f[:, 0] *= -1.0
    else:
        f *= -1.0
    model = ElementNetwork(3, 3, DT, "chain")
    with pytest.raises(ValueError, match=f"sign of {channel} changed: check the signs and units"):
        model.identify([replace(record, a=a, f=f)])


@pytest.mark.parametrize("base", [True, False])
def test_a_latent_network_gets_a_start(base):
    record = motion(chain(base, 0.8), noise=0.1)
    model = LatentHysteresisNetwork(3, record.f.shape[1], DT, from_accelerations=True)
    model.identify([record])
    assert error(model, record) < 0.6


# Topology


def test_a_chain_by_its_name_and_where_all_pairs_are_not_determined():
    chain = [["ground", "x1"], ["x1", "x2"], ["x2", "x3"]]
    assert ElementNetwork(3, 3, DT, "chain").elements == chain
    assert ElementNetwork(3, 1, DT, forced="base").elements == chain
    assert ElementNetwork(3, 1, DT, None, MASSES, forced="base").topology == "all pairs"
    assert len(ElementNetwork(3, 1, DT, "all", forced="base").elements) == 6
    assert ElementNetwork(2, 2, DT, "chain", forced=[]).elements == [["s1", "x1"], ["x1", "x2"]]
    assert len(ElementNetwork(5, 5, DT).elements) == 5
    with pytest.raises(ValueError, match="is for one support, there are 3"):
        ElementNetwork(3, 9, DT, "chain")


def test_springs_of_either_sign_pass_through_zero():
    model = bent_frame()
    stiffness = model.laws.stiffness
    assert stiffness().detach() == pytest.approx(torch.tensor(BENT))
    assert stiffness.exponential.tolist() == [k > 0.0 for k in BENT]
    slope, theta = stiffness.slope(), stiffness.theta.data
    for step in (0.3, -2.0, 2.0):
        before = stiffness().tolist()
        theta[1] += step
        assert stiffness().tolist()[1] - before[1] == pytest.approx(step * float(slope[1]))
    assert Positive(3, 1, DT, "all", forced="base").laws.either == []
    assert ElementNetwork(3, 1, DT, "chain", forced="base").laws.either == []
    assert ElementNetwork(3, 3, DT, "all").laws.either == []
