"""Free runs: exact where theory is, honest about what they see, scored beside one-step errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lsim
from torch.nn.functional import pad

from data.record import Drive, Record, Response, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.records import Simulation
from data.simulation.scenario import Noisy
from models.baselines import FilteredExtrapolation, LastValue, TwoPoint
from models.estimator import Estimator, NoFreeRunError, periodic_run, simulate
from models.fit.metrics import FreeRunScore, free_run_score
from models.layers.integrate import between, runge_kutta
from models.linear import EquivalentLinear
from models.mlp import GlobalMLP, ResidualMLP
from models.polynomial import ModalPolynomial
from models.vwnn import VWNN

DT = 0.01
SIMULATORS = {
    "equivalent_linear": lambda: EquivalentLinear(3, 3, DT),
    "power_series_residual": lambda: ModalPolynomial(3, 3, DT, fits="residual", order=3),
    "chebyshev": lambda: ModalPolynomial(
        3, 3, DT, basis="chebyshev", order=2, pairs=[["u1", "u1_dot"], ["u2", "u3"]]
    ),
    "global_mlp": lambda: GlobalMLP(3, 3, DT),
    "residual_mlp": lambda: ResidualMLP(3, 3, DT),
}


@pytest.fixture(scope="module")
def zoo(bilinear_records):
    """Every estimator that integrates itself; the networks with small random weights."""
    torch.manual_seed(0)
    estimators = {name: build() for name, build in SIMULATORS.items()}
    for estimator in estimators.values():
        estimator.identify(bilinear_records[:2])
        for p in estimator.parameters():
            if p.requires_grad:
                p.data *= 0.3
    return estimators


def short(record: Record) -> Record:
    """A second of less than the motion that was trained on: all models stay with it."""
    return record.window(0, 120).map(lambda u: 0.2 * u)


def oscillator(stiffness: float = 40.0, damping: float = 0.8, mass: float = 2.0):
    """A single mass as an equivalent linear system, identified by hand."""
    estimator = EquivalentLinear(1, 1, DT)
    estimator.weights.copy_(torch.tensor([[-damping], [-stiffness], [1.0]]).double() / mass)
    return estimator


def random_drive(hold: str, channels: int) -> Drive:
    u = torch.randn(400, channels, generator=torch.Generator().manual_seed(3)).double()
    x0, v0 = torch.full((channels,), 0.02).double(), torch.full((channels,), -0.3).double()
    return Drive(DT, u, x0, v0, hold)


@pytest.mark.parametrize(("hold", "interpolate"), [("linear", True), ("zero_order", False)])
def test_a_linear_free_run_is_that_of_scipy(linear_structure, hold, interpolate):
    M, C, K = linear_structure.linearised()
    inverse = np.linalg.inv(M)
    estimator = EquivalentLinear(3, 3, DT)
    estimator.weights.copy_(
        torch.from_numpy(np.vstack([-(inverse @ C).T, -(inverse @ K).T, inverse.T]))
    )
    drive = random_drive(hold, channels=3)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ K, -inverse @ C]])
    B = np.vstack([np.zeros((3, 3)), inverse])
    t, start = DT * np.arange(drive.samples), torch.cat([drive.x0, drive.v0]).numpy()
    system = (A, B, np.eye(6), np.zeros((6, 3)))
    _, states, _ = lsim(system, drive.u.numpy(), t, X0=start, interp=interpolate)
    ours = estimator.free_run(drive)
    motion = torch.cat([ours.x, ours.v], dim=-1).numpy()
    assert np.abs(motion - states).max() < 1e-10 * np.abs(states).max()
    a = (
        drive.u.numpy() @ inverse.T
        - states[:, :3] @ (inverse @ K).T
        - states[:, 3:] @ (inverse @ C).T
    )
    assert np.abs(ours.a.numpy() - a).max() < 1e-10 * np.abs(a).max()


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"order": 3, "stages": 3},
        {"order": [1, 3], "bias": False, "unfiltered_excitation": True, "squares": False},
    ],
)
def test_the_compiled_free_run_of_the_vwnn_is_that_of_torch(settings):
    model = VWNN(3, 2, DT, sigmoid_weight=0.3, **settings)
    random = torch.Generator().manual_seed(1)
    model.weights.copy_(torch.randn(model.weights.shape, generator=random).double() / 20.0)
    u, rest = torch.randn(2, 4, 300, 2, generator=random).double(), torch.zeros(2, 4, 3).double()
    drive = Drive(DT, u, rest, rest)
    reference = model._run(drive)
    assert float(reference.std()) > 1e-3
    assert torch.allclose(model.free_run(drive).a, reference, rtol=1e-11, atol=1e-13)


TWINS = {
    "linear": ("zero_order", SIMULATORS["equivalent_linear"]),
    "power_series_residual": ("linear", SIMULATORS["power_series_residual"]),
    "power_series": ("zero_order", lambda: ModalPolynomial(3, 3, DT, order=4)),
    "chebyshev": ("band_limited", SIMULATORS["chebyshev"]),
    "tanh": ("zero_order", lambda: GlobalMLP(3, 3, DT)),
    "relu": ("linear", lambda: GlobalMLP(3, 3, DT, hidden=(12, 4, 5), activation="relu")),
    "sigmoid": ("band_limited", lambda: ResidualMLP(3, 3, DT, activation="sigmoid")),
    "silu": ("linear", lambda: ResidualMLP(3, 3, DT, hidden=(3, 7), activation="silu")),
}


@pytest.mark.parametrize(("hold", "build"), TWINS.values(), ids=TWINS)
def test_the_compiled_free_run_of_a_law_is_that_of_torch(bilinear_record, hold, build):
    """Batches of any shape, from any state; PyTorch's is taken where derivatives are asked for."""
    torch.manual_seed(0)
    estimator = build()
    estimator.identify([bilinear_record])
    calm = short(bilinear_record).window(40, 40)
    record = stack([stack([calm.map(lambda u, s=s: s * u)]) for s in (0.5, 1.0)])
    drive = replace(record.drive(), hold=hold, x0=record.x[..., 7, :], v0=record.v[..., 7, :])
    with torch.no_grad():
        compiled = estimator.free_run(drive)
    u = drive.u.clone().requires_grad_()
    reference = estimator.free_run(replace(drive, u=u))
    assert torch.autograd.grad(reference.a.square().sum(), u)[0].norm() > 0.0
    for name in "xva":
        ours, torchs = getattr(compiled, name), getattr(reference, name)
        assert ours.shape == torchs.shape
        assert (ours - torchs).abs().max() < 1e-12 * torchs.abs().max()


def duffing(x: torch.Tensor, v: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
    return u - 0.4 * v - 9.0 * x - 6.0 * x**3


def test_the_integrator_is_of_fourth_order():
    """A cubic oscillator under a sine, whose middle samples are known to the band-limited hold."""
    motions = []
    for samples in (64, 128, 256, 2048):
        t = 4.0 * np.pi / samples * torch.arange(samples, dtype=torch.float64)
        zero = torch.zeros(1, dtype=torch.float64)
        drive = Drive(4.0 * np.pi / samples, torch.sin(t)[:, None], zero, zero, "band_limited")
        motions.append(runge_kutta(duffing, drive).x[:: samples // 64])
    *coarse, exact = motions
    errors = [float((x - exact).abs().max()) for x in coarse]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert (np.abs(orders - 4.0) < 0.3).all(), orders


def test_a_band_limited_hold_knows_what_a_sine_does_between_samples():
    for samples in (50, 51):
        phase = 2.0 * np.pi * 7.0 * torch.arange(samples).double() / samples
        middle = between(torch.sin(phase)[:, None], "band_limited", 2)[:, 0]
        exact = torch.sin(phase + np.pi * 7.0 / samples)[:-1, None]
        assert (middle - exact).abs().max() < 1e-12


@pytest.mark.parametrize("name", SIMULATORS)
def test_a_free_run_obeys_its_own_equation(zoo, bilinear_record, name):
    """One-step estimates along a free run are the run's own accelerations."""
    record = short(bilinear_record)
    with torch.no_grad():
        run = simulate(zoo[name], record)
    along = Record(DT, run.a, record.f, run.x, run.v)
    estimate = zoo[name](along)
    assert torch.allclose(estimate, run.a, rtol=0, atol=1e-9 * float(run.a.detach().abs().max()))


def test_a_diverging_model_is_reported_with_its_time(linear_record):
    estimator = EquivalentLinear(3, 3, DT)
    estimator.identify([linear_record])
    estimator.weights[:3] += 4.0 * torch.eye(3, dtype=torch.float64)  # negative damping
    errors = free_run_score(estimator, [linear_record])
    assert errors["diverged"] == 1
    a = simulate(estimator, linear_record).a
    beyond = (a.abs() > 100.0 * linear_record.a.abs().max()).any(dim=-1)
    assert errors["diverged_after_s"] == [pytest.approx(DT * int(beyond.int().argmax()))]
    assert 0.0 < errors["diverged_after_s"][0] < 10.0
    assert errors["relative_rms_percent"] is None
    assert errors["displacement_percent"] is None
    assert errors["per_dof_percent_true"] == [None, None, None]


class Fixed(Estimator):
    """Runs as it was told to, where the excitation is positive; else stays at rest."""

    def __init__(self, factor: float) -> None:
        super().__init__(1, 1, DT)
        self.factor = factor

    def free_run(self, drive):
        a = torch.where(drive.u > 0.0, self.factor * drive.u, drive.u)
        return Response(a, a, a)


def one_record(u: torch.Tensor) -> Record:
    return Record(DT, u, u)


def test_one_diverged_record_of_a_split_is_never_dropped():
    calm, lost = -torch.ones(50, 1).double(), torch.ones(50, 1).double()
    score = FreeRunScore()
    score.update(Fixed(101.0), stack([one_record(calm), one_record(lost)]))
    score.update(Fixed(float("nan")), one_record(pad(lost[7:], (0, 0, 7, 0), value=-1.0)))
    errors = score.percent()
    assert errors["diverged"] == 2
    assert errors["diverged_after_s"] == pytest.approx([0.0, 0.07])
    assert errors["relative_rms_percent"] is None


@pytest.mark.parametrize("build", [LastValue, TwoPoint, FilteredExtrapolation])
def test_an_extrapolation_says_why_it_has_no_free_run(build, bilinear_record):
    estimator = build(3, 3, DT)
    with pytest.raises(NoFreeRunError, match="has no excitation"):
        estimator.free_run(bilinear_record.drive())
    result = FreeRunScore()
    result.update(estimator, bilinear_record)
    assert "has no excitation" in result.percent()["no_free_run"]
    assert result.over_time() is None
    assert result.example is None


@pytest.mark.parametrize("samples", [300, 301])
def test_a_periodic_steady_state_is_the_frequency_response(samples):
    estimator = oscillator(damping=14.0)
    omega = 2.0 * np.pi * 4.0 / (samples * DT)
    t = DT * torch.arange(samples, dtype=torch.float64)
    rest = torch.zeros(1, dtype=torch.float64)
    drive = Drive(DT, 5.0 * torch.cos(omega * t)[:, None], rest, rest, "band_limited")
    response = periodic_run(estimator, drive)
    receptance = 5.0 / (40.0 - 2.0 * omega**2 + 14.0j * omega)
    wanted = (receptance * np.exp(1j * omega * t.numpy())).real
    assert np.abs(response.x[:, 0].numpy() - wanted).max() < 1e-5 * abs(receptance)
    assert response.a.shape == (samples, 1)


def test_a_model_is_judged_under_the_force_that_acted_where_its_sensor_erred(linear_chain):
    """The exact model: no error against the truth, the sensor's against what was measured."""
    excitation = Excitation(force=BandLimitedGaussian(std=2.0, band=(0.0, 3.0)))
    scenario = Noisy(level=0.1, signals=["f"])
    simulation = Simulation(linear_chain(3), excitation, scenario, DT, 20.0)
    (noisy,), _ = simulation.records("train", 1, seed=0)
    clean = noisy.truly_driven()
    assert not torch.equal(clean.f, noisy.f)
    model = EquivalentLinear(noisy.dofs, noisy.f.shape[-1], DT)
    model.identify([clean])
    scores = free_run_score(model, [noisy])
    assert scores["relative_rms_percent_true"] < 0.1
    assert scores["displacement_percent"] < 0.1
    assert scores["relative_rms_percent"] > 3.0


def test_a_residual_network_that_says_nothing_leaves_the_linear_system(bilinear_record):
    linear, residual = EquivalentLinear(3, 3, DT), ResidualMLP(3, 3, DT)
    for estimator in (linear, residual):
        estimator.identify([bilinear_record])
    for p in residual.network.layers.parameters():
        p.data.zero_()
    residual.network.output_scale.centre.zero_()
    record = short(bilinear_record)
    ours, exact = simulate(residual, record), simulate(linear, record)
    integrated = runge_kutta(linear.acceleration, record.drive())
    assert torch.allclose(ours.a, integrated.a, rtol=0, atol=1e-12)
    assert torch.allclose(ours.x, exact.x, rtol=0, atol=1e-3 * float(exact.x.abs().max()))
