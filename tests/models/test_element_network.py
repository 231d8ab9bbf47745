"""Element networks: planted structures are recovered, from accelerations alone where need be."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from data import BoucWen, LimitedSlip, Polynomial
from data.record import Record, stack
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.laws.element import Element
from data.simulation.structure import Structure
from models.composition.composite import Composite
from models.element_network import ElementNetwork
from models.element_network_named import ElementNetworkNamed
from models.fit.free_run_objective import FreeRun
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.starts.spectra import Layout

DT = 0.01
CHAIN = [["ground", "x1"], ["x1", "x2"]]
MASSES = [1.0, 1.5]
FORCES = Excitation(force=BandLimitedGaussian(1.0, (0.0, 4.0)))
SHAKING = Excitation(support=BandLimitedGaussian(0.05, (0.0, 4.0)), dofs=[])


def chain(first: Element, **second: float) -> Structure:
    """x1 held by the ground or a support, x2 by x1 on a damped spring."""
    settings = {"stiffness": 50.0, "damping": 0.6, **second}
    return Structure(MASSES, {"r1": first, "r2": Polynomial(between=("x1", "x2"), **settings)})


def linear(fixed: str = "ground", damping: float = 0.6) -> Structure:
    """`damping` of the second element; 0.5 N s/m is in the proportion of the stiffnesses."""
    return chain(Polynomial(between=(fixed, "x1"), stiffness=80.0, damping=0.8), damping=damping)


def train(model: Composite, record: Record, *horizons: int | None, iterations: int = 30) -> None:
    """Stages of a free run, on a batch of records."""
    objective, free = FreeRun(horizons), [p for p in model.parameters() if p.requires_grad]
    for stage in range(len(horizons)):
        solver = LevenbergMarquardt(
            free, iterations, damping=1e-4, decrease=0.2, increase=4.0, largest=1e6, scaled=True
        )
        while not solver.finished:
            solver.solve(objective.problem(model, record, stage))


@torch.no_grad()
def free_run_error(model: Composite, record: Record) -> float:
    return float((model.free_run(record.drive()).a - record.a).norm() / record.a.norm())


def assert_recovered(model: ElementNetwork, planted: dict[str, float], tolerance: float) -> None:
    for name, value in planted.items():
        first = getattr(model.laws, name)()[0].reshape(-1)[0]
        assert first.item() == pytest.approx(value, rel=tolerance, abs=tolerance), name


# Planted structures


@pytest.mark.parametrize("elements", [None, CHAIN], ids=["all pairs", "chain"])
def test_a_linear_structure_is_solved_exactly(record_of, elements):
    model = ElementNetwork(2, 2, DT, elements, units=2)
    model.identify([record_of(linear(), FORCES, 10.0)])
    assert torch.allclose(model.mass(), torch.tensor(MASSES).double(), rtol=1e-9)
    ends = [0, -1]
    assert model.laws.stiffness()[ends].tolist() == pytest.approx([80.0, 50.0], rel=1e-9)
    assert model.laws.damping()[ends].tolist() == pytest.approx([0.8, 0.6], rel=1e-9)


def test_hysteresis_of_bouc_and_wen_is_recovered_from_the_linear_start(record_of):
    """b₊ = γ − β and b₋ = −γ − β, with the signs as printed."""
    first = BoucWen(between=("ground", "x1"), stiffness=40.0, beta=10.0, gamma=-10.0)
    record = stack([record_of(chain(first, cubic_stiffness=4000.0), FORCES, 15.0)])
    model = ElementNetwork(2, 2, DT, CHAIN, hinges=0, units=1)
    model.identify([record])
    before = free_run_error(model, record)
    train(model, record, 1, 20, None)
    assert before > 0.1
    assert free_run_error(model, record) < 2e-3
    assert model.mass().tolist() == pytest.approx(MASSES, rel=0.01)
    planted = {"stiffness": 40.0, "unit_stiffness": 40.0, "unit_rising": -20.0}
    assert_recovered(model, planted, 0.01)
    assert model.laws.unit_falling()[0, 0].item() == pytest.approx(0.0, abs=0.2)
    assert model.laws.stiffness()[1].item() == pytest.approx(50.0, rel=0.01)
    assert model.laws.cubic()[1].item() == pytest.approx(4000.0, rel=0.01)


def test_slip_and_a_gap_are_recovered_from_a_start_nearby(record_of):
    first = LimitedSlip(
        between=("ground", "x1"), yield_displacement=0.02, stiffness=40.0, gap_stiffness=60.0,
        damping=0.5, slip_damping=0.5, gap=0.05,
    )  # fmt: skip
    record = stack([record_of(chain(first, cubic_stiffness=4000.0), FORCES, 15.0)])
    model = ElementNetwork(2, 2, DT, CHAIN, hinges=1, units=1)
    model.identify([record])
    model.laws.unit_stiffness.theta.data[0] = 0.5
    model.laws.unit_limit.start(torch.tensor([[0.03], [1.0]]))
    model.laws.hinge_stiffness.theta.data[0] = 0.5
    model.laws.hinge_gap.start(torch.tensor([[0.04], [0.04]]))
    train(model, record, 20, None, iterations=40)
    assert free_run_error(model, record) < 2e-3
    assert model.mass().tolist() == pytest.approx(MASSES, rel=0.01)
    planted = {
        "stiffness": 40.0,
        "damping": 0.5,
        "hinge_stiffness": 60.0,
        "hinge_gap": 0.05,
        "unit_stiffness": 40.0,
        "unit_limit": 0.02,
    }
    assert_recovered(model, planted, 0.01)
    assert model.laws.stiffness()[1].item() == pytest.approx(50.0, rel=0.01)


def test_accelerations_and_forces_alone_give_masses_and_stiffness(record_of):
    record = record_of(linear(), FORCES, 20.0)
    model = ElementNetwork(2, 2, DT, CHAIN, units=2)
    model.identify([replace(record, x=None, v=None)])
    assert model.mass().tolist() == pytest.approx(MASSES, rel=0.01)
    assert model.laws.stiffness().tolist() == pytest.approx([80.0, 50.0], rel=0.01)
    assert free_run_error(model, record) < 0.02


def test_a_shaken_support_leaves_the_scale_open_and_gives_the_rest(record_of):
    record = stack([record_of(linear("s1"), SHAKING, 15.0)])
    model = ElementNetwork(
        2, 2, DT, [["s1", "x1"], ["x1", "x2"]], forced=[], hinges=0, units=0, cubic=False
    )
    model.identify([record])
    train(model, record, 20, None, iterations=20)
    mass, stiffness = model.mass(), model.laws.stiffness()
    assert (mass[1] / mass[0]).item() == pytest.approx(1.5, rel=0.01)
    assert (stiffness / mass[0]).tolist() == pytest.approx([80.0, 50.0], rel=0.01)
    assert free_run_error(model, record) < 2e-3


# Structure of the network


def test_all_pairs_or_only_those_that_are_named():
    assert ElementNetwork(3, 3, DT).elements == [
        ["ground", "x1"],
        ["ground", "x2"],
        ["ground", "x3"],
        ["x1", "x2"],
        ["x1", "x3"],
        ["x2", "x3"],
    ]
    assert ElementNetwork(1, 5, DT, forced=[1]).elements == [["s1", "x1"], ["s2", "x1"]]
    model = ElementNetwork(2, 2, DT, CHAIN, hinges=1, units=1)
    assert model.composition().laws.value.shape[0] == 2
    assert torch.equal(model.B, torch.tensor([[1.0, 0.0], [-1.0, 1.0]]).double())


def test_masses_times_accelerations_are_forces_less_those_of_the_elements(record_of):
    first = BoucWen(between=("ground", "x1"), stiffness=40.0, beta=10.0, gamma=-10.0)
    record = record_of(chain(first), FORCES, 5.0)
    model = ElementNetwork(2, 2, DT, units=2)
    model.identify([record])
    model.laws.unit_stiffness.theta.data += 0.3
    y, r = model.element_loops(record.drive())
    with torch.no_grad():
        run = model.free_run(record.drive())
    assert torch.allclose(y, run.x @ model.B.T, atol=1e-12)
    inertia = record.f - r @ model.B
    assert torch.allclose(model.mass() * run.a, inertia, atol=1e-9)


# Inputs that do not fit


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"elements": [["x1", "x3"]]}, r"model\.elements holds \['x1', 'x3'\].*x1, x2 and ground"),
        ({"elements": [["x1", "x1"]]}, "expected two different ones"),
        ({"elements": [["x1"]]}, "expected two different ones"),
        ({"elements": [["s1", "x1"]]}, "expected two different ones of x1, x2 and ground"),
        ({"masses": [1.0]}, r"model\.masses=\[1\.0\]: expected 2 positive masses"),
        ({"masses": [1.0, 0.0]}, "expected 2 positive masses"),
        ({"forced": [1]}, r"model\.forced=\[1\] does not fit 2 DOFs and 2 channels"),
        ({"forced": [1, 3]}, r"every support; model\.dofs=3, or list the DOFs that carry"),
        ({"forced": [1, 2, 2]}, "does not fit 2 DOFs"),
        ({"hinges": -1}, "hinges=-1"),
    ],
)
def test_settings_that_do_not_fit_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        ElementNetwork(2, 2, DT, **wrong)


def test_a_base_beside_other_supports_is_refused():
    """Their displacements [m] would count as accelerations of the base."""
    with pytest.raises(ValueError, match=r"model\.forced=base does not fit 2 DOFs and 3 channels"):
        ElementNetwork(2, 3, DT, [["s1", "x1"], ["x1", "x2"]], forced="base")


def test_a_floor_that_never_moves_is_named(record_of):
    record = record_of(linear(), FORCES, 5.0)
    still = record.map(lambda u: u * torch.tensor([1.0, 0.0]).double())
    with pytest.raises(ValueError, match="ground–x2 does not deform in any record"):
        ElementNetwork(2, 2, DT, "all").identify([replace(still, f=record.f)])


def test_records_of_two_quantities_are_refused(record_of):
    """Accelerations would be read as displacements."""
    record = record_of(linear(), FORCES, 5.0)
    displaced = replace(record, a=record.x, x=None, v=None, quantity="displacement")
    with pytest.raises(ValueError, match="some records hold acceleration, others displacement"):
        ElementNetwork(2, 2, DT, CHAIN).identify([record, displaced])


def test_from_accelerations_alone_x_and_v_change_nothing(record_of):
    record = record_of(linear(), FORCES, 10.0)
    model = ElementNetwork(2, 2, DT, CHAIN, hinges=1, units=1, from_accelerations=True)
    model.identify([record])
    lies = replace(record, x=record.a, v=record.a)
    with torch.no_grad():
        assert torch.equal(model(lies), model(record))
    other = ElementNetwork(2, 2, DT, CHAIN, hinges=1, units=1, from_accelerations=True)
    other.identify([lies])
    assert torch.equal(other.laws.stiffness(), model.laws.stiffness())
    with torch.no_grad():
        assert torch.equal(model.restarted_run(lies, 20), model.restarted_run(record, 20))


def test_a_chain_that_bends_has_the_stiffness_of_a_frame_without_negative_springs():
    """K (2, 2) of a column whose joints turn couples x2 to the ground by a negative spring."""
    model = ElementNetwork(2, 1, DT, "frame", MASSES, "base")
    assert model.elements == [["ground", "x1"], ["x1", "x2"], ["ground", "x1", "x2"]]
    x = torch.tensor([[0.5, 3.0]]).double()
    assert (x @ model.B.T).tolist() == [[0.5, 2.5, 2.0]]  # the last: 0 − 2 x1 + x2
    K = model.B.T @ torch.diag(torch.tensor([3.0, 1.0, 2.0]).double()) @ model.B
    assert K.tolist() == [[12.0, -5.0], [-5.0, 3.0]]  # rows: a spring of −2 from x2 to the ground
    assert Layout(model.B.numpy(), model.B_s.numpy(), [], True).chain().tolist() == [1, 1, 0]


def test_nodes_that_no_element_can_join_are_refused():
    for nodes in (["x1", "x2", "x1"], ["x1"], ["ground", "x1", "x2", "x4"]):
        with pytest.raises(ValueError, match="at whose middle one it bends"):
            ElementNetwork(3, 1, DT, [["ground", "x1"], nodes], None, "base")
    with pytest.raises(ValueError, match="joins two nodes"):  # a named law does not bend
        ElementNetworkNamed(2, 1, DT, [["ground", "x1"], ["ground", "x1", "x2"]], MASSES, "base")


def test_rayleighs_damping_of_a_chain_of_known_masses_is_found(record_of):
    """Dampers from the masses to the ground, for which a chain has no elements."""
    alpha = 0.5
    dampers = {
        f"d{i}": Polynomial(between=("ground", f"x{i}"), stiffness=0.0, damping=alpha * mass)
        for i, mass in enumerate(MASSES, start=1)
    }
    structure = Structure(MASSES, {**linear().elements, **dampers})
    record, errors = stack([record_of(structure, FORCES, 15.0)]), []
    for damped in (False, True):
        model = ElementNetwork(2, 2, DT, "chain", MASSES, units=0, mass_damping=damped)
        model.identify([record])
        train(model, record, None)
        errors.append(free_run_error(model, record))
    assert errors[0] > 0.02
    assert errors[1] < 1e-3
    found = {p.name: p.value for p in model.physical_parameters()}
    assert found["mass_damping"] == pytest.approx(alpha, rel=0.01)
    assert found["r1.damping"] == pytest.approx(0.8, rel=0.01)
    exported = [damper.tangent() for damper in model.mass_dampers().values()]
    assert exported == [pytest.approx((0.0, alpha * mass), rel=0.01) for mass in MASSES]
    _, damping, _ = model.small_motion()
    _, right, _ = (torch.from_numpy(m) for m in structure.linearised())
    assert torch.allclose(damping, right / torch.tensor(MASSES)[:, None].double(), rtol=0.01)


def test_only_a_chain_on_the_ground_is_given_rayleighs_damping():
    """Where all pairs are joined, dampers to the ground say it already."""
    for elements, given in (("chain", True), ("all", False)):
        model = ElementNetwork(2, 2, DT, elements, MASSES, mass_damping=True)
        assert (model.drag is not None) == given
    assert ElementNetwork(2, 1, DT, "chain", forced="base", mass_damping=True).drag is not None
    assert ElementNetwork(1, 1, DT, "chain", mass_damping=True).drag is None
