"""Laws of elements that share forces: fitted together under the motion; damping of the masses."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from data.record import Record, singles, stack
from models.element_network_branch import ElementNetworkBranch
from models.fit.objective import restore, state_of
from models.fit.problem import Joint
from models.starts import branch_laws
from models.starts.equilibrium import Balance, fit_together
from models.uncertainty.parameters import free_vector
from tests.reference_networks import reference_run

DT, MASSES = 0.01, [3e4, 2e4]
ALPHA = 0.8  # 1/s
B = np.array([[1.0, 0.0], [-1.0, 1.0], [-2.0, 1.0]])  # of two floors that bend
SPRINGS, LIMITS = np.array([9e6, 3e6, 4e6]), np.array([4e4, 2e4, 2.5e4])  # N/m, N


def shaken(seed: int, size: float = 3.0, samples: int = 500) -> Record:
    """A frame of two floors on a shaken base, of Bouc and Wen's elements, its masses damped."""
    rng, fine = np.random.default_rng(seed), 8
    t = DT / fine * np.arange(samples * fine)
    wave = np.sin(np.outer(t, rng.uniform(4.0, 25.0, 8)) + rng.uniform(0.0, 6.0, 8)).sum(axis=1)
    ground = np.minimum(t / 1.0, 1.0) ** 2 * size * wave / np.abs(wave).max()
    x, v, z, m, h = np.zeros(2), np.zeros(2), np.zeros(3), np.array(MASSES), DT / fine
    motion = np.zeros((len(t), 3, 2))
    for k in range(len(t)):
        rate = B @ v
        a = -ground[k] - ALPHA * v - B.T @ (z + 0.05 * SPRINGS * (B @ x) + 2e3 * rate) / m
        motion[k] = x, v, a
        z = z + h * SPRINGS * rate * (1.0 - (z * rate > 0.0) * (z / LIMITS) ** 2)
        v = v + h * a
        x = x + h * v
    x, v, a = (torch.from_numpy(u.copy()) for u in motion[::fine].transpose(1, 0, 2))
    return Record(DT, a, -torch.from_numpy(ground[::fine].copy())[:, None], x, v)


def network(**more: object) -> ElementNetworkBranch:
    small = {"ramps": 3, "bends": 1, "law_starts": 1, "prior": 1e-4}
    return ElementNetworkBranch(2, 1, DT, "frame", MASSES, "base", **{**small, **more})


@pytest.fixture(scope="module")
def model() -> ElementNetworkBranch:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(branch_laws, "FIRST", 4)
        patch.setattr("models.element_network_branch.fit_together", lambda *given: 1.0)
        model = network()
        model.identify([stack([shaken(0), shaken(1)])])
    return model


def test_the_balance_has_exact_derivatives(model):
    balance, own = Balance(model, shaken(2), 1e-3), model.theta.shape[1]
    with torch.no_grad():
        matrix, vector = balance.normal_equations()
        for place in (1, own + 2, 3 * own):  # the last: log α
            free = [p for p in model.parameters() if p.requires_grad]
            before, losses = free_vector(model).clone(), []
            for step in (1e-5, -1e-5):
                moved = before.clone()
                moved[place] += step
                torch.nn.utils.vector_to_parameters(moved, free)
                losses.append(float(balance.loss()))
            torch.nn.utils.vector_to_parameters(before, free)
            slope = (losses[0] - losses[1]) / 2e-5
            assert 2.0 * float(vector[place]) / balance.y.numel() == pytest.approx(slope, rel=1e-4)
    assert torch.allclose(matrix, matrix.T)


def test_laws_that_share_forces_are_nearer_to_them_when_fitted_together(model):
    before, motions = state_of(model), [shaken(0), shaken(1)]
    begun = float(Joint([Balance(model, m, 0.0) for m in motions]).loss()) ** 0.5
    error = fit_together(model, motions)
    assert error < 0.5 * begun
    restore(model, before)


def test_masses_of_a_frame_on_a_shaken_base_are_damped(model):
    assert model.drag is not None
    core = model.composition().core
    assert torch.equal(core.value[1], model.drag().detach().expand(2))
    record = next(singles([shaken(3, samples=60)]))
    drive = record.drive()
    trace, reference = model.trace(drive, derivatives=True), reference_run(model, drive)
    assert torch.allclose(trace.response.a, reference.a, rtol=1e-7, atol=1e-9)
    assert model.drag is not None
    (slopes,) = torch.autograd.grad(reference.a.sum(), [model.drag.theta])
    assert float(trace.jacobian[..., -1].sum()) == pytest.approx(float(slopes), rel=1e-6)
