"""Structures and short records that the tests share, named for their physics."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from runner.loading import loading

with loading():  # as programs do: PyTorch's compiler takes longer than all that is used
    from data import Bilinear, BoucWen, LimitedSlip, Polynomial
    from data.inspect import __main__ as inspect_command
    from data.parallel import take_threads
    from data.record import Record
    from data.simulation.excitation import BandLimitedGaussian, Excitation
    from data.simulation.laws.element import Element
    from data.simulation.records import Simulation
    from data.simulation.scenario import FullState
    from data.simulation.structure import Structure
    from tests.compiled_once import compile_in_turn
    from tests.experiments import said_by
    from tests.parsed_once import remember

remember()
compile_in_turn()
gc.disable()  # until all tests are collected
MASSES = [0.8, 2.0, 1.2]
K0, C0 = 4.0 * np.pi**2, np.pi / 4.0
ENDS = {
    "r1": ("s1", "x1"), "r2": ("x1", "x2"), "r3": ("x1", "x3"), "r4": ("x2", "x3"),
    "r5": ("x3", "s3"), "r6": ("s2", "x2"),
}  # fmt: skip
FORCES = {"bilinear": (1.7, 4.5), "polynomial": (12.0, 3.4), "bouc_wen": (1.2, 3.0)}
COMPILING = (  # in turns on two cores: integrator and branch law, then both called by others
    "test_motion.py", "test_branch_element.py", "test_every_named_law.py", "test_modal_network.py",
    "test_composition.py", "test_element_network_branch.py",
)  # fmt: skip
LONG = {  # files of ten seconds and more on one core; they start early: both end at about one time
    "test_c.py", "test_disk_full.py", "test_docs.py", "test_every_config.py",
    "test_every_estimator.py", "test_golden.py", "test_kills.py", "test_launchers.py",
    "test_live.py", "test_named_laws.py", "test_paper.py",
    "test_search.py", "test_side_by_side.py", "test_steps.py", "test_sweep.py", "test_train.py",
    "test_units.py", "test_zoo_names.py",
}  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """First what compiles, each core another part, which others read from the cache; then `data`,
    and long files.
    """

    def place(item: pytest.Item) -> tuple[int, bool, bool]:
        name = item.path.name
        first = COMPILING.index(name) if name in COMPILING else len(COMPILING)
        return first, item.path.parent.name != "data", name not in LONG

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """Loaded modules and tests stay to the end: they are never searched for garbage. What tests
    load later is searched seldom.
    """
    gc.freeze()
    gc.set_threshold(5000, 10, 50)
    gc.enable()


def _bilinear(between: tuple[str, str], outer: bool) -> Element:
    if outer:
        return Bilinear(
            between=between, yield_displacement=0.02, stiffness=K0, post_yield_stiffness=0.5 * K0,
            damping=0.01, post_yield_damping=0.01,
        )  # fmt: skip
    return LimitedSlip(
        between=between, yield_displacement=0.01, stiffness=K0, gap_stiffness=K0,
        damping=0.1 * C0, slip_damping=0.1 * C0, gap=0.03,
    )  # fmt: skip


def _polynomial(between: tuple[str, str], outer: bool) -> Element:
    cubic = 0.5 * K0 if outer else -0.5 * K0
    return Polynomial(between=between, stiffness=K0, damping=np.pi / 5.0, cubic_stiffness=cubic)


def _bouc_wen(between: tuple[str, str], outer: bool) -> Element:
    return BoucWen(
        between=between, stiffness=K0, beta=K0 / 4.0, gamma=K0 / 3.0 if outer else -K0 / 3.0
    )


LAWS = {"bilinear": _bilinear, "polynomial": _polynomial, "bouc_wen": _bouc_wen}


def _paper_structure(system: str) -> Structure:
    law = LAWS[system]
    return Structure(MASSES, {r: law(ends, r in ("r1", "r5", "r6")) for r, ends in ENDS.items()})


def _excitation(system: str) -> Excitation:
    std, highest = FORCES[system]
    return Excitation(force=BandLimitedGaussian(std, (0.0, highest)))


def _record(structure: Structure, excitation: Excitation, duration: float, seed: int = 0) -> Record:
    """One full-state record, dt = 0.01 s."""
    simulation = Simulation(structure, excitation, FullState(), 0.01, duration)
    return simulation.records("train", 1, seed)[0][0]


def _linear_chain(dofs: int) -> Structure:
    """x1 held by s1, then mass after mass; damped and slightly uneven."""
    nodes = ["s1", *(f"x{i + 1}" for i in range(dofs))]
    springs = {
        f"r{i + 1}": Polynomial(between=(nodes[i], nodes[i + 1]), stiffness=80.0 - i, damping=0.9)
        for i in range(dofs)
    }
    return Structure([1.0 + 0.1 * i for i in range(dofs)], springs)


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """Matrices are small here: a second thread only waits, for seconds where cores are shared."""
    take_threads(1)


@pytest.fixture(params=["bilinear", "polynomial", "bouc_wen"])
def system(request: pytest.FixtureRequest) -> str:
    """Each of the paper's three systems in turn."""
    return request.param


@pytest.fixture
def structure(system: str) -> Structure:
    """The paper's structure with the elements of `system`."""
    return _paper_structure(system)


@pytest.fixture
def excitation(system: str) -> Excitation:
    """Forces that bring out the nonlinearity of `system`."""
    return _excitation(system)


@pytest.fixture(scope="session")
def bilinear_structure() -> Structure:
    return _paper_structure("bilinear")


@pytest.fixture(scope="session")
def polynomial_structure() -> Structure:
    return _paper_structure("polynomial")


@pytest.fixture(scope="session")
def linear_structure() -> Structure:
    """The paper's structure with linear springs and dampers."""
    springs = {
        r: Polynomial(between=ends, stiffness=K0 * (1.0 + 0.1 * i), damping=0.5 + 0.1 * i)
        for i, (r, ends) in enumerate(ENDS.items())
    }
    return Structure(MASSES, springs)


@pytest.fixture(scope="session")
def linear_chain():
    """Linear chain of any number of masses."""
    return _linear_chain


@pytest.fixture(scope="session")
def record_of():
    """(structure, excitation, duration, seed) → one full-state record, dt = 0.01 s."""
    return _record


@pytest.fixture(scope="session")
def bilinear_records(bilinear_structure: Structure) -> list[Record]:
    """Three independent records of 10 s of the yielding structure."""
    return [_record(bilinear_structure, _excitation("bilinear"), 10.0, seed) for seed in range(3)]


@pytest.fixture(scope="session")
def bilinear_record(bilinear_records: list[Record]) -> Record:
    return bilinear_records[0]


@pytest.fixture(scope="session")
def linear_record(linear_structure: Structure) -> Record:
    """10 s of the linear structure."""
    return _record(linear_structure, _excitation("bilinear"), 10.0)


@pytest.fixture
def inspect_run(monkeypatch, tmp_path, capsys):
    """python -m data.inspect: (words) → (exit status, stdout, stderr), in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def of(*words: str) -> tuple[int, str, str]:
        return said_by(inspect_command.main, words, capsys)

    return of
