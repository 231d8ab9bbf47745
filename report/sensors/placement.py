"""Which floors of a chain should have a sensor: a table, and a picture.   n storeys."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from data.parallel import in_threads
from data.simulation.laws.candidate import Candidate, Units
from data.simulation.laws.element import Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.motion import simulate
from data.simulation.structure import Structure
from data.terminal import terminal
from models.experiment import Experiment
from models.named_laws.fit import Fit, units_of
from models.named_laws.fit import Motion as ElementTest
from models.named_laws.free_run import FreeRuns, Laws
from models.named_laws.information import Expected, Plan, drifts
from models.named_laws.learned import LAWS
from models.stored.run import read_run
from report.output import Section, printed, save_figure
from report.prediction.peaks import MOST_ROWS, number
from report.run.rescore import require_record
from report.style import ESTIMATED, MEASURED, TRUE, titled
from runner.config.choices import plain
from runner.config.compose import composed
from runner.config.settings import check_settings
from runner.folder.run import restore
from runner.folder.run_folder import results_folder


@dataclass(frozen=True)
class Case:
    """A structure in its motions.

    noise: in words; present: numbers of the floors that have a sensor.
    """

    name: str
    plan: Plan
    noise: str
    present: tuple[int, ...]
    folder: Path


def of_run(folder: Path, share: float | None, count: int) -> Case:
    """A finished run. share: of noise; None: its residual; count: of floors that get a sensor.

    Raises ValueError where it has no chain of named laws of so many, or its records are gone.
    """
    run = read_run(folder)
    model = require_chain(restore(run), f"run={folder}", count)
    require_record(run.experiment, "sensors are placed by")
    data = run.experiment.set_up_data()
    if share is None and data.records["train"][0].quantity != "acceleration":
        raise ValueError("the run's sensors are no accelerometers: give their noise, noise=0.05")
    runs, laws = model.runs_beside(data.loader("train")), model.found_laws()
    left = float(np.sqrt(np.mean(np.square(runs.size * runs.residuals(laws)))))
    words = f"{left:.2g} m/s² (residual of the fit)" if share is None else _in_words(share)
    noise = lambda a: np.full(a.shape[1], left) if share is None else share * a.std(axis=0)
    plan, place = Plan(runs, laws, noise, _spread), results_folder(folder) / "sensors"
    return Case(run.metrics["system"], plan, words, tuple(model.sensors), place)


def of_system(name: str, words: Sequence[str], share: float, count: int) -> Case:
    """A structure of conf/system in the motions of training. words: for its config.

    Raises ValueError where it is no chain of storeys, or one of these is no law of a name.
    """
    chosen = ("model=element_network", "model.laws=named", "model.elements=chain")
    cfg = composed(f"system={name}", *chosen, "baselines=none", *words)
    check_settings(cfg)
    experiment = Experiment.of(plain(cfg))
    data = experiment.make_simulated_data()
    structure = data.simulation.structure
    estimator = experiment.model.with_values({"dofs": structure.dofs}).estimator(data)
    model = require_chain(estimator, f"system={name}", count)
    data.setup()
    runs = model.runs_beside(data.loader("train"))
    plan = Plan(runs, laws_of(structure, runs, model), lambda a: share * a.std(axis=0), _spread)
    present = tuple(model.sensors) if model.hidden else ()
    return Case(name, plan, _in_words(share), present, Path("runs") / "sensors" / name)


def _in_words(share: float) -> str:
    return f"{100.0 * share:.3g} % of each floor's"


def _spread(work: Callable[[int], np.ndarray], numbers: Iterable[int]) -> list[np.ndarray]:
    return in_threads(work, list(numbers))


def require_chain(model: Any, name: str, count: int) -> Any:
    """The model. Raises ValueError unless it is a chain of named laws with so many floors."""
    if not (hasattr(model, "found_laws") and model.is_chain):
        raise ValueError(
            f"{name}: sensors are placed on a chain of named laws (model=element_network "
            "model.laws=named model.elements=chain)"
        )
    if count > model.floors:
        raise ValueError(f"count={count}: {name} has {model.floors} floors; give a smaller number")
    return model


def place(case: Case, count: int, output: Path | None) -> None:
    """Print the best sets of so many floors, and draw them."""
    n = len(case.plan.information)
    found, whole = case.plan.sets(count)
    shown, every = found[:MOST_ROWS], tuple(range(1, n + 1))
    for floors in (case.present, every):
        if floors and floors not in [one.floors for one in shown]:
            shown.append(case.plan.expected(floors))
    lines = []
    for one in shown:
        marks = ["present"] * (one.floors == case.present) + ["all"] * (one.floors == every)
        numbers = _percent(one.size), _widest(one), f"{one.bits:.1f}"
        lines.append([_floors(one.floors), *numbers, ", ".join(marks)])
    head = ("floors", "peak drifts\n± 95 % [%]", "widest\n[%]", "parameters\n[bits]", "")
    console = terminal()
    console.print(
        f"{case.name}: sensors on the ground and {count} of {n} floors, noise {case.noise}"
    )
    console.print(printed(Section(head, lines)))
    kind = "all sets" if whole else "one floor added after the other"
    console.print(
        f"{kind}: {len(found)}. Half widths of 95 % intervals: root mean square over storeys and "
        "motions, and of the storey with the widest; bits: information on the parameters. Use this "
        "to compare sets only: the kind of law, the masses and the ground motion are taken as "
        "known, so the intervals of a fit are wider"
    )
    if case.present in (ranked := [one.floors for one in found]):
        console.print(f"the present sensors are number {ranked.index(case.present) + 1}")
    place = output or case.folder
    save_figure(draw(case, shown, f"sensors on {count} floors of {case.name}"), place, "sensors")
    console.print(f"picture: {place / 'sensors.png'}", soft_wrap=True)


def _floors(floors: Sequence[int]) -> str:
    whole = len(floors) > 2 and np.ptp(floors) == len(floors) - 1
    return f"{floors[0]}–{floors[-1]}" if whole else ", ".join(map(str, floors))


def _percent(share: float) -> str:
    return number(100.0 * share, 3)


def _widest(one: Expected) -> str:
    of_storeys = one.halves.max(axis=0)
    return f"{_percent(of_storeys.max())} (storey {of_storeys.argmax() + 1})"


def draw(case: Case, shown: Sequence[Expected], title: str) -> Figure:
    """The building with the best floors, how sure each storey's drift is, and all sets as bars."""
    n = len(case.plan.information)
    figure = Figure(figsize=(8.0, max(3.0, 1.2 + 0.3 * max(n, len(shown)))), layout="constrained")
    building, bars = figure.subplots(1, 2)
    best, levels = shown[0], np.arange(n + 1)
    present = [one for one in shown if one.floors == case.present and one is not best]
    for one, colour, marker, label in [
        *((one, MEASURED, "o", "present") for one in present),
        (best, ESTIMATED, "s", "best"),
    ]:
        widths = 100.0 * one.halves.max(axis=0)
        building.stairs(widths, levels, orientation="horizontal", color=colour, label=label)
        size = {"markersize": 7} if one is best else {"markersize": 11, "fillstyle": "none"}
        building.plot(
            [0.0] * len(one.floors), one.floors, marker, color=colour, clip_on=False, **size
        )
    building.set_yticks(levels, ["ground", *map(str, levels[1:])])
    building.grid(axis="y", alpha=0.5)
    building.set_xlim(left=0.0)
    building.set_ylim(0.0, n + 0.3)
    building.set_xlabel("peak drift of each storey, ± 95 % [%]; marks: sensors")
    building.set_ylabel("floor")
    building.legend(frameon=False)
    colours = [ESTIMATED if one is best else MEASURED if one in present else TRUE for one in shown]
    places = np.arange(len(shown))
    bars.barh(places, [100.0 * one.size for one in shown], color=colours)
    bars.set_yticks(places, [_floors(one.floors) for one in shown])
    bars.invert_yaxis()
    bars.set_xlabel("peak drifts ± 95 % [%]")
    bars.set_ylabel("floors with a sensor")
    return titled(figure, title)


# Laws of a name that the storeys of a known structure are.


def laws_of(structure: Structure, runs: FreeRuns, model: Any) -> Laws:
    """Raises ValueError for an element between other floors, and for one that is no such law."""
    pairs = [[_node(node) for node in pair] for pair in model.elements]
    storeys: list[list[int]] = [[] for _ in pairs]
    for i, (name, element) in enumerate(structure.elements.items()):
        pair = [_node(node) for node in element.between]
        if pair not in pairs:
            raise ValueError(
                f"element {name} joins {' and '.join(element.between)}: sensors are placed on a "
                "chain of storeys, each between neighbouring floors; choose another system"
            )
        storeys[pairs.index(pair)].append(i)
    one, fits, elements = runs.shakings[0], [], list(structure.elements.values())
    supports = (one.s, one.s_dot) if one.s.shape[1] else (None, None)
    motion = simulate(structure, one.driving(structure.masses), one.dt, *supports)
    for e, (own, y) in enumerate(
        zip(storeys, drifts(model.elements, motion, one).T, strict=True), start=1
    ):
        force, none = motion.r[:, own].sum(axis=1), np.zeros((len(y), 0))
        units = units_of([ElementTest(one.dt, y, np.gradient(y, one.dt), force, none)])
        fits.append(law_of([elements[i] for i in own], units, f"storey {e}"))
    alpha = float(np.finfo(float).tiny)
    return Laws(fits, structure.masses, model.elements, False, alpha, model.foot)


def _node(name: str) -> str:
    return "ground" if name.startswith("s") else name


def law_of(parts: Sequence[Element], units: Units, name: str) -> Fit:
    """The law of a name that elements in parallel are. Raises ValueError where there is none."""
    from scipy.optimize import least_squares  # slow to import

    kinds, numbers = _numbers(parts)
    for law in sorted(LAWS.values(), key=lambda law: len(law.parameters)):

        def of(q: np.ndarray, law: Candidate = law) -> tuple[list[str], np.ndarray]:
            return _numbers(law.elements(q, units))

        begin = law.at([0.5] * len(law.parameters))
        same, at_first = of(begin)
        if same != kinds:
            continue
        scale = np.abs(np.where(numbers == 0.0, at_first, numbers))
        scale[scale == 0.0] = 1.0
        found = least_squares(lambda q, scale=scale: (of(q)[1] - numbers) / scale, begin)
        if np.abs(found.fun).max() < 1e-3:  # of each parameter
            return Fit(law, units, found.x)
    raise ValueError(
        f"{name}, of {' and '.join(kinds)}, is not among the named laws; choose another system, or "
        "fit a run and give run=FOLDER"
    )


def _numbers(parts: Sequence[Element]) -> tuple[list[str], np.ndarray]:
    """Kinds of elements in parallel, and their parameters; of all dampers the sum."""
    kinds, numbers, damping = list[str](), list[float](), 0.0
    for one in sorted(parts, key=lambda one: type(one).__name__):
        damping += one.tangent()[1]
        own = {key: value for key, value in vars(one).items() if "damping" not in key}
        own.pop("between")
        if type(one) is not Polynomial or any(own.values()):
            kinds.append(type(one).__name__)
            numbers += own.values()
    return kinds, np.array([*numbers, damping])
