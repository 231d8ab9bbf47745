"""Describe a run's model: its inputs, physical parameters, modes of small motions."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from data.arguments import count_of
from data.record import QUANTITIES
from data.sample import Sensors
from data.terminal import LISTED, ROWS, WIDTH, Terminal, terminal
from export.modes import Modes, modes_of
from models.estimator import Estimator, Parameter
from models.fit.metrics import FREE_RUNS
from models.physical.parameters import yield_point
from models.stored.run import read_run
from report.output import Section, printed, save_figure
from report.prediction.interface import Interface
from report.prediction.peaks import number
from report.style import DRAWN, ESTIMATED, MEASURED, one_legend, titled
from runner.folder.run import restore
from runner.folder.run_folder import results_folder


def describe(folder: Path) -> None:
    """Print what a run's model is; draw the shapes of its modes.

    Raises ValueError for a folder that holds no finished run.
    """
    run = read_run(folder)
    metrics, estimator = run.metrics, restore(run)
    parameters, modes = estimator.physical_parameters(), modes_of(estimator)
    console = terminal()
    _print_about(console, metrics, estimator, run.sensors)
    print_parameters(console, parameters, estimator, metrics)
    if modes is not None:
        print_modes(console, modes)
    if parameters:
        console.print(f"python -m export run=… to=json writes all {len(parameters)} parameters")
    if modes is not None and len(modes.frequencies):
        place = results_folder(folder) / "description"
        title = f"small motions of {metrics['model']} on {metrics['system']}"
        save_figure(draw_modes(modes, title), place, "modes")
        console.print(f"shapes: {place / 'modes'}.png", soft_wrap=True)


def text_of(model: Estimator) -> str:
    """A model in words: its size, and its parameters with units where it has any."""
    text = io.StringIO()
    console = Terminal(file=text, width=WIDTH)
    size = f"{count_of(model.dofs, 'DOF')}, {count_of(model.inputs, 'channel')} of excitation"
    console.print(f"{type(model).__name__}: {size}, a step of {model.dt:g} s")
    try:
        print_parameters(console, model.physical_parameters(), model, {})
    except ValueError as error:  # it is not identified
        console.print(str(error))
    return text.getvalue()


def _print_about(
    console: Console, metrics: Mapping[str, Any], estimator: Estimator, sensors: Sensors
) -> None:
    """The model, its error, its inputs and its outputs."""
    console.print(f"{metrics['model']} identified on {metrics['system']}, {metrics['scenario']}")
    verdict = metrics.get("verdict", {})
    if verdict.get("identified") is False:
        console.print(f"not identified: {verdict['reason']}")
    free = metrics.get(FREE_RUNS["test"], {})
    error = free.get("relative_rms_percent")
    if error is not None:
        console.print(f"free-run error of the test motion: {error:.3g} %")
    elif free:
        console.print(f"free run of the test motion: {free.get('no_free_run', 'diverges')}")
    symbol, unit = QUANTITIES[sensors.quantity]
    read = Interface.of(estimator, sensors).channels
    listed = ", ".join(read[:8]) + (f", … ({len(read)})" if len(read) > 8 else "")
    console.print(
        f"driven by {listed}; estimates the {sensors.quantity} {symbol} [{unit}] of "
        f"{sensors.dofs} {'DOF' if sensors.dofs == 1 else 'DOFs'} every {sensors.dt:g} s"
    )


def print_parameters(
    console: Console, parameters: list[Parameter], estimator: Estimator, metrics: Mapping[str, Any]
) -> None:
    """Print masses and elements in tables; of a black box what it reads."""
    if not parameters:
        signals = {"a": "measured accelerations", "f": "the excitation", "x": "displacements",
                   "v": "velocities"}  # fmt: skip
        read = ", ".join(signals.get(name, name) for name in estimator.reads)
        console.print(
            f"a black box of {estimator.identified_parameters} identified parameters: it reads "
            f"{read} and has no physical parameters"
        )
        return
    if estimator.scale_is_open:
        console.print(
            "no force and no mass was given in training: masses, stiffnesses and forces are known "
            "up to a common factor; model.masses sets it"
        )
    if estimator.laws_are_curves:
        console.print("laws are general curves; the values below are of a slow monotonic push")
    trained = metrics.get("trained_range", {})
    print_elements(console, parameters, trained, estimator.scale_is_open)
    print_rest(console, parameters, trained)


# A picture of the shapes of small motions, DOF over DOF, a mode each.


def draw_modes(modes: Modes, title: str) -> Figure:
    """Displacement of every DOF in each mode; faint: the part that is out of phase."""
    count, dofs = min(DRAWN, len(modes.frequencies)), len(modes.shapes)
    columns = min(6, count)
    rows = -(-count // columns)
    height = 1.2 + 0.22 * min(max(dofs, 4), 12)
    size = (max(4.0, 0.8 + 1.5 * columns), 0.7 + rows * height)  # of one mode, with its title
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    place = np.arange(dofs + 1)
    for i, ax in enumerate(axes[:count]):
        shape = np.concatenate([[0.0], modes.shapes[:, i]])
        ax.axvline(0.0, color="#bbbbbb", linewidth=0.8)
        if np.abs(shape.imag).max() > 0.02:
            ax.plot(shape.imag, place, ":", color=ESTIMATED, linewidth=1.0, label="out of phase")
        ax.plot(
            shape.real, place, ".-", color=MEASURED, linewidth=1.2, markersize=6, label="in phase"
        )
        hertz, share = modes.frequencies[i], 100.0 * modes.damping[i]
        ax.set_title(f"{hertz:.3g} Hz, {share:.2g} %", fontsize=8)
        ax.set_xlim(-1.15, 1.15)
        ax.tick_params(labelsize=7)
        step = -(-dofs // 12)
        ax.set_yticks(place[::step], ["ground", *(f"x{j}" for j in place[1:])][::step])
    for ax in axes[count:]:
        ax.set_visible(False)
    if count < len(modes.frequencies):
        title += f", the slowest {count} of {len(modes.frequencies)}"
    titled(figure, title)
    for ax in axes[max(0, count - columns) : count]:
        ax.set_xlabel("shape [–]", fontsize=8)
        ax.tick_params(labelbottom=True)
    one_legend(figure, axes[:count], loc="outside lower center", ncols=2, fontsize=8)
    return figure


# Tables of a model's parameters and modes within 80 columns.

SHAPES = 5  # DOFs whose shapes are in the table
HEADS = {  # quantity → heading of the elements' table
    "stiffness": "stiffness\n[N/m]",
    "damping": "damping\n[N s/m]",
    "yield_displacement": "yields at\n[m]",
    "activation_displacement": "opens at\n[m]",
    "yield_force": "force\n[N]",
    "activation_force": "force\n[N]",
    "post_yield_ratio": "post-\nyield",
    "hardening_ratio": "post-\nyield",
    "gap": "gap\n[m]",
}
MATTERS = 0.01  # of an element's stiffness: terms that are printed
NO_WORDS = ("post_yield_stiffness",)  # which the ratio says


def print_elements(
    console: Console,
    parameters: Sequence[Parameter],
    trained: Mapping[str, Any],
    scale_is_open: bool = False,
) -> None:
    """Masses, and a line for each element: what every law has, as far as training went.

    scale_is_open: masses are known over that of the first alone.
    """
    masses = [p for p in parameters if p.name.endswith(".mass")]
    if masses:
        unit = masses[0].value if scale_is_open else 1.0
        what = f"masses over that of {masses[0].name.partition('.')[0]}"
        listed = ", ".join(
            f"{p.name.partition('.')[0]} {number(p.value / unit)}" for p in masses[:ROWS]
        )
        more = ", …" if len(masses) > ROWS else ""
        console.print(f"{what if scale_is_open else 'masses [kg]'}: {listed}{more}")
    elements = _elements(parameters)
    if not elements:
        return
    table = Table()
    table.add_column("element", no_wrap=True)
    heads = list(dict.fromkeys(HEADS[q] for q in HEADS if any(q in e for e in elements.values())))
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for name, own in list(elements.items())[:ROWS]:
        about = next(iter(own.values())).about.partition(",")[0]
        pair = f" {about}" if "–" in about else ""
        if not set(own) & set(HEADS):
            continue
        untold = _beyond(own, _reached(name, trained))
        seen = {q: p for q, p in own.items() if q in HEADS and q not in untold}
        cells = {HEADS[q]: _cell(q, p.value) for q, p in seen.items()}
        table.add_row(f"{name}{pair}", *(cells.get(head, "–") for head in heads))
    table.caption_justify = "left"
    if any("post_yield_stiffness" in own for own in elements.values()):
        table.caption = "post-yield: stiffness after an element has yielded, over the initial one"
    if len(elements) > ROWS:
        table.caption = f"{ROWS} of {len(elements)} elements"
    console.print(table)


def _reached(name: str, trained: Mapping[str, Any]) -> float | None:
    """The largest deformation [m] of an element in training, where it is known."""
    sizes = trained.get("deformation", {}).get("largest", [])
    number_of = int(name.partition(" ")[0][1:]) - 1
    return sizes[number_of] if number_of < len(sizes) else None


def _beyond(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Quantities of an element that its training never reached: they are not printed."""
    if largest is None:
        return []
    found = ["gap"] if "gap" in own and own["gap"].value > largest else []
    if "yield_displacement" in own and own["yield_displacement"].value > largest:
        found += ["yield_displacement", "yield_force"]
    return found


def _cell(quantity: str, value: float) -> str:
    """Of seven characters, or eight below zero, so that six columns fit: 2.71e-5."""
    if quantity.endswith("_ratio") and abs(value) < 1000.0:
        return f"{value:z.3f}"
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        return number(value, 4 if abs(value) >= 0.01 else 3)
    return f"{value:.2e}".replace("e-0", "e-").replace("e+0", "e")


def _elements(parameters: Sequence[Parameter]) -> dict[str, dict[str, Parameter]]:
    """{"r1": {"stiffness": …}}: parameters of the elements, by what they are."""
    found: dict[str, dict[str, Parameter]] = {}
    for p in parameters:
        part, _, quantity = p.name.partition(".")
        if part[0] == "r" and part[1:].isdigit():
            law, _, rest = quantity.partition(".")
            if law.startswith("law_"):
                part, quantity = f"{part} {law.replace('_', ' ')}", rest
            found.setdefault(part, {})[quantity] = p
    return found


def print_rest(
    console: Console, parameters: Sequence[Parameter], trained: Mapping[str, Any]
) -> None:
    """Print further parameters: repeated terms, and those of named laws."""
    for name, own in list(_elements(parameters).items())[:ROWS]:
        largest = _reached(name, trained)
        words = [*_terms(own, largest), *_others(own, largest)]
        about = next(iter(own.values())).about.partition(", ")[2]
        if words or about:
            called = f"{name} {about}" if about else name
            console.print(f"{called}: {', '.join(words) or 'no more terms'}")
    others = [p for p in parameters if p.name[0] != "r" and not p.name.endswith(".mass")]
    if others and len(others) <= LISTED:
        words = [
            f"{p.name.replace('_', ' ').replace('.', ' ')} {number(p.value)} {p.unit}".strip()
            for p in others
        ]
        console.print("; ".join(words))
        return
    if others:
        table = Table()
        for head in ("parameter", "value", "unit"):
            table.add_column(head, justify="right" if head == "value" else "left")
        for p in others[:ROWS]:
            table.add_row(p.name, number(p.value), p.unit)
        table.caption = others[0].about or None
        if len(others) > ROWS:
            table.caption = f"{ROWS} of {len(others)}; {others[0].about}".rstrip("; ")
        console.print(table)


def _terms(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Hinges and units that are a notable part of an element."""
    k = abs(own["stiffness"].value) if "stiffness" in own else 0.0
    groups = dict.fromkeys(q.partition(".")[0] for q in own if "." in q)
    terms = []
    for group in groups:
        at = {q.partition(".")[2]: p.value for q, p in own.items() if q.startswith(f"{group}.")}
        size = at.get("stiffness")
        if size is not None and abs(size) < MATTERS * k:
            continue
        place = at.get("yield_displacement", at.get("gap", at.get("place", at.get("half_width"))))
        if group.startswith("unit") and place is not None:
            place = yield_point(place, at.get("rising", 0.0))
        word = {"hinge": "beyond", "unit": "yields at", "slider": "slips at"}.get(
            group.partition("_")[0], "about"
        )
        beyond = largest is not None and place is not None and place > largest
        never = ", not reached in training" if beyond else ""
        stiff = f" of {number(size)} N/m" if size is not None else ""
        if place is not None:
            terms.append(f"{group.partition('_')[0]}{stiff} {word} {number(place)} m{never}")
        elif at.get("force"):
            saturates = number(at.get("saturates_at"))
            terms.append(f"{number(at['force'])} N that saturate at {saturates} m/s")
    return terms


def _others(own: Mapping[str, Parameter], largest: float | None) -> list[str]:
    """Parameters of an element without a column or a term, that have an effect."""
    k = own["stiffness"].value if "stiffness" in own else 0.0
    others = []
    for q, p in own.items():
        faint = q == "cubic_stiffness" and largest and abs(p.value) * largest**2 < MATTERS * k
        if q not in HEADS and "." not in q and q not in NO_WORDS and p.value != 0.0 and not faint:
            others.append(f"{q.replace('_', ' ')} {number(p.value)} {p.unit}".strip())
    return others


def print_modes(console: Console, modes: Modes) -> None:
    """Frequency, damping ratio and shape of small motions."""
    dofs = len(modes.shapes)
    shown = range(min(dofs, SHAPES)) if dofs > 1 else ()
    head = ("mode", "frequency\n[Hz]", "damping\nratio [%]", *(f"x{i + 1}" for i in shown))
    rows = zip(modes.frequencies, modes.damping, modes.shapes.T, strict=True)
    lines = [
        [str(i), number(frequency), number(100.0 * damping, 3)]
        + [f"{shape[j].real:.3f}" for j in shown]
        for i, (frequency, damping, shape) in enumerate(rows, start=1)
    ]
    if not lines:
        console.print("no modes: small motions do not oscillate")
        return
    console.print(printed(Section(head, lines[:ROWS], "modes of small motions"), left=()))
    if dofs > SHAPES:
        console.print(f"shapes of all {dofs} DOFs: in the picture")
    if modes.unstable.any():
        console.print("modes of negative damping grow: the model is unstable about rest")
