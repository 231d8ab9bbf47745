"""Composed structures: the compiled run, its derivatives, restarted runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn
from torch.func import functional_call, jvp, vmap

from data.parallel import take_threads
from data.record import Drive, Record, stack
from models.composition.coefficients import Coefficients, Composition, Numbering, Part
from models.composition.composite import Composite
from models.composition.laws import ElementLaws
from models.composition.trace import SMALLEST_BLOCK
from tests.reference_networks import simulate

# A composed structure in which every part of the equation counts, and its motions
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
        self.laws = ElementLaws(3, 2, 2, True)
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


def begun_in_motion(samples: int = 80, seed: int = 0) -> Record:
    """Some motion under a drive: a run from measured states leaves it, as in training."""
    drive = excited(samples, seed)
    model = Everything()
    model.core_stiffness.theta.data += 0.3
    with torch.no_grad():
        motion = model.free_run(drive)
    signals = (drive.u[:, :2], motion.x, motion.v, drive.u[:, 2:3], drive.u[:, 3:])
    return Record(DT, motion.a, *signals, initial_state="given")


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


@pytest.mark.parametrize(
    ("hold", "substeps"), [("linear", 1), ("zero_order", 3), ("band_limited", 2)]
)
def test_the_compiled_run_is_that_in_pytorch(hold, substeps):
    model, drive = Everything(substeps), excited(200, hold=hold)
    with torch.no_grad():
        compiled = model.free_run(drive)
        plain = simulate(model.composition(), drive, substeps)
    for name in ("x", "v", "a"):
        assert_close(getattr(compiled, name), getattr(plain, name), 1e-12)


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


@pytest.mark.parametrize("records", [1, 3])
def test_a_run_is_the_same_to_the_bit_on_any_number_of_threads(records):
    """Derivatives of one record are shared among threads too, those by its beginning with them."""
    model, drive = Everything(), excited(2000)
    drive = replace(drive, u=torch.stack([excited(2000, seed).u for seed in range(records)]))
    state = 2 * 2 + model.composition().laws.value.shape[0] * model.composition().counts[1]
    begin = torch.full((records, state), 0.01, dtype=torch.float64)
    runs = []
    try:
        for threads in (1, 2, 2, 2, 2, 4):  # a race is seldom lost in one run
            take_threads(threads)
            runs.append(model.trace(drive, derivatives=True, begin=begin))
    finally:
        take_threads(1)
    one = runs[0]
    assert one.jacobian.shape[-1] > 2 * SMALLEST_BLOCK
    for several in runs[1:]:
        for key in ("forces", "deformations", "jacobian", "by_begin"):
            assert torch.equal(getattr(one, key), getattr(several, key)), key
        for key in "xva":
            assert torch.equal(getattr(one.response, key), getattr(several.response, key)), key


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


def test_the_compiled_derivatives_of_a_free_run_are_those_of_pytorch():
    """Along a direction of each parameter's own; PyTorch takes all directions at once."""
    model, drive = Everything(), excited(40)
    plain = Plain(model)
    theta = {key: p.detach() for key, p in plain.named_parameters()}
    directions = [along(plain, f"model.{name}") for name in NAMES]
    stacked = {key: torch.stack([d[key] for d in directions]) for key in theta}

    def derivative(direction: dict[str, torch.Tensor]) -> torch.Tensor:
        return jvp(lambda t: functional_call(plain, t, (drive,)), (theta,), (direction,))[1]

    jacobian = model.trace(drive, derivatives=True).jacobian
    for direction, wanted in zip(directions, vmap(derivative)(stacked), strict=True):
        assert wanted.abs().max() > 1e-6
        assert_close(jacobian @ flat(direction), wanted, 1e-10)


@pytest.mark.parametrize("every", [1, 7, None])
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


def test_autograd_through_a_restarted_run_is_its_jacobian_transposed():
    model, record = Everything(), stack([begun_in_motion(seed=0), begun_in_motion(seed=1)])
    cotangent = spread(record.a.shape, -1.0, 1.0, 3)
    run = model.restarted_run(record, 7)
    slopes = torch.autograd.grad((cotangent * run).sum(), list(model.parameters()))
    _, jacobian = model.restarted_jacobian(record, 7)
    wanted = torch.einsum("btn,btnp->p", cotangent, jacobian)
    assert_close(flat(dict(enumerate(slopes))), wanted, 1e-12)


@pytest.mark.parametrize("signal", ["x", "v", "a"])
def test_autograd_through_a_free_run_is_that_of_pytorch(signal):
    model, drive = Everything(), excited(60)
    cotangent, free = spread((60, 2), -1.0, 1.0, 3), list(model.parameters())
    ours, plain = model.free_run(drive), simulate(model.composition(), drive, model.substeps)
    slopes, wanted = (
        torch.autograd.grad((cotangent * getattr(run, signal)).sum(), free, allow_unused=True)
        for run in (ours, plain)
    )
    pairs = [(one, other) for one, other in zip(slopes, wanted, strict=True) if other is not None]
    assert len(pairs) > len(free) - 3
    for one, other in pairs:
        assert_close(one, other, 1e-8)


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


def test_a_restart_without_states_says_what_to_do():
    record = replace(begun_in_motion(), x=None, v=None, initial_state="rest")
    with pytest.raises(ValueError, match=r"objective\.restart"):
        Everything().restarted_run(replace(record, quantity="force"), 7)
    with torch.no_grad():
        for quantity in ("displacement", "velocity", "acceleration"):
            moved = replace(record, quantity=quantity)
            assert torch.isfinite(Everything().restarted_run(moved, 7)).all()
        assert torch.isfinite(Everything()(record)).all()


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
