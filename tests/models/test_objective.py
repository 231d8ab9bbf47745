"""Training on free runs in the LightningModule: stages, several starts, which one is kept."""

from __future__ import annotations

import math

import pytest
import torch
from lightning.pytorch import Trainer
from torch.nn.utils import parameters_to_vector

from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.scenario import FullState
from models.element_network import ElementNetwork
from models.estimator import Estimator
from models.fit.finalists import middle
from models.fit.free_run_objective import FreeRun
from models.fit.identification import Identification
from models.fit.objective import OneStep, state_of
from models.fit.problem import FreeRunProblem, Problem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.mlp import GlobalMLP
from models.neural_state_space import NeuralStateSpace
from models.fit.finalists import middle
from models.fit.free_run_objective import FreeRun
from models.fit.identification import Identification
from models.fit.objective import OneStep, state_of
from models.fit.problem import FreeRunProblem, Problem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from tests.models.two_masses import DT

# PyTorch's forward differentiation compiles its own rules with what PyTorch deprecates
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*torch.jit.script. is deprecated"),
    pytest.mark.filterwarnings("ignore:.*LeafSpec.*"),
    pytest.mark.filterwarnings("ignore:.*does not have many workers.*"),
    pytest.mark.filterwarnings("ignore:.*litlogger.*"),
]


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


@pytest.mark.parametrize("solver", ["adam", "lbfgs"])
def test_training_on_the_free_run_simulates_better(solver, linear_chain, tmp_path):
    """From the same start; one step ahead it may be worse."""
    make = {
        "adam": lambda p: Adam(p, iterations=60, rate=0.01),
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


def test_starts_are_those_of_the_seed(data):
    ends = []
    for seed in (1, 1, 2):
        estimator = network()
        estimator.restart(torch.Generator().manual_seed(seed))
        ends.append(parameters_to_vector(estimator.parameters()).detach())
    assert torch.equal(ends[0], ends[1])
    assert not torch.equal(ends[0], ends[2])
    assert (ends[0] != parameters_to_vector(network().parameters())).any()


@pytest.mark.parametrize(
    "wrong", [{"horizons": []}, {"horizons": [50, 5]}, {"horizons": [None, 5]}, {"horizons": [0]},
              {"starts": 0}, {"warmup": -1}, {"start_iterations": 0},
              {"starts": 2, "finalists": 3}, {"finalists": 0}],
)  # fmt: skip
def test_an_objective_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match=r"objective\."):
        FreeRun(**wrong)


def test_the_best_of_the_finalists_in_the_end_stays(data, tmp_path, monkeypatch):
    """All three go on after the first horizon; parameters and units of the best end are kept."""
    ends, compared, begun, enter = [], FreeRun.final_loss, [], FreeRun.enter

    def noted(objective, estimator, batches):
        ends.append(compared(objective, estimator, batches))
        return ends[-1]

    def entered(objective, estimator, stage):
        enter(objective, estimator, stage)
        if stage in (2, 4):
            pairs = zip(state_of(estimator), objective.ranked[stage // 2], strict=True)
            begun.append(all(torch.equal(now, ranked) for now, ranked in pairs))

    monkeypatch.setattr(FreeRun, "final_loss", noted)
    monkeypatch.setattr(FreeRun, "enter", entered)
    objective = FreeRun([1, 5, None], starts=3, start_iterations=1, finalists=3, seed=2)
    module = Identification(
        ElementNetwork(2, 2, DT, hinges=1, units=1),
        lambda p: LevenbergMarquardt(p, iterations=2, scaled=True),
        objective=objective,
    )
    fit(module, data, tmp_path)
    names = ["horizon 5", "horizon whole record"]
    assert [stage["stage"] for stage in module.ended] == [
        *names, *(f"{name}, start {n}" for n in (2, 3) for name in names), "the chosen in full"
    ]  # fmt: skip
    assert begun == [True, True]
    assert len({round(end, 14) for end in ends}) == 1 + 7  # the start too
    assert free_run_loss(module.estimator, data) == pytest.approx(min(ends), rel=1e-9)


@pytest.mark.parametrize(
    ("losses", "farther", "chosen"),
    [
        ((1.0, 1.1, 1.2), (9.0, 2.0, 2.1), 2),  # the best fit is alone in what it does farther out
        ((1.0, 1.1, 1.2), (2.0, 2.3, 2.1), 2),  # between the others
        ((1.0, 3.0, 3.1), (9.0, 2.0, 2.1), 0),  # the others fit worse: they say nothing
        ((1.0, 1.1), (9.0, 2.0), 0),  # of two neither is in the middle
        ((1.2, 1.0, 1.1), (math.nan, 2.0, 2.1), 1),  # a run that is lost agrees with none
        ((1.1, 1.0, math.inf), (2.0, 2.1, math.nan), 1),
    ],
)
def test_of_finalists_that_fit_alike_the_one_in_the_middle_goes_on(losses, farther, chosen):
    runs = [[torch.full((1, 5, 2), value).double()] for value in farther]
    ends = [
        (loss, [torch.tensor(k)], run)
        for k, (loss, run) in enumerate(zip(losses, runs, strict=True))
    ]
    assert int(middle(ends)[0]) == chosen
