"""FIR filter, linear state-space model and linear motion: what is linear is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from data.record import Drive, Record
from models.fir import FIR
from models.fit.blocks import BLOCKS, blocks_of, fewest, motions_of, sizes_of
from models.fit.metrics import free_run_score
from models.linear import EquivalentLinear
from models.linear_motion import LinearMotion, OutputError, run_of_weights
from models.linear_state_space import LinearStateSpace, terms

MODELS = (FIR, LinearStateSpace)
DT = 0.01
POLES = np.array([0.97 * np.exp(0.2j), 0.9 * np.exp(0.7j), 0.5])  # and their conjugates


def drawn(seed: int, samples: int, level: float = 1.0) -> Record:
    """A record of a planted system of five poles, two outputs and a direct way through."""
    noise = np.random.default_rng(seed).normal(size=(samples, 2))
    u, sizes = level * noise, np.random.default_rng(9)
    y = u @ sizes.normal(size=(2, 2))
    for pole in POLES:
        pair = np.array([[pole.real, abs(pole.imag)], [pole.real, -abs(pole.imag)]])
        answer = terms(u @ sizes.normal(size=(2, 1)), pair)
        y = y + answer[:, 1:] @ sizes.normal(size=(2, 2))
    return Record(DT, torch.from_numpy(y), torch.from_numpy(u))


def fitted(make, records, **settings):
    model = make(records[0].dofs, records[0].excitation.shape[-1], records[0].dt, **settings)
    return model, model.identify(records)


def error(model, records) -> float:
    return free_run_score(model, records)["relative_rms_percent"]


def impulse(model, samples: int, inputs: int = 2) -> torch.Tensor:
    u = torch.zeros(samples, inputs, dtype=torch.float64)
    u[0, 0] = 1.0
    rest = torch.zeros(model.dofs, dtype=torch.float64)
    return model.free_run(Drive(DT, u, rest, rest)).a


@pytest.mark.parametrize("records", [1, 3, 12])
def test_a_planted_system_is_found_from_one_or_several_records(records):
    given = [drawn(seed, 1800 // records) for seed in range(records)]
    model, facts = fitted(LinearStateSpace, given)
    assert facts["poles"] in (5, 6)  # six are tried, four do not do; one that grew is left out
    found = torch.view_as_complex(model.poles[: facts["poles"]]).numpy()
    assert min(abs(found - 0.5)) < 1e-6
    assert min(abs(found - POLES[0])) < 1e-6
    assert error(model, [drawn(99, 1000)]) < 1e-3


def test_the_impulse_response_is_that_of_the_planted_system():
    given, planted = [drawn(0, 4000)], drawn(0, 60)
    u = torch.zeros_like(planted.f)
    u[0, 0] = 1.0
    state_space, _ = fitted(LinearStateSpace, given)
    fir, facts = fitted(FIR, given)
    for model, near in ((state_space, 1e-4), (fir, 0.05)):
        answer = impulse(model, 60)
        assert torch.allclose(answer, impulse(state_space, 60), atol=near)
    assert 100 <= facts["taps"] <= 300  # 0.97^150 = 0.01
    assert torch.equal(impulse(fir, 400)[facts["taps"] :], torch.zeros(400 - facts["taps"], 2))


@pytest.mark.parametrize("make", MODELS)
def test_the_motion_of_a_linear_structure_is_followed(make, linear_structure, record_of):
    from data.simulation.excitation import BandLimitedGaussian, Excitation

    shaken = Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.5)), dofs=[1])
    train, test = (record_of(linear_structure, shaken, 50.0, seed) for seed in range(2))
    model, _ = fitted(make, [train.measured()])
    run = model.free_run(test.drive())
    assert error(model, [test]) < {FIR: 12.0, LinearStateSpace: 0.5}[make]
    assert (run.x - test.x).norm() < 0.2 * test.x.norm()  # measured in training, so modelled


def test_a_motion_that_grows_gives_poles_that_decay():
    u = np.random.default_rng(0).normal(size=(600, 1))
    y = lfilter([1.0], [1.0, -1.02], u, axis=0)
    model, _ = fitted(LinearStateSpace, [Record(DT, torch.from_numpy(y), torch.from_numpy(u))])
    sizes = torch.view_as_complex(model.poles[: int(model.order)]).abs()
    assert float(sizes.max()) < 1.0
    assert float(impulse(model, 100_000, 1)[-1].abs().max()) < 1e-3


@pytest.mark.parametrize("make", MODELS)
def test_noise_is_not_learned(make):
    """Neither more parameters than held-back motion asks for, nor noise that has no cause."""
    generator = torch.Generator().manual_seed(0)
    clean = [drawn(seed, 3000) for seed in range(2)]
    noise = [torch.randn(r.a.shape, generator=generator).double() for r in clean]
    noisy = [replace(r, a=r.a + 0.3 * r.a.std() * n) for r, n in zip(clean, noise, strict=True)]
    model, _ = fitted(make, noisy)
    assert error(model, [drawn(5, 3000)]) < 12.0
    useless = [replace(r, a=n) for r, n in zip(clean, noise, strict=True)]
    model, facts = fitted(make, useless)
    assert 95.0 < error(model, useless) < 101.0
    assert facts["held_out_error_percent"] > 99.0
    assert facts.get("poles", 0) <= 2
    assert facts.get("taps", 0) <= 16


@pytest.mark.parametrize("make", MODELS)
def test_records_by_themselves_and_in_a_batch_are_one_motion_each(make):
    """No window and no lag reaches from one record into the next."""
    from data.record import stack

    records = [drawn(seed, 900, level=10.0**seed) for seed in range(3)]
    one, _ = fitted(make, records)
    other, _ = fitted(make, [stack(records)])
    assert torch.allclose(impulse(one, 100), impulse(other, 100), atol=1e-6)


@pytest.mark.parametrize("make", MODELS)
def test_imposed_motions_and_displacements_are_inputs_and_outputs_too(make):
    u = drawn(3, 2000)
    s, rate = u.f[:, :1], u.f[:, 1:]
    record = Record(DT, u.a[:, :1], u.f[:, :0], s=s, s_dot=rate, quantity="displacement")
    model, _ = fitted(make, [record])
    assert error(model, [record]) < 10.0


@pytest.mark.parametrize("make", MODELS)
def test_samples_of_the_warm_up_are_not_fitted(make):
    record = drawn(4, 2000)
    spoilt = record.a.clone()
    spoilt[:500] += 100.0
    model, _ = fitted(make, [replace(record, a=spoilt, warmup=500)])
    assert error(model, [replace(record, warmup=500)]) < 3.0


@pytest.mark.parametrize("make", MODELS)
def test_what_is_too_short_or_still_is_refused(make):
    if make is LinearStateSpace:
        with pytest.raises(ValueError, match="too short"):
            fitted(make, [drawn(0, 400).window(0, 20)])
    record = drawn(0, 400)
    with pytest.raises(ValueError, match=r"too still|follows the motion"):
        fitted(make, [replace(record, a=torch.zeros_like(record.a))])
    with pytest.raises(ValueError, match="must be a whole number from 1"):
        make(2, 2, DT, 0)


@pytest.mark.parametrize("sizes", [(1.0, 1.0), (10.0, 1.0, 1.0), (0.1, 1.0, 5.0, 0.2, 1.0, 2.0)])
def test_blocks_have_equal_power_and_cover_each_counted_sample_once(sizes):
    """Also where one record is stronger than all others: as a block it would outweigh them."""
    records = [replace(drawn(seed, 1000), warmup=50) for seed in range(len(sizes))]
    records = [replace(r, a=size * r.a) for r, size in zip(records, sizes, strict=True)]
    motions = motions_of(records)
    blocks = blocks_of(motions, 2)
    assert len(blocks) == BLOCKS
    seen = [(p.motion, k) for block in blocks for p in block for k in range(p.start, p.stop)]
    assert sorted(seen) == [(i, k) for i in range(len(sizes)) for k in range(50, 1000)]
    power = sizes_of(motions, blocks, 2)
    assert power == pytest.approx(power.mean(), rel=0.1)


def test_the_fewest_parameters_within_a_standard_error_are_chosen():
    errors = np.array([[0.5, 0.5, 0.5], [0.11, 0.09, 0.1], [0.1, 0.1, 0.1], [0.09, 0.1, 0.1]])
    assert fewest(errors) == 1
    assert fewest(errors - [[0], [0], [0.09], [0.09]]) == 2
    with pytest.raises(ValueError, match="outliers"):
        fewest(np.full((2, 3), np.inf))


# The linear bar: recovers what is linear from any channels, and never diverges


def relative_error(record: Record) -> float:
    model = LinearMotion(record.dofs, record.excitation.shape[-1], record.dt)
    model.identify([record])
    return free_run_score(model, [record])["relative_rms_percent"]


def test_a_linear_structure_is_recovered(linear_record):
    assert relative_error(linear_record) < 1e-3


def test_accelerations_and_forces_alone_are_enough(linear_record):
    assert relative_error(replace(linear_record, x=None, v=None)) < 1.0


def test_its_free_run_is_fitted_from_noisy_accelerations(linear_record):
    noise = torch.randn(linear_record.a.shape, generator=torch.Generator().manual_seed(0))
    level = 0.3 * float(linear_record.a.std())
    noisy = replace(linear_record, a=linear_record.a + level * noise.to(linear_record.a))
    noisy = replace(noisy.measured(), x=None, v=None)
    model = LinearMotion(noisy.dofs, noisy.f.shape[-1], noisy.dt)
    model.identify([noisy])
    assert free_run_score(model, [linear_record])["relative_rms_percent"] < 3.0


def test_derivatives_of_the_free_run_are_those_of_small_steps(linear_record):
    model = LinearMotion(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    model.identify([linear_record])
    weights = 1.05 * model.system.weights.data
    problem = OutputError(weights, [linear_record], run_of_weights, lambda motion: motion.a)
    _, slope = problem.normal_equations()
    place, here = (3, 1), problem.loss()
    step = 1e-5 * float(problem.theta.data[place])
    problem.theta.data[place] += step
    measured = float(problem.loss() - here) / step
    expected = 2.0 / problem.y.numel() * float(slope[place[0] * weights.shape[1] + place[1]])
    assert measured == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("hold", ["zero_order", "band_limited"])
def test_its_run_is_that_of_the_equivalent_linear_system(linear_record, hold):
    ours = LinearMotion(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    theirs = EquivalentLinear(linear_record.dofs, linear_record.f.shape[-1], linear_record.dt)
    for model in (ours, theirs):
        model.identify([linear_record])
    theirs.weights.data = ours.system.weights.data
    drive = replace(linear_record.drive(), hold=hold)
    near = {"rtol": 0.0, "atol": (1e-3 if hold == "band_limited" else 1e-9) * float(drive.u.std())}
    assert torch.allclose(ours.free_run(drive).a, theirs.free_run(drive).a, **near)


def test_noise_makes_it_useless_and_never_diverge():
    noise = torch.randn(2000, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    assert relative_error(Record(0.01, noise[:, :3], noise[:, 3:])) < 110.0


@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
def test_a_model_that_is_loaded_estimates_what_it_was_trained_on(linear_record, quantity):
    seen = linear_record if quantity == "acceleration" else of_displacements(linear_record)
    first, second = (LinearMotion(seen.dofs, seen.f.shape[-1], seen.dt) for _ in range(2))
    first.identify([seen])
    second.load_state_dict(first.state_dict())
    assert torch.equal(second(seen), first(seen))
    assert (first(seen) - seen.a).norm() < 0.02 * seen.a.norm()


def of_displacements(record):
    return replace(record.measured(), a=record.x, x=None, v=None, quantity="displacement")
