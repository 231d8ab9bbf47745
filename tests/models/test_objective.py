"""Training on the simulation: restarted runs, their normal equations, stages, starts, choice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from lightning.pytorch import Trainer
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector

from data.record import Drive, Record, Response, stack
from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.scenario import FullState
from models.element_network import ElementNetwork
from models.estimator import Estimator, NoFreeRunError
from models.mlp import GlobalMLP, ResidualMLP
from models.neural_state_space import NeuralStateSpace
from models.training.free_run_objective import FreeRun
from models.training.identification import Identification
from models.training.objective import OneStep, state_of
from models.training.problem import FreeRunProblem, Problem
from models.training.solvers.adam import Adam
from models.training.solvers.lbfgs import LBFGS
from models.training.solvers.levenberg_marquardt import LevenbergMarquardt
from models.training.trainable import Trainable
from models.vwnn import VWNN

# PyTorch's forward differentiation compiles its own rules with what PyTorch deprecates
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*torch.jit.script. is deprecated"),
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]
DT = 0.01
MODELS = {
    "global": lambda: GlobalMLP(2, 2, DT, hidden=(3,)),
    "residual": lambda: ResidualMLP(2, 2, DT, hidden=(3,)),
    "state_space": lambda: NeuralStateSpace(2, 2, DT, memory=2, hidden=3, past=4),
}


class Growth(Trainable):
    """ẍ = g ẋ + f with a single g: above zero, a run grows without bound."""

    reads = ("x", "v", "f")

    def __init__(self, gain: float) -> None:
        super().__init__(2, 2, DT)
        self.gain = nn.Parameter(torch.tensor(gain, dtype=torch.float64))

    def free_run(self, drive: Drive) -> Response:
        x, v, history = drive.x0, drive.v0, []
        for u in drive.u.unbind(dim=-2):
            a = self.gain * v + u
            history.append((x, v, a))
            x, v = x + DT * v, v + DT * a
        return Response(*(torch.stack(s, dim=-2) for s in zip(*history, strict=True)))


def motion(samples: int = 40, seed: int = 0, begins: str = "rest") -> Record:
    """Two masses under smooth random forces, from rest (or as given), by small Euler steps."""
    rng = np.random.default_rng(seed)
    f = np.cumsum(rng.standard_normal((samples, 2)), axis=0)
    x, v, history = np.zeros(2), np.zeros(2), []
    for u in f:
        a = u - 90.0 * x - 1.5 * v - 2000.0 * x**3
        history.append((x, v, a))
        v = v + DT * a
        x = x + DT * v
    x, v, a = (torch.from_numpy(np.stack(s)) for s in zip(*history, strict=True))
    return Record(DT, a, torch.from_numpy(f), x, v, initial_state=begins)


def identified(model: str, record: Record) -> Estimator:
    torch.manual_seed(3)
    estimator = MODELS[model]()
    estimator.identify([record])
    return estimator


def free_of(estimator: Estimator) -> list[nn.Parameter]:
    return [p for p in estimator.parameters() if p.requires_grad]


RECORDS = {
    "record": motion,
    "in_motion": lambda: motion(70).window(30, 40, warmup=5),
    "batch": lambda: stack([motion(), motion(seed=1)]),
}


# restarted runs


@pytest.mark.parametrize("warmup", [0, 3])
@pytest.mark.parametrize("kind", RECORDS)
def test_a_restarted_run_is_that_of_every_window_by_itself(kind, warmup):
    record = RECORDS[kind]()
    estimator = identified("global", record)
    for horizon in (1, 2, 7, 20, 39):
        pieces = []
        for begin in range(0, record.samples, horizon):
            start = max(begin - warmup, 0)
            whole, u = record.drive(), record.f[..., start : begin + horizon, :]
            x0, v0 = record.x[..., start, :], record.v[..., start, :]
            x0, v0 = (whole.x0, whole.v0) if start == 0 else (x0, v0)
            run = estimator.free_run(Drive(DT, u, x0, v0))
            pieces.append(run.a[..., begin - start :, :])
        together = estimator.restarted_run(record, horizon, warmup)
        assert torch.allclose(together, torch.cat(pieces, dim=-2), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("horizon", [None, 40, 1000])
@pytest.mark.parametrize("kind", RECORDS)
@pytest.mark.parametrize("model", MODELS)
def test_a_run_that_is_never_restarted_is_the_free_run(model, kind, horizon):
    record = RECORDS[kind]()
    estimator = identified(model, record)
    assert torch.equal(
        estimator.restarted_run(record, horizon), estimator.free_run(record.drive()).a
    )


def test_a_restart_at_every_sample_is_the_one_step_estimate():
    record = motion()
    estimator = identified("global", record)
    assert torch.allclose(estimator.restarted_run(record, 1), estimator(record), rtol=1e-12)


def test_the_first_window_begins_as_the_record_does_and_the_others_as_measured():
    record = motion()
    lies = replace(record, x=record.x + 1.0)
    run, other = (Growth(-1.0).restarted_run(r, 10) for r in (record, lies))
    assert torch.equal(run, other)  # x plays no part in ẍ here
    lies = replace(record, v=record.v + 1.0)
    changed = (Growth(-1.0).restarted_run(lies, 10) - run).abs().amax(dim=-1)
    assert (changed[:10] == 0.0).all()
    assert (changed[10:] > 0.5).all()


def test_without_measured_states_only_the_whole_record_can_be_run():
    record = replace(motion(), x=None, v=None)
    estimator = identified("global", motion())
    estimator.restarted_run(record, None)
    with pytest.raises(ValueError, match=r"horizons=\[null\]"):
        estimator.restarted_run(record, 10)


# the problem


@pytest.mark.parametrize(("horizon", "warmup"), [(7, 0), (10, 4), (None, 0)])
@pytest.mark.parametrize("kind", RECORDS)
@pytest.mark.parametrize("model", MODELS)
def test_normal_equations_of_a_free_run(model, kind, horizon, warmup):
    """JᵀJ and Jᵀe against reverse differentiation of every single error."""
    record = RECORDS[kind]()
    estimator = identified(model, record)
    problem = FreeRunProblem(estimator, record, horizon, warmup)
    matrix, vector = problem.normal_equations()
    free = free_of(estimator)
    errors = problem.errors()
    assert errors.numel() == record.a[..., record.warmup :, :].numel()
    weights = torch.linspace(-1.0, 1.0, errors.numel(), dtype=torch.float64)
    along = _gradient((errors * weights).sum(), free)  # Jᵀ w
    assert torch.allclose(2.0 * vector / errors.numel(), _gradient(problem.loss(), free), atol=1e-9)
    shifted = _gradient((problem.errors() * problem.errors().detach()).sum(), free)
    assert torch.allclose(vector, shifted, rtol=1e-8, atol=1e-9 * float(vector.abs().max()))
    J = _jacobian(problem, free)
    assert torch.allclose(J.T @ weights, along, rtol=1e-6, atol=1e-8 * float(along.abs().max()))
    assert torch.allclose(matrix, J.T @ J, rtol=0.0, atol=1e-9 * float(matrix.abs().max()))


def _gradient(value: Tensor, free: list[nn.Parameter]) -> Tensor:
    slopes = torch.autograd.grad(value, free, allow_unused=True)
    return torch.cat(
        [
            (torch.zeros_like(p) if slope is None else slope).reshape(-1)
            for slope, p in zip(slopes, free, strict=True)
        ]
    )


def _jacobian(problem: FreeRunProblem, free: list[nn.Parameter]) -> Tensor:
    rows = []
    errors = problem.errors()
    for e in errors:
        slopes = torch.autograd.grad(e, free, retain_graph=True, allow_unused=True)
        parts = [torch.zeros_like(p) if g is None else g for g, p in zip(slopes, free, strict=True)]
        rows.append(parameters_to_vector(parts))
    return torch.stack(rows)


def test_the_normal_equations_do_not_depend_on_the_size_of_a_block(monkeypatch):
    record = motion()
    problem = FreeRunProblem(identified("global", record), record, 4)
    whole = problem.normal_equations()
    for block in (1, 500):
        monkeypatch.setattr("models.training.problem.BLOCK_ELEMENTS", block)
        for one, other in zip(problem.normal_equations(), whole, strict=True):
            assert torch.allclose(one, other, rtol=1e-10, atol=1e-12)


def test_an_estimators_own_jacobian_is_taken(monkeypatch):
    record = RECORDS["in_motion"]()
    estimator = identified("global", record)
    problem = FreeRunProblem(estimator, record, 7)
    wanted = problem.normal_equations()
    J = problem._differentiated(problem.y.numel()) / problem.weight
    whole = torch.full((*record.a.shape, J.shape[1]), torch.nan, dtype=J.dtype)
    whole[record.warmup :] = J.view(*problem.y.shape, -1)
    run = estimator.restarted_run(record, 7)
    monkeypatch.setattr(GlobalMLP, "restarted_jacobian", lambda self, *how: (run, whole))
    monkeypatch.delattr(FreeRunProblem, "_differentiated")
    for one, other in zip(problem.normal_equations(), wanted, strict=True):
        assert torch.allclose(one, other, rtol=1e-10, atol=1e-12)


def test_the_loss_is_that_of_the_free_run():
    record = RECORDS["in_motion"]()
    estimator = identified("global", record)
    a = estimator.free_run(record.drive()).a
    wanted = (a - record.a)[5:].square().sum() / record.a[5:].square().sum()
    loss = FreeRunProblem(estimator, record, None).loss()
    assert float(loss.detach()) == pytest.approx(float(wanted.detach()), rel=1e-12)


def test_an_estimator_that_cannot_simulate_says_so():
    estimator = VWNN(2, 2, DT)
    with pytest.raises(NoFreeRunError):
        FreeRunProblem(Trainable(2, 2, DT), motion(), None).loss()
    assert isinstance(estimator, Estimator)


# starts that diverge


def falling(gain: float, samples: int = 4000) -> tuple[Growth, Record]:
    """A record of Growth(−3), and Growth with another gain to start from."""
    f = torch.from_numpy(np.random.default_rng(0).standard_normal((samples, 2)))
    drive = Drive(DT, f, torch.zeros(2, dtype=f.dtype), torch.zeros(2, dtype=f.dtype))
    with torch.no_grad():
        run = Growth(-3.0).free_run(drive)
    return Growth(gain), Record(DT, run.a, f, run.x, run.v)


@pytest.mark.parametrize("solver", [LevenbergMarquardt, LBFGS, Adam])
def test_a_start_that_overflows_leaves_the_parameters_alone(solver):
    estimator, record = falling(30.0)
    fitted = solver(estimator.parameters(), iterations=3)
    problem = FreeRunProblem(estimator, record, None)
    assert not torch.isfinite(problem.loss())
    for _ in range(3):
        if not fitted.finished:
            assert fitted.solve(problem) == []
    assert fitted.finished
    assert float(estimator.gain.detach()) == 30.0
    assert solver is Adam or "not finite" in fitted.why


def test_levenberg_marquardt_stops_where_derivatives_overflow():
    class Steep(Growth):
        def restarted_jacobian(self, record, *how) -> tuple[Tensor, Tensor]:
            derivatives = torch.full((400, 2, 1), torch.inf, dtype=torch.float64)
            return self.restarted_run(record, None), derivatives

    estimator, record = Steep(-1.0), falling(0.0, 400)[1]
    solver = LevenbergMarquardt(estimator.parameters())
    assert solver.solve(FreeRunProblem(estimator, record, None)) == []
    assert solver.why == "the derivatives are not finite"


@pytest.mark.parametrize("solver", [LevenbergMarquardt, LBFGS])
def test_short_horizons_lead_to_where_the_whole_record_can_be_run(solver):
    estimator, record = falling(30.0, 1500)
    assert not torch.isfinite(FreeRunProblem(estimator, record, None).loss())
    for horizon in (5, None):
        fitted = solver(free_of(estimator), iterations=30)
        while not fitted.finished:
            fitted.solve(FreeRunProblem(estimator, record, horizon))
    assert float(estimator.gain.detach()) == pytest.approx(-3.0, rel=1e-5)


def test_a_line_search_turns_back_where_the_run_overflows():
    """A wall of NaN beyond 1 on the way from 0 to the minimum at 0.9, steep at the start."""

    class Wall:
        y, steepest = torch.zeros(1, dtype=torch.float64), float("inf")
        theta = nn.Parameter(torch.tensor([0.0], dtype=torch.float64))

        def loss(self) -> Tensor:
            e = (self.theta - 0.9) * 3.0
            return torch.where(self.theta > 1.0, torch.nan, e**2 + e**4).sum()

    wall = Wall()
    solver = LBFGS([wall.theta], change=0.0)
    losses = []
    while not solver.finished:
        losses += solver.solve(wall)
    assert np.isfinite(losses).all()
    assert float(wall.theta.detach()) == pytest.approx(0.9, abs=1e-4)


def test_adam_shortens_long_gradients_of_a_free_run_and_of_nothing_else():
    record = motion()
    for problem, shortened in (
        (FreeRunProblem(identified("global", record), record, None), True),
        (Problem(identified("global", record), record), False),
    ):
        estimator = problem.estimator if shortened else problem.module
        scaled = 1e4 * problem.loss()
        problem.loss = lambda value=scaled: value
        Adam(free_of(estimator)).solve(problem)
        norm = float(torch.cat([p.grad.reshape(-1) for p in free_of(estimator)]).norm())
        assert (norm <= 1.0 + 1e-9) == shortened


# stages in the LightningModule


@pytest.fixture(scope="module")
def data(linear_chain) -> SimulatedData:
    return data_of(linear_chain)


def data_of(linear_chain, **cut) -> SimulatedData:
    excitation = Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.0)))
    return SimulatedData(linear_chain(2), excitation, FullState(), seed=0, duration=1.6, **cut)


def fit(module: Identification, data, folder, epochs: int = 60) -> Identification:
    trainer = Trainer(
        accelerator="cpu", devices=1, max_epochs=epochs, logger=False, num_sanity_val_steps=0,
        enable_progress_bar=False, enable_model_summary=False, enable_checkpointing=False,
        limit_val_batches=None if data.validation else 0, log_every_n_steps=1,
        default_root_dir=folder,
    )  # fmt: skip
    trainer.fit(module, datamodule=data)
    return module


def network(seed: int = 0) -> GlobalMLP:
    torch.manual_seed(seed)
    return GlobalMLP(2, 2, DT, hidden=(4,))


def free_run_loss(estimator: Estimator, data: SimulatedData) -> float:
    (record,) = data.loader("train")
    with torch.no_grad():
        return float(FreeRunProblem(estimator, record, None).loss())


def test_stages_follow_each_other_and_are_reported(data, tmp_path):
    module = Identification(
        network(), lambda p: LBFGS(p, iterations=3), objective=FreeRun([5, 20, None])
    )
    fit(module, data, tmp_path)
    trained = module.how_trained()
    names = [stage["stage"] for stage in trained["stages"]]
    assert names == ["horizon 5", "horizon 20", "horizon whole record"]
    assert [stage["iterations"] for stage in trained["stages"]] == [3, 3, 3]
    assert {stage["stopped"] for stage in trained["stages"]} == {"3 iterations"}
    assert trained["iterations"] == len(module.losses) == 9
    assert free_run_loss(module.estimator, data) == pytest.approx(module.losses[-1], rel=1e-9)


def test_one_step_has_one_stage_and_reports_as_before(data, tmp_path):
    module = Identification(network(), lambda p: LBFGS(p, iterations=5), objective=OneStep())
    trained = fit(module, data, tmp_path).how_trained()
    assert trained == {"solver": "LBFGS", "iterations": 5, "stopped": "5 iterations"}


def test_the_end_of_the_best_stage_is_kept(data, tmp_path):
    """The last stage leads astray, on purpose."""

    class Astray(LevenbergMarquardt):
        made = 0

        def __init__(self, parameters) -> None:
            super().__init__(parameters, iterations=1, gradient=0.0)
            Astray.made += 1
            self.astray = Astray.made == 2

        @torch.no_grad()
        def solve(self, problem) -> list[float]:
            if not self.astray:
                return super().solve(problem)
            for group in self.param_groups:
                for p in group["params"]:
                    p.mul_(0.1)
            self.finished, self.why = True, "astray"
            return [float(problem.loss())]

    module = Identification(
        NeuralStateSpace(2, 2, DT, memory=1, hidden=2, past=2),
        lambda parameters: Astray(parameters),
        objective=FreeRun([20, None]),
    )
    fit(module, data, tmp_path)
    assert [stage["stopped"] for stage in module.ended] == ["1 iterations", "astray"]
    assert free_run_loss(module.estimator, data) == pytest.approx(module.chosen[0], rel=1e-12)
    assert module.chosen[0] < module.losses[-1]


@pytest.mark.parametrize("solver", ["adam", "levenberg_marquardt", "lbfgs"])
def test_training_on_the_free_run_simulates_better(solver, linear_chain, tmp_path):
    """From the same start; one step ahead it may be worse."""
    make = {
        "adam": lambda p: Adam(p, iterations=60, rate=0.01),
        "levenberg_marquardt": lambda p: LevenbergMarquardt(p, iterations=8),
        "lbfgs": lambda p: LBFGS(p, iterations=25),
    }[solver]
    cut = {"window": 40, "warmup": 5, "batch": 4} if solver == "adam" else {}
    data = data_of(linear_chain, **cut)
    data.setup()
    start = network()
    fit(Identification(start, make, objective=OneStep()), data, tmp_path)
    before = free_run_loss(start, data)
    module = Identification(start, make, objective=FreeRun([20]))
    fit(module, data, tmp_path)
    assert free_run_loss(module.estimator, data) < 0.9 * before


def test_windows_of_a_batch_begin_as_measured(linear_chain, tmp_path):
    """Also where the first window of the batch is the beginning of the record."""
    data = data_of(linear_chain, window=40)
    seen = []

    class Noting(OneStep):
        def problem(self, estimator, record, stage) -> Problem:
            seen.append(record)
            return super().problem(estimator, record, stage)

    fit(
        Identification(network(), lambda p: Adam(p, iterations=1), objective=Noting()),
        data,
        tmp_path,
    )
    assert seen[0].initial_state == "given"
    assert (seen[0].drive().x0[1:] != 0.0).all()


# starts


def test_the_best_of_several_starts_goes_on(data, tmp_path):
    data.setup()
    (record,) = data.loader("train")
    objective = FreeRun([20], starts=4, start_iterations=2, seed=5)
    estimator, noted = network(), []
    estimator.identify([record])
    make = lambda p: LevenbergMarquardt(p, iterations=5)
    objective.begin(estimator, [record], make, noted.extend)
    assert len(noted) == 8
    ends = noted[1::2]
    kept = float(objective.problem(estimator, record, 0).loss().detach())
    assert kept == pytest.approx(min(ends), rel=1e-9)
    assert len({round(e, 12) for e in ends}) == 4


def test_the_best_start_keeps_the_units_it_was_drawn_with(data):
    """An element network draws gaps and limits, which are units of its parameters."""
    data.setup()
    (record,) = data.loader("train")
    objective, noted = FreeRun([1], starts=4, start_iterations=3, seed=5), []
    estimator = ElementNetwork(record.dofs, record.f.shape[-1], record.dt, hinges=1, units=1)
    estimator.identify([record])
    make = lambda p: LevenbergMarquardt(p, iterations=5, scaled=True)
    objective.begin(estimator, [record], make, noted.extend)
    kept = float(objective.problem(estimator, record, 0).loss().detach())
    assert kept == pytest.approx(min(noted[2::3]), rel=1e-9)


def test_starts_are_those_of_the_seed(data):
    ends = []
    for seed in (1, 1, 2):
        estimator = network()
        estimator.restart(torch.Generator().manual_seed(seed))
        ends.append(parameters_to_vector(estimator.parameters()).detach())
    assert torch.equal(ends[0], ends[1])
    assert not torch.equal(ends[0], ends[2])
    assert (ends[0] != parameters_to_vector(network().parameters())).any()


def test_what_has_no_random_start_says_so():
    with pytest.raises(ValueError, match=r"objective\.starts=1"):
        Growth(1.0).restart(torch.Generator())


@pytest.mark.parametrize(
    "wrong", [{"horizons": []}, {"horizons": [50, 5]}, {"horizons": [None, 5]}, {"horizons": [0]},
              {"starts": 0}, {"warmup": -1}, {"start_iterations": 0},
              {"starts": 2, "finalists": 3}, {"finalists": 0}],
)  # fmt: skip
def test_an_objective_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match=r"objective\."):
        FreeRun(**wrong)


def test_without_restarts_a_stage_is_the_first_samples_of_the_first_records():
    """Where x and v are not to be trusted, they are not looked at."""
    batch = stack([motion(), motion(seed=1), motion(seed=2)])
    estimator = identified("global", batch)
    objective = FreeRun([10, None], restart=False, records=2)
    first, last = (objective.problem(estimator, batch, stage) for stage in (0, 1))
    assert first.y.shape == (2, 10, 2)
    assert last.y.shape == batch.a.shape
    lies = replace(batch, x=torch.full_like(batch.a, 7.0), v=torch.full_like(batch.a, 7.0))
    for stage, problem in enumerate((first, last)):
        told = objective.problem(estimator, lies, stage)
        assert float(told.loss().detach()) == float(problem.loss().detach())


def test_normal_equations_of_every_second_sample_take_all_dofs():
    """Two DOFs: every second row would be one DOF alone."""
    record = motion()
    problem = FreeRunProblem(identified("global", record), record, 20)
    J = problem._differentiated(problem.y.numel()).view(*problem.y.shape, -1)
    some = J[::2].flatten(0, 1)
    matrix, _ = problem.normal_equations(every=2)
    assert torch.allclose(matrix, J.numel() / some.numel() * some.T @ some, rtol=1e-9)


def test_the_best_of_the_finalists_in_the_end_stays(data, tmp_path, monkeypatch):
    """All three go through both stages; parameters and units of the best end are kept."""
    ends, compared, begun, enter = [], FreeRun.final_loss, [], FreeRun.enter

    def noted(objective, estimator, batches):
        ends.append(compared(objective, estimator, batches))
        return ends[-1]

    def entered(objective, estimator, stage):
        enter(objective, estimator, stage)
        if stage % 2 == 0:
            pairs = zip(state_of(estimator), objective.ranked[stage // 2], strict=True)
            begun.append(all(torch.equal(now, ranked) for now, ranked in pairs))

    monkeypatch.setattr(FreeRun, "final_loss", noted)
    monkeypatch.setattr(FreeRun, "enter", entered)
    objective = FreeRun([1, None], starts=3, start_iterations=1, finalists=3, seed=2)
    module = Identification(
        ElementNetwork(2, 2, DT, hinges=1, units=1),
        lambda p: LevenbergMarquardt(p, iterations=2, scaled=True),
        objective=objective,
    )
    fit(module, data, tmp_path)
    names = ["horizon 1", "horizon whole record"]
    assert [stage["stage"] for stage in module.ended] == [
        *names, *(f"{name}, start {n}" for n in (2, 3) for name in names)
    ]  # fmt: skip
    assert begun == [True, True]
    assert len({round(end, 14) for end in ends}) == 1 + 6  # the start too
    assert free_run_loss(module.estimator, data) == pytest.approx(min(ends), rel=1e-9)
