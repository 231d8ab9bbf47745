"""What would never end or would not fit, any argument of any class: refused in one line."""

from __future__ import annotations

import inspect
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import data
import models
from data import Excitation, FullState, Multisine, Polynomial, SimulatedData, Simulation, Structure
from data.simulation import motion
from data.simulation.damage import StiffnessLoss
from data.simulation.motion import simulate
from tests.data.named_laws import LAWS

# the integrator is called a part at a time


def test_a_record_in_parts_has_the_same_bits_as_in_one(bilinear_structure, monkeypatch):
    force = np.random.default_rng(0).standard_normal((200, 3))
    wear = StiffnessLoss("r1", 0.503, 0.3, 0.5).changes(bilinear_structure, 200, 0.01)
    whole = simulate(bilinear_structure, force, 0.01, changes=wear)
    monkeypatch.setattr(motion, "STEPS_OF_A_CALL", 1)  # each call takes a single step
    parts = simulate(bilinear_structure, force, 0.01, changes=wear)
    for name in ("x", "v", "a", "y", "r", "work"):
        assert getattr(whole, name).tobytes() == getattr(parts, name).tobytes()


def stiff(stiffness: float) -> Structure:
    return Structure([1.0], {"r1": Polynomial(between=("ground", "x1"), stiffness=stiffness)})


def test_a_motion_without_end_is_refused_before_and_within(monkeypatch):
    excitation = Excitation(Multisine(1.0))
    with pytest.raises(ValueError, match=r"x1 of 1 kg, held by 1e\+16 N/m .* steps .* lower its"):
        Simulation(stiff(1e16), excitation, FullState(), 0.01, 50.0)
    monkeypatch.setattr(motion, "LEAST_BUDGET", 1000)
    monkeypatch.setattr(motion, "STEPS_OF_A_SAMPLE", 1)
    with pytest.raises(ValueError, match=r"steps for the first \d+ of 100 samples.*x1 of 1 kg"):
        simulate(stiff(1e10), np.ones((100, 1)), 0.01)


ENDLESS = """
import signal
import numpy as np
from data.parallel import in_threads, take_threads
from data.simulation import motion
from data import Polynomial
from data.simulation.structure import Structure
signal.signal(signal.SIGINT, signal.default_int_handler)  # as in the foreground
motion.LEAST_BUDGET = 10**12
structure = Structure([1.0], {"r1": Polynomial(between=("ground", "x1"), stiffness=1e12)})
motion.simulate(structure, np.ones((3, 1)), 1e-6)
print("begun", flush=True)
try:
    motion.simulate(structure, np.ones((10**5, 1)), 0.01)
except KeyboardInterrupt:
    print("heard", flush=True)
take_threads(2)
in_threads(lambda force: motion.simulate(structure, force, 0.01), [np.ones((10**5, 1))] * 3)
"""


def test_ctrl_c_ends_simulations_and_their_process_within_seconds():
    """Minutes of integration, of one record and then of three on threads that go on behind."""
    process = subprocess.Popen(
        [sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    for stage in ("begun", "heard"):
        assert process.stdout.readline() == f"{stage}\n"
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
    began = time.monotonic()
    _, error = process.communicate(timeout=60)
    assert time.monotonic() - began < 10.0  # two, where nothing else runs
    assert process.returncode not in (0, -signal.SIGKILL)
    assert "KeyboardInterrupt" in error


# sizes, before anything is made


def simulated(**arguments) -> SimulatedData:
    spring = Polynomial(between=("s1", "x1"), stiffness=40.0, damping=0.5)
    structure = Structure([1.0], {"r1": spring})
    return SimulatedData(structure, Excitation(Multisine(1.0)), FullState(), 0, **arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"duration": 1e9}, r"data\.duration=1e\+09 s .* would take some .* are there; shorten"),
        ({"dt": 1e-12}, r"data\.dt=1e-12 s .* are there"),
        ({"duration": 1e300, "dt": 1e-300}, "of memory"),
        ({"train_records": 10**8}, "100000006 records would take"),
        ({"duration": float("nan")}, "duration=nan is not finite"),
        ({"train_records": 1.5}, "train_records=1.5 must be a whole number"),
        ({"window": 10**9}, r"data\.window=1000000000 samples must lie"),
        (
            {"window": 50_000, "stride": 1, "duration": 1000.0},
            r"50001 windows .* raise data\.stride",
        ),
        ({"validation": 1e-9}, "holds 0 of"),
    ],
)
def test_data_that_would_not_fit_are_refused_before_they_are_made(arguments, words):
    with pytest.raises(ValueError, match=words) as error:
        simulated(**arguments)
    assert "\n" not in str(error.value)


def test_a_support_of_a_number_that_no_structure_has_is_refused():
    for name in ("s999999", "s" + "9" * 40):
        spring = Polynomial(between=(name, "x1"), stiffness=40.0)
        with pytest.raises(ValueError, match=r"nodes are possible|unknown node"):
            Structure([1.0], {"r1": spring})
    with pytest.raises(ValueError, match="200000 masses"):
        Structure([1.0] * 200_000, {"r1": Polynomial(between=("ground", "x1"), stiffness=1.0)})


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("VWNN", {"stages": 10**6}),
        ("GlobalMLP", {"hidden": [10**9]}),
        ("Recurrent", {"hidden": 10**9}),
        ("NeuralStateSpace", {"memory": 10**9}),
        ("ModalPolynomial", {"order": 10**4}),
        ("ElementNetwork", {"units": 10**6}),
        ("LatentHysteresisNetwork", {"elements": 10**12}),
        ("EquivalentLinear", {"dofs": 10**9}),
    ],
)
def test_a_model_that_would_not_fit_is_refused_before_it_is_made(name, arguments):
    began = time.monotonic()
    with pytest.raises(ValueError, match=r"model\.|stages|dofs=|elements=") as error:
        getattr(models, name)(**{"dofs": 2, "inputs": 2, "dt": 0.01, **arguments})
    assert "\n" not in str(error.value)
    assert time.monotonic() - began < 2.0


# any argument of any class

VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5),
    st.lists(st.one_of(st.integers(-3, 3), st.floats(), st.text(max_size=3)), max_size=3),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2), st.binary(max_size=2),
)  # fmt: skip


SIZES = {"dofs": 1, "inputs": 1, "dt": 0.01}
MODELS = [
    *(models.EquivalentLinear, models.VWNN, models.GlobalMLP, models.ResidualMLP, models.Recurrent),
    *(models.NeuralStateSpace, models.ModalPolynomial, models.ElementNetwork, models.Online),
    *(models.LatentHysteresisNetwork, models.HystereticElement, models.PrandtlIshlinskii),
]
GOOD = [  # a class, arguments that it takes, and the names of all that it may take
    *((type(law), vars(law), sorted(vars(law))) for law in LAWS.values()),
    *((model, SIZES, sorted(inspect.signature(model).parameters)) for model in MODELS),
]


@settings(deadline=None, max_examples=120, derandomize=True)
@given(st.data())
def test_whatever_an_argument_is_it_is_taken_or_refused_in_a_line(source):
    make, arguments, names = source.draw(st.sampled_from(GOOD))
    name = source.draw(st.sampled_from(names))
    try:
        make(**{**arguments, name: source.draw(VALUES)})
    except ValueError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017


def test_whole_numbers_beyond_all_counting_and_lines_in_names_are_refused():
    """A ridge of 10³⁰ without its point, a history of 5·10¹², an element called "a\\nb"."""
    for make in (
        lambda: models.VWNN(1, 1, 0.01, ridge=10**30),
        lambda: models.LBFGS([torch.nn.Parameter(torch.zeros(1))], history=5 * 10**12),
        lambda: data.HystereticDegradation(element="a\nb", eta_rate=0.1, nu_rate=0.1),
    ):
        with pytest.raises(ValueError, match=r"^[^\n]+$"):
            make()
