"""Steps that take any time: several of a model's own in one, and a part of one."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from export.step import Step, run
from export.steps import step_of
from models.layers.integrate import between
from tests.export.compiling import needs_gcc, run_in_c
from tests.export.every_model import ELEMENTS, MODELS, agrees_with, drive, imposed

ANY = ("global_mlp", "power_series_residual", "chebyshev_restoring_force")
OWN = ("linear", "gru", "vwnn", "residual_mlp", "modal_network")


@needs_gcc
@pytest.mark.parametrize("name", [*ANY[1:], *OWN[-2:]])
def test_a_long_step_is_several(name, tmp_path):
    model = MODELS[name](2)
    coarse = drive(model.dofs, model.inputs, 60)
    inner = between(coarse.u, "linear", 7).flatten(0, 1)
    fine = replace(coarse, u=torch.cat([coarse.u[:1], inner]))
    found = run_in_c(step_of(model), replace(coarse, dt=7 * coarse.dt), tmp_path)
    for array, signal in found.items():
        whole = model.free_run(fine)
        wanted = {"x": whole.x, "v": whole.v}.get(array, whole.a)
        agrees_with(signal, wanted[::7], 1e-12)


@pytest.mark.parametrize("name", ANY)
def test_a_step_of_half_the_time_is_more_exact(name):
    model = MODELS[name](2)
    coarse, step = drive(model.dofs, model.inputs, 60), step_of(model)
    assert step.any_step
    x = []
    for parts in (1, 2, 4):
        u = torch.cat([coarse.u[:1], between(coarse.u, "linear", parts).flatten(0, 1)])
        x.append(run(step, replace(coarse, u=u, dt=coarse.dt / parts))["x"][::parts])
    assert abs(x[1] - x[2]).max() < 0.5 * abs(x[0] - x[1]).max()


def test_other_steps_say_that_they_take_their_own_alone():
    steps: list[Step] = [step_of(MODELS[name](2)) for name in OWN]
    assert not any(step.any_step for step in steps)
    step = step_of(ELEMENTS["surface"]())
    assert step.any_step  # no memory
    assert run(step, replace(imposed(20), dt=0.3))["r"].shape == (20, 1)
