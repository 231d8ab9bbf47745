"""Training that was broken off ends where it would have ended; no file is trusted blindly."""

from __future__ import annotations

import pickle

import pytest
import torch
from lightning.pytorch import Callback, Trainer

from data.datamodule import Data
from models.fit import free_run_objective
from models.fit.free_run_objective import FreeRun
from models.fit.identification import Identification
from models.fit.progress import limited
from models.fit.resume import SaveProgress, fault_of, seal
from models.fit.solvers.adam import Adam
from models.fit.solvers.lbfgs import LBFGS
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.mlp import GlobalMLP
from tests.hostile_files import Bomb
from tests.models.training import trainer
from tests.models.two_masses import DT, motion

RUN = {"config": "one", "results": 2}


class Motions(Data):
    name, dt, dofs, inputs = "two masses", DT, 2, 2

    def make_records(self):
        return {"train": [motion(60), motion(60, 1)], "test": [motion(60, 2)]}


class KilledError(Exception):
    pass


class KillAfter(Callback):
    def __init__(self, epochs: int) -> None:
        self.epochs = epochs

    def on_train_epoch_start(self, trainer, pl_module) -> None:
        if trainer.current_epoch == self.epochs:
            raise KilledError


CASES = {
    "lbfgs": (lambda p: LBFGS(p, iterations=60, patience=5, change=0.0), None, {}),
    "levenberg_marquardt": (lambda p: LevenbergMarquardt(p, iterations=12), None, {}),
    "shuffled_mini_batches": (
        lambda p: Adam(p, iterations=60, rate=0.02),
        None,
        {"window": 20, "batch": 4, "validation": 0.2},
    ),
    "stages_and_finalists": (
        lambda p: LevenbergMarquardt(p, iterations=3),
        lambda: FreeRun([2, 5], records=1, starts=3, start_iterations=2, finalists=2),
        {},
    ),
}


def trained(case: str, folder, *callbacks, go_on: bool = False) -> Identification:
    make_solver, objective, cut = CASES[case]
    torch.manual_seed(7)
    module = Identification(
        GlobalMLP(2, 2, DT, hidden=(4,)), make_solver, 3, objective and objective()
    )
    path = folder / "training.ckpt"
    data = Motions(**cut)
    own = trainer(folder, data, [SaveProgress(path, RUN, 0.0), *callbacks])
    own.fit(module, datamodule=data, ckpt_path=path if go_on else None, weights_only=True)
    return module


@pytest.mark.parametrize("case", CASES)
def test_training_that_is_broken_off_ends_where_it_would_have_ended(case, tmp_path, monkeypatch):
    monkeypatch.setattr(free_run_objective, "ASTRAY", 0.0)  # a start goes beside the finalists
    undisturbed = trained(case, tmp_path / "undisturbed")
    epochs = {"shuffled_mini_batches": 2}.get(case, 5)
    with pytest.raises(KilledError):
        trained(case, tmp_path, KillAfter(epochs))
    assert not fault_of(tmp_path / "training.ckpt", RUN)
    with pytest.raises(KilledError):  # and once more, a little later
        trained(case, tmp_path, KillAfter(epochs + 1), go_on=True)
    resumed = trained(case, tmp_path, go_on=True)
    assert len(resumed.losses) > epochs
    assert resumed.losses == undisturbed.losses
    assert resumed.ended == undisturbed.ended
    pairs = zip(resumed.estimator.parameters(), undisturbed.estimator.parameters(), strict=True)
    assert all(torch.equal(ours, theirs) for ours, theirs in pairs)


def test_a_budget_counts_what_was_spent_before_the_break(tmp_path):
    with pytest.raises(KilledError):
        trained("lbfgs", tmp_path, KillAfter(2))
    path = tmp_path / "training.ckpt"
    checkpoint = torch.load(path, weights_only=True)
    checkpoint["progress"]["seconds"] = 90.0
    torch.save(checkpoint, path)
    seal(path)
    with limited(100.0) as budget:
        trained("lbfgs", tmp_path, go_on=True)
    assert 0.0 < budget.remaining < 10.0


def test_only_the_own_file_is_gone_on_from(tmp_path):
    with pytest.raises(KilledError):
        trained("lbfgs", tmp_path, KillAfter(1))
    path = tmp_path / "training.ckpt"
    assert fault_of(path, {**RUN, "results": 3})
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert fault_of(path, RUN)
    path.write_bytes(b"")
    assert fault_of(path, RUN)
    path.unlink()
    assert fault_of(path, RUN)
    torch.save({"identity": RUN, "payload": Bomb()}, path)
    assert fault_of(path, RUN)
    path.write_bytes(pickle.dumps({"identity": RUN, "payload": Bomb()}, protocol=2))
    assert fault_of(path, RUN)


def test_a_saving_that_never_ends_leaves_the_one_before(tmp_path, monkeypatch):
    with pytest.raises(KilledError):
        trained("lbfgs", tmp_path, KillAfter(1))

    def half(self, path, *_: object, **__: object) -> None:
        path.write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Trainer, "save_checkpoint", half)
    with pytest.raises(OSError, match="No space"):
        trained("lbfgs", tmp_path, go_on=True)
    assert not fault_of(tmp_path / "training.ckpt", RUN)
