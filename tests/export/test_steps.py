"""Steps do what free runs do, sample by sample, to rounding; some take any time."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest
import torch

from data.record import Drive
from export.step import Step, run
from export.steps import step_of
from models.baselines import LastValue
from models.estimator import Estimator
from models.layers.integrate import between
from models.linear import EquivalentLinear
from tests.export import networks
from tests.export.compiling import needs_gcc, run_in_c
from tests.export.every_model import DT, ELEMENTS, MODELS, agrees_with, differences, drive, imposed

TOLERANCE = 1e-12  # largest difference over largest signal, of each output


def agrees(model: Estimator, given: Drive) -> None:
    found = differences(model, given, run(step_of(model), given))
    assert all(error <= TOLERANCE for error in found.values()), found


def once_more(step: Step) -> Step:
    """The step, whose every `observe` is called with another excitation before."""
    names = step.arguments(step.observe)

    def observe(*arguments: np.ndarray) -> None:
        given = dict(zip(names, arguments, strict=True))
        step.observe(*(given[n] if n != "u" else given[n] + 0.7 for n in names))
        step.observe(*arguments)

    signature = inspect.Signature([inspect.Parameter(n, POSITIONAL) for n in names])
    observe.__signature__ = signature  # type: ignore[attr-defined]
    return replace(step, observe=observe)


POSITIONAL = inspect.Parameter.POSITIONAL_OR_KEYWORD


@pytest.mark.parametrize("name", ELEMENTS)
def test_the_step_of_an_element_is_its_free_run(name):
    model = ELEMENTS[name]()
    agrees(model, imposed())
    step = step_of(model)
    assert step.outputs == [("r", ["r1"], "N")]
    once, twice = run(step, imposed(60)), run(once_more(step), imposed(60))
    np.testing.assert_array_equal(once["r"], twice["r"])


def test_what_has_no_step_says_so_in_one_line():
    class Own(EquivalentLinear):
        """Not of this zoo: its free run may be another."""

    for model in (LastValue(2, 2, DT), Own(2, 2, DT)):
        with pytest.raises(ValueError, match=rf"^{type(model).__name__} has no step.*VWNN"):
            step_of(model)
    with pytest.raises(ValueError, match="not identified yet"):
        step_of(EquivalentLinear(2, 2, DT))


@pytest.mark.parametrize("dofs", [1, 4])
@pytest.mark.parametrize("name", MODELS)
def test_a_step_is_the_free_run_and_what_is_observed_again_is_made_good(name, dofs):
    model = MODELS[name](dofs)
    step = step_of(model)
    for hold in step.holds if dofs == 1 else ("linear", "zero_order"):
        agrees(model, drive(model.dofs, model.inputs, 200, hold))
    given = drive(model.dofs, model.inputs, 60)
    once, twice = run(step, given), run(once_more(step), given)
    for output in once:
        np.testing.assert_array_equal(once[output], twice[output])


@pytest.mark.parametrize("hold", ["linear", "zero_order"])
@pytest.mark.parametrize("kind", [networks.network, networks.latent])
def test_the_step_of_a_network_is_its_free_run(kind, hold):
    agrees(kind(2), drive(2, 2, 60, hold))


def test_a_run_that_left_its_bounds_is_lost_from_there():
    model = MODELS["modal_network"](1)
    given = drive(1, model.inputs, 60)
    given = replace(given, u=1e5 * given.u)
    given.u[:10] = 0.0
    lost = np.isnan(model.free_run(given).a.numpy())
    step = step_of(model)
    assert 0 < lost.sum() < len(lost)
    found = run(step, given)[step.outputs[0][0]]
    np.testing.assert_array_equal(np.isnan(found), lost)


# --- steps that take any time: several of a model's own in one, and a part of one

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
