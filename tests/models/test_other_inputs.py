"""An element under other inputs: lag, laws between nodes, derivatives, units, planted dampers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.signal import lsim

from data.record import Record, stack
from models.composition.other_inputs import OtherInputs, lagged
from models.fit.problem import run_problem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.hysteretic_element import HystereticElement
from tests.reference_networks import reference_run

# Controlled dampers under imposed motions, by laws that no model here has: Spencer et al. (1997),
# Phenomenological model for magnetorheological dampers: a Bouc–Wen element (z), a dashpot c₀ and a
# spring in parallel, in series with a dashpot c₁; α, c₀ and c₁ are linear in the voltage that
# reaches the coil, w, a lag behind the voltage that is applied.

Test = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # s, ṡ, other inputs, force


def imposed_motion(
    rng: np.random.Generator, samples: int, dt: float, size: float, top: float
) -> tuple[np.ndarray, np.ndarray]:
    """A random motion of that RMS [m] between 0.1 and `top` Hz, and its rate."""
    frequency = np.fft.rfftfreq(samples, dt)
    phases = np.exp(2j * np.pi * rng.random(len(frequency)))
    spectrum = ((frequency > 0.1) & (frequency < top)) * phases
    s = np.fft.irfft(spectrum, samples)
    rate = np.fft.irfft(2j * np.pi * frequency * spectrum, samples)
    return size / s.std() * s, size / s.std() * rate


def voltage(
    rng: np.random.Generator, samples: int, dt: float, top: float, fastest: float = 4.0
) -> np.ndarray:
    """A random voltage between 0 and `top`; half of them in steps."""
    if rng.random() < 0.5:
        length = round(0.4 / dt)
        levels = top * rng.random(samples // length + 1)
        return np.repeat(levels, length)[:samples]
    smooth, _ = imposed_motion(rng, samples, dt, 0.35, fastest)
    return np.clip(top * (0.5 + smooth), 0.0, top)


def magnetorheological(records: int, samples: int, dt: float, noise: float) -> Iterator[Test]:
    """Tests of a damper of 3 kN, with its published parameters, under 2.25 V at most."""
    rng = np.random.default_rng(0)
    motions = [imposed_motion(rng, samples, dt, 0.006, 3.0) for _ in range(records)]
    s, rate = (np.stack(u, axis=1) for u in zip(*motions, strict=True))  # (T, records)
    volts = np.stack([voltage(rng, samples, dt, 2.25) for _ in range(records)], axis=1)
    force = _force(s, rate, volts, dt, 20)
    for i in range(records):
        measured = force[:, i] + noise * force[:, i].std() * rng.standard_normal(samples)
        yield s[:, i], rate[:, i], volts[:, i : i + 1], measured


def _force(
    s: np.ndarray, rate: np.ndarray, volts: np.ndarray, dt: float, substeps: int
) -> np.ndarray:
    """Forces (T, records) [N] by the classical Runge–Kutta scheme, signals linear in between."""

    def law(at: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (x, v, applied), (y, z, w) = at, state
        alpha, c0, c1 = 14000.0 + 69500.0 * w, 2100.0 + 350.0 * w, 28300.0 + 295.0 * w
        inner = (alpha * z + c0 * v + 4690.0 * (x - y)) / (c0 + c1)
        slip = v - inner
        memory = 301.0 * slip - 3.63e6 * (np.abs(slip) * np.abs(z) * z + slip * z * z)
        force = c1 * inner + 500.0 * (x - 0.143)
        return np.stack([inner, memory, 190.0 * (applied - w)]), force

    signals = np.stack([s, rate, volts], axis=1)  # (T, 3, records)
    state, h = np.stack([s[0], 0.0 * s[0], volts[0]]), dt / substeps
    forces = [law(signals[0], state)[1]]
    for before, after in pairwise(signals):
        for part in range(substeps):
            ends = [before + (part + share) / substeps * (after - before) for share in (0, 0.5, 1)]
            k1 = law(ends[0], state)[0]
            k2 = law(ends[1], state + 0.5 * h * k1)[0]
            k3 = law(ends[1], state + 0.5 * h * k2)[0]
            k4 = law(ends[2], state + h * k3)[0]
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        forces.append(law(after, state)[1])
    return np.stack(forces)


DT = 0.002


def record_of(s, rate, inputs, force, **more) -> Record:
    signals = (torch.from_numpy(np.atleast_2d(u.T).T.copy()) for u in (force, s, rate, inputs))
    force, s, rate, inputs = signals
    none = force.new_zeros(len(force), 0)
    return Record(DT, force, none, s=s, s_dot=rate, e=inputs, quantity="force", **more)


def some_record(samples: int = 300, inputs: int = 1) -> Record:
    rng = np.random.default_rng(0)
    s, rate = imposed_motion(rng, samples, DT, 0.006, 6.0)
    u = np.stack([voltage(rng, samples, DT, 2.0, 8.0) for _ in range(inputs)], axis=1)
    force = 3e4 * s * (1.0 + u[:, 0]) + 400.0 * (1.0 + u.sum(axis=1)) * np.tanh(rate / 0.02)
    return record_of(s, rate, u, force)


def model_of(record: Record, **more) -> HystereticElement:
    """A model whose every coefficient counts."""
    k = record.e.shape[-1]
    model = HystereticElement(record.dofs, 2 * record.dofs + k, DT, other_inputs=k, **more)
    model.identify([record])
    generator = torch.Generator().manual_seed(1)
    for p in model.parameters():
        p.data += 0.1 + 0.3 * torch.rand(p.shape, generator=generator, dtype=p.dtype)
    return model


# The lag


@pytest.mark.parametrize("lag", [0.1, 7.3, 300.0])
def test_a_lag_is_that_of_an_integrator(lag):
    """In samples, on an input that is linear between them; scipy solves it by the exponential."""
    u = np.random.default_rng(0).standard_normal(40)
    system = (np.array([[-1.0 / lag]]), np.array([[1.0 / lag]]), np.eye(1), np.zeros((1, 1)))
    _, exact, _ = lsim(system, u, np.arange(40.0), u[:1])
    of = torch.tensor([lag * DT], dtype=torch.float64)
    ours = lagged(torch.from_numpy(u)[:, None], of, DT)[:, 0]
    assert np.abs(ours.numpy() - exact).max() < 1e-12


# Laws under other inputs


def test_at_a_node_the_law_of_the_node_acts_alone():
    others, one = OtherInputs(1, 1, nodes=3, rates=1), torch.ones(1).double()
    others.start(torch.linspace(0.0, 2.0, 300).double()[:, None] ** 2, one, one, DT)
    assert int(others.used[0]) == 3
    for node, place in enumerate(others.places[0]):
        h, _ = others.weights(place.reshape(1, 1))
        expected = torch.zeros(3).double().index_fill(0, torch.tensor(node), 1.0)
        assert torch.allclose(h[0], expected, atol=1e-12)
    last, step = others.places[0, -1], others.places[0, -1] - others.places[0, -2]
    h, by_w = others.weights((last + 2.0 * step).reshape(1, 1))
    assert torch.allclose(h[0], torch.tensor([0.0, -2.0, 3.0]).double())  # the last line goes on
    assert torch.allclose(by_w[0] * step, torch.tensor([0.0, -1.0, 1.0]).double())


def test_the_compiled_run_and_its_derivatives_are_those_of_pytorch():
    record = some_record(120, 2)
    model = model_of(record, hinges=1, units=2)
    drive = record.drive()
    reference = reference_run(model, drive).a
    with torch.no_grad():
        assert torch.allclose(model.free_run(drive).a, reference, rtol=0.0, atol=1e-9)
    direction = torch.randn(reference.shape, generator=torch.Generator().manual_seed(0)).double()
    free = [p for p in model.parameters() if p.requires_grad]
    slopes = torch.autograd.grad((direction * reference).sum(), free)
    run, jacobian = model.restarted_jacobian(record, None)
    ours = (direction[..., None] * jacobian).sum(dim=(0, 1))
    theirs = torch.cat([s.reshape(-1) for s in slopes])
    assert torch.allclose(run, reference.detach(), rtol=0.0, atol=1e-9)
    assert torch.allclose(ours, theirs, rtol=1e-7, atol=1e-9 * float(theirs.abs().max()))


def test_first_states_have_exact_derivatives_too():
    record = replace(some_record(200), initial_state="unknown")
    model = model_of(record, units=2)
    own = model.first_states(record)
    own += 0.05
    _, _, slopes = model.run_from(record, own, derivatives=True)
    for place in range(len(own)):
        ends = []
        for way in (1e-5, -1e-5):
            moved = own.clone()
            moved[place] += way
            ends.append(model.run_from(record, moved, derivatives=False)[0])
        found = (ends[0] - ends[1]) / 2e-5
        assert torch.allclose(slopes[..., place], found, rtol=1e-4, atol=1e-5)


def fitted(records: list[Record], iterations: int, **more) -> HystereticElement:
    k = records[0].e.shape[-1]
    batch, model = stack(records), HystereticElement(1, 2 + k, DT, other_inputs=k, **more)
    model.identify([batch])
    free = [p for p in model.parameters() if p.requires_grad]
    solver = LevenbergMarquardt(free, iterations, 1e-4, 0.2, 4.0, 1e6, scaled=True, floor=3e-3)
    while not solver.finished:
        solver.solve(run_problem(model, batch, None, prior=1e-6))
    return model


@torch.no_grad()
def error(model: HystereticElement, records: list[Record]) -> float:
    """Relative RMS error of the free runs of some records."""
    runs = [model.run_of(r).a[r.warmup :] for r in records]
    true = [r.a[r.warmup :] for r in records]
    return float((torch.cat(runs) - torch.cat(true)).norm() / torch.cat(true).norm())


@pytest.mark.parametrize(("factor", "shift"), [(1e-6, 0.0), (1.8, 32.0)])
def test_the_unit_of_another_input_changes_nothing(factor, shift):
    record = some_record()
    other = replace(record, e=factor * record.e + shift)
    models = [fitted([r], 8) for r in (record, other)]
    runs = [m.free_run(r.drive()).a.detach() for m, r in zip(models, (record, other), strict=True)]
    assert torch.allclose(runs[0], runs[1], rtol=0.0, atol=1e-5 * float(runs[0].abs().max()))


def test_units_of_force_and_motion_change_nothing():
    record = some_record()
    error_here = error(fitted([record], 8), [record])
    forces = replace(record, a=1e6 * record.a)
    motions = replace(record, s=1e6 * record.s, s_dot=1e6 * record.s_dot)
    for other in (forces, motions):
        assert error(fitted([other], 8), [other]) == pytest.approx(error_here, rel=1e-3)


# Planted dampers


def test_a_magnetorheological_damper_is_found_under_voltages_that_it_was_not_trained_on():
    """Spencer's modified Bouc–Wen law is none of ours; 2 % of noise."""
    records = [
        record_of(*signals, initial_state="unknown", warmup=150)
        for signals in magnetorheological(5, 900, DT, noise=0.02)
    ]
    model = fitted(records[:3], 12)
    assert error(model, records[3:]) < 0.10
    blind = [replace(r, e=torch.zeros_like(r.e)) for r in records]
    assert error(fitted(blind[:3], 6), blind[3:]) > 0.25


def test_a_test_without_rates_is_followed_and_one_without_force_is_refused():
    t = 0.05 * torch.arange(200.0, dtype=torch.float64)[:, None]
    s, warmth = torch.sin(t), torch.cos(0.3 * t)
    r = (3.0 + warmth) * s
    record = Record(0.05, r, s[:, :0], s=s, s_dot=0.0 * s, e=warmth, quantity="force")
    model = HystereticElement(1, 3, 0.05, other_inputs=1)
    model.identify([record])
    with torch.no_grad():
        assert bool(torch.isfinite(model(record)).all())
    for silent in ({"a": 0.0 * r}, {"s": 0.0 * s}):
        with pytest.raises(ValueError, match="zero throughout"):
            model.identify([replace(record, **silent)])


def test_other_inputs_have_to_be_said():
    with pytest.raises(ValueError, match="3 channels"):
        HystereticElement(1, 3, DT)
    with pytest.raises(ValueError, match="nodes=1"):
        HystereticElement(1, 3, DT, other_inputs=1, nodes=1)
