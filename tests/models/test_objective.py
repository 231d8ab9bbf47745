"""Training on free runs in the LightningModule: stages, several starts, which one is kept."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import count

import pytest
import torch

from data.record import stack
from data.simulation.datamodule import SimulatedData
from data.simulation.excitation import BandLimitedGaussian, Excitation
from data.simulation.scenario import FullState
from models.element_network import ElementNetwork
from models.estimator import Estimator
from models.fit.extrapolation import middle
from models.fit.free_run_objective import FreeRun
from models.fit.identification import Identification
from models.fit.objective import OneStep
from models.fit.problem import FreeRunProblem, Problem
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.mlp import GlobalMLP
from models.neural_state_space import NeuralStateSpace
from tests.models.solver_problems import Astray
from tests.models.training import fit
from tests.models.two_masses import DT, identified, motion

# stages in the LightningModule


@pytest.fixture(scope="module")
def data(linear_chain) -> SimulatedData:
    return data_of(linear_chain)


def data_of(linear_chain, **cut) -> SimulatedData:
    excitation = Excitation(force=BandLimitedGaussian(2.0, (0.0, 4.0)))
    return SimulatedData(linear_chain(2), excitation, FullState(), seed=0, duration=1.6, **cut)


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


def test_the_best_of_several_starts_goes_on(data):
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


def test_the_start_of_a_fit_does_not_see_the_motion_that_it_holds_back(monkeypatch):
    """Motion held back chooses among the ends of all stages, and this start is one of them."""
    record = replace(motion(800), x=None, v=None)
    estimator = ElementNetwork(2, 2, DT, "chain", from_accelerations=True)
    estimator.identify([record])
    seen, module = [], "models.fit.free_run_objective"
    monkeypatch.setattr(f"{module}.grow", lambda _, records: seen.extend(records) or 1.0)
    monkeypatch.setattr(f"{module}.fit_linear", lambda *_: None)
    objective = FreeRun(held_back=0.2)
    objective.prepare(estimator, [record], measured=True)
    objective.begin(estimator, [record], LevenbergMarquardt, lambda losses: None)
    assert objective.near
    assert 0.5 * record.samples < seen[0].samples < 0.95 * record.samples


@pytest.mark.parametrize(
    "wrong", [{"horizons": []}, {"horizons": [50, 5]}, {"horizons": [None, 5]}, {"horizons": [0]},
              {"starts": 0}, {"start_iterations": 0},
              {"starts": 2, "finalists": 3}, {"finalists": 0}],
)  # fmt: skip
def test_an_objective_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(ValueError, match=rf"{next(reversed(wrong))}="):
        FreeRun(**wrong)


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


def test_the_best_of_the_finalists_alone_is_trained_on_all_records():
    batch = stack([motion(), motion(seed=1), motion(seed=2)])
    estimator = identified("global", batch)
    objective = FreeRun([1, 10, None], starts=2, finalists=2, records=2)
    objective.prepare(estimator, [batch], measured=False)
    assert objective.stages[-2:] == ["horizon whole record, start 2", "the chosen in full"]
    sizes = [len(objective.problem(estimator, batch, k).y) for k in range(5)]
    assert sizes == [2, 2, 2, 2, 3]
    for stage in range(5):
        objective.present = stage
        assert objective.refits is (stage == 4)
        objective.final_loss(estimator, [batch])


def test_the_end_of_the_best_stage_is_kept(data, tmp_path):
    """The last stage leads astray, on purpose."""

    made = count(1)
    module = Identification(
        NeuralStateSpace(2, 2, DT, memory=1, hidden=2, past=2),
        lambda parameters: Astray(parameters, next(made) == 2),
        objective=FreeRun([20, None]),
    )
    fit(module, data, tmp_path)
    assert [stage["stopped"] for stage in module.ended] == ["1 iterations", "astray"]
    assert free_run_loss(module.estimator, data) == pytest.approx(module.chosen[0], rel=1e-12)
    assert module.chosen[0] < module.losses[-1]
