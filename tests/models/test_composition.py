"""Composed structures: the compiled run, its derivatives, order, known hysteresis laws, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn
from torch.func import functional_call, jvp

from data.record import Drive, Record, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.structure import Structure
from models.composition.coefficients import Coefficients, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import ElementLaws, law, units
from models.composition.simulate import Composition, simulate
from models.element_network import ElementNetwork

# PyTorch's forward differentiation compiles its own rules with what PyTorch deprecates
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.script. is deprecated")

DT = 0.01


def spread(shape: torch.Size | tuple, low: float, high: float, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)


class Everything(Composite):
    """Two coordinates, three elements, two forces and a moving support; all coefficients learned.

    Not reciprocal, with outputs that mix the coordinates: every part of the equation counts.
    """

    def __init__(self, substeps: int = 2) -> None:
        super().__init__(2, 4, DT, substeps)
        self.core_stiffness = Coefficients(2, positive=True)
        self.core_damping = Coefficients(2, positive=True)
        self.inputs_to = Coefficients(2, 4)
        self.reactions = Coefficients(2, 3)
        self.directions = Coefficients(3, 2)
        self.shapes = Coefficients(2, 2)
        self.laws = ElementLaws(3, 2, 1, 2, True, True, True, True)
        self.identified.fill_(1.0)
        self.core_stiffness.start(torch.tensor([30.0, 60.0]))
        self.core_damping.start(torch.tensor([0.5, 0.8]))
        directions = torch.tensor([[1.0, 0.1], [-1.0, 1.1], [0.2, 0.9]])
        self.directions.start(torch.ones(3, 2), directions)
        self.reactions.start(torch.ones(2, 3), directions.T + 0.1)
        self.inputs_to.start(torch.ones(2, 4), spread((2, 4), -1.0, 1.0, 0))
        self.shapes.start(torch.ones(2, 2), torch.tensor([[1.0, 0.3], [-0.4, 0.9]]))
        each, ones = torch.full((3,), 20.0).double(), torch.ones(3).double()
        self.laws.start(each, 0.02 * each, 0.2 * ones, (0.3, 0.2))
        for seed, part in enumerate(self.laws.children()):
            part.theta.data += spread(part.theta.shape, 0.1, 0.4, 10 + seed)
        self.laws.unit_falling.theta.data -= 0.6

    def composition(self) -> Composition:
        numbering = Numbering(self)
        supports = torch.zeros(2, 3, 4, dtype=torch.float64)
        supports[0, 0, 2] = supports[1, 0, 3] = -1.0
        return Composition(
            core=Part.stack(
                [numbering.part(self.core_stiffness), numbering.part(self.core_damping)], dim=0
            ),
            inputs=numbering.part(self.inputs_to),
            G=numbering.part(self.reactions),
            D=numbering.part(self.directions),
            laws=self.laws.table(numbering),
            outputs=numbering.part(self.shapes),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )


def excited(samples: int = 80, seed: int = 0, hold: str = "linear") -> Drive:
    rng = np.random.default_rng(seed)
    f = 0.35 * np.cumsum(rng.standard_normal((samples, 2)), axis=0)
    rate = 0.3 * np.sin(9.0 * DT * np.arange(samples)[:, None] + seed)
    u = torch.from_numpy(np.hstack([f, DT * np.cumsum(rate, axis=0), rate]))
    x0, v0 = torch.tensor([0.02, -0.01]).double(), torch.tensor([0.1, 0.3]).double()
    return Drive(DT, u, x0, v0, hold)


def begun_in_motion(samples: int = 80, seed: int = 0, hold: str = "linear") -> Record:
    """Some motion under a drive: a run from measured states leaves it, as in training."""
    drive = excited(samples, seed, hold)
    model = Everything()
    model.core_stiffness.theta.data += 0.3
    with torch.no_grad():
        motion = model.free_run(drive)
    signals = (drive.u[:, :2], motion.x, motion.v, drive.u[:, 2:3], drive.u[:, 3:])
    return Record(DT, motion.a, *signals, initial_state="given", hold=hold)


def assert_close(one: torch.Tensor, other: torch.Tensor, tolerance: float) -> None:
    assert (one - other).abs().max() <= tolerance * other.abs().max()


# The compiled run is the one in PyTorch


def test_outputs_are_what_sensors_measure_with_its_derivatives():
    """The first a displacement, the second a velocity: against PyTorch's own derivatives."""
    model, drive = Everything(), excited(40)
    motion = model.trace(drive).response
    model.measures.copy_(torch.tensor([0, 1]))
    trace = model.trace(drive, derivatives=True)
    assert torch.equal(trace.response.a[:, 0], motion.x[:, 0])
    assert torch.equal(trace.response.a[:, 1], motion.v[:, 1])
    free = list(model.parameters())
    for sample, output in ((39, 0), (39, 1), (17, 0)):
        plain = simulate(model.composition(), drive, 2).a[sample, output]
        slopes = torch.autograd.grad(plain, free, allow_unused=True)
        pairs = zip(free, slopes, strict=True)
        flat = torch.cat([(torch.zeros_like(p) if s is None else s).reshape(-1) for p, s in pairs])
        assert_close(trace.jacobian[sample, output], flat, 1e-8)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("hold", ["linear", "zero_order", "band_limited"])
def test_the_compiled_run_is_that_in_pytorch(hold, substeps):
    model, drive = Everything(substeps), excited(200, hold=hold)
    with torch.no_grad():
        compiled = model.free_run(drive)
        plain = simulate(model.composition(), drive, substeps)
    for name in ("x", "v", "a"):
        assert_close(getattr(compiled, name), getattr(plain, name), 1e-12)


def test_in_that_comparison_all_laws_are_at_work():
    model, drive = Everything(), excited(200)
    y, _ = model.element_loops(drive)
    largest = y.abs().amax(dim=0)
    assert (largest[:, None] > model.laws.hinge_gap()).any(dim=1).all()
    limits = model.laws.unit_limit()
    assert (largest[:, None] > limits).any(dim=1).all()
    assert (largest[:, None] < limits).any()
    for part in model.laws.children():
        assert (part().abs() > 0.0).all()


def test_a_batch_runs_record_by_record():
    model, drives = Everything(), [excited(seed=seed) for seed in range(3)]
    batch = replace(
        drives[0], **{s: torch.stack([getattr(d, s) for d in drives]) for s in ("u", "x0", "v0")}
    )
    together = model.trace(batch, derivatives=True)
    for i, drive in enumerate(drives):
        alone = model.trace(drive, derivatives=True)
        assert torch.equal(together.response.a[i], alone.response.a)
        assert torch.equal(together.jacobian[i], alone.jacobian)
        assert torch.equal(together.forces[i], alone.forces)


def test_a_run_that_diverges_is_not_finite_from_there_on():
    model = Everything()
    model.laws.cubic.theta.data -= 50.0
    with torch.no_grad():
        lost = ~torch.isfinite(model.free_run(excited(200)).a).all(dim=-1)
    assert lost[-1]
    assert not lost[0]
    assert (lost[1:] >= lost[:-1]).all()


# Derivatives


class Plain(nn.Module):
    """The free run in PyTorch as the `forward` that function transforms call."""

    def __init__(self, model: Composite) -> None:
        super().__init__()
        self.model = model

    def forward(self, drive: Drive) -> torch.Tensor:
        return simulate(self.model.composition(), drive, self.model.substeps).a


def along(model: nn.Module, name: str) -> dict[str, torch.Tensor]:
    """A direction in which the parameters of one name change, and no other."""
    return {
        other: spread(p.shape, -1.0, 1.0, 7) if other == name else torch.zeros_like(p)
        for other, p in model.named_parameters()
    }


def flat(parts: dict[str, torch.Tensor]) -> torch.Tensor:
    return torch.cat([p.reshape(-1) for p in parts.values()])


NAMES = [name for name, _ in Everything().named_parameters()]


@pytest.mark.parametrize("name", NAMES)
def test_the_compiled_derivatives_of_a_free_run_are_those_of_pytorch(name):
    model, drive = Everything(), excited(60)
    plain = Plain(model)
    theta = {key: p.detach() for key, p in plain.named_parameters()}
    direction = along(plain, f"model.{name}")
    _, wanted = jvp(lambda t: functional_call(plain, t, (drive,)), (theta,), (direction,))
    ours = model.trace(drive, derivatives=True).jacobian @ flat(direction)
    assert wanted.abs().max() > 1e-6
    assert_close(ours, wanted, 1e-10)


@pytest.mark.parametrize("every", [1, 7, 50, None])
def test_the_derivatives_of_a_restarted_run_are_finite_differences(every):
    model, record = Everything(), begun_in_motion()
    _, jacobian = model.restarted_jacobian(record, every)
    assert jacobian is not None
    for name in NAMES:
        direction = along(model, name)
        ends = []
        for sign in (1.0, -1.0):
            moved = Everything()
            for p, d in zip(moved.parameters(), direction.values(), strict=True):
                p.data += sign * 1e-6 * d
            with torch.no_grad():
                ends.append(moved.restarted_run(record, every))
        wanted = (ends[0] - ends[1]) / 2e-6
        assert_close(jacobian @ flat(direction), wanted, 1e-5)


@pytest.mark.parametrize("every", [7, None])
def test_autograd_through_a_restarted_run_is_its_jacobian_transposed(every):
    model, record = Everything(), stack([begun_in_motion(seed=0), begun_in_motion(seed=1)])
    cotangent = spread(record.a.shape, -1.0, 1.0, 3)
    run = model.restarted_run(record, every)
    slopes = torch.autograd.grad((cotangent * run).sum(), list(model.parameters()))
    _, jacobian = model.restarted_jacobian(record, every)
    wanted = torch.einsum("btn,btnp->p", cotangent, jacobian)
    assert_close(flat(dict(enumerate(slopes))), wanted, 1e-12)


def test_parameters_that_are_held_are_left_out():
    model, drive = Everything(), excited(60)
    whole = model.trace(drive, derivatives=True).jacobian
    sizes = [p.numel() for p in model.parameters()]
    columns = [
        c for c, name in zip(whole.split(sizes, dim=-1), NAMES, strict=True) if "hinge" not in name
    ]
    for name, p in model.named_parameters():
        p.requires_grad_("hinge" not in name)
    assert torch.equal(model.trace(drive, derivatives=True).jacobian, torch.cat(columns, dim=-1))


# Restarted runs


@pytest.mark.parametrize("every", [1, 7])
def test_without_memory_a_restarted_run_is_that_of_every_window_by_itself(every):
    """A sample at which a run begins anew is the end of the run before."""
    record = begun_in_motion(60)
    model = Everything()
    model.laws.unit_stiffness.theta.data.zero_()
    with torch.no_grad():
        ours = model.restarted_run(record, every)
        for begin in range(0, record.samples - 1, every):
            window = record.window(begin, min(every + 1, record.samples - begin))
            alone = model.free_run(window.drive()).a
            assert_close(ours[begin + 1 : begin + every + 1], alone[1:], 1e-10)


def test_the_memory_goes_on_where_a_run_begins_anew():
    """On the model's own motion it changes nothing but the velocity that the dampers see."""
    model, drive = Everything(), excited()
    with torch.no_grad():
        motion = model.free_run(drive)
        signals = (drive.u[:, :2], motion.x, motion.v, drive.u[:, 2:3], drive.u[:, 3:])
        record = Record(DT, motion.a, *signals, initial_state="given")
        assert_close(model.restarted_run(record, 7), motion.a, 1e-4)
        assert_close(model(record), motion.a, 1e-3)


def test_a_restart_without_states_says_what_to_do():
    record = replace(begun_in_motion(), x=None, v=None, initial_state="rest")
    with pytest.raises(ValueError, match=r"objective\.restart"):
        Everything().restarted_run(replace(record, quantity="velocity"), 7)
    with torch.no_grad():
        assert torch.isfinite(Everything().restarted_run(record, 7)).all()
        assert torch.isfinite(Everything()(record)).all()


# Known laws


class Prescribed(Composite):
    """An element whose deformation is the support's: it pulls at nothing."""

    def __init__(self, stiffness: float, limit: float) -> None:
        super().__init__(1, 2, DT, substeps=1)
        self.laws = ElementLaws(1, 0, 0, 1)
        each = torch.tensor([stiffness]).double()
        self.laws.start(each, 0.0 * each, torch.ones(1).double(), (0.5, 0.5))
        self.identified.fill_(1.0)
        self.laws.unit_stiffness.theta.data.fill_(1.0)
        self.laws.unit_limit.start(torch.tensor([[limit]]))

    def composition(self) -> Composition:
        numbering, zeros = Numbering(self), torch.zeros(2, 1, dtype=torch.float64)
        supports = torch.eye(2, dtype=torch.float64)[:, None, :]  # y = s, ẏ = ṡ
        return Composition(
            core=Part.fixed(zeros),
            inputs=Part.fixed(zeros.T),
            G=Part.fixed(zeros[:1]),
            D=Part.fixed(zeros[:1]),
            laws=self.laws.table(numbering),
            outputs=Part.fixed(torch.ones(1, 1, dtype=torch.float64)),
            supports=supports,
            counts=self.laws.counts,
            parameters=numbering.count,
            measures=self.measures,
        )


def test_an_elastoplastic_unit_encloses_the_area_of_the_bilinear_loop():
    """4 k z_y (y_max − z_y) of work is lost in a quasi-static cycle."""
    k, limit, largest = 50.0, 0.25, 1.0
    quarter = torch.linspace(0.0, largest, 401).double()
    way = torch.cat([quarter, quarter.flip(0), -quarter, -quarter.flip(0), quarter])
    rest = torch.zeros(1, dtype=torch.float64)
    drive = Drive(DT, torch.stack([way, torch.zeros_like(way)], dim=1), rest, rest)
    y, r = (s[:, 0] for s in Prescribed(k, limit).element_loops(drive))
    cycle = slice(400, None)  # from y_max back to y_max
    work = torch.trapezoid(r[cycle], y[cycle])
    assert float(work) == pytest.approx(4.0 * k * limit * (largest - limit), rel=1e-6)
    assert float(r.abs().max()) == pytest.approx(k * limit, rel=1e-12)


@pytest.mark.parametrize("b", [-3.0, 2.0])
def test_a_unit_without_limit_rises_along_the_exponential_of_bouc_and_wen(b):
    """dz = (1 + b z) dy from rest is z = (eᵇʸ − 1)/b; falling, b₋ takes the place of b₊."""
    table = torch.zeros(1, 10).double()
    table[0, 6:] = torch.tensor([1.0, 1e9, b, 7.0])
    step = torch.full((1,), 0.01, dtype=torch.float64)
    z = torch.full((1, 1), np.expm1(b * 0.01) / b, dtype=torch.float64)
    for k in range(2, 51):
        z = units(table, (0, 0, 1), z, step)
        exact = np.expm1(b * 0.01 * k) / b
        assert float(z) == pytest.approx(exact, rel=1e-12)
        force = law(table, (0, 0, 1), k * step, step, z[None])
        assert float(force) == pytest.approx(exact - 0.01 * k, rel=1e-9)


GROUNDED = [
    ["ground", "x1"],
    ["x1", "x2"],
    ["x1", "x3"],
    ["x2", "x3"],
    ["x3", "ground"],
    ["ground", "x2"],
]


def same_structure(structure: Structure, substeps: int) -> ElementNetwork:
    """The paper's structure (its supports at rest), element for element, in terms of learned laws.

    A unit whose weight is the stiffness itself, without a limit, is Bouc–Wen's law with z = r/A.
    """
    model = ElementNetwork(
        3, 3, DT, GROUNDED, structure.masses.tolist(), hinges=1, units=1, substeps=substeps
    )
    model.mass.start(torch.as_tensor(structure.masses))
    model.identified.fill_(1.0)
    model.laws.start(*torch.ones(3, 6).double(), (0.5, 0.5))
    for e, element in enumerate(structure.elements.values()):
        kind, stiffness = type(element).__name__, element.tangent()[0]
        cubic, hinge, gap, unit, limit, rising, falling = 0.0, 0.0, 1.0, 0.0, 1e3, 0.0, 0.0
        if kind == "Polynomial":
            cubic = element.cubic_stiffness
        elif kind == "Bilinear":
            unit, limit = stiffness - element.post_yield_stiffness, element.yield_displacement
        elif kind == "LimitedSlip":
            hinge, gap = element.gap_stiffness, element.gap
            unit, limit = stiffness, element.yield_displacement
        else:
            unit, rising = stiffness, -(element.beta - element.gamma)
            falling = -(element.beta + element.gamma)
        planted = {
            "stiffness": stiffness,
            "damping": element.tangent()[1],
            "cubic": cubic,
            "hinge_stiffness": hinge,
            "hinge_gap": gap,
            "unit_stiffness": unit,
            "unit_limit": limit,
            "unit_rising": rising,
            "unit_falling": falling,
        }
        for name, value in planted.items():
            part = getattr(model.laws, name)
            part.unit[e], part.theta.data[e] = value, 0.0 if part.positive else 1.0
    return model


def test_it_contains_the_papers_systems_and_converges_to_them_at_second_order(
    system, structure, excitation, record_of
):
    record = record_of(structure, excitation, 10.0)
    errors = []
    for substeps in (2, 4, 8):
        with torch.no_grad():
            run = same_structure(structure, substeps).free_run(record.drive())
        errors.append(float((run.a - record.a).norm() / record.a.norm()))
    assert errors[0] < 0.004
    slope = np.polyfit(np.log([2, 4, 8]), np.log(errors), 1)[0]
    assert -2.5 < slope < -1.7, errors


# Energy


def test_left_alone_a_dissipative_structure_never_gains_energy(bilinear_structure):
    """½ ẋᵀ M ẋ and what is stored: (k − w) y²/2 + w z²/2 and the hinges'."""
    model = same_structure(bilinear_structure, 1)
    rest = torch.zeros(3, dtype=torch.float64)
    v0 = torch.tensor([0.8, -0.5, 0.6]).double()
    drive = Drive(0.1 * DT, torch.zeros(4000, 3).double(), rest, v0)
    with torch.no_grad():
        motion, (y, _) = model.free_run(drive), model.element_loops(drive)
        table = model.composition().laws.value
        z, stored = torch.zeros(6, 1).double(), []
        for k in range(drive.samples):
            if k > 0:
                z = units(table, model.laws.counts, z, y[k] - y[k - 1])
            stored.append(z[:, 0])
        z = torch.stack(stored)
    k, weight, gap = table[:, 0], table[:, 8], table[:, 7]
    beyond = torch.relu(y.abs() - gap)
    potential = (k - weight) * y**2 + weight * z**2 + table[:, 6] * beyond**2
    energy = 0.5 * ((motion.v**2) @ model.mass() + potential.sum(dim=-1))
    assert (energy[1:] - energy[:-1]).max() < 1e-4 * energy[0]
    assert energy[-1] < 0.1 * energy[0]
    assert (energy - torch.cummin(energy, dim=0).values).max() < 1e-3 * energy[0]


# Inputs that do not fit


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"substeps": 0}, "substeps=0"),
        ({"prior": -1.0}, "prior"),
        ({"early_prior": -1.0}, "early_prior=-1.0"),
        ({"units": -1}, "units=-1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        ElementNetwork(2, 2, DT, **wrong)


def test_substeps_keep_their_length_at_another_time_step(linear_structure, record_of):
    """A drive at twice the rate, in half the substeps: the same motion at the same instants."""
    excitation = Excitation(force=BandLimitedGaussian(1.7, (0.0, 4.5)))
    record = record_of(linear_structure, excitation, 2.0)
    model = same_structure(linear_structure, 2)
    twice = 0.5 * (record.f[1:] + record.f[:-1])
    u = torch.stack([record.f[:-1], twice], dim=1).flatten(0, 1)
    drive = record.drive()
    with torch.no_grad():
        coarse, fine = model.free_run(drive), model.free_run(replace(drive, dt=0.5 * DT, u=u))
    assert_close(fine.a[::2], coarse.a[:-1], 1e-9)
